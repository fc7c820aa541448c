"""Homing of azimuth: the middle of the zero switch's vane, sought between the travel switches. A pure step.

Slowly towards one side until the vane or a travel switch; at a switch, turn and search the other way. Through the vane, the counts of its two
edges are noted, their middle is zero. Edges are taken halfway between two frames of the stepper, and
both are passed in the same direction, so that the play
of the gear lies on the same flank.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from spsp_ctrl.messages import AzimuthSample


class Phase(IntEnum):
    """Where the search is."""

    SEEK = 0
    """Towards the vane."""
    THROUGH = 1
    """In the vane, having come from outside."""
    LEAVE = 2
    """Started in the vane: out of it first, then back through the whole of it."""
    FOUND = 3
    FAILED = 4


class HomingState(NamedTuple):
    """Phase, direction (+1, -1), travel switches met, counts at the last frame and at the first edge, and what was found."""

    phase: int
    direction: int
    turned: int
    seq: int
    microsteps: int
    entered: float
    zero: int


START = HomingState(int(Phase.SEEK), 1, 0, -1, 0, 0.0, 0)
_SEEK, _THROUGH, _LEAVE, _FOUND, _FAILED = (int(phase) for phase in Phase)


def step(s: HomingState, a: AzimuthSample) -> HomingState:
    """One cycle; nothing happens between frames."""
    phase, direction, turned, seq, before, entered, zero = s
    if a.seq == seq or phase >= _FOUND:
        return s
    count = a.microsteps
    edge = 0.5 * (before + count) if seq >= 0 else float(count)
    if seq < 0:
        phase = _LEAVE if a.home_switch else _SEEK
    elif phase == _LEAVE and not a.home_switch:
        phase, direction = _SEEK, -direction
    elif phase == _SEEK and a.home_switch:
        phase, entered = _THROUGH, edge
    elif phase == _THROUGH and not a.home_switch:
        phase, zero = _FOUND, round(0.5 * (entered + edge))
    pressed = (a.left_switch and direction > 0) or (a.right_switch and direction < 0)
    if pressed and phase < _FOUND:
        turned += 1
        # a vane that ends beyond the switch is no vane
        phase, direction = (_FAILED if turned > 2 else _SEEK), -direction
    return HomingState(phase, direction, turned, a.seq, count, entered, zero)
