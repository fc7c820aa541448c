"""Watch over the law: chatter of the motor currents and divergence of the base observer. Either one asks for the next plainer law.

Chatter is judged from the current *demand* above a corner frequency: its mean square over a window. On the virtual rig the default gains stay
below 0.08 A, and a motor with 1.86 times the believed gain chatters at 0.4 A and more.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from spsp_ctrl.control.params import WatchParams

_new = tuple.__new__


class Reason(IntEnum):
    """Why a plainer law was asked for."""

    NONE = 0
    CHATTER = 1
    """Currents oscillate fast: the motor reacts more strongly than the gains assume (motor constant, inertia, a loose coupling)."""
    DIVERGENCE = 2
    """The IMU keeps contradicting what the base observer predicts (IMU delay or lag, zero offsets, a slipped coupling)."""


class WatchState(NamedTuple):
    """Low-passed currents in A, mean squares above the corner in A^2, mean square of the innovations in rad^2, age of the state in s."""

    low_pitch_a: float
    low_roll_a: float
    pitch_a2: float
    roll_a2: float
    innovation_rad2: float
    age_s: float


START = WatchState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def step(
    state: WatchState, p: WatchParams, pitch_a: float, roll_a: float, innovation_sq: float, fresh: bool, dt: float
) -> tuple[int, WatchState]:
    """One cycle. ``innovation_sq`` is the sum of both squared attitude innovations, ``fresh`` whether a frame came. Returns a ``Reason``."""
    low1, low2, power1, power2, innovation, age = state
    low1 += p.corner_share * (pitch_a - low1)
    low2 += p.corner_share * (roll_a - low2)
    fast1, fast2 = pitch_a - low1, roll_a - low2
    power1 += p.window_share * (fast1 * fast1 - power1)
    power2 += p.window_share * (fast2 * fast2 - power2)
    if fresh:
        innovation += p.frame_share * (innovation_sq - innovation)
    age += dt
    reason = 0
    if age > p.window_s:
        if power1 > p.chatter_a2 or power2 > p.chatter_a2:
            reason = 1
        elif innovation > p.divergence_rad2:
            reason = 2
    return reason, _new(WatchState, (low1, low2, power1, power2, innovation, age))
