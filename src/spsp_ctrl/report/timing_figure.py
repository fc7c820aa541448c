"""Histogram of loop timing: counts over microseconds, both axes logarithmic, so that one late cycle shows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from spsp_ctrl.report.data import FloatArray
from spsp_ctrl.report.svg import HEIGHT, WIDTH, Style
from spsp_ctrl.report.text import number

PER_DECADE = 14
_LABEL_HALF = 0.0065
"""Half the width of one character, as a share of a printed plot."""
_MARKS = (("max", "max"), ("p50", "p50"), ("p99", "p99"), ("p99_9", "p99.9"))


def log_histogram(values_us: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Bin edges in µs (logarithmic, whole decades) and counts. Values of zero or less are counted in the first bin."""
    finite = values_us[np.isfinite(values_us)]
    positive = finite[finite > 0.0]
    if not len(positive):
        return np.array([1.0, 10.0]), np.array([float(len(finite))])
    low = math.floor(math.log10(max(float(np.quantile(positive, 0.001)), 0.1)))
    high = max(math.ceil(math.log10(float(positive.max())) + 1e-9), low + 1)
    edges = np.logspace(low, high, (high - low) * PER_DECADE + 1)
    inside = np.clip(finite, edges[0], edges[-1] * (1.0 - 1e-12))
    counts, _ = np.histogram(inside, edges)
    return edges, counts.astype(np.float64)


def render_histogram(
    title: str, values_us: FloatArray, stats: Mapping[str, Any], style: Style, period_us: float | None
) -> str:
    """One histogram as HTML. ``stats`` are the percentiles of ``summary.json``; ``period_us`` is drawn when it fits."""
    edges, counts = log_histogram(values_us)
    low, high = math.log10(edges[0]), math.log10(edges[-1])
    if period_us is not None and high < math.log10(period_us) <= high + 1.0:
        high = float(math.ceil(math.log10(period_us) + 1e-9))
    top = max(1.0, math.ceil(math.log10(max(float(counts.max()), 1.0)) + 0.15))

    def across(value_us: float) -> float:
        return (math.log10(max(value_us, 1e-9)) - low) / (high - low)

    def up(count: float) -> float:
        # Half a decade below 1 carries the bins that hold a single cycle.
        return (math.log10(max(count, 1e-9)) + 0.5) / (top + 0.5)

    outline = f"M{across(edges[0]) * WIDTH:.0f} {HEIGHT}"
    for k, count in enumerate(counts):
        height = HEIGHT * (1.0 - max(0.0, up(count))) if count > 0 else float(HEIGHT)
        outline += f"V{height:.0f}H{across(edges[k + 1]) * WIDTH:.0f}"
    outline += f"V{HEIGHT}z"
    decades_x = [10.0**k for k in range(round(low), round(high) + 1)]
    decades_y = [10.0**k for k in range(round(top) + 1)]
    grid = "".join(f"M{across(v) * WIDTH:.0f} 0v{HEIGHT}" for v in decades_x)
    grid += "".join(f"M0 {(1.0 - up(v)) * HEIGHT:.0f}h{WIDTH}" for v in decades_y)
    texts = [
        f'<text x="{100 * across(v):.2f}%" y="100%" dy="1.5em" text-anchor="middle">{_plain(v)}</text>'
        for v in decades_x
    ]
    texts += [
        f'<text x="-8" y="{100 * (1.0 - up(v)):.2f}%" dy=".35em" text-anchor="end">{_plain(v)}</text>'
        for v in decades_y
    ]
    stems = {"": "", " period": ""}
    placed: list[tuple[float, float]] = []
    marks = [(name, float(stats[key])) for key, name in _MARKS if _is_number(stats.get(key))]
    if period_us is not None:
        marks.insert(0, (f"period {_plain(period_us)}", period_us))
    for name, value in marks:
        at = across(value)
        if not 0.0 <= at <= 1.0:
            continue
        stems[" period" if name.startswith("period") else ""] += f"M{at * WIDTH:.0f} 0v{HEIGHT}"
        half = len(name) * _LABEL_HALF
        # A label that would touch another one is left to the table below.
        if all(abs(at - other) > half + other_half for other, other_half in placed):
            placed.append((at, half))
            texts.append(f'<text x="{100 * at:.2f}%" y="0" dy="-.5em" text-anchor="middle">{name}</text>')
    lines = "".join(f'<path class="stem{cls}" d="{d}"/>' for cls, d in stems.items() if d)
    return (
        f'<div class="panel"><div class="head"><h4>{title} <small>number of cycles</small></h4></div>'
        f'<svg xmlns="http://www.w3.org/2000/svg" class="plot hist" style="height:230px" role="img" '
        f'aria-label="Histogram: {title}"><svg width="100%" height="100%" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'preserveAspectRatio="none"><path class="grid" d="{grid}"/><path class="area {style}" d="{outline}"/>'
        f'<path class="trace {style}" d="{outline}"/>{lines}</svg>'
        f'<rect class="frame" width="100%" height="100%"/>{"".join(texts)}</svg><p class="xlabel">µs</p></div>'
    )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _plain(value: float) -> str:
    """Short thousands: 10, 1 k, 100 k."""
    if value >= 1e6:
        return f"{number(value / 1e6)} M"
    return f"{number(value / 1e3)} k" if value >= 1e4 else number(value)
