"""Fixed-gain observer of one motor: angle, speed and disturbance acceleration.

The steady-state Kalman filter of a double integrator driven by the measured current, with a random-walk disturbance (friction, load).
Gains are designed by ``tools/design_gains.py``; the equality with ``filterpy``'s filter is a test.
"""

from __future__ import annotations

from typing import NamedTuple


class MotorState(NamedTuple):
    """Angle in rad, speed in rad/s, disturbance in rad/s2, and the acceleration by current at the previous cycle."""

    angle: float
    speed: float
    disturbance: float
    drive: float


_new = tuple.__new__


def start(angle_rad: float) -> MotorState:
    """At rest at ``angle_rad``."""
    return MotorState(angle_rad, 0.0, 0.0, 0.0)


def step(
    state: MotorState, angle_rad: float, drive_rad_s2: float, dt: float, l_angle: float, l_speed: float, l_disturbance: float
) -> MotorState:
    """Predict with the mean acceleration by current over the cycle, then correct with the resolver angle."""
    angle, speed, disturbance, before = state
    accel = 0.5 * (before + drive_rad_s2) + disturbance
    predicted = angle + dt * (speed + 0.5 * dt * accel)
    innovation = angle_rad - predicted
    return _new(
        MotorState,
        (
            predicted + l_angle * innovation,
            speed + dt * accel + l_speed * innovation,
            disturbance + l_disturbance * innovation,
            drive_rad_s2,
        ),
    )
