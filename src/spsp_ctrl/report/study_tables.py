"""Tables of the studies: the ladder of terms over motions with its margins, and what was drawn with the draws that are worst."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from spsp_ctrl.experiments.draws import standing_out
from spsp_ctrl.experiments.margins import MarginRow
from spsp_ctrl.experiments.summary import look_up
from spsp_ctrl.experiments.verdict import CaseResult
from spsp_ctrl.report.page import table
from spsp_ctrl.report.svg import Level, Style
from spsp_ctrl.report.text import DASH, number
from spsp_ctrl.report.xy import Chart, Line, render_chart

WORST = "error_arcmin.worst.imu_max"
RMS = "error_arcmin.worst.imu_rms"
Results = Sequence[CaseResult]
STYLES: tuple[tuple[Style, bool], ...] = (("pitch", False), ("roll", False), ("third", False), ("base", False), ("pitch", True), ("roll", True))


def _names(values: Sequence[str]) -> list[str]:
    return list(dict.fromkeys(values))


def _worst(results: Results, variant: str, motion: str, path: str) -> float | None:
    found = [look_up(r.figures, path) for r in results if (r.variant, r.motion) == (variant, motion)]
    good = [v for v in found if v is not None]
    return max(good) if good and len(good) == len(found) else None


def ladder(results: Results, margins: Sequence[MarginRow]) -> str:
    """Rung by motion, largest and rms; the same as a picture; the margins of each rung."""
    rungs, motions = _names([r.variant for r in results]), _names([r.motion for r in results])
    cells = []
    for rung in rungs:
        row = [escape(rung)]
        for motion in motions:
            top, rms = _worst(results, rung, motion, WORST), _worst(results, rung, motion, RMS)
            row.append(DASH if top is None or rms is None else f"{number(top, 1)} / {number(rms, 2)}")
        cells.append(row)
    out = table(["Rung", *map(escape, motions)], cells, numeric=tuple(range(1, 1 + len(motions))))
    out += '<p class="note">Largest / rms of the worst axis by the IMU, arcmin, after the start-up.</p>'
    lines = []
    for motion, (style, soft) in zip(motions, STYLES, strict=False):
        points = [(k, v) for k, rung in enumerate(rungs) if (v := _worst(results, rung, motion, WORST))]
        x, y = (np.array([p[i] for p in points], dtype=np.float64) for i in (0, 1))
        lines.append(Line(motion, x, np.log10(y) if len(y) else y, style, soft, dots=True))
    levels = [Level(float(np.log10(v)), f"{v:g}′") for v in (0.3, 0.6, 1.0, 3.0, 10.0)]
    title = "Largest error by the IMU, from rung to rung"
    out += render_chart(Chart(title, "log10 arcmin", "rung, by its number", lines, levels, height_px=280))
    return out + (margin_table(margins) if margins else "")


def margin_table(margins: Sequence[MarginRow]) -> str:
    """Gain, phase and disk margin, one row for rungs that share their loops."""
    loops = _names([f"{m.at}, {m.axis}" for m in margins])
    shared: dict[tuple[str, ...], list[str]] = {}
    for variant in _names([m.variant for m in margins]):
        mine = {f"{m.at}, {m.axis}": m.margins for m in margins if m.variant == variant}
        shared.setdefault(tuple(_margin(mine.get(loop)) for loop in loops), []).append(variant)
    rows = [[escape(", ".join(names)), *key] for key, names in shared.items()]
    head = ["Rungs", *loops]
    note = "Gain margin dB / phase margin deg / disk margin, broken at the motor current, at the IMU and at the resolver; nominal plant, 7 kg."
    return "<h3>Margins</h3>" + table(head, rows, numeric=tuple(range(1, 1 + len(loops)))) + f'<p class="note">{note}</p>'


def _margin(found: dict[str, float | None] | None) -> str:
    if found is None:
        return "unstable"
    places = (("gain_db", 1), ("phase_deg", 0), ("disk", 2))
    return " / ".join("∞" if (v := found[name]) is None else number(v, digits) for name, digits in places)


def draws(results: Results, count: int = 5) -> str:
    """Of each variant that draws: how the errors spread, and the worst runs with what stands out in them."""
    out = ""
    for variant in _names([r.variant for r in results if r.drawn]):
        mine = [r for r in results if r.variant == variant and look_up(r.figures, WORST) is not None]
        errors = [look_up(r.figures, WORST) or 0.0 for r in mine]
        if not mine:
            continue
        quantiles = ", ".join(f"{name} {number(float(np.quantile(errors, q)), 2)}" for name, q in (("median", 0.5), ("90 %", 0.9), ("largest", 1.0)))
        out += f"<h3>{escape(variant)}</h3><p>{len(mine)} drawn, largest error by the IMU in arcmin: {quantiles}.</p>"
        order = np.argsort(-np.array(errors), kind="stable")[:count].tolist()
        rows = [[str(mine[i].seed), number(errors[i], 2), escape(what_stands_out(mine[i], mine, errors))] for i in order]
        out += table(["Seed", "Largest, arcmin", "What was drawn"], rows, numeric=(0, 1))
    return out + '<p class="note">A seed with --variant NAME --seed S --repeats 1 plays the run again alone.</p>' if out else ""


def what_stands_out(result: CaseResult, results: Results, errors: Sequence[float]) -> str:
    """A drawn plant: the parameters that stand out. A drawn motion: the motion."""
    if "factors" in result.drawn:
        many = [r.drawn for r in results]
        found = standing_out(result.drawn, many, list(errors))
        return ", ".join(f"{name} × {factor:.2f}" + (f" ({adds:+.2f}′)" if adds else "") for name, factor, adds in found)
    return motion_text(result.drawn.get("motion", {}))


def motion_text(motion: dict[str, Any]) -> str:
    """A motion in words."""
    parts = []
    for axis in ("roll", "pitch"):
        parts += [f"{axis} {s['amplitude_deg']:.1f}° / {s['period_s']:.1f} s at {s['phase_deg']:+.0f}°" for s in motion.get(axis, ())]
        sea = motion.get("sea", {}).get(axis)
        if sea:
            parts.append(f"{axis} sea {sea['rms_deg']:.1f}° rms about {sea['strongest_s']:.1f} s")
    order = motion.get("axis_order", "")
    return ", ".join(parts) + (f"; outer frame in {order.split('_')[0]}" if order else "")
