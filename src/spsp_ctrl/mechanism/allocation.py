"""The loosest tolerances that keep a requirement, and what each tolerance does to the result (section 3.4 of the paper).

Cost of a limit t is ``cost * reference / t`` with the reference 10 um, 0.1 mrad or 1 K: the reciprocal model of the field. The cheapest set under
``sum |S_i| t_i <= requirement`` (worst case) or ``sum S_i^2 t_i^2 <= requirement^2`` (root sum square) at every pose and axis is a
geometric program: convex in log t, solved by SLSQP over the few poses that bind. By yield, the root-sum-square set is scaled so that
the wanted part of a Monte Carlo keeps the requirement.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from spsp_ctrl.mechanism.error_model import Lengths
from spsp_ctrl.mechanism.tolerance import (
    WORST_GRID,
    YIELD_GRID,
    Poses,
    Tolerance,
    attitude_matrix,
    exact_worst_case,
    limits_of,
    monte_carlo,
    root_sum_square,
    worst_case,
)
from spsp_ctrl.mechanism.vectorised import Array

Method = Literal["worst", "rss", "yield"]
REFERENCE = {"m": 1e-5, "rad": 1e-4, "K": 1.0}
LOOSEST = {"m": 1e-2, "rad": 2e-2, "K": 100.0}
"""Upper bound of a limit for which no other is given: an error without effect on the attitude would else have none."""
TIGHTEST = {"m": 1e-9, "rad": 1e-9, "K": 1e-6}
RELAXED = 1.1
"""Factor by which :func:`relaxation` relaxes each limit."""


class Infeasible(ValueError):
    """No set within the given bounds keeps the requirement."""


def cost_of(tolerances: Sequence[Tolerance], limits: Array) -> Array:
    """Cost of each limit."""
    return np.array([t.cost * REFERENCE[t.source.si_unit] / limit for t, limit in zip(tolerances, limits, strict=True)])


@dataclass(frozen=True)
class Relaxation:
    """What it does to relax one tolerance (or one group) by 10 %."""

    names: tuple[str, ...]
    added_rad: float
    """To the worst case over the workspace."""
    saved: float
    """Of the cost."""

    @property
    def worth(self) -> float:
        """Cost saved per rad of attitude error; infinite when the error does not grow."""
        return self.saved / self.added_rad if self.added_rad > 1e-15 else float("inf")


def _groups(tolerances: Sequence[Tolerance]) -> list[list[int]]:
    """Indices of the tolerances that share one limit."""
    found: dict[str, list[int]] = {}
    for k, t in enumerate(tolerances):
        found.setdefault(f"group {t.group}" if t.group else f"alone {k}", []).append(k)
    return list(found.values())


def relaxation(tolerances: Sequence[Tolerance], limits: Array, matrix: Array) -> list[Relaxation]:
    """Each tolerance or group relaxed by itself, best first: the first is to be relaxed first, the last to be tightened first."""
    before = float(worst_case(matrix, limits).max())
    found = []
    for group in _groups(tolerances):
        trial = limits.copy()
        trial[group] *= RELAXED
        added = max(float(worst_case(matrix, trial).max()) - before, 0.0)
        saved = float((cost_of(tolerances, limits) - cost_of(tolerances, trial)).sum())
        found.append(Relaxation(tuple(tolerances[k].source.name for k in group), added, saved))
    return sorted(found, key=lambda r: -r.worth)


@dataclass(frozen=True)
class Allocation:
    """A set of limits that keeps the requirement."""

    method: Method
    limits: Array
    """SI units, in the order of the tolerances."""
    cost: float
    worst_rad: float
    """Worst case, exact model."""
    rss_rad: float
    beyond: float
    """Part of the Monte Carlo units beyond the requirement."""


def _bounds(tolerances: Sequence[Tolerance], group: list[int]) -> tuple[float, float]:
    units = tolerances[group[0]].source.si_unit
    low = max((t.least for k in group if (t := tolerances[k]).least is not None), default=TIGHTEST[units])
    high = min((t.most for k in group if (t := tolerances[k]).most is not None), default=LOOSEST[units])
    if low > high:
        names = ", ".join(tolerances[k].source.name for k in group)
        raise Infeasible(f"min and max of the group of {names} exclude each other")
    return low, high


def _cheapest(tolerances: Sequence[Tolerance], matrix: Array, requirement_rad: float, power: int) -> Array:
    """Cheapest limits with ``sum (|S| t)^power <= requirement^power`` in every row of ``matrix``: power 1 worst case, 2 root sum square."""
    from scipy.optimize import minimize

    groups = _groups(tolerances)
    rows = (np.abs(matrix) / requirement_rad) ** power
    rows = np.moveaxis(rows, 1, 2).reshape(-1, len(tolerances))
    rows = np.stack([rows[:, group].sum(axis=1) for group in groups], axis=1)
    weight = np.array([sum(tolerances[k].cost * REFERENCE[tolerances[k].source.si_unit] for k in group) for group in groups])
    bounds = np.array([_bounds(tolerances, group) for group in groups])
    tightest = rows @ bounds[:, 0] ** power
    if tightest.max() > 1.0:
        least = requirement_rad * float(tightest.max()) ** (1.0 / power)
        raise Infeasible(
            f"the requirement cannot be kept: with every limit at its least the error is still {np.degrees(least) * 60.0:.3f} arcmin"
        )
    # start: every group with the same share of the governing row, inside the bounds
    governing = rows.max(axis=0)
    share = (1.0 / (len(groups) * np.maximum(governing, 1e-300))) ** (1.0 / power)
    y = np.log(np.clip(share, bounds[:, 0], bounds[:, 1]))
    total = float((weight / np.exp(y)).sum())
    binding: list[int] = []
    for _ in range(40):
        sums = rows @ np.exp(power * y)
        new = int(np.argmax(sums))
        if binding and (sums[new] <= 1.0 + 1e-9 or new in binding):
            break
        binding.append(new)
        some = rows[binding]

        def slack(z: Array, some: Array = some) -> Array:
            left: Array = -np.log(some @ np.exp(power * z))
            return left

        def slope(z: Array, some: Array = some) -> Array:
            terms = some * np.exp(power * z)
            gradient: Array = -power * terms / terms.sum(axis=1, keepdims=True)
            return gradient

        found: Any = minimize(
            lambda z: float((weight / np.exp(z)).sum()) / total,
            y,
            jac=lambda z: -(weight / np.exp(z)) / total,
            bounds=np.log(bounds),
            constraints=[{"type": "ineq", "fun": slack, "jac": slope}],
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        y = found.x
    result = np.empty(len(tolerances))
    for group, value in zip(groups, np.exp(y), strict=True):
        result[group] = value
    return result


def rounded_down(value: float, digits: int = 3) -> float:
    """A limit that can stand on a drawing: rounded down to some digits."""
    step = 10.0 ** (np.floor(np.log10(value)) - digits + 1)
    return float(np.floor(value / step + 1e-9) * step)


def allocate(
    tolerances: Sequence[Tolerance],
    pitch_limit_rad: float,
    roll_limit_rad: float,
    lengths_m: Lengths,
    requirement_rad: float,
    method: Method = "worst",
    wanted_yield: float = 0.9973,
    units: int = 200_000,
    seed: int = 1,
    zeroed: bool = False,
    advance: Callable[[int, int], None] = lambda done, total: None,
) -> Allocation:
    """The cheapest limits that keep a requirement over the workspace.

    By worst case the set is checked with the exact model and scaled until it passes there too; every limit is then rounded down to three
    digits. Raises :class:`Infeasible` when the bounds of the tolerances leave no such set.
    """
    poses = Poses.grid(pitch_limit_rad, roll_limit_rad, WORST_GRID)
    matrix = attitude_matrix(tolerances, poses, lengths_m, zeroed)
    some = Poses.grid(pitch_limit_rad, roll_limit_rad, YIELD_GRID)
    sampled = attitude_matrix(tolerances, some, lengths_m, zeroed)
    fixed = np.array([t.least is not None and t.least == t.most for t in tolerances])
    least = np.array([t.least or 0.0 for t in tolerances])

    aim = requirement_rad
    for _ in range(12):
        limits = _cheapest(tolerances, matrix, aim, 1 if method == "worst" else 2)
        limits = np.where(fixed, limits, np.maximum([rounded_down(v) for v in limits], least))
        if method == "yield":
            reached = monte_carlo(sampled, tolerances, units, seed, None, limits, advance).quantile(wanted_yield)
        elif method == "rss":
            reached = float(root_sum_square(matrix, limits).max())
        else:
            reached = float(exact_worst_case(matrix, tolerances, limits, poses, lengths_m, zeroed).max())
        # rounding leaves up to 1 %; a yield may also be reached from below
        if reached <= requirement_rad and (method != "yield" or reached > 0.985 * requirement_rad or aim > 50.0 * requirement_rad):
            break
        aim *= (0.9999 if method != "yield" else 0.9975) * requirement_rad / reached
    else:
        if reached > requirement_rad:
            raise Infeasible("the requirement cannot be kept within the bounds of the tolerances")
    made = monte_carlo(sampled, tolerances, units, seed, None, limits)
    return Allocation(
        method,
        limits,
        float(cost_of(tolerances, limits).sum()),
        float(exact_worst_case(matrix, tolerances, limits, poses, lengths_m, zeroed).max()),
        float(root_sum_square(matrix, limits).max()),
        made.beyond(requirement_rad),
    )


def current_cost(tolerances: Sequence[Tolerance]) -> float:
    """Cost of the limits as they are."""
    return float(cost_of(tolerances, limits_of(tolerances)).sum())
