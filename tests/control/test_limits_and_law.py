"""Limits hold for any demand; the law is pure, bounded, and quiet when it is told to be."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.config.loader import apply_overrides, load_rig
from spsp_ctrl.control import backlash, law
from spsp_ctrl.control.law import Gate
from spsp_ctrl.control.limits import limit_rate
from spsp_ctrl.control.params import LawParams, law_params
from spsp_ctrl.mechanism.frames import euler_from_rotation, joint_rotation, roll_from_imu, transpose
from spsp_ctrl.mechanism.kinematics import jacobian, rod_lengths
from spsp_ctrl.messages import Estimate, Limited, Reference

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml")
P = law_params(RIG.model)
CASCADE = law_params(apply_overrides(RIG, ["control.law=cascade"]).model)
DT = 1e-3
angles = st.floats(-0.3, 0.3)
rates = st.floats(-1.0, 1.0)


def estimate(p: LawParams, pitch: float = 0.0, roll: float = 0.0, **other: float) -> Estimate:
    l1, l2 = rod_lengths(pitch, roll, p.height_m, p.radius_m, p.static_radius_m)
    j = jacobian(pitch, roll, l1, l2, p.height_m, p.radius_m, p.static_radius_m)
    values: dict[str, float] = dict.fromkeys(Estimate._fields, 0.0)
    values |= {
        "joint_pitch_rad": pitch,
        "joint_roll_rad": roll,
        "rod_pitch_m": l1 - p.level_m,
        "rod_roll_m": l2 - p.level_m,
        "screw_pitch_m": l1 - p.level_m,
        "screw_roll_m": l2 - p.level_m,
        "lever_pitch_m_rad": j[0],
        "lever_cross_m_rad": j[1],
        "lever_roll_m_rad": j[2],
        "attitude_dt_s": p.imu_period_s,
    }
    return Estimate(**(values | other))  # type: ignore[arg-type]


LEVEL = Reference(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@given(
    demands=st.lists(st.floats(-1.0, 1.0), min_size=20, max_size=60),
    start=st.floats(-0.03, 0.03),
    hold=st.integers(1, 80),
)
@settings(max_examples=200, deadline=None)
def test_no_demand_drives_through_the_end_of_travel(demands: list[float], start: float, hold: int) -> None:
    """An axis that follows exactly stays inside, whatever is asked, and never exceeds the speed limit."""
    position, rate = start, 0.0
    for demand in demands:
        for _ in range(hold):
            rate, bits = limit_rate(demand, rate, position, -0.034, 0.034, 0.08, 0.4, DT)
            assert abs(rate) <= 0.08 + 1e-12
            position += rate * DT
            assert -0.034 - 1e-9 <= position <= 0.034 + 1e-9
            if rate != demand:
                assert bits != 0


@given(demand=st.floats(-10, 10), before=st.floats(-0.08, 0.08))
def test_speed_and_acceleration_limits_are_reported(demand: float, before: float) -> None:
    rate, bits = limit_rate(demand, before, 0.0, -1.0, 1.0, 0.08, 0.4, DT)
    assert abs(rate - before) <= 0.4 * DT + 1e-15
    assert (bits == 0) == (rate == demand)
    if abs(demand) > 0.08:
        assert bits & Limited.SPEED


@given(
    pitch=angles, roll=angles, wx=rates, wy=rates, wz=rates, motor=st.floats(-400, 400), tilt=angles, gate=st.integers(0, 3)
)
@settings(max_examples=300, deadline=None)
def test_output_is_finite_bounded_and_a_function_of_its_arguments(
    pitch: float, roll: float, wx: float, wy: float, wz: float, motor: float, tilt: float, gate: int
) -> None:
    e = estimate(
        P,
        pitch,
        roll,
        platform_pitch_rad=tilt,
        base_pitch_rad=tilt,
        base_pitch_rate_rad_s=wx,
        base_roll_rate_rad_s=wy,
        base_yaw_rate_rad_s=wz,
        motor_pitch_rate_rad_s=motor,
    )
    state = law.START
    for _ in range(5):
        out, after = law.step(state, P, e, LEVEL, DT, gate)
        again, after_again = law.step(state, P, e, LEVEL, DT, gate)
        assert (out, after) == (again, after_again)
        state = after
    for axis in (out.pitch, out.roll):
        assert all(map(isfinite, axis))
        assert abs(axis.u_a) <= P.current_a
        assert abs(axis.rod_speed_ref_m_s) <= P.rod_speed_m_s + 1e-12
        if axis.u_a != axis.u_unlimited_a:
            assert axis.limited & Limited.CURRENT
    assert abs(out.azimuth.rate_rad_s) <= P.azimuth_rate_rad_s + 1e-12
    if gate == Gate.OFF:
        assert out.pitch.u_a == out.roll.u_a == out.azimuth.rate_rad_s == 0.0


def test_arming_does_not_jump() -> None:
    """Whatever happened while disarmed, the first currents after arming come from the present error only."""
    e = estimate(P, 0.15, -0.15, motor_pitch_rate_rad_s=80.0, base_pitch_rate_rad_s=0.3, heading_rad=0.5)
    state = law.START
    for _ in range(2000):
        _, state = law.step(state, P, e, LEVEL, DT, Gate.OFF)
    assert state.attitude_pitch == law.START.attitude_pitch
    assert state.axis_pitch == law.START.axis_pitch
    assert state.heading_integral == 0.0
    _, base_pitch, imu_roll = euler_from_rotation(transpose(joint_rotation(0.1, -0.1)))
    settled = estimate(P, 0.1, -0.1, base_pitch_rad=base_pitch, base_roll_rad=roll_from_imu(imu_roll))
    out, _ = law.step(state, P, settled, LEVEL, DT, Gate.ALIGN)
    assert abs(out.pitch.u_a) < 0.05
    assert abs(out.pitch.rod_speed_ref_m_s) < 1e-4


def test_stop_brakes_at_the_acceleration_limit_and_ends_at_zero() -> None:
    state = law.START._replace(axis_pitch=law.START.axis_pitch._replace(rod_speed=0.05))
    speeds = []
    for _ in range(200):
        out, state = law.step(state, P, estimate(P), LEVEL, DT, Gate.STOP)
        speeds.append(out.pitch.rod_speed_ref_m_s)
    steps = [a - b for a, b in zip([0.05, *speeds], speeds, strict=False)]
    assert max(steps) <= P.rod_accel_m_s2 * DT + 1e-12
    assert speeds[-1] == 0.0


def test_integrator_does_not_wind_up_in_a_limit() -> None:
    """Held off by a travel limit for a long time, the attitude integral stays where it was."""
    end = estimate(CASCADE, -0.349, 0.0, platform_pitch_rad=0.1)
    state = law.START
    for _ in range(3000):
        out, state = law.step(state, CASCADE, end, LEVEL._replace(pitch_rad=0.09), DT, Gate.ACTIVE)
    assert out.pitch.limited & Limited.TRAVEL
    assert abs(state.attitude_pitch.integral) < 0.05


@given(st.lists(st.floats(-0.05, 0.05), min_size=5, max_size=40), st.floats(-30, 30))
@settings(deadline=None)
def test_take_up_is_continuous_and_never_exceeds_gap_and_wind_up(speeds: list[float], gravity: float) -> None:
    assert P.gap is not None
    state = backlash.START
    most = P.gap.half_gap_m + (P.gap.friction_n + abs(gravity)) / P.gap.stiffness_n_m
    for speed in speeds:
        for _ in range(50):
            after = backlash.step(state, P.gap, speed, 1.0, gravity, DT)
            assert abs(after.offset_m) <= most * 1.001
            # what the rate says is what the offset does
            assert abs(after.offset_m - state.offset_m) <= most
            state = after


def test_take_up_settles_on_the_loaded_flank() -> None:
    assert P.gap is not None
    state = backlash.START
    for _ in range(2000):
        state = backlash.step(state, P.gap, 0.01, 1.0, 0.0, DT)
    expected = P.gap.half_gap_m + P.gap.friction_n / P.gap.stiffness_n_m
    assert abs(state.offset_m - expected) < 0.1e-6
    assert abs(state.rate_m_s) < 1e-9
