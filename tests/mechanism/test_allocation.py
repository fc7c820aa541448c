"""Allocation: it keeps the requirement exactly, it is the cheapest, and it honours bounds and groups."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

from spsp_ctrl.mechanism.allocation import Infeasible, Method, allocate, cost_of, current_cost, relaxation, rounded_down
from spsp_ctrl.mechanism.error_model import elementary, error_sources, exact_error
from spsp_ctrl.mechanism.tolerance import Poses, Tolerance, attitude_matrix, limits_of, monte_carlo, root_sum_square, worst_case

LENGTHS = (0.2655, 0.1, 0.1)
LIMIT = radians(20.0)
THREE = radians(3.0 / 60.0)
KNOWN = error_sources(LENGTHS)
FOUR = tuple(Tolerance(KNOWN[n], v) for n, v in (("dl1", 7e-5), ("dl2", 7e-5), ("dr", 1e-5), ("dh", 5e-5)))
POSES = Poses.grid(LIMIT, LIMIT, 41)
MATRIX = attitude_matrix(FOUR, POSES, LENGTHS)


def run(tolerances: tuple[Tolerance, ...], method: Method = "worst", **more: Any) -> Any:
    return allocate(tolerances, LIMIT, LIMIT, LENGTHS, THREE, method, **more)


def test_worst_case_is_kept_exactly_and_not_wasted() -> None:
    found = run(FOUR)
    assert 0.99 * THREE < found.worst_rad <= THREE
    assert found.beyond == 0.0
    # by brute force: every sign at the corners of the workspace and in it, solved again
    rng = np.random.default_rng(1)
    signs = rng.choice([-1.0, 1.0], (4, 400, 1))
    errors = elementary([(t.source, s * v) for t, s, v in zip(FOUR, signs, found.limits, strict=True)])
    some = Poses.grid(LIMIT, LIMIT, 5)
    assert np.abs(exact_error(some.pitch_rad, some.roll_rad, LENGTHS, errors)).max() <= THREE


def test_it_is_the_cheapest() -> None:
    """No random set of the same worst case costs less (but for the rounding to three digits)."""
    found = run(FOUR)
    rng = np.random.default_rng(2)
    corners = MATRIX[:, :, [0, 40, 1640, 1680]]
    for _ in range(4000):
        trial = found.limits * np.exp(rng.normal(0.0, 0.2, 4))
        trial *= THREE / worst_case(corners, trial).max()
        assert cost_of(FOUR, trial).sum() > 0.994 * found.cost


def test_looser_requirement_costs_in_proportion() -> None:
    costs = [allocate(FOUR, LIMIT, LIMIT, LENGTHS, radians(a / 60.0)).cost for a in (3.0, 6.0)]
    assert costs[0] == pytest.approx(2.0 * costs[1], rel=0.01)


def test_radius_is_relaxed_and_the_others_tightened() -> None:
    order = relaxation(FOUR, LIMITS, MATRIX)
    assert order[0].names == ("dr",)
    assert order[-1].names == ("dl2",)
    assert order[0].added_rad == pytest.approx(1e-6 * np.abs(MATRIX[1, 2]).max(), rel=1e-6)
    found = run(FOUR)
    assert found.limits[2] > 3.0 * LIMITS[2]
    assert found.limits[1] < 0.6 * LIMITS[1]
    # optimality (Karush, Kuhn, Tucker): what each micrometre saves is a combination of what it adds at the binding poses
    saving = cost_of(FOUR, found.limits) / found.limits
    over = worst_case(MATRIX, found.limits)
    binding = np.stack([np.abs(MATRIX[axis, :, int(np.argmax(over[axis]))]) for axis in (0, 1)], axis=1)
    weights, residual = nnls(binding, saving)
    assert residual < 0.02 * np.linalg.norm(saving)
    assert weights.min() > 0.0


LIMITS = limits_of(FOUR)


def test_root_sum_square_and_yield() -> None:
    rss = run(FOUR, "rss")
    assert 0.99 * THREE < rss.rss_rad <= THREE
    assert rss.worst_rad > THREE
    made = run(FOUR, "yield", wanted_yield=0.99, units=100_000)
    assert 0.0 < made.beyond <= 0.01
    assert made.beyond > 0.007
    nine = attitude_matrix(FOUR, Poses.grid(LIMIT, LIMIT, 9), LENGTHS)
    fresh = monte_carlo(nine, FOUR, 200_000, 99, limits=made.limits)
    assert fresh.beyond(THREE) < 0.0115
    assert run(FOUR, "yield", wanted_yield=0.99, units=100_000).limits == pytest.approx(made.limits, rel=0.0)
    assert root_sum_square(MATRIX, rss.limits).max() == pytest.approx(rss.rss_rad)


def test_cost_weights_bounds_groups_and_fixed() -> None:
    plain = run(FOUR)
    dear = run((FOUR[0], FOUR[1], replace(FOUR[2], cost=10.0), FOUR[3]))
    assert dear.limits[2] > 1.5 * plain.limits[2]
    bounded = run((FOUR[0], FOUR[1], replace(FOUR[2], most=2e-5), FOUR[3]))
    assert bounded.limits[2] == pytest.approx(2e-5)
    assert bounded.limits[1] > plain.limits[1]
    fixed = run((FOUR[0], FOUR[1], FOUR[2], replace(FOUR[3], least=3.33e-5, most=3.33e-5)))
    assert fixed.limits[3] == pytest.approx(3.33e-5)
    tied = run((replace(FOUR[0], group="rods"), replace(FOUR[1], group="rods"), FOUR[2], FOUR[3]))
    assert tied.limits[0] == tied.limits[1]
    assert tied.cost > plain.cost
    for found in (dear, bounded, fixed, tied):
        assert found.worst_rad <= THREE


def test_zeroing_frees_the_height() -> None:
    found = run((replace(FOUR[0], varies=True), replace(FOUR[1], varies=True), FOUR[2], FOUR[3]), zeroed=True)
    assert found.worst_rad <= THREE
    assert found.limits[3] > 1e-4


def test_an_error_without_effect_gets_the_loosest_limit() -> None:
    found = run((*FOUR, Tolerance(KNOWN["b1_y"], 1e-4)))
    assert found.limits[4] == pytest.approx(1e-2)


def test_infeasible() -> None:
    tight = tuple(replace(t, least=t.limit) for t in FOUR)
    with pytest.raises(Infeasible, match=r"5\.6\d\d arcmin"):
        run(tight)
    clash = (replace(FOUR[0], group="g", least=5e-5), replace(FOUR[1], group="g", most=4e-5), *FOUR[2:])
    with pytest.raises(Infeasible, match="dl1, dl2 exclude each other"):
        run(clash)


def test_rounding_down() -> None:
    assert rounded_down(3.4567e-5) == pytest.approx(3.45e-5)
    assert rounded_down(1e-5) == pytest.approx(1e-5)
    assert rounded_down(9.999e-6) == pytest.approx(9.99e-6)
    assert current_cost(FOUR) == pytest.approx(10 / 70 + 10 / 70 + 1.0 + 10 / 50)
