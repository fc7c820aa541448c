"""Limits of motion: travel with braking distance, speed, acceleration. Scalar, each says whether it acted."""

from __future__ import annotations

from math import sqrt

from spsp_ctrl.messages import Limited

TRAVEL = int(Limited.TRAVEL)
SPEED = int(Limited.SPEED)
ACCELERATION = int(Limited.ACCELERATION)


def limit_rate(
    rate: float, before: float, position: float, low: float, high: float, top_rate: float, top_accel: float, dt: float
) -> tuple[float, int]:
    """Limit a rate demand so that the axis can still brake before ``low`` and ``high``.

    ``before`` is the demand of the previous cycle. The travel limit may brake harder than ``top_accel`` allows other demands to change, since
    running into a stop is worse. Returns the rate and the ``Limited`` bits.
    """
    bits = 0
    if rate > top_rate:
        rate, bits = top_rate, SPEED
    elif rate < -top_rate:
        rate, bits = -top_rate, SPEED
    step = top_accel * dt
    if rate > before + step:
        rate, bits = before + step, bits | ACCELERATION
    elif rate < before - step:
        rate, bits = before - step, bits | ACCELERATION
    if rate > 0.0:
        # until this demand acts the axis goes on with the one before
        room = high - position - (before * dt if before > 0.0 else 0.0)
        allowed = _braking_rate(room, top_accel, dt)
        if rate > allowed:
            rate, bits = allowed, bits | TRAVEL
    elif rate < 0.0:
        room = position - low + (before * dt if before < 0.0 else 0.0)
        allowed = _braking_rate(room, top_accel, dt)
        if -rate > allowed:
            rate, bits = -allowed, bits | TRAVEL
    return rate, bits


def _braking_rate(room: float, top_accel: float, dt: float) -> float:
    if room <= 0.0:
        return 0.0
    reaction = top_accel * dt
    return sqrt(reaction * reaction + 2.0 * top_accel * room) - reaction
