"""Kinematics: inverse of forward, derivatives by complex step, the paper's numbers, the chain on a moving carrier."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.mechanism import chain, frames, kinematics, vectorised
from spsp_ctrl.mechanism.workspace import pitch_singularity, roll_singularity

PAPER = (0.2655, 0.1, 0.1)
many = settings(max_examples=300, deadline=None)
tilt = st.floats(radians(-20.0), radians(20.0))
rate = st.floats(-2.0, 2.0)
geometry = st.tuples(st.floats(0.15, 2.0), st.floats(0.2, 0.9), st.floats(0.2, 0.9)).map(lambda g: (g[0], g[0] * g[1], g[0] * g[2]))
"""Height, and radii of 0.2 to 0.9 of it: the nearest singularity is then beyond 43 degrees."""
EPS = 1e-30


def printed_lengths(pitch: float, roll: float, h: float, r: float) -> tuple[float, float]:
    """Eqs (9) and (10) as printed, term by term."""
    l1_sq = r**2 * (1 - cos(pitch)) ** 2 + (h - r * sin(pitch)) ** 2
    l2_sq = r**2 * (1 - cos(roll)) ** 2 + r**2 * sin(pitch) ** 2 * sin(roll) ** 2 + (h - r * sin(roll) * cos(pitch)) ** 2
    return l1_sq**0.5, l2_sq**0.5


@many
@given(tilt, tilt)
def test_lengths_are_equations_9_and_10(pitch: float, roll: float) -> None:
    h, r, _ = PAPER
    assert kinematics.rod_lengths(pitch, roll, *PAPER) == pytest.approx(printed_lengths(pitch, roll, h, r), abs=1e-15)


@many
@given(tilt, tilt, geometry)
def test_lengths_are_the_distances_of_the_hinges(pitch: float, roll: float, g: tuple[float, float, float]) -> None:
    h, upper, lower = g
    rotation = np.array(frames.joint_rotation(pitch, roll)).reshape(3, 3)
    for k, length in enumerate(kinematics.rod_lengths(pitch, roll, *g)):
        foot = np.array([0.0, 0.0, -h])
        foot[k] = lower
        assert length == pytest.approx(np.linalg.norm(upper * rotation[:, k] - foot), rel=1e-14)


@many
@given(tilt, tilt)
def test_inverse_of_forward_is_identity(pitch: float, roll: float) -> None:
    back = kinematics.attitude_from_rods(*kinematics.rod_lengths(pitch, roll, *PAPER), *PAPER)
    assert back == pytest.approx((pitch, roll), abs=1e-12)


@many
@given(tilt, tilt, geometry)
def test_inverse_of_forward_is_identity_for_any_geometry(pitch: float, roll: float, g: tuple[float, float, float]) -> None:
    back = kinematics.attitude_from_rods(*kinematics.rod_lengths(pitch, roll, *g), *g)
    assert back == pytest.approx((pitch, roll), abs=1e-12)


def test_inverse_of_forward_over_the_grid() -> None:
    axis = np.radians(np.linspace(-20.0, 20.0, 401))
    pitch, roll = np.meshgrid(axis, axis, indexing="ij")
    back = vectorised.attitude_from_rods(*vectorised.rod_lengths(pitch, roll, *PAPER), *PAPER)
    assert max(np.abs(back[0] - pitch).max(), np.abs(back[1] - roll).max()) < 1e-12


@many
@given(tilt, tilt, geometry)
def test_jacobian_by_complex_step(pitch: float, roll: float, g: tuple[float, float, float]) -> None:
    l1, l2 = kinematics.rod_lengths(pitch, roll, *g)
    j11, j21, j22 = kinematics.jacobian(pitch, roll, l1, l2, *g)
    by_pitch = [x.imag / EPS for x in vectorised.rod_lengths(pitch + EPS * 1j, roll, *g)]
    by_roll = [np.imag(x) / EPS for x in vectorised.rod_lengths(pitch, roll + EPS * 1j, *g)]
    assert (by_pitch[0], by_pitch[1], by_roll[1]) == pytest.approx((j11, j21, j22), abs=1e-10)
    assert by_roll[0] == 0.0
    # and the inverse function's derivative is the inverse matrix
    d1 = [x.imag / EPS for x in vectorised.attitude_from_rods(l1 + EPS * 1j, l2, *g)]
    d2 = [np.imag(x) / EPS for x in vectorised.attitude_from_rods(l1, l2 + EPS * 1j, *g)]
    identity = np.array([[j11, 0.0], [j21, j22]]) @ np.array([[d1[0], d2[0]], [d1[1], d2[1]]])
    np.testing.assert_allclose(identity, np.eye(2), atol=1e-10)


@many
@given(tilt, tilt, rate, rate, geometry)
def test_jacobian_rate_by_complex_step(pitch: float, roll: float, p: float, r: float, g: tuple[float, float, float]) -> None:
    at = (pitch + EPS * p * 1j, roll + EPS * r * 1j)
    moving = vectorised.jacobian(*at, *vectorised.rod_lengths(*at, *g), *g)
    lengths = kinematics.rod_lengths(pitch, roll, *g)
    found = kinematics.jacobian_rate(pitch, roll, p, r, *lengths, *g)
    assert found == pytest.approx([x.imag / EPS for x in moving], abs=1e-10)


@many
@given(tilt, tilt, rate, rate, rate, rate)
def test_rod_motion_by_complex_step(pitch: float, roll: float, p: float, r: float, pp: float, rr: float) -> None:
    """Speed is the derivative of length, acceleration that of speed, along ``q + q' t + q'' t^2 / 2`` at t = 0."""
    l1, l2, v1, v2, a1, a2 = kinematics.rod_motion(pitch, roll, p, r, pp, rr, *PAPER)
    assert (l1, l2) == kinematics.rod_lengths(pitch, roll, *PAPER)
    t = EPS * 1j
    moved = vectorised.rod_motion(pitch + p * t, roll + r * t, p + pp * t, r + rr * t, pp, rr, *PAPER)
    assert (v1, v2) == pytest.approx([x.imag / EPS for x in moved[:2]], abs=1e-12)
    assert (a1, a2) == pytest.approx([x.imag / EPS for x in moved[2:4]], abs=1e-12)


@many
@given(tilt, tilt)
def test_gains_are_the_singular_values(pitch: float, roll: float) -> None:
    j11, j21, j22 = kinematics.jacobian(pitch, roll, *kinematics.rod_lengths(pitch, roll, *PAPER), *PAPER)
    expected = np.linalg.svd(np.array([[j11, 0.0], [j21, j22]]), compute_uv=False)
    assert kinematics.jacobian_gains(j11, j21, j22) == pytest.approx(expected, rel=1e-13)


def test_stroke_of_table_1() -> None:
    """+-20 degrees move a rod by -34.123 and +34.263 mm: Table 1's 34.26 is the extension alone."""
    h = PAPER[0]
    for k in (0, 1):
        pose = [0.0, 0.0]
        travel = []
        for degrees in (20.0, -20.0):
            pose[k] = radians(degrees)
            travel.append(1e3 * (kinematics.rod_lengths(*pose, *PAPER)[k] - h))
        assert travel == pytest.approx([-34.123, 34.263], abs=5e-4)
        assert travel[1] - travel[0] == pytest.approx(68.386, abs=5e-4)


def test_combined_tilt_needs_no_more_travel_than_one_axis() -> None:
    axis = np.radians(np.linspace(-20.0, 20.0, 201))
    travel = np.array([x - PAPER[0] for x in np.broadcast_arrays(*vectorised.rod_lengths(axis[:, None], axis[None, :], *PAPER))])
    np.testing.assert_allclose([1e3 * travel.min(), 1e3 * travel.max()], [-34.123, 34.263], atol=5e-4)


@many
@given(geometry, tilt)
def test_singularities(g: tuple[float, float, float], pitch: float) -> None:
    """At the singular angle the rod's derivative vanishes: tan pitch = h / r, tan roll = (h / r) cos pitch."""
    h, _, lower = g
    p = pitch_singularity(h, lower)
    assert tan(p) == pytest.approx(h / lower)
    l1, l2 = kinematics.rod_lengths(p, 0.0, *g)
    assert kinematics.jacobian(p, 0.0, l1, l2, *g)[0] == pytest.approx(0.0, abs=1e-12)
    r = roll_singularity(pitch, h, lower)
    assert tan(r) == pytest.approx(h / lower * cos(pitch))
    l1, l2 = kinematics.rod_lengths(pitch, r, *g)
    assert kinematics.jacobian(pitch, r, l1, l2, *g)[2] == pytest.approx(0.0, abs=1e-12)


def test_singular_pitch_of_the_paper() -> None:
    assert np.degrees(pitch_singularity(PAPER[0], PAPER[2])) == pytest.approx(69.36, abs=5e-3)


# --- the chain on a moving carrier -----------------------------------------------------------------------------------

angle = st.floats(-3.0, 3.0)
coefficient = st.floats(-0.3, 0.3)
path = st.tuples(coefficient, rate, rate)
"""Value, rate and acceleration at t = 0."""
triple = st.tuples(path, path, path)


def along(motion: tuple[tuple[float, float, float], ...], t: complex) -> list[complex]:
    return [q + v * t + 0.5 * a * t * t for q, v, a in motion]


def base_rates(motion: tuple[tuple[float, float, float], ...], t: complex) -> tuple[complex, ...]:
    _, pitch, roll = along(motion, t)
    yaw_rate, pitch_rate, roll_rate = (v + a * t for _, v, a in motion)
    return vectorised.euler_rates_to_body(roll, pitch, roll_rate, pitch_rate, yaw_rate)


@many
@given(triple, triple)
def test_chain_rates_and_accelerations_are_derivatives_of_its_angles(carrier: tuple, demand: tuple) -> None:  # type: ignore[type-arg]
    t = EPS * 1j
    wanted = along(demand, 0.0), [v for _, v, _ in demand], [a for _, _, a in demand]
    base = frames.rotation_from_euler(*(x.real for x in along(carrier, 0.0 + 0.0j)))
    rate_now = tuple(np.real(x) for x in base_rates(carrier, 0.0))
    accel_now = tuple(np.imag(x) / EPS for x in base_rates(carrier, t))
    found = chain.joint_motion(base, rate_now, accel_now, *wanted[0], *wanted[1], *wanted[2])  # type: ignore[arg-type]

    moved_base = vectorised.rotation_from_euler(*along(carrier, t))
    moved = vectorised.joint_references(
        moved_base, base_rates(carrier, t), *along(demand, t), *(v + a * t for _, v, a in demand)
    )
    assert found[3:6] == pytest.approx([np.imag(x) / EPS for x in moved[:3]], abs=1e-11)
    assert found[6:9] == pytest.approx([np.imag(x) / EPS for x in moved[3:6]], abs=1e-10)
    assert found[:6] == tuple(chain.joint_references(base, rate_now, *wanted[0], *wanted[1]))  # type: ignore[arg-type]


@many
@given(triple, angle)
def test_chain_holds_the_platform_where_demanded(carrier: tuple, heading: float) -> None:  # type: ignore[type-arg]
    """Carrier times joints is level on the heading; and the rates leave the platform without any motion in space."""
    base = frames.rotation_from_euler(*(q for q, _, _ in carrier))
    base_rate = tuple(float(x) for x in base_rates(carrier, 0.0))
    ref = chain.joint_references(base, base_rate, heading, 0.0, 0.0, 0.0, 0.0, 0.0)  # type: ignore[arg-type]
    tilt_now = frames.attitude(ref.azimuth_rad, ref.pitch_rad, ref.roll_rad)
    np.testing.assert_allclose(frames.multiply(base, tilt_now), frames.rotation_from_euler(heading, 0.0, 0.0), atol=1e-14)
    relative = frames.joint_rates_to_body(ref.pitch_rad, ref.roll_rad, ref.pitch_rad_s, ref.roll_rad_s, ref.azimuth_rad_s)
    carried = frames.apply(frames.transpose(tilt_now), base_rate)  # type: ignore[arg-type]
    np.testing.assert_allclose(np.add(relative, carried), 0.0, atol=1e-13)


@many
@given(triple, path)
def test_level_with_free_heading(carrier: tuple, azimuth: tuple[float, float, float]) -> None:  # type: ignore[type-arg]
    t = EPS * 1j
    base = frames.rotation_from_euler(*(q for q, _, _ in carrier))
    rate_now = tuple(float(np.real(x)) for x in base_rates(carrier, 0.0))
    accel_now = tuple(float(np.imag(x) / EPS) for x in base_rates(carrier, t))
    found = chain.level_motion(base, rate_now, accel_now, *azimuth)  # type: ignore[arg-type]
    whole = frames.multiply(base, frames.attitude(found.azimuth_rad, found.pitch_rad, found.roll_rad))
    assert (whole[6], whole[7], whole[8]) == pytest.approx((0.0, 0.0, 1.0), abs=1e-14)
    moved = vectorised.level_motion(
        vectorised.rotation_from_euler(*along(carrier, t)),
        base_rates(carrier, t),
        accel_now,
        *along((azimuth,), t),
        azimuth[1] + azimuth[2] * t,
        azimuth[2],
    )
    assert found[4:6] == pytest.approx([np.imag(x) / EPS for x in moved[1:3]], abs=1e-11)
    assert found[7:9] == pytest.approx([np.imag(x) / EPS for x in moved[4:6]], abs=1e-10)


@many
@given(tilt, tilt, st.tuples(*[rate] * 6))
def test_joint_accelerations_there_and_back(p: float, r: float, rates: tuple[float, ...]) -> None:
    there = frames.joint_accels_to_body(p, r, *rates)
    assert frames.body_to_joint_accels(p, r, *rates[:3], *there) == pytest.approx(rates[3:], abs=1e-12)
    assert frames.body_to_tilt_accels(p, r, *rates[:3], *there[:2], rates[5]) == pytest.approx(rates[3:5], abs=1e-12)


def test_the_complex_step_through_atan2_is_its_derivative() -> None:
    y, x = 0.3, -0.7
    assert vectorised._arctan2(y + EPS * 1j, x).imag / EPS == pytest.approx(x / hypot(x, y) ** 2)
    assert vectorised._arctan2(y, x + EPS * 1j).imag / EPS == pytest.approx(-y / hypot(x, y) ** 2)
    assert vectorised._arctan2(y, x) == atan2(y, x)
    assert atan2(y, x) > pi / 2.0
