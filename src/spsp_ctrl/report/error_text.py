"""Results of the error commands as dictionaries (JSON) and as lines for a terminal: sources, motion, poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from spsp_ctrl.mechanism.error_analysis import Motion, PoseTable, Response
from spsp_ctrl.mechanism.error_model import Source, sensitivity
from spsp_ctrl.mechanism.tolerance import AXES, WORST_GRID, Poses, worst_case
from spsp_ctrl.mechanism.vectorised import Array
from spsp_ctrl.mechanism.workspace import Travel
from spsp_ctrl.report.text import PRIME, number

DEG = 180.0 / np.pi
ARCMIN = 60.0 * DEG
SHOWN: dict[str, tuple[str, float]] = {"m": ("um", 1e6), "rad": ("mrad", 1e3), "K": ("K", 1.0)}
"""SI unit -> unit of tables and how many of it one SI unit is."""
STEP: dict[str, tuple[str, float]] = {"m": ("10 µm", 1e-5), "rad": ("0.1 mrad", 1e-4), "K": ("1 K", 1.0)}
"""SI unit -> size for which sensitivities are stated."""
PER: dict[str, tuple[str, float]] = {"m": ("mm", 1e-3), "rad": ("mrad", 1e-3), "K": ("K", 1.0)}
"""SI unit -> unit per which static tables are stated."""


def shown(value: float, si_unit: str) -> str:
    """A value with its unit, for people."""
    unit, factor = SHOWN[si_unit]
    return f"{number(float(f'{value * factor:.4g}'))} {unit.replace('um', 'µm')}"


def sources_dict(travel: Travel, sources: Sequence[Source]) -> dict[str, Any]:
    """Result of ``mechanism errors sources``: attitude error per step at level and at most over the workspace."""
    poses = Poses.grid(travel.pitch_limit_rad, travel.roll_limit_rad, WORST_GRID)
    matrix = sensitivity(poses.pitch_rad, poses.roll_rad, travel.lengths_m, sources)
    level = sensitivity(0.0, 0.0, travel.lengths_m, sources)
    rows = []
    for k, source in enumerate(sources):
        text, step = STEP[source.si_unit]
        rows.append(
            {
                "source": source.name,
                "text": source.text,
                "per": text.replace("µ", "u"),
                "level_pitch_arcmin": float(level[0, k]) * step * ARCMIN,
                "level_roll_arcmin": float(level[1, k]) * step * ARCMIN,
                "max_pitch_arcmin": float(np.abs(matrix[0, k]).max()) * step * ARCMIN,
                "max_roll_arcmin": float(np.abs(matrix[1, k]).max()) * step * ARCMIN,
            }
        )
    return {"pitch_limit_deg": travel.pitch_limit_rad * DEG, "roll_limit_deg": travel.roll_limit_rad * DEG, "sources": rows}


def sources_lines(result: dict[str, Any]) -> list[str]:
    """Text of ``mechanism errors sources``."""
    where = f"±{result['pitch_limit_deg']:g}° × ±{result['roll_limit_deg']:g}°"
    lines = [
        f"attitude error per step of each error, arcmin: at level, and at most over {where}",
        f"{'source':<20}{'step':>10}{'level pitch':>13}{'roll':>9}{'max pitch':>12}{'roll':>9}   meaning",
    ]
    for row in result["sources"]:
        lines.append(
            f"{row['source']:<20}{row['per'].replace('um', 'µm'):>10}{number(row['level_pitch_arcmin'], 3):>13}"
            f"{number(row['level_roll_arcmin'], 3):>9}{number(row['max_pitch_arcmin'], 3):>12}{number(row['max_roll_arcmin'], 3):>9}   {row['text']}"
        )
    return lines


def _curve(values: Array) -> dict[str, float]:
    v = values * ARCMIN
    return {"min_arcmin": float(v.min()), "max_arcmin": float(v.max()), "mean_arcmin": float(v.mean()), "peak_arcmin": float(np.abs(v).max())}


def dynamic_dict(motion: Motion, responses: Sequence[Response], envelope: Array | None) -> dict[str, Any]:
    """Result of ``mechanism errors dynamic``; ``envelope`` (2, time) is the worst case of all errors together."""
    cases = []
    for r in responses:
        cases.append(
            {
                "case": r.case.name,
                "errors": {s.name: {"value": v * SHOWN[s.si_unit][1], "unit": SHOWN[s.si_unit][0]} for s, v in r.case.values},
                "pitch": _curve(r.linear[0]),
                "roll": _curve(r.linear[1]),
                "exact_pitch_peak_arcmin": float(np.abs(r.exact[0]).max() * ARCMIN),
                "exact_roll_peak_arcmin": float(np.abs(r.exact[1]).max() * ARCMIN),
                "nonlinearity_arcmin": r.nonlinearity * ARCMIN,
            }
        )
    result: dict[str, Any] = {"duration_s": float(motion.t_s[-1]), "cases": cases}
    if envelope is not None:
        result["worst_signs"] = {f"{axis}_peak_arcmin": float(envelope[k].max() * ARCMIN) for k, axis in enumerate(AXES)}
    return result


def case_title(response: Response) -> str:
    """Name of a case with the sizes of its errors."""
    if len(response.case.values) == 1:
        source, value = response.case.values[0]
        return f"{source.name} = {shown(value, source.si_unit)}"
    return response.case.name


def dynamic_lines(result: dict[str, Any], responses: Sequence[Response]) -> list[str]:
    """Text of ``mechanism errors dynamic``."""
    lines = [
        f"attitude error over {result['duration_s']:g} s of motion, arcmin",
        f"{'':<26}{'pitch from':>11}{'to':>9}{'roll from':>12}{'to':>9}{'exact − linear':>17}",
    ]
    for row, response in zip(result["cases"], responses, strict=True):
        p, r = row["pitch"], row["roll"]
        lines.append(
            f"{case_title(response):<26}{number(p['min_arcmin'], 3):>11}{number(p['max_arcmin'], 3):>9}"
            f"{number(r['min_arcmin'], 3):>12}{number(r['max_arcmin'], 3):>9}{number(row['nonlinearity_arcmin'], 5):>17}"
        )
    if "worst_signs" in result:
        w = result["worst_signs"]
        lines.append(
            f"{'all, worst signs':<26}{number(-w['pitch_peak_arcmin'], 3):>11}{number(w['pitch_peak_arcmin'], 3):>9}"
            f"{number(-w['roll_peak_arcmin'], 3):>12}{number(w['roll_peak_arcmin'], 3):>9}"
        )
    return lines


Points = Sequence[tuple[str, float, float]]
"""Name, pitch and roll (rad) of poses."""


def static_dict(points: Points, tables: Sequence[PoseTable]) -> dict[str, Any]:
    """Result of ``mechanism errors static``."""
    rows = []
    for table in tables:
        per, step = PER[table.source.si_unit]
        unit, factor = SHOWN[table.source.si_unit]
        rows.append(
            {
                "source": table.source.name,
                "text": table.source.text,
                "per": per,
                f"sizes_{unit.lower()}": [float(v) * factor for v in table.sizes],
                "nonlinearity_arcmin": table.nonlinearity * ARCMIN,
                "points": [
                    {
                        "point": name,
                        **{f"{axis}_arcmin_per_{per.lower()}": float(table.per_unit[a, k]) * step * ARCMIN for a, axis in enumerate(AXES)},
                        **{f"{axis}_exact_arcmin": [float(v) for v in table.exact[a, k] * ARCMIN] for a, axis in enumerate(AXES)},
                    }
                    for k, (name, _, _) in enumerate(points)
                ],
            }
        )
    return {"points": [{"point": n, "pitch_deg": p * DEG, "roll_deg": r * DEG} for n, p, r in points], "sources": rows}


def static_lines(points: Points, tables: Sequence[PoseTable]) -> list[str]:
    """Text of ``mechanism errors static``."""
    lines = ["attitude error at poses; per unit by the linear model, at the largest size by the exact one"]
    for table in tables:
        per, step = PER[table.source.si_unit]
        largest = shown(float(table.sizes[-1]), table.source.si_unit)
        lines += [
            "",
            f"{table.source.name}: {table.source.text}; exact − linear at most {number(table.nonlinearity * ARCMIN, 3)}{PRIME}",
            f"  {'pose':<22}{'pitch, ' + PRIME + '/' + per:>14}{'roll, ' + PRIME + '/' + per:>14}{'pitch, roll at ' + largest:>30}",
        ]
        for k, (name, pitch, roll) in enumerate(points):
            where = f"{name} ({number(round(pitch * DEG, 6))}°, {number(round(roll * DEG, 6))}°)"
            a, b = (float(table.per_unit[axis, k]) * step * ARCMIN for axis in (0, 1))
            p, r = (float(table.exact[axis, k, -1]) * ARCMIN for axis in (0, 1))
            lines.append(f"  {where:<22}{number(a, 3):>14}{number(b, 3):>14}{number(p, 3) + PRIME + ', ' + number(r, 3) + PRIME:>30}")
    return lines


def envelope(motion: Motion, travel: Travel, response: Response) -> Array:
    """Worst case of the errors of a case along a motion, shape (2, time), rad."""
    matrix = sensitivity(motion.pitch_rad, motion.roll_rad, travel.lengths_m, [s for s, _ in response.case.values])
    return worst_case(matrix, np.abs(np.array([v for _, v in response.case.values])))
