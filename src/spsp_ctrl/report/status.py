"""What the loop tells the live screen, about five times a second, as one JSON object per line."""

from __future__ import annotations

from collections import deque
from typing import TypedDict

HISTORY = 240
"""Status lines kept for the sparklines: 48 s at 5 Hz."""


class Status(TypedDict, total=False):
    """One status line. Every key may be missing or None: it is then shown as a dash.

    The errors are the largest in magnitude since the previous status line, so that no spike falls between two lines.
    """

    rig: str
    scenario: str
    virtual: bool
    clock: str
    """``real-time`` or ``lock-step``."""
    mode: str
    """Name of :class:`spsp_ctrl.messages.Mode`."""
    fault: str
    """Text of the first fault, empty for none."""
    elapsed_s: float
    duration_s: float
    settle_s: float
    base_pitch_deg: float | None
    base_roll_deg: float | None
    platform_pitch_deg: float
    platform_roll_deg: float
    error_pitch_arcmin: float
    error_roll_arcmin: float
    error_pitch_max_arcmin: float | None
    """Running maximum after ``settle_s``; None before."""
    error_roll_max_arcmin: float | None
    rod_pitch_mm: float
    rod_roll_mm: float
    stroke_min_mm: float
    stroke_max_mm: float
    azimuth_deg: float
    azimuth_limit_deg: float
    heading_deg: float
    heading_target_deg: float
    rate_hz: float
    lateness_p50_us: float
    lateness_max_us: float
    compute_p50_us: float
    compute_max_us: float
    skipped: int
    degraded: str
    """What of the real-time settings was not granted, empty for nothing."""
    log_records: int | None
    log_lost: int | None
    event: str
    """The last event, in words."""
    event_t_s: float
    """When it happened, on the clock of ``elapsed_s``."""


class History:
    """Recent attitude errors in arcmin, oldest first."""

    def __init__(self, length: int = HISTORY) -> None:
        self.pitch: deque[float] = deque(maxlen=length)
        self.roll: deque[float] = deque(maxlen=length)

    def add(self, status: Status) -> None:
        """Take the errors of one status line; a missing one, or one while the loop does not hold yet, leaves a gap (NaN)."""
        holds = status.get("mode", "ACTIVE") == "ACTIVE"
        for axis, key in ((self.pitch, "error_pitch_arcmin"), (self.roll, "error_roll_arcmin")):
            value = status.get(key) if holds else None
            axis.append(abs(float(value)) if isinstance(value, int | float) else float("nan"))
