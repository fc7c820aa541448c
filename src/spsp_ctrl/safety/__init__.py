"""Faults as a table, judgement of signals, and the supervisor. Pure steps."""
