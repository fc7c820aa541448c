"""Numbers and signs as people read them. Imports nothing heavy: the live screen uses it, too."""

from __future__ import annotations

import math

MINUS = "\u2212"
DASH = "\u2013"
PRIME = "\u2032"
"""Minute of arc."""
THIN_SPACE = "\u202f"


def number(value: float, decimals: int | None = None) -> str:
    """A number with a real minus sign and no negative zero; a dash when not finite."""
    if not math.isfinite(value):
        return DASH
    text = f"{value:.{decimals}f}" if decimals is not None else f"{value:.6g}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def grouped(value: float) -> str:
    """A count with thin spaces between thousands; a dash when not finite."""
    return f"{value:,.0f}".replace(",", THIN_SPACE) if math.isfinite(value) else DASH
