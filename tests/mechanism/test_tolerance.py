"""Tolerances: Table 4 by all three methods, zeroing, Monte Carlo."""

from __future__ import annotations

from itertools import product
from math import radians
from pathlib import Path

import numpy as np
import pytest

from spsp_ctrl.config.loader import load_tolerances
from spsp_ctrl.mechanism.error_model import elementary, exact_error
from spsp_ctrl.mechanism.tolerance import (
    Poses,
    Tolerance,
    as_given,
    attitude_matrix,
    exact_worst_case,
    governing,
    limits_of,
    monte_carlo,
    root_sum_square,
    tolerances_of,
    worst_case,
)

LENGTHS = (0.2655, 0.1, 0.1)
LIMIT = radians(20.0)
ARCMIN = 60.0 * 180.0 / np.pi
ROOT = Path(__file__).parents[2]
POSES = Poses.grid(LIMIT, LIMIT, 41)


def load(name: str) -> tuple[Tolerance, ...]:
    return tolerances_of(load_tolerances(ROOT / f"config/tolerances/{name}.yaml").model, LENGTHS)


TABLE_4 = load("table4")
LIMITS = limits_of(TABLE_4)
MATRIX = attitude_matrix(TABLE_4, POSES, LENGTHS)


def arcmin(values: object) -> tuple[float, float]:
    largest = np.abs(np.asarray(values)).max(axis=1) * ARCMIN
    return float(largest[0]), float(largest[1])


def test_table_4() -> None:
    assert arcmin(as_given(MATRIX, LIMITS)) == pytest.approx((0.865, 1.066), abs=5e-4)
    assert arcmin(worst_case(MATRIX, LIMITS)) == pytest.approx((4.559, 5.645), abs=5e-4)
    assert arcmin(root_sum_square(MATRIX, LIMITS)) == pytest.approx((3.180, 3.649), abs=5e-4)
    level = attitude_matrix(TABLE_4, Poses(np.zeros(1), np.zeros(1)), LENGTHS)
    assert arcmin(worst_case(level, LIMITS)) == pytest.approx((4.125, 4.125), abs=5e-4)


def test_table_4_shares() -> None:
    worst = governing(MATRIX, LIMITS)
    assert worst.axis == 1
    assert np.degrees((POSES.pitch_rad[worst.pose], POSES.roll_rad[worst.pose])) == pytest.approx((20.0, 20.0))
    shares = dict(zip([t.source.name for t in TABLE_4], worst.shares_rad * ARCMIN, strict=True))
    assert shares == pytest.approx({"dl1": 0.401, "dl2": 2.809, "dr": 0.145, "dh": 2.290}, abs=5e-4)
    assert worst.shares_rad.sum() == pytest.approx(worst.error_rad)


def test_worst_signs_of_the_exact_model_are_the_worst_of_all_signs() -> None:
    corner = Poses(np.array([LIMIT]), np.array([LIMIT]))
    matrix = attitude_matrix(TABLE_4, corner, LENGTHS)
    found = exact_worst_case(matrix, TABLE_4, LIMITS, corner, LENGTHS)
    every = [
        np.abs(exact_error(LIMIT, LIMIT, LENGTHS, elementary([(t.source, s * t.limit) for t, s in zip(TABLE_4, signs, strict=True)])))
        for signs in product((-1.0, 1.0), repeat=4)
    ]
    np.testing.assert_allclose(found[:, 0], np.max(every, axis=0), rtol=1e-12)
    assert found[1, 0] * ARCMIN == pytest.approx(5.653, abs=5e-4)


def test_height_and_rods_with_the_same_sign_cancel() -> None:
    same = np.array([5e-5, 5e-5, 0.0, 5e-5])
    assert max(arcmin(as_given(MATRIX, same))) == pytest.approx(0.003, abs=5e-4)


def test_zeroing_at_level() -> None:
    zeroed = attitude_matrix(TABLE_4, POSES, LENGTHS, zeroed=True)
    # rods vary from pose to pose and stay; the height goes away but for 0.003 arcmin
    assert arcmin(worst_case(zeroed, LIMITS)) == pytest.approx((2.71, 3.36), abs=0.005)
    exact = exact_worst_case(zeroed, TABLE_4, LIMITS, POSES, LENGTHS, zeroed=True)
    assert arcmin(exact) == pytest.approx(arcmin(worst_case(zeroed, LIMITS)), rel=2e-3)
    np.testing.assert_array_equal(zeroed[:, 0], MATRIX[:, 0])
    assert np.abs(zeroed[:, 3, len(POSES.pitch_rad) // 2]).max() < 1e-12


NINE = attitude_matrix(TABLE_4, Poses.grid(LIMIT, LIMIT, 9), LENGTHS)


def test_monte_carlo_of_table_4() -> None:
    uniform = monte_carlo(NINE, TABLE_4, 1_000_000, 1, "uniform")
    assert 100.0 * uniform.beyond(3.0 / ARCMIN) == pytest.approx(26.5, abs=0.2)
    assert 100.0 * uniform.beyond(5.0 / ARCMIN) == pytest.approx(0.2, abs=0.05)
    normal = monte_carlo(NINE, TABLE_4, 1_000_000, 1, "normal")
    assert 100.0 * normal.beyond(3.0 / ARCMIN) == pytest.approx(1.86, abs=0.05)
    assert normal.quantile(0.5) * ARCMIN == pytest.approx(1.20, abs=0.01)


def test_monte_carlo_repeats_and_keeps_its_units_when_more_are_made() -> None:
    first, again = (monte_carlo(NINE, TABLE_4, 20_000, 7, "uniform") for _ in range(2))
    np.testing.assert_array_equal(first.worst_rad, again.worst_rad)
    more = monte_carlo(NINE, TABLE_4, 30_000, 7, "uniform")
    assert np.isin(first.worst_rad, more.worst_rad).all()
    other = monte_carlo(NINE, TABLE_4, 20_000, 8, "uniform")
    assert not np.array_equal(first.worst_rad, other.worst_rad)


def test_monte_carlo_against_the_exact_model() -> None:
    """The same distribution by re-solving a few hundred units exactly, drawn here by other means."""
    rng = np.random.default_rng(5)
    grid = Poses.grid(LIMIT, LIMIT, 9)
    units = 400
    values = rng.uniform(-1.0, 1.0, (4, units, 1)) * LIMITS[:, None, None]
    errors = elementary([(t.source, v) for t, v in zip(TABLE_4, values, strict=True)])
    exact = np.abs(exact_error(grid.pitch_rad[None, :], grid.roll_rad[None, :], LENGTHS, errors)).max(axis=(0, 2))
    linear = np.abs(np.einsum("asp,sn->anp", NINE, values[:, :, 0])).max(axis=(0, 2))
    assert np.abs(exact - linear).max() < 0.005 * exact.max()
    made = monte_carlo(NINE, TABLE_4, 200_000, 1, "uniform")
    assert np.median(exact) == pytest.approx(made.quantile(0.5), rel=0.1)


def test_distributions_of_a_file() -> None:
    """A unit with one error has the distribution of that error."""
    poses = Poses(np.zeros(1), np.zeros(1))
    one = (TABLE_4[0],)
    matrix = attitude_matrix(one, poses, LENGTHS)
    top = float(worst_case(matrix, limits_of(one)).max())
    uniform = monte_carlo(matrix, one, 200_000, 1)
    assert uniform.worst_rad[-1] <= top
    assert uniform.quantile(0.5) == pytest.approx(0.5 * top, rel=0.02)
    normal = (Tolerance(one[0].source, one[0].limit, "normal", 2.0),)
    assert monte_carlo(matrix, normal, 200_000, 1).beyond(top) == pytest.approx(0.0455, abs=0.002)
    seen: list[tuple[int, int]] = []
    monte_carlo(matrix, one, 20_000, 1, advance=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (20_000, 20_000)
    assert [s[0] for s in seen] == sorted(s[0] for s in seen)


def test_shipped_sets() -> None:
    for name in ("table2", "table4", "hinges"):
        assert load(name)
    hinges = load("hinges")
    matrix = attitude_matrix(hinges, Poses.grid(LIMIT, LIMIT, 9), LENGTHS)
    assert worst_case(matrix, limits_of(hinges)).max() * ARCMIN > 5.0
    assert monte_carlo(matrix, hinges, 100_000, 1, "uniform").beyond(5.0 / ARCMIN) < 0.0027
