"""Frames: exact algebra against numpy matrices, derivative identities by finite differences."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import cos, inf, isnan, nan, nextafter, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from spsp_ctrl.mechanism import frames

Array = NDArray[np.float64]
EXACT = 1e-12

angle = st.floats(-pi, pi)
tilt = st.floats(radians(-40.0), radians(40.0))
"""Twice the travel of the platform."""
rate = st.floats(-5.0, 5.0)
many = settings(max_examples=200, deadline=None)


def rx(a: float) -> Array:
    return np.array([[1.0, 0.0, 0.0], [0.0, cos(a), -sin(a)], [0.0, sin(a), cos(a)]])


def ry(a: float) -> Array:
    return np.array([[cos(a), 0.0, sin(a)], [0.0, 1.0, 0.0], [-sin(a), 0.0, cos(a)]])


def rz(a: float) -> Array:
    return np.array([[cos(a), -sin(a), 0.0], [sin(a), cos(a), 0.0], [0.0, 0.0, 1.0]])


def square(m: frames.Matrix) -> Array:
    return np.array(m).reshape(3, 3)


def nine(m: Array) -> frames.Matrix:
    a, b, c, d, e, f, g, h, i = (float(x) for x in m.ravel())
    return a, b, c, d, e, f, g, h, i


def body_rate(rotation: Callable[[float], Array]) -> Array:
    """Angular velocity in body axes at t = 0 from ``R^T dR/dt``, by an eighth-order difference."""
    h = 2e-3
    weights = {1: 4.0 / 5.0, 2: -1.0 / 5.0, 3: 4.0 / 105.0, 4: -1.0 / 280.0}
    derivative = sum((w * (rotation(k * h) - rotation(-k * h)) / h for k, w in weights.items()), np.zeros((3, 3)))
    skew = rotation(0.0).T @ derivative
    np.testing.assert_allclose(skew, -skew.T, atol=1e-10)
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def difference(a: float, b: float) -> float:
    """Distance of two directions."""
    return abs(frames.wrap_angle(a - b))


# --- rotations ------------------------------------------------------------------------------------------------------


@many
@given(tilt, tilt)
def test_joint_rotation_is_ry_pitch_times_rx_minus_roll(pitch: float, roll: float) -> None:
    np.testing.assert_allclose(square(frames.joint_rotation(pitch, roll)), ry(pitch) @ rx(-roll), atol=EXACT)


@many
@given(angle, angle, angle)
def test_attitude_and_euler_are_the_same_rotation_but_for_the_sign_of_roll(h: float, p: float, r: float) -> None:
    expected = rz(h) @ ry(p) @ rx(-r)
    np.testing.assert_allclose(square(frames.attitude(h, p, r)), expected, atol=EXACT)
    euler = frames.rotation_from_euler(h, p, frames.imu_roll_from_roll(r))
    np.testing.assert_allclose(square(euler), expected, atol=EXACT)


@pytest.mark.parametrize(
    ("hinge", "pitch", "roll"),
    [((1.0, 0.0, 0.0), 0.1, 0.0), ((0.0, 1.0, 0.0), 0.0, 0.1)],
    ids=["pitch leg at +x", "roll leg at +y"],
)
def test_a_positive_angle_lowers_the_hinge_of_its_leg(
    hinge: tuple[float, float, float], pitch: float, roll: float
) -> None:
    assert frames.apply(frames.joint_rotation(pitch, roll), hinge)[2] == pytest.approx(-sin(0.1), abs=1e-15)


def printed_lengths(pitch: float, roll: float, height: float, radius: float) -> tuple[float, float]:
    """Eqs (9) and (10) of the paper."""
    common = 2.0 * radius**2 + height**2
    return (
        sqrt(common - 2.0 * radius * (radius * cos(pitch) + height * sin(pitch))),
        sqrt(common - 2.0 * radius * (radius * cos(roll) + height * sin(roll) * cos(pitch))),
    )


def leg_lengths(rotation: Array, height: float, radius: float) -> tuple[float, float]:
    """Distance of each moving hinge, on the joint centre, from the same point on the static platform below."""
    hinges = np.diag([radius, radius])
    legs = [np.linalg.norm(rotation[:, :2] @ hinge + (0.0, 0.0, height) - (*hinge, 0.0)) for hinge in hinges]
    return float(legs[0]), float(legs[1])


@many
@given(tilt, tilt, st.floats(0.2, 1.0), st.floats(0.05, 0.15))
def test_this_rotation_gives_equations_9_and_10(pitch: float, roll: float, height: float, radius: float) -> None:
    found = leg_lengths(square(frames.joint_rotation(pitch, roll)), height, radius)
    assert found == pytest.approx(printed_lengths(pitch, roll, height, radius), abs=1e-13)


@pytest.mark.parametrize("other", [ry(0.2) @ rx(0.1), rx(-0.1) @ ry(0.2)], ids=["other sign", "other order"])
def test_no_other_rotation_does(other: Array) -> None:
    found, expected = leg_lengths(other, 0.3, 0.1), printed_lengths(0.2, 0.1, 0.3, 0.1)
    assert max(abs(found[0] - expected[0]), abs(found[1] - expected[1])) > 1e-5


@many
@given(angle, st.floats(-1.57, 1.57), angle)
def test_euler_angles_go_there_and_back(yaw: float, pitch: float, imu_roll: float) -> None:
    found = frames.euler_from_rotation(frames.rotation_from_euler(yaw, pitch, imu_roll))
    # near the vertical yaw and roll become one angle: their split loses what cos(pitch) loses
    tolerance = EXACT / cos(pitch)
    assert difference(found[0], yaw) < tolerance
    assert abs(found[1] - pitch) < EXACT
    assert difference(found[2], imu_roll) < tolerance


@many
@given(angle, angle, st.sampled_from([pi / 2, -pi / 2]))
def test_euler_angles_on_the_vertical_still_give_the_rotation(yaw: float, roll: float, pitch: float) -> None:
    rotation = frames.rotation_from_euler(yaw, pitch, roll)
    found = frames.euler_from_rotation(rotation)
    assert found[2] == 0.0
    np.testing.assert_allclose(frames.rotation_from_euler(*found), rotation, atol=EXACT)


@many
@given(angle, angle, angle, angle, angle, angle)
def test_products(a: float, b: float, c: float, d: float, e: float, f: float) -> None:
    m, n = rz(a) @ ry(b) @ rx(c), rx(d) @ rz(e) @ ry(f)
    np.testing.assert_allclose(square(frames.multiply(nine(m), nine(n))), m @ n, atol=EXACT)
    np.testing.assert_array_equal(square(frames.transpose(nine(m))), m.T)
    np.testing.assert_allclose(frames.apply(nine(m), (a, b, c)), m @ [a, b, c], atol=EXACT)


def test_roll_changes_sign_between_imu_and_platform() -> None:
    assert frames.roll_from_imu(0.3) == -0.3
    assert frames.imu_roll_from_roll(0.3) == -0.3


# --- the chain ------------------------------------------------------------------------------------------------------


@many
@given(angle, tilt, tilt, angle, tilt, tilt)
def test_whole_chain(
    yaw: float, base_pitch: float, base_roll: float, azimuth: float, pitch: float, roll: float
) -> None:
    base = rz(yaw) @ rx(-base_roll) @ ry(base_pitch)
    mounting = rx(0.01) @ ry(-0.02) @ rz(0.5)
    expected = base @ rz(azimuth) @ ry(pitch) @ rx(-roll) @ mounting
    found = frames.imu_attitude(nine(base), azimuth, pitch, roll, nine(mounting))
    np.testing.assert_allclose(square(found), expected, atol=EXACT)
    on_platform = frames.imu_attitude(nine(base), azimuth, pitch, roll)
    np.testing.assert_allclose(square(on_platform) @ mounting, expected, atol=EXACT)


@many
@given(angle, tilt, tilt, angle, tilt, tilt)
def test_inverse_chain_reaches_the_demand(
    yaw: float, base_pitch: float, base_roll: float, heading: float, pitch: float, roll: float
) -> None:
    base = nine(rz(yaw) @ rx(-base_roll) @ ry(base_pitch))
    joints = frames.joint_angles(base, heading, pitch, roll)
    assert abs(joints[1]) <= pi / 2
    reached = frames.imu_attitude(base, *joints)
    np.testing.assert_allclose(reached, frames.attitude(heading, pitch, roll), atol=EXACT)


@many
@given(angle, tilt, tilt, angle, tilt, tilt)
def test_inverse_chain_finds_the_joints(
    yaw: float, base_pitch: float, base_roll: float, azimuth: float, pitch: float, roll: float
) -> None:
    base = nine(rz(yaw) @ rx(-base_roll) @ ry(base_pitch))
    heading, platform_pitch, imu_roll = frames.euler_from_rotation(frames.imu_attitude(base, azimuth, pitch, roll))
    if abs(platform_pitch) > 1.5:
        return
    found = frames.joint_angles(base, heading, platform_pitch, frames.roll_from_imu(imu_roll))
    assert difference(found[0], azimuth) < 1e-11
    assert abs(found[1] - pitch) < 1e-11
    assert abs(found[2] - roll) < 1e-11


def test_level_on_a_tilted_base_needs_azimuth() -> None:
    """Levelling 6 x 15 degrees turns the platform by up to 96 arcmin unless azimuth gives way (control-limits, 9.5)."""
    base = nine(ry(radians(6.0)) @ rx(-radians(15.0)))
    azimuth, _, _ = frames.joint_angles(base, 0.0, 0.0, 0.0)
    assert abs(azimuth) == pytest.approx(radians(96.0 / 60.0), rel=0.03)


# --- rates ----------------------------------------------------------------------------------------------------------


@many
@given(tilt, tilt)
def test_joint_axes_are_the_axes_of_the_rotations(pitch: float, roll: float) -> None:
    back = (ry(pitch) @ rx(-roll)).T
    azimuth_axis, pitch_axis, roll_axis = frames.joint_axes(pitch, roll)
    np.testing.assert_allclose(azimuth_axis, back @ [0.0, 0.0, 1.0], atol=EXACT)
    np.testing.assert_allclose(pitch_axis, rx(-roll).T @ [0.0, 1.0, 0.0], atol=EXACT)
    np.testing.assert_allclose(roll_axis, [-1.0, 0.0, 0.0], atol=EXACT)


@many
@given(angle, tilt, tilt, rate, rate, rate)
def test_joint_rates_to_body_is_the_derivative_of_the_rotation(
    azimuth: float, pitch: float, roll: float, d_pitch: float, d_roll: float, d_azimuth: float
) -> None:
    expected = body_rate(lambda t: rz(azimuth + t * d_azimuth) @ ry(pitch + t * d_pitch) @ rx(-(roll + t * d_roll)))
    found = frames.joint_rates_to_body(pitch, roll, d_pitch, d_roll, d_azimuth)
    np.testing.assert_allclose(found, expected, atol=1e-10)
    by_axes = np.array(frames.joint_axes(pitch, roll)).T @ [d_azimuth, d_pitch, d_roll]
    np.testing.assert_allclose(found, by_axes, atol=EXACT)


@many
@given(tilt, tilt, rate, rate, rate)
def test_body_rates_to_joint_rates_and_back(pitch: float, roll: float, wx: float, wy: float, wz: float) -> None:
    rates = frames.body_to_joint_rates(pitch, roll, wx, wy, wz)
    np.testing.assert_allclose(frames.joint_rates_to_body(pitch, roll, *rates), (wx, wy, wz), atol=EXACT)


@many
@given(tilt, tilt, rate, rate, rate)
def test_tilt_rates_give_the_wanted_body_rates_whatever_azimuth_does(
    pitch: float, roll: float, wx: float, wy: float, d_azimuth: float
) -> None:
    rates = frames.body_to_tilt_rates(pitch, roll, wx, wy, d_azimuth)
    reached = frames.joint_rates_to_body(pitch, roll, *rates, d_azimuth)
    np.testing.assert_allclose(reached[:2], (wx, wy), atol=EXACT)


@many
@given(angle, tilt, tilt, rate, rate, rate)
def test_euler_rates_to_body_is_the_derivative_of_the_rotation(
    yaw: float, pitch: float, imu_roll: float, d_yaw: float, d_pitch: float, d_roll: float
) -> None:
    expected = body_rate(
        lambda t: square(frames.rotation_from_euler(yaw + t * d_yaw, pitch + t * d_pitch, imu_roll + t * d_roll))
    )
    found = frames.euler_rates_to_body(imu_roll, pitch, d_roll, d_pitch, d_yaw)
    np.testing.assert_allclose(found, expected, atol=1e-10)


# --- wrap_angle -----------------------------------------------------------------------------------------------------


@many
@given(st.floats(-1e4, 1e4))
@example(nextafter(pi, inf))
@example(nextafter(-pi, -inf))
@example(-pi)
@example(-2.0 * pi - 1e-30)
@example(3.0 * pi)
def test_wrapped_angle_is_the_same_direction_in_the_half_open_circle(a: float) -> None:
    wrapped = frames.wrap_angle(a)
    assert -pi < wrapped <= pi
    assert cos(wrapped) == pytest.approx(cos(a), abs=1e-11)
    assert sin(wrapped) == pytest.approx(sin(a), abs=1e-11)


@many
@given(st.floats(nextafter(-pi, 0.0), pi))
def test_an_angle_in_range_is_untouched(a: float) -> None:
    assert frames.wrap_angle(a) == a


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_bad_angles_come_out_as_nan(bad: float) -> None:
    assert isnan(frames.wrap_angle(bad))


def test_wrapping_a_steady_turn_has_no_jump_but_the_full_circle() -> None:
    steps = [frames.wrap_angle(0.01 * i) for i in range(-2000, 2000)]
    assert all(min(abs(b - a - 0.01), abs(b - a - 0.01 + 2.0 * pi)) < EXACT for a, b in pairwise(steps))


# --- compiled -------------------------------------------------------------------------------------------------------

ROTATION = frames.attitude(0.4, -0.2, 0.3)
CALLS: list[tuple[Callable[..., Any], tuple[Any, ...]]] = [
    (frames.roll_from_imu, (0.3,)),
    (frames.imu_roll_from_roll, (0.3,)),
    (frames.wrap_angle, (7.0,)),
    (frames.multiply, (ROTATION, ROTATION)),
    (frames.transpose, (ROTATION,)),
    (frames.apply, (ROTATION, (1.0, 2.0, 3.0))),
    (frames.rotation_from_euler, (0.4, -0.2, 0.3)),
    (frames.euler_from_rotation, (ROTATION,)),
    (frames.joint_rotation, (0.2, -0.1)),
    (frames.attitude, (0.4, -0.2, 0.3)),
    (frames.joint_angles, (ROTATION, 0.1, 0.02, -0.03)),
    (frames.joint_axes, (0.2, -0.1)),
    (frames.joint_rates_to_body, (0.2, -0.1, 1.0, 2.0, 3.0)),
    (frames.body_to_joint_rates, (0.2, -0.1, 1.0, 2.0, 3.0)),
    (frames.body_to_tilt_rates, (0.2, -0.1, 1.0, 2.0, 3.0)),
    (frames.euler_rates_to_body, (0.2, -0.1, 1.0, 2.0, 3.0)),
]


@pytest.mark.parametrize(("function", "arguments"), CALLS, ids=[f.__name__ for f, _ in CALLS])
def test_compiles_as_it_stands_and_agrees(function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    numba = pytest.importorskip("numba")
    compiled = numba.njit(error_model="numpy")(function)
    np.testing.assert_allclose(np.ravel(compiled(*arguments)), np.ravel(function(*arguments)), rtol=0.0, atol=1e-15)
