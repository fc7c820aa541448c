"""The observer of the carrier: exact prediction, exact geometry, convergence on a swing, and what it learns."""

from __future__ import annotations

from math import cos, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from spsp_ctrl.config.loader import apply_overrides, load_rig
from spsp_ctrl.control import base_observer, screw_map
from spsp_ctrl.control.base_observer import ahead, see
from spsp_ctrl.control.params import lag_step, law_params
from spsp_ctrl.mechanism.frames import (
    attitude,
    euler_from_rotation,
    euler_rates_to_body,
    imu_roll_from_roll,
    joint_angles,
    joint_rates_to_body,
    multiply,
    roll_from_imu,
)
from spsp_ctrl.mechanism.levelling import base_rate_on_platform, platform_tilt, tilt_joints

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml")
P = law_params(RIG.model)
ARCMIN = pi / 10800
tilts = st.floats(-0.3, 0.3)
azimuths = st.floats(-1.5, 1.5)
rates = st.floats(-1.0, 1.0)


@given(st.floats(-1, 1), rates, st.floats(-5, 5), st.floats(0, 60), st.floats(0, 0.3))
def test_prediction_is_the_matrix_exponential(angle: float, rate: float, accel: float, omega_sq: float, t: float) -> None:
    exact = expm(np.array([[0, 1, 0], [0, 0, 1], [0, -omega_sq, 0]]) * t) @ [angle, rate, accel]
    np.testing.assert_allclose(ahead(angle, rate, accel, omega_sq, t), exact, rtol=1e-9, atol=1e-9)


@given(tilts, tilts, azimuths, tilts, tilts, azimuths, rates, rates, rates, rates, rates, rates)
@settings(deadline=None)
def test_base_is_seen_as_it_is(
    base_pitch: float, base_roll: float, yaw: float, pitch: float, roll: float, azimuth: float,
    base_pitch_rate: float, base_roll_rate: float, yaw_rate: float, pitch_rate: float, roll_rate: float, azimuth_rate: float,
) -> None:  # fmt: skip
    """An ideal IMU on the platform, taken back through the joints, gives tilt and Euler rates of the base."""
    _, imu_pitch, imu_roll = euler_from_rotation(
        multiply(attitude(yaw, base_pitch, base_roll), attitude(azimuth, pitch, roll))
    )
    assume(abs(imu_pitch) < 1.2)
    on_platform = base_rate_on_platform(
        base_pitch, base_roll, base_pitch_rate, base_roll_rate, yaw_rate, azimuth, pitch, roll
    )
    joints = joint_rates_to_body(pitch, roll, pitch_rate, roll_rate, azimuth_rate)
    gyro = tuple(a + b for a, b in zip(on_platform, joints, strict=True))
    seen = see(imu_roll, imu_pitch, gyro, (pitch, roll, azimuth), joints)  # type: ignore[arg-type]
    np.testing.assert_allclose(seen, (base_pitch, base_roll, base_pitch_rate, base_roll_rate, yaw_rate), atol=1e-9)


@given(tilts, tilts, azimuths, st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
@settings(deadline=None)
def test_tilt_joints_put_the_platform_where_it_is_wanted(
    base_pitch: float, base_roll: float, azimuth: float, pitch_ref: float, roll_ref: float
) -> None:
    pitch, roll = tilt_joints(base_pitch, base_roll, azimuth, pitch_ref, roll_ref)
    _, got_pitch, imu_roll = euler_from_rotation(
        multiply(attitude(0.4, base_pitch, base_roll), attitude(azimuth, pitch, roll))
    )
    assert got_pitch == pytest.approx(pitch_ref, abs=1e-12)
    assert platform_tilt(base_pitch, base_roll, azimuth, pitch, roll) == pytest.approx((pitch_ref, roll_ref), abs=1e-12)
    assert roll_from_imu(imu_roll) == pytest.approx(roll_ref, abs=1e-12)


@given(tilts, tilts, azimuths)
def test_tilt_joints_agree_with_the_whole_chain(base_pitch: float, base_roll: float, heading: float) -> None:
    """At the azimuth that the chain itself asks for, the tilt joints are those of the chain."""
    azimuth, pitch, roll = joint_angles(attitude(0.0, base_pitch, base_roll), heading, 0.0, 0.0)
    assert tilt_joints(base_pitch, base_roll, azimuth, 0.0, 0.0) == pytest.approx((pitch, roll), abs=1e-12)


def test_rate_on_platform_is_that_of_the_chain() -> None:
    wx, wy, wz = euler_rates_to_body(imu_roll_from_roll(0.2), -0.1, imu_roll_from_roll(0.5), 0.3, 0.7)
    assert base_rate_on_platform(-0.1, 0.2, 0.3, 0.5, 0.7, 0.0, 0.0, 0.0) == pytest.approx((wx, wy, wz))
    assert base_rate_on_platform(-0.1, 0.2, 0.3, 0.5, 0.7, pi / 2, 0.0, 0.0) == pytest.approx((wy, -wx, wz))


@given(st.floats(1e-4, 0.05), st.floats(-3, 3), st.floats(-30, 30))
def test_lag_is_exact_for_a_ramp(tau: float, start: float, slope: float) -> None:
    """After the transient a ramp comes out late by the time constant, to the last digit and not by half a cycle more."""
    dt = 1e-3
    keep, old, new = lag_step(tau, dt)
    out, x = start - tau * slope, start
    for _ in range(50):
        after = x + slope * dt
        out = keep * out + old * x + new * after
        x = after
    assert out == pytest.approx(x - tau * slope, abs=1e-9)


def swing_error(period_s: float, *, adaptive: bool, silent_s: float = 0.0) -> float:
    """Largest error in arcmin of the prediction to now over 8 s of a 10 deg swing, IMU 5 ms late behind its lags, after 12 s."""
    sets = [f"control.base.adaptive.enabled={str(adaptive).lower()}"]
    g = law_params(apply_overrides(RIG, sets).model).base
    omega = 2 * pi / period_s
    amplitude = radians(10.0)

    def lagged(order: int, tau: float, t: float) -> float:
        # steady answer of a first-order lag to the sine or its derivative
        z = (1j * omega) ** order / (1 + 1j * omega * tau)
        return amplitude * (z.real * sin(omega * t) + z.imag * cos(omega * t))

    state = base_observer.START
    stamp, worst = 0.0, 0.0
    for k in range(4000):
        t = 0.005 * k
        silent = t > 12.0 and k % 400 * 0.005 >= 2.0 - silent_s
        if not silent:
            seen = base_observer.BaseSeen(
                0.0, lagged(0, P.attitude_lag_s, t), 0.0, lagged(1, P.gyro_lag_s, t), 0.0
            )
            state = base_observer.start(seen) if k == 0 else base_observer.update(state, g, seen, t - stamp)
            stamp = t
        omega_sq = base_observer.omega_squared(g, state.roll_rate_power, state.roll_accel_power)
        now = t + P.imu_delay_s
        predicted, _, _ = ahead(state.roll, state.roll_rate, state.roll_accel, omega_sq, now - stamp)
        if t > 12.0:
            worst = max(worst, abs(predicted - amplitude * sin(omega * now)))
    return worst / ARCMIN


@pytest.mark.parametrize("period_s", [8.0, 4.0, 2.0])
def test_a_swing_is_predicted_to_now_far_better_with_the_learnt_frequency(period_s: float) -> None:
    with_it, without = swing_error(period_s, adaptive=True), swing_error(period_s, adaptive=False)
    assert with_it < 0.3
    assert with_it < 0.3 * without, (with_it, without)


def test_a_silent_imu_is_bridged() -> None:
    assert swing_error(4.0, adaptive=True, silent_s=0.05) < 0.5
    assert swing_error(2.0, adaptive=True, silent_s=0.05) < 1.5


def test_standstill_teaches_nothing() -> None:
    g = P.base
    assert base_observer.omega_squared(g, 0.0, 0.0) == 0.0
    tiny = (0.05 * g.rate_floor_rad_s) ** 2
    assert base_observer.omega_squared(g, tiny, 100.0 * tiny) < 1.0
    strong = (100.0 * g.rate_floor_rad_s) ** 2
    assert base_observer.omega_squared(g, strong, 3.0 * strong) == pytest.approx(3.0, rel=1e-3)
    assert base_observer.omega_squared(g, strong, 1e6 * strong) == g.omega_max_rad_s**2


def test_screw_map_closed_through_the_rod_settles_on_the_truth() -> None:
    truth = (2.1e-6, -1.3e-6, 0.5e-6, 0.6e-6)
    rng = np.random.default_rng(3)
    state, low, share = screw_map.START, 0.0, 0.241
    for k in range(6000):
        angle = 0.16 * k
        error = sum(a * b for a, b in zip(truth, (sin(angle), cos(angle), sin(2 * angle), cos(2 * angle)), strict=True))
        error -= screw_map.error(state, angle)[0]
        innovation = error - low
        low += share * innovation
        state = screw_map.learn(state, angle, innovation + 2e-6 * rng.standard_normal(), 0.004, share, 20e-6)
    np.testing.assert_allclose(state[:4], truth, atol=0.4e-6)
    value, slope = screw_map.error(state, 0.3)
    step = 1e-6
    assert slope == pytest.approx((screw_map.error(state, 0.3 + step)[0] - value) / step, rel=1e-4)
