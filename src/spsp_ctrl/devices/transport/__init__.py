"""Frames and bytes in and out: one small interface for buses inside this process, between processes and on wires."""
