"""Results of the tolerance and budget commands as dictionaries (JSON) and as lines for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from spsp_ctrl.config.tolerances import TOLERANCES_SCHEMA, ToleranceFile
from spsp_ctrl.config.units import UNITS
from spsp_ctrl.mechanism.allocation import Allocation, cost_of, relaxation
from spsp_ctrl.mechanism.budget import Budget
from spsp_ctrl.mechanism.tolerance import (
    AXES,
    WORST_GRID,
    YIELD_GRID,
    MonteCarlo,
    Poses,
    Tolerance,
    Worst,
    as_given,
    attitude_matrix,
    exact_worst_case,
    governing,
    limits_of,
    monte_carlo,
    root_sum_square,
    worst_case,
)
from spsp_ctrl.mechanism.vectorised import Array
from spsp_ctrl.mechanism.workspace import Travel
from spsp_ctrl.report.error_text import ARCMIN, DEG, SHOWN
from spsp_ctrl.report.text import PRIME, number

WANTED = 0.9973
"""Part of the units that counts as 'kept' by Monte Carlo: 3 sigma."""


@dataclass(frozen=True)
class Check:
    """A set of tolerances against a requirement, with what its picture needs."""

    requirement_rad: float
    poses: Poses
    matrix: Array
    worst: Worst
    made: dict[str, MonteCarlo]
    result: dict[str, Any]


def check_set(
    travel: Travel,
    tolerances: Sequence[Tolerance],
    requirement_rad: float,
    units: int,
    seed: int,
    zeroed: bool,
    advance: Callable[[int, int], None],
) -> Check:
    """Worst case, root sum square and Monte Carlo of a set; shares, order of relaxation, effect of zeroing at level."""
    limits = limits_of(tolerances)
    lengths, bounds = travel.lengths_m, (travel.pitch_limit_rad, travel.roll_limit_rad)
    poses = Poses.grid(*bounds, WORST_GRID)
    matrix = attitude_matrix(tolerances, poses, lengths, zeroed)
    sampled = attitude_matrix(tolerances, Poses.grid(*bounds, YIELD_GRID), lengths, zeroed)
    kinds: list[tuple[str, Any]] = [("uniform", "uniform"), ("normal", "normal")]
    if any(t.distribution for t in tolerances):
        kinds.insert(0, ("as in the file", None))
    made = {}
    for k, (name, kind) in enumerate(kinds):

        def step(done: int, total: int, k: int = k) -> None:
            advance(k * total + done, len(kinds) * total)

        made[name] = monte_carlo(sampled, tolerances, units, seed, kind, advance=step)
    worst = governing(matrix, limits)
    exact = exact_worst_case(matrix, tolerances, limits, poses, lengths, zeroed)
    level = attitude_matrix(tolerances, Poses(np.zeros(1), np.zeros(1)), lengths, zeroed)
    other = attitude_matrix(tolerances, poses, lengths, not zeroed)

    def both(values: Array) -> dict[str, float]:
        return {f"{axis}_arcmin": float(np.abs(values[k]).max() * ARCMIN) for k, axis in enumerate(AXES)}

    rss = root_sum_square(matrix, limits)
    result: dict[str, Any] = {
        "requirement_arcmin": requirement_rad * ARCMIN,
        "zeroed": zeroed,
        "all_positive": both(as_given(matrix, limits)),
        "worst_case": {
            **both(worst_case(matrix, limits)),
            **{f"exact_{name}": v for name, v in both(exact).items()},
            "passes": bool(exact.max() <= requirement_rad),
            "axis": AXES[worst.axis],
            "pitch_deg": float(poses.pitch_rad[worst.pose]) * DEG,
            "roll_deg": float(poses.roll_rad[worst.pose]) * DEG,
        },
        "worst_case_at_level": both(worst_case(level, limits)),
        "rss": {**both(rss), "passes": bool(rss.max() <= requirement_rad)},
        "monte_carlo": {
            name: {
                "units": mc.units,
                "seed": seed,
                "poses": YIELD_GRID**2,
                "beyond": mc.beyond(requirement_rad),
                "standard_error": mc.standard_error(requirement_rad),
                "median_arcmin": mc.quantile(0.5) * ARCMIN,
                "percentile_95_arcmin": mc.quantile(0.95) * ARCMIN,
                "percentile_99_73_arcmin": mc.quantile(WANTED) * ARCMIN,
                "passes": mc.beyond(requirement_rad) <= 1.0 - WANTED,
            }
            for name, mc in made.items()
        },
        "shares": [
            {
                "source": t.source.name,
                "text": t.source.text,
                "limit": t.limit * SHOWN[t.source.si_unit][1],
                "unit": SHOWN[t.source.si_unit][0],
                "arcmin": float(share) * ARCMIN,
                "percent": 100.0 * float(share) / worst.error_rad if worst.error_rad else 0.0,
            }
            for t, share in zip(tolerances, worst.shares_rad, strict=True)
        ],
        "relax_first": [
            {
                "sources": list(r.names),
                "added_arcmin": r.added_rad * ARCMIN,
                "cost_saved": r.saved,
                "cost_saved_per_arcmin": r.worth / ARCMIN if np.isfinite(r.worth) else None,
            }
            for r in relaxation(tolerances, limits, matrix)
        ],
        "cost": float(cost_of(tolerances, limits).sum()),
        "worst_case_" + ("without_zeroing" if zeroed else "after_zeroing"): both(worst_case(other, limits)),
    }
    return Check(requirement_rad, poses, matrix, worst, made, result)


def _pair(found: dict[str, float], prefix: str = "") -> str:
    return f"pitch {number(found[prefix + 'pitch_arcmin'], 3)}{PRIME}, roll {number(found[prefix + 'roll_arcmin'], 3)}{PRIME}"


def _verdict(passes: bool) -> str:
    return "kept" if passes else "NOT KEPT"


def check_lines(result: dict[str, Any]) -> list[str]:
    """Text of ``mechanism tolerance check``."""
    w = result["worst_case"]
    need = f"{number(result['requirement_arcmin'])}{PRIME}"
    lines = [
        f"requirement {need} on pitch and roll, anywhere in the workspace" + (", after zeroing at level" if result["zeroed"] else ""),
        "",
        f"{'worst case, exact':<26}{_pair(w, 'exact_'):<32}{_verdict(w['passes'])}",
        f"{'worst case, linear':<26}{_pair(w):<32}(at level {_pair(result['worst_case_at_level'])})",
        f"{'root sum square':<26}{_pair(result['rss']):<32}{_verdict(result['rss']['passes'])}",
    ]
    for name, mc in result["monte_carlo"].items():
        label = {"uniform": "Monte Carlo, uniform", "normal": "Monte Carlo, normal"}.get(name, f"Monte Carlo, {name}")
        beyond = f"{100.0 * mc['beyond']:.2f} ± {100.0 * mc['standard_error']:.2f} % beyond"
        lines.append(f"{label:<26}{beyond:<32}{_verdict(mc['passes'])}; 99.73 % below {number(mc['percentile_99_73_arcmin'], 2)}{PRIME}")
    lines.append(f"{'all positive, as printed':<26}{_pair(result['all_positive'])}")
    for key, label in (("worst_case_after_zeroing", "worst, zeroed at level"), ("worst_case_without_zeroing", "worst, without zeroing")):
        if key in result:
            lines.append(f"{label:<26}{_pair(result[key])}")
    units = next(iter(result["monte_carlo"].values()))
    lines += [
        f"({units['units']} units, worst of {units['poses']} poses, seed {units['seed']}; kept means 99.73 % of them)",
        "",
        f"shares of the worst case ({w['axis']} at pitch {number(round(w['pitch_deg'], 6))}°, roll {number(round(w['roll_deg'], 6))}°):",
    ]
    for row in sorted(result["shares"], key=lambda r: -r["arcmin"]):
        limit = f"±{number(row['limit'])} {row['unit'].replace('um', 'µm')}"
        lines.append(f"  {row['source']:<20}{limit:>12}{number(row['arcmin'], 3):>9}{PRIME}{row['percent']:>7.1f} %   {row['text']}")
    lines += ["", "relax first … tighten first (cost saved per arcmin, each relaxed by 10 %):"]
    for row in result["relax_first"]:
        worth = row["cost_saved_per_arcmin"]
        effect = f"adds {row['added_arcmin']:.3f}{PRIME}, saves {row['cost_saved']:.4f}"
        what = "no effect on the worst case" if worth is None else f"{worth:9.3f}   {effect}"
        lines.append(f"  {' = '.join(row['sources']):<28}{what}")
    return lines


def allocation_dict(tolerances: Sequence[Tolerance], found: Allocation, requirement_rad: float, before_cost: float, zeroed: bool) -> dict[str, Any]:
    """Result of ``mechanism tolerance allocate``."""
    return {
        "requirement_arcmin": requirement_rad * ARCMIN,
        "by": found.method,
        "zeroed": zeroed,
        "limits": [
            {
                "source": t.source.name,
                "text": t.source.text,
                "limit": float(f"{limit * SHOWN[t.source.si_unit][1]:.6g}"),
                "before": float(f"{t.limit * SHOWN[t.source.si_unit][1]:.6g}"),
                "unit": SHOWN[t.source.si_unit][0],
                "factor": float(limit) / t.limit,
            }
            for t, limit in zip(tolerances, found.limits, strict=True)
        ],
        "cost": found.cost,
        "cost_before": before_cost,
        "worst_case_exact_arcmin": found.worst_rad * ARCMIN,
        "rss_arcmin": found.rss_rad * ARCMIN,
        "beyond": found.beyond,
    }


def allocation_lines(result: dict[str, Any], order: list[dict[str, Any]]) -> list[str]:
    """Text of ``mechanism tolerance allocate``; ``order`` is the order of relaxation of the set it started from."""
    how = {"worst": "in the worst case", "rss": "by root sum square", "yield": "by Monte Carlo"}[result["by"]]
    need = f"{number(result['requirement_arcmin'])}{PRIME}"
    lines = [
        f"cheapest limits that keep {need} {how}" + (", after zeroing at level" if result["zeroed"] else ""),
        f"{'':<20}{'before':>14}{'allocated':>14}",
    ]
    for row in result["limits"]:
        unit = row["unit"].replace("um", "µm")
        lines.append(
            f"{row['source']:<20}{'±' + number(row['before']) + ' ' + unit:>14}{'±' + number(row['limit']) + ' ' + unit:>14}"
            f"   {'×' + format(row['factor'], '.2f'):<8} {row['text']}"
        )
    first, last = order[0], order[-1]
    lines += [
        "",
        f"worst case, exact {number(result['worst_case_exact_arcmin'], 3)}{PRIME}; root sum square {number(result['rss_arcmin'], 3)}{PRIME}; "
        f"{100.0 * result['beyond']:.2f} % of units beyond {need}",
        f"cost {result['cost']:.4f}, before {result['cost_before']:.4f}",
        f"from the set as it was: relax {' = '.join(first['sources'])} first, tighten {' = '.join(last['sources'])} first",
    ]
    return lines


def allocated_file(given: ToleranceFile, tolerances: Sequence[Tolerance], found: Allocation, requirement_rad: float) -> str:
    """Text of a tolerance file with the limits found; everything else as in the file it came from."""
    entries = []
    for entry, t, limit in zip(given.tolerances, tolerances, found.limits, strict=True):
        value = float(f"{limit / UNITS[entry.unit][1]:.6g}")
        entries.append({**entry.model_dump(exclude_unset=True), "limit": value, "cost": t.cost})
    data: dict[str, Any] = {
        "schema": TOLERANCES_SCHEMA,
        "name": f"{given.name or 'set'}, allocated"[:80],
        "requirement": {"value": float(f"{requirement_rad * ARCMIN:.9g}"), "unit": "arcmin"},
    }
    if "materials" in given.model_fields_set:
        data["materials"] = given.materials.model_dump(exclude_unset=True)
    return yaml.safe_dump({**data, "tolerances": entries}, sort_keys=False, allow_unicode=True, default_flow_style=None, width=150)


def budget_dict(budget: Budget) -> dict[str, Any]:
    """Result of ``mechanism budget``."""
    e = budget.effect

    def attitude(rod_m: float) -> dict[str, float]:
        return {
            "rod_um": rod_m * 1e6,
            "pitch_arcmin": rod_m * e.pitch_by_pitch_rod * ARCMIN,
            "roll_by_roll_rod_arcmin": rod_m * e.roll_by_roll_rod * ARCMIN,
            "roll_by_pitch_rod_arcmin": rod_m * e.roll_by_pitch_rod * ARCMIN,
        }

    result: dict[str, Any] = {
        "rows": [{"name": r.name, "kind": r.kind, "how": r.how, **attitude(r.rod_m)} for r in budget.rows],
        "worst": attitude(budget.worst_m),
        "rss": attitude(budget.rss_m),
        "play": attitude(budget.play_m),
    }
    if budget.rod_limit_m is not None:
        result["rod_limit_um"] = budget.rod_limit_m * 1e6
        result["passes"] = budget.worst_m <= budget.rod_limit_m
    return result


def budget_lines(result: dict[str, Any]) -> list[str]:
    """Text of ``mechanism budget``."""
    lines = [
        "largest errors of one actuator and the attitude error they give, anywhere in the workspace",
        f"{'':<34}{'rod, µm':>9}{'pitch':>9}{'roll':>9}{'roll by pitch rod':>20}   how",
    ]

    def line(name: str, row: dict[str, Any], how: str) -> str:
        angles = [f"{number(row[key], 3)}{PRIME}" for key in ("pitch_arcmin", "roll_by_roll_rod_arcmin", "roll_by_pitch_rod_arcmin")]
        return f"{name:<34}{number(row['rod_um'], 2):>9}{angles[0]:>9}{angles[1]:>9}{angles[2]:>20}   {how}"

    lines += [line(row["name"], row, row["how"]) for row in result["rows"]]
    lines += [
        "",
        line("all, worst case", result["worst"], "added"),
        line("all, root sum square", result["rss"], ""),
        line("of this play", result["play"], "step at each reversal"),
    ]
    if "rod_limit_um" in result:
        lines.append(f"{'limit':<34}{number(result['rod_limit_um'], 2):>9}   {_verdict(result['passes'])} in the worst case")
    return lines

