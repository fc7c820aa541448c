"""The log: what is written, how it is written without disturbing the loop, and how it is read again."""
