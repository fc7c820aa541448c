"""What is computed together for the loop is, to the last bit, what its parts give apart."""

from __future__ import annotations

import struct
from math import cos, radians, sin

from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.control import base_observer
from spsp_ctrl.control.base_observer import START, BaseGains
from spsp_ctrl.mechanism.frames import body_to_tilt_motion, body_to_tilt_rates
from spsp_ctrl.mechanism.kinematics import jacobian, rod_lengths, rods_and_jacobian
from spsp_ctrl.mechanism.levelling import base_motion_on_platform, base_rate_on_platform

ANGLE = st.one_of(st.just(0.0), st.just(-0.0), st.floats(-radians(25.0), radians(25.0)))
RATE = st.one_of(st.just(0.0), st.just(-0.0), st.floats(-3.0, 3.0))
POWER = st.one_of(st.just(0.0), st.floats(0.0, 10.0))


def bits(values: tuple[float, ...]) -> bytes:
    """A zero has a sign."""
    return struct.pack(f"{len(values)}d", *values)


@given(ANGLE, ANGLE, st.floats(0.2, 0.4), st.floats(0.05, 0.15), st.floats(0.05, 0.15))
def test_rods_and_jacobian(pitch: float, roll: float, height: float, upper: float, lower: float) -> None:
    l1, l2 = rod_lengths(pitch, roll, height, upper, lower)
    apart = (l1, l2, *jacobian(pitch, roll, l1, l2, height, upper, lower))
    assert bits(rods_and_jacobian(pitch, roll, height, upper, lower)) == bits(apart)


@given(st.tuples(ANGLE, ANGLE), st.tuples(RATE, RATE, RATE, RATE, RATE), st.floats(-3.2, 3.2), st.tuples(ANGLE, ANGLE))
def test_base_motion(
    tilt: tuple[float, float], rates: tuple[float, float, float, float, float], azimuth: float, joints: tuple[float, float]
) -> None:
    pitch_rate, roll_rate, yaw_rate, pitch_accel, roll_accel = rates
    x, y, z = base_rate_on_platform(*tilt, pitch_rate, roll_rate, yaw_rate, azimuth, *joints)
    u, v, _ = base_rate_on_platform(*tilt, pitch_accel, roll_accel, 0.0, azimuth, *joints)
    assert bits(base_motion_on_platform(*tilt, *rates, azimuth, *joints)) == bits((x, y, z, u, v))


@given(ANGLE, ANGLE, st.tuples(RATE, RATE, RATE, RATE, RATE))
def test_tilt_motion(pitch: float, roll: float, rates: tuple[float, float, float, float, float]) -> None:
    wx, wy, azimuth_rate, ax, ay = rates
    apart = (*body_to_tilt_rates(pitch, roll, wx, wy, azimuth_rate), *body_to_tilt_rates(pitch, roll, ax, ay, 0.0), cos(pitch), cos(roll), sin(roll))
    assert bits(body_to_tilt_motion(pitch, roll, *rates)) == bits(apart)


@given(st.lists(RATE, min_size=8, max_size=8), st.lists(POWER, min_size=4, max_size=4), st.floats(0.0, 0.3), st.floats(0.0, 0.02), st.booleans())
def test_forecast(motion: list[float], powers: list[float], t: float, lead: float, adaptive: bool) -> None:
    g = BaseGains(*(0.1,) * 10, adaptive=adaptive, memory_s=2.0, rate_floor_rad_s=0.01, omega_max_rad_s=8.0)
    state = START._make([*motion, *powers, 0.0, 0.0])
    later = t + lead
    w1, w2 = base_observer.omega_squared(g, powers[0], powers[1]), base_observer.omega_squared(g, powers[2], powers[3])
    pitch, _, _ = base_observer.ahead(state.pitch, state.pitch_rate, state.pitch_accel, w1, t)
    roll, _, _ = base_observer.ahead(state.roll, state.roll_rate, state.roll_accel, w2, t)
    _, pitch_rate, pitch_accel = base_observer.ahead(0.0, state.pitch_rate, state.pitch_accel, w1, later)
    _, roll_rate, roll_accel = base_observer.ahead(0.0, state.roll_rate, state.roll_accel, w2, later)
    apart = (pitch, roll, pitch_rate, roll_rate, state.yaw_rate + later * state.yaw_accel, pitch_accel, roll_accel)
    assert bits(base_observer.forecast(state, g, t, later)) == bits(apart)
