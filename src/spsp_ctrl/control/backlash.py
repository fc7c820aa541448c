"""Backlash compensation: where the nut sits between the two flanks.

The flank follows the sign of the rod force. That force is estimated from what the controller knows: friction of hinges and guide, which turns round
over a short travel after a reversal (Dahl), and gravity of the tilted, off-centre load. Screw travel minus rod travel is then half the gap towards
the loaded flank plus the elastic wind-up; a critically damped second-order filter keeps its rate within what the speed loop can follow.
"""

from __future__ import annotations

from math import exp, tanh
from typing import NamedTuple

from spsp_ctrl.control.params import GapParams


class GapState(NamedTuple):
    """Friction direction (-1..1), screw minus rod travel in m, its rate in m/s, and the rod force behind it."""

    friction: float
    offset_m: float
    rate_m_s: float
    force_n: float
    gravity_n: float
    moving: float


START = GapState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_new = tuple.__new__
PULL = 0.05
"""Share per cycle by which the integrated offset is drawn to the one that the force asks for (gravity changes, rounding)."""


def step(state: GapState, gap: GapParams, rod_rate_m_s: float, moving: float, gravity_n: float, dt: float) -> GapState:
    """One cycle: ``rod_rate_m_s`` is the wanted rod speed, ``gravity_n`` the rod force that carries gravity.

    ``moving`` (0..1) is how far the axis is moved on purpose: at standstill the flank is left where it is, since reversals of a few um
    of noise would drive it to and fro (a limit cycle of 0.2 arcmin at 6 Hz).
    """
    friction, offset, rate, _, _, _ = state
    travel = moving * rod_rate_m_s * dt
    target = 1.0 if travel > 0.0 else -1.0
    friction = target + (friction - target) * exp(-abs(travel) / gap.presliding_m)
    force = gap.friction_n * friction + gravity_n
    asked = gap.half_gap_m * tanh(force / gap.width_n) + force / gap.stiffness_n_m
    wanted = offset + moving * (asked - offset)
    # critically damped, exact for a constant target over the cycle
    w = 1.0 / gap.time_constant_s
    decay = exp(-w * dt)
    error = offset - wanted
    slope = rate + w * error
    return _new(
        GapState, (friction, wanted + (error + slope * dt) * decay, (rate - w * slope * dt) * decay, force, gravity_n, moving)
    )


class Flank(NamedTuple):
    """Where the nut is believed to be: friction direction (-1..1), screw minus rod travel in m, rod per screw motion (0..1)."""

    friction: float
    offset_m: float
    share: float


def follow(state: Flank, gap: GapParams, screw_step_m: float, gravity_n: float, moving: float) -> Flank:
    """The nut after the screw has *really* moved by ``screw_step_m``: the same force model as the take-up, driven by the resolver.

    While the force is large the rod follows the screw; while it passes through zero the screw crosses the gap and the rod is left
    behind. ``share`` is how much of the step reached the rod.
    """
    friction, offset, _ = state
    target = 1.0 if screw_step_m > 0.0 else -1.0
    force = gap.friction_n * friction + gravity_n
    gate = tanh(force / gap.width_n)
    give = gap.half_gap_m / gap.width_n * (1.0 - gate * gate) + 1.0 / gap.stiffness_n_m
    slope = moving * give * gap.friction_n * (1.0 - target * friction) / gap.presliding_m
    share = 1.0 / (1.0 + slope)
    rod = share * screw_step_m
    friction = target + (friction - target) * exp(-moving * abs(rod) / gap.presliding_m)
    force = gap.friction_n * friction + gravity_n
    wanted = gap.half_gap_m * tanh(force / gap.width_n) + force / gap.stiffness_n_m
    offset += screw_step_m - rod
    return _new(Flank, (friction, offset + PULL * (wanted - offset), share))


def play(before: float, driving: float, half: float) -> float:
    """Where the driven side of a play of ``2 half`` stands that friction holds: it moves only while the driving side pushes it."""
    if driving - half > before:
        return driving - half
    return driving + half if driving + half < before else before


def gravity_forces(
    gap: GapParams, tilt_pitch_rad: float, tilt_roll_rad: float, j11: float, j21: float, j22: float
) -> tuple[float, float]:
    """Rod forces in N (positive pushes up) that hold the centre of gravity at a tilt in space; small-angle moments about the U joint."""
    # m c x f for a platform tilted by (pitch, roll): the moment that the rods must balance about the pitch and the roll axis
    about_y = gap.weight_nm * -tilt_pitch_rad - gap.offset_x_nm
    about_x = -gap.weight_nm * tilt_roll_rad - gap.offset_y_nm
    roll_n = about_x / j22
    return (about_y - roll_n * j21) / j11, roll_n
