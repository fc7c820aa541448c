"""The swing table: analytic derivatives against numerical ones, blocks cut anyhow, figures of the paper."""

from __future__ import annotations

from math import degrees, pi, radians, sin
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from spsp_ctrl.config.scenario import BaseMotion, Roughness, Sine
from spsp_ctrl.plant.swing_table import CHUNK, GRAVITY_M_S2, SwingTable

Array = NDArray[np.float64]
Order = Literal["roll_pitch", "pitch_roll"]
ORDERS: tuple[Order, ...] = ("roll_pitch", "pitch_roll")
RATE_HZ = 1000


def everything(order: Order) -> BaseMotion:
    """Every kind of motion at once, fast enough to make all inertial terms count."""
    return BaseMotion(
        axis_order=order,
        start_s=0.35,
        ramp_s=1.3,
        pitch=(Sine(amplitude_deg=6.0, period_s=1.7, phase_deg=20.0), Sine(amplitude_deg=2.0, period_s=0.9)),
        roll=(Sine(amplitude_deg=15.0, period_s=2.3, phase_deg=-50.0),),
        yaw=(Sine(amplitude_deg=8.0, period_s=3.1, phase_deg=70.0),),
        yaw_rate_deg_s=-25.0,
        roughness=Roughness(rms_arcmin=0.5, low_hz=2.0, high_hz=10.0),
    )


def rotations(rows: Array) -> Array:
    return rows[:, :9].reshape(-1, 3, 3)


def derivative(x: Array) -> Array:
    """Eighth-order central difference along the first axis; four rows are lost at each end."""
    weights = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)
    n = len(x)
    total = np.zeros_like(x[4 : n - 4])
    for k, w in enumerate(weights, start=1):
        total += w * (x[4 + k : n - 4 + k] - x[4 - k : n - 4 - k])
    return total * RATE_HZ


def turn(axis: int, angles: Array) -> Array:
    """Rotations about one axis, shape (n, 3, 3), written out apart from the code under test."""
    c, s, zero, one = np.cos(angles), np.sin(angles), np.zeros_like(angles), np.ones_like(angles)
    rows = (
        ((one, zero, zero), (zero, c, -s), (zero, s, c)),
        ((c, zero, s), (zero, one, zero), (-s, zero, c)),
        ((c, -s, zero), (s, c, zero), (zero, zero, one)),
    )[axis]
    return np.moveaxis(np.array(rows), -1, 0)


# --- geometry -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
def test_rotation_follows_the_documented_axis_order(order: Order) -> None:
    table = SwingTable(everything(order), RATE_HZ, seed=3)
    pitch, roll, yaw = table.angles(0, 4000).T
    tilt = turn(0, -roll) @ turn(1, pitch) if order == "roll_pitch" else turn(1, pitch) @ turn(0, -roll)
    np.testing.assert_allclose(rotations(table.block(0, 4000)), turn(2, yaw) @ tilt, atol=1e-14)


def test_the_two_orders_differ() -> None:
    first, second = (SwingTable(everything(order), RATE_HZ, seed=3).block(3000, 10) for order in ORDERS)
    assert np.abs(first[:, :9] - second[:, :9]).max() > 1e-3


@pytest.mark.parametrize("order", ORDERS)
def test_rotations_are_orthonormal(order: Order) -> None:
    r = rotations(SwingTable(everything(order), RATE_HZ, seed=3).block(0, 4000))
    np.testing.assert_allclose(r @ r.swapaxes(1, 2), np.broadcast_to(np.eye(3), r.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(r), 1.0, atol=1e-14)


def test_a_positive_roll_lowers_the_left_side_and_a_positive_pitch_the_front() -> None:
    quarter = 0.25 * 4.0
    for key, axis in (("pitch", 0), ("roll", 1)):
        motion = BaseMotion.model_validate(
            {"start_s": 0.0, "ramp_s": 0.5, key: [{"amplitude_deg": 6.0, "period_s": 4.0}]}
        )
        row = SwingTable(motion, RATE_HZ, seed=0).block(int(quarter * RATE_HZ), 1)
        assert rotations(row)[0, 2, axis] == pytest.approx(-sin(radians(6.0)))


# --- derivatives ----------------------------------------------------------------------------------------------------


def smooth_part(rows: Array) -> slice:
    """After the ramp: the envelope's third derivative jumps at its ends, which a high-order difference would see."""
    return slice(1660, len(rows))


@pytest.mark.parametrize("order", ORDERS)
def test_angular_velocity_is_the_derivative_of_the_rotation(order: Order) -> None:
    rows = SwingTable(everything(order), RATE_HZ, seed=3).block(0, 4000)
    rows = rows[smooth_part(rows)]
    r = rotations(rows)
    skew = r[4:-4].swapaxes(1, 2) @ derivative(r)
    found = np.stack((skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]), axis=1)
    np.testing.assert_allclose(rows[4:-4, 9:12], found, atol=1e-11)


@pytest.mark.parametrize("order", ORDERS)
def test_angular_acceleration_is_the_derivative_of_the_angular_velocity(order: Order) -> None:
    rows = SwingTable(everything(order), RATE_HZ, seed=3).block(0, 4000)
    rows = rows[smooth_part(rows)]
    np.testing.assert_allclose(rows[4:-4, 12:15], derivative(rows[:, 9:12]), atol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("arm_m", [0.45, -1.2, 0.0])
def test_specific_acceleration_is_that_of_the_pivot(order: Order, arm_m: float) -> None:
    rows = SwingTable(everything(order), RATE_HZ, seed=3, arm_m=arm_m).block(0, 4000)
    rows = rows[smooth_part(rows)]
    r = rotations(rows)
    pivot = r @ np.array([0.0, 0.0, arm_m])
    inertial = derivative(derivative(pivot)) + np.array([0.0, 0.0, 9.80665])
    found = np.einsum("nji,nj->ni", r[8:-8], inertial)
    np.testing.assert_allclose(rows[8:-8, 15:18], found, atol=2e-9)
    by_arm = float(np.abs(rows[:, 15:18] - GRAVITY_M_S2 * r[:, 2, :]).max())
    assert by_arm == 0.0 if arm_m == 0.0 else by_arm > 1.0, "the arm must matter in this motion"


@pytest.mark.parametrize("order", ORDERS)
def test_derivatives_hold_through_the_start_too(order: Order) -> None:
    """Low-order differences, which need no more than the second derivatives that are continuous."""
    rows = SwingTable(everything(order), RATE_HZ, seed=3).block(300, 1500)
    r = rotations(rows)
    middle = r[1:-1].swapaxes(1, 2) @ (r[2:] - r[:-2]) * (RATE_HZ / 2.0)
    found = np.stack((middle[:, 2, 1], middle[:, 0, 2], middle[:, 1, 0]), axis=1)
    np.testing.assert_allclose(rows[1:-1, 9:12], found, atol=1e-3)
    accel = (rows[2:, 9:12] - rows[:-2, 9:12]) * (RATE_HZ / 2.0)
    np.testing.assert_allclose(rows[1:-1, 12:15], accel, atol=2e-2)
    assert np.abs(np.diff(rows[:, 12:15], axis=0)).max() < 0.2, "angular acceleration must not jump"


# --- start ----------------------------------------------------------------------------------------------------------


def test_still_before_the_start_but_for_gravity() -> None:
    motion = everything("roll_pitch")
    n = int(motion.start_s * RATE_HZ) + 1
    table = SwingTable(motion, RATE_HZ, seed=3)
    still = np.concatenate((np.eye(3).ravel(), np.zeros(6), [0.0, 0.0, 9.80665]))
    np.testing.assert_array_equal(table.block(0, n), np.broadcast_to(still, (n, 18)))
    np.testing.assert_array_equal(table.angles(0, n), np.zeros((n, 3)))
    assert np.abs(table.angles(n + 500, 1)).min() > 0.0


def test_an_empty_motion_stays_still() -> None:
    rows = SwingTable(BaseMotion(), RATE_HZ, seed=3).block(5000, 3)
    np.testing.assert_array_equal(rows[0], rows[2])
    assert tuple(rows[0, 15:]) == (0.0, 0.0, 9.80665)


def test_sines_start_their_time_at_start_s() -> None:
    motion = BaseMotion(start_s=1.25, ramp_s=2.0, roll=(Sine(amplitude_deg=15.0, period_s=8.0, phase_deg=30.0),))
    found = SwingTable(motion, RATE_HZ, seed=0).angles(6000, 1)[0, 1]
    assert found == pytest.approx(radians(15.0) * sin(2.0 * pi * (6.0 - 1.25) / 8.0 + radians(30.0)), abs=1e-15)


def test_yaw_rate_grows_smoothly_and_stays() -> None:
    table = SwingTable(BaseMotion(start_s=1.0, ramp_s=2.0, yaw_rate_deg_s=5.0), RATE_HZ, seed=0)
    rows, yaw = table.block(0, 200_000)[::20], table.angles(0, 200_000)[::20, 2]
    np.testing.assert_allclose(rows[200:, 11], radians(5.0), rtol=1e-14)
    np.testing.assert_allclose(rows[200:, 14], 0.0, atol=1e-15)
    np.testing.assert_allclose(np.gradient(yaw, 0.02)[201:-1], radians(5.0), rtol=1e-10)
    # half of the ramp's way is lost; no wrapping after two and a half turns
    assert degrees(yaw[-1]) == pytest.approx(5.0 * (199.98 - 1.0 - 1.0), rel=1e-12)
    assert np.all(np.diff(rows[:, 11]) >= 0.0)


# --- blocks ---------------------------------------------------------------------------------------------------------

REFERENCE = SwingTable(everything("roll_pitch"), RATE_HZ, seed=11)
WHOLE, WHOLE_ANGLES = REFERENCE.block(0, 1500), REFERENCE.angles(0, 1500)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1499), st.integers(0, 400)), min_size=1, max_size=6))
def test_a_row_has_the_same_bits_in_any_block(cuts: list[tuple[int, int]]) -> None:
    table = SwingTable(everything("roll_pitch"), RATE_HZ, seed=11)
    for first, length in cuts:
        n = min(length, 1500 - first)
        assert table.block(first, n).tobytes() == WHOLE[first : first + n].tobytes()
        assert table.angles(first, n).tobytes() == WHOLE_ANGLES[first : first + n].tobytes()


def test_going_back_after_a_long_way_gives_the_same_bits() -> None:
    table = SwingTable(everything("roll_pitch"), RATE_HZ, seed=11)
    for chunk in range(200, 250):
        table.block(chunk * CHUNK, 1)
    assert table.block(700, 1).tobytes() == WHOLE[700:701].tobytes()


def test_a_block_belongs_to_its_caller() -> None:
    table = SwingTable(everything("roll_pitch"), RATE_HZ, seed=11)
    table.block(0, CHUNK)[:] = 7.0
    assert table.block(0, CHUNK).tobytes() == WHOLE[:CHUNK].tobytes()


def test_an_empty_block_has_its_shape() -> None:
    table = SwingTable(BaseMotion(), RATE_HZ, seed=0)
    assert table.block(10, 0).shape == (0, 18)
    assert table.angles(10, 0).shape == (0, 3)
    assert table.block(0, 1).dtype == np.float64


# --- figures --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    ("key", "amplitude_deg", "period_s", "peak_rate_deg_s", "peak_accel_deg_s2"),
    [("roll", 15.0, 8.0, 11.78, 9.25), ("pitch", 6.0, 4.0, 9.42, 14.80)],
)
def test_peaks_of_the_paper(
    order: Order, key: str, amplitude_deg: float, period_s: float, peak_rate_deg_s: float, peak_accel_deg_s2: float
) -> None:
    motion = BaseMotion.model_validate(
        {"axis_order": order, key: [{"amplitude_deg": amplitude_deg, "period_s": period_s}]}
    )
    table = SwingTable(motion, RATE_HZ, seed=0)
    rows, angles = table.block(4000, 16_000), table.angles(4000, 16_000)
    peaks = np.degrees(np.abs(rows[:, 9:15]).max(axis=0))
    axis, column = (0, 1) if key == "roll" else (1, 0)
    assert peaks[axis] == pytest.approx(peak_rate_deg_s, abs=0.005)
    assert peaks[3 + axis] == pytest.approx(peak_accel_deg_s2, abs=0.01)
    assert np.degrees(np.abs(angles[:, column]).max()) == pytest.approx(amplitude_deg, abs=1e-4)
    np.testing.assert_array_equal(np.delete(rows[:, 9:15], [axis, 3 + axis], axis=1), 0.0)


# --- roughness ------------------------------------------------------------------------------------------------------


def rough(seed: int, seconds: int, low_hz: float = 2.0, high_hz: float = 10.0, order: Order = "roll_pitch") -> Array:
    motion = BaseMotion(
        axis_order=order,
        start_s=0.0,
        ramp_s=0.1,
        roughness=Roughness(rms_arcmin=0.05, low_hz=low_hz, high_hz=high_hz),
    )
    return SwingTable(motion, 200, seed).angles(20, 200 * seconds)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_roughness_has_the_stated_rms_on_pitch_and_roll_alone(seed: int) -> None:
    angles = rough(seed, seconds=300)
    np.testing.assert_allclose(np.degrees(angles[:, :2].std(axis=0)) * 60.0, 0.05, rtol=0.03)
    assert np.all(angles[:, 2] == 0.0)
    assert abs(np.corrcoef(angles[:, 0], angles[:, 1])[0, 1]) < 0.1


def test_roughness_fills_its_band_and_nothing_else() -> None:
    seconds = 200
    angles = rough(5, seconds, low_hz=3.0, high_hz=9.0)[:, 0]
    power = np.abs(np.fft.rfft(angles * np.hanning(len(angles)))) ** 2
    frequency = np.fft.rfftfreq(len(angles), 1.0 / 200.0)
    inside = (frequency > 2.95) & (frequency < 9.05)
    assert power[inside].sum() > 0.9999 * power.sum()
    # a quarter of the band holds a quarter of the power
    for low in (3.0, 4.5, 6.0, 7.5):
        part = power[(frequency >= low) & (frequency < low + 1.5)].sum() / power.sum()
        assert part == pytest.approx(0.25, abs=0.05)


def test_roughness_is_a_function_of_the_seed() -> None:
    assert rough(4, 2).tobytes() == rough(4, 2).tobytes()
    assert np.abs(rough(4, 2) - rough(5, 2)).max() > radians(0.01 / 60.0)
    # the order of the axes changes the geometry, not what each axis does
    assert rough(4, 2, order="pitch_roll").tobytes() == rough(4, 2).tobytes()


# --- errors ---------------------------------------------------------------------------------------------------------


def test_bad_input_is_refused_with_the_reason() -> None:
    with pytest.raises(ValueError, match=r"rate_hz .* not 0"):
        SwingTable(BaseMotion(), 0, seed=1)
    with pytest.raises(ValueError, match=r"high_hz .2. must not be below low_hz .10."):
        Roughness(rms_arcmin=0.1, low_hz=10.0, high_hz=2.0)
    table = SwingTable(BaseMotion(), RATE_HZ, seed=1)
    with pytest.raises(ValueError, match="ask from cycle 0 on"):
        table.block(-1, 5)
    with pytest.raises(ValueError, match="ask from cycle 0 on"):
        table.angles(0, -1)
