"""Plots of one quantity over another (angle, displacement, time) in the look of the run report's time plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from spsp_ctrl.report.data import FloatArray
from spsp_ctrl.report.svg import HEIGHT, WIDTH, Level, Style, legend_html, nice_ticks, tick_labels


@dataclass(frozen=True)
class Line:
    """One curve; ``soft`` draws it pale, ``dots`` marks every point."""

    name: str
    x: FloatArray
    y: FloatArray
    style: Style
    soft: bool = False
    dots: bool = False


@dataclass(frozen=True)
class Chart:
    """One set of axes. ``reach`` fixes a symmetric ordinate."""

    title: str
    unit: str
    x_label: str
    lines: Sequence[Line]
    levels: Sequence[Level] = ()
    reach: float | None = None
    height_px: int = 200
    note: str = ""


def _range(low: float, high: float, least: float) -> tuple[float, float]:
    if high - low < least:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * least, middle + 0.5 * least
    margin = 0.07 * (high - low)
    return low - margin, high + margin


def _ordinate(chart: Chart, values: FloatArray) -> tuple[float, float]:
    if chart.reach is not None:
        return -chart.reach, chart.reach
    if not len(values):
        return -1.0, 1.0
    low, high = float(values.min()), float(values.max())
    near = 2.0 * max(abs(low), abs(high))
    kept = [level.value for level in chart.levels if abs(level.value) <= near]
    return _range(min([low, *kept]), max([high, *kept]), 1e-3)


def render_chart(chart: Chart) -> str:
    """The chart as HTML: heading with unit and legend, and the SVG."""
    clean = [(line, np.isfinite(line.x) & np.isfinite(line.y)) for line in chart.lines]
    lines = [(line, line.x[good], line.y[good]) for line, good in clean if good.any()]
    every_x = np.concatenate([x for _, x, _ in lines]) if lines else np.array([0.0, 1.0])
    every_y = np.concatenate([y for _, _, y in lines]) if lines else np.empty(0)
    x0, x1 = float(every_x.min()), float(every_x.max())
    if x1 - x0 < 1e-9:
        x0, x1 = x0 - 0.5, x1 + 0.5
    y0, y1 = _ordinate(chart, every_y)

    def across(x: FloatArray | float) -> FloatArray:
        return np.asarray((np.asarray(x) - x0) / (x1 - x0))

    def down(y: FloatArray | float) -> FloatArray:
        return np.asarray((y1 - np.asarray(y)) / (y1 - y0))

    y_ticks = nice_ticks(y0, y1, max(3, chart.height_px // 30))
    x_ticks = nice_ticks(x0, x1, 9)
    grid = "".join(f"M0 {float(down(v)) * HEIGHT:.0f}h{WIDTH}" for v in y_ticks)
    grid += "".join(f"M{float(across(v)) * WIDTH:.0f} 0v{HEIGHT}" for v in x_ticks)
    back = [f'<path class="grid" d="{grid}"/>']
    if y0 < 0.0 < y1:
        back.append(f'<path class="zero" d="M0 {float(down(0.0)) * HEIGHT:.0f}h{WIDTH}"/>')
    levels = [level for level in chart.levels if y0 <= level.value <= y1]
    if levels:
        path = "".join(f"M0 {float(down(level.value)) * HEIGHT:.0f}h{WIDTH}" for level in levels)
        back.append(f'<path class="level" d="{path}"/>')
    drawn, dots = [], []
    for line, x, y in lines:
        px = np.rint(across(x) * WIDTH).astype(int)
        py = np.rint(np.clip(down(y), -50.0, 50.0) * HEIGHT).astype(int)
        path = "M" + " ".join(f"{a} {b}" for a, b in zip(px.tolist(), py.tolist(), strict=True))
        drawn.append(f'<path class="trace {line.style}{" soft" if line.soft else ""}" d="{path}"/>')
        if line.dots:
            fill = "none" if line.soft else f"var(--{line.style})"
            dots += [
                f'<circle cx="{100.0 * a:.2f}%" cy="{100.0 * b:.2f}%" r="2.6" style="fill:{fill};stroke:var(--{line.style})"/>'
                for a, b in zip(across(x).tolist(), down(y).tolist(), strict=True)
            ]
    texts = [
        f'<text x="-8" y="{100.0 * float(down(v)):.2f}%" dy=".35em" text-anchor="end">{label}</text>'
        for v, label in zip(y_ticks, tick_labels(y_ticks), strict=True)
    ]
    texts += [
        f'<text x="{100.0 * float(across(v)):.2f}%" y="100%" dy="1.5em" text-anchor="middle">{label}</text>'
        for v, label in zip(x_ticks, tick_labels(x_ticks), strict=True)
    ]
    texts += [
        f'<text class="side" x="100%" dx="7" y="{100.0 * float(down(level.value)):.2f}%" dy=".35em">{escape(level.label)}</text>'
        for level in levels
    ]
    if not lines:
        texts.append('<text class="none" x="50%" y="50%" dy=".35em" text-anchor="middle">no such signal in these runs</text>')
    legend = legend_html([(f"{line.style}{' soft' if line.soft else ''}", line.name, False) for line, _, _ in lines])
    note = f'<p class="note">{escape(chart.note)}</p>' if chart.note else ""
    return (
        f'<div class="panel"><div class="head"><h4>{escape(chart.title)} <small>{escape(chart.unit)}</small></h4>{legend}</div>'
        f'<svg xmlns="http://www.w3.org/2000/svg" class="plot" style="height:{chart.height_px + 34}px" role="img" '
        f'aria-label="{escape(f"{chart.title}, {chart.unit}, over {chart.x_label}")}">'
        f'<svg width="100%" height="100%" viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none">{"".join(back)}{"".join(drawn)}</svg>'
        f'<rect class="frame" width="100%" height="100%"/>{"".join(dots)}{"".join(texts)}</svg>'
        f'<p class="xlabel">{escape(chart.x_label)}</p>{note}</div>'
    )
