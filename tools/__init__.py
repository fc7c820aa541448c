"""What a developer runs beside the program. Each is both ``python -m tools.NAME`` and ``python tools/NAME.py``."""
