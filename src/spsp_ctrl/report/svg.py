"""Plots as inline SVG: nice ticks, min/max decimation, panels that scale with the page while their text does not.

A panel is one ``<svg>`` without a view box: its labels are placed in percent, so they keep their size at any width. The
traces sit in a nested ``<svg>`` that is stretched, with strokes that are not. Every trace is decimated to the smallest
and the largest sample of each pixel column: taking every n-th sample would hide the spikes that a report must show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.report.data import FloatArray
from spsp_ctrl.report.text import number

WIDTH = 4000
HEIGHT = 2000
COLUMNS = 1100
"""Pixel columns for decimation: about the width of the page on a desktop screen."""

Style = Literal["pitch", "roll", "base", "third"]


@dataclass(frozen=True)
class Trace:
    """One line. ``soft`` draws it thin and pale (a noisy companion), ``area`` fills it down to zero,
    ``bold`` makes it the subject of the figure."""

    name: str
    t_s: FloatArray
    y: FloatArray
    style: Style
    soft: bool = False
    area: bool = False
    bold: bool = False


@dataclass(frozen=True)
class Level:
    """A horizontal dashed line with a label in the right margin."""

    value: float
    label: str


@dataclass(frozen=True)
class Band:
    """A tinted horizontal zone."""

    low: float
    high: float
    style: Literal["good", "warn"]


@dataclass(frozen=True)
class TimeAxis:
    """Common time axis: 0 to ``end_s``, the part that is not judged, and times to mark (faults)."""

    end_s: float
    settle_s: float = 0.0
    marks_s: tuple[float, ...] = ()


@dataclass(frozen=True)
class Panel:
    """One set of axes. ``y_range`` None takes the data's own range; levels far outside that range are not drawn."""

    title: str
    unit: str
    traces: Sequence[Trace]
    levels: Sequence[Level] = ()
    bands: Sequence[Band] = ()
    y_range: tuple[float, float] | None = None
    ticks: Sequence[float] | None = None
    height_px: int = 190
    min_span: float = 1e-3
    note: str = field(default="")


def nice_ticks(low: float, high: float, target: int = 6) -> list[float]:
    """Round values inside [low, high], about ``target`` of them, in steps of 1, 2, 2.5 or 5 times a power of ten."""
    span = high - low
    if not (math.isfinite(span) and span > 0.0):
        return [low] if math.isfinite(low) else []
    raw = span / max(target, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def tick_labels(ticks: Sequence[float]) -> list[str]:
    """Labels of equal precision, as many decimals as the step needs."""
    if len(ticks) < 2:
        return [number(t) for t in ticks]
    step = min(abs(b - a) for a, b in pairwise(ticks))
    decimals = next((d for d in range(7) if abs(round(step, d) - step) < 1e-6 * step), 7)
    return [number(t, decimals) for t in ticks]


def decimate_minmax(t: FloatArray, y: FloatArray, columns: int = COLUMNS) -> NDArray[np.intp]:
    """Indices, ascending, of the smallest and the largest finite sample of each of ``columns`` equal time slots.

    The first and the last finite sample are always among them. Non-finite samples are never chosen.
    """
    finite = np.flatnonzero(np.isfinite(y) & np.isfinite(t))
    if len(finite) <= 2 * columns:
        return finite
    times, values = t[finite], y[finite]
    start, span = float(times.min()), float(np.ptp(times))
    scale = columns / span if span > 0.0 else 0.0
    slot = np.minimum(((times - start) * scale).astype(np.int64), columns - 1)
    order = np.lexsort((values, slot))  # by slot, inside a slot by value: its ends are the minimum and the maximum
    edges = np.flatnonzero(np.diff(slot[order])) + 1
    lowest = order[np.concatenate(([0], edges))]
    highest = order[np.concatenate((edges - 1, [len(order) - 1]))]
    chosen = np.unique(np.concatenate(([0], lowest, highest, [len(finite) - 1])))
    kept: NDArray[np.intp] = finite[chosen]
    return kept


def _breaks(y: FloatArray, index: NDArray[np.intp]) -> NDArray[np.bool_]:
    """For each chosen sample: does a gap of non-finite samples lie before it."""
    holes = np.cumsum(~np.isfinite(y))[index]
    new: NDArray[np.bool_] = np.ones(len(index), dtype=np.bool_)
    new[1:] = np.diff(holes) > 0
    return new


def path_of(trace: Trace, axis: TimeAxis, y_range: tuple[float, float]) -> str:
    """Path data of a trace in the nested view box: ``M x y l dx dy ...`` in integers, ``M`` again behind each gap."""
    index = decimate_minmax(trace.t_s, trace.y)
    if not len(index):
        return ""
    low, high = y_range
    x = np.rint(trace.t_s[index] / axis.end_s * WIDTH).astype(np.int64)
    scaled = (high - trace.y[index]) / (high - low) * HEIGHT
    y = np.rint(np.clip(scaled, -50 * HEIGHT, 50 * HEIGHT)).astype(np.int64)
    new = _breaks(trace.y, index)
    # A sample between two equal neighbours adds nothing to the line.
    inner = np.zeros(len(x), dtype=bool)
    inner[1:-1] = (y[1:-1] == y[:-2]) & (y[1:-1] == y[2:]) & ~new[1:-1] & ~new[2:]
    x, y, new = x[~inner], y[~inner], new[~inner]
    parts: list[str] = []
    for k in range(len(x)):
        if new[k]:
            parts.append(f"M{x[k]} {y[k]}l0 0")
        else:
            parts.append(f" {x[k] - x[k - 1]} {y[k] - y[k - 1]}")
    return "".join(parts)


def auto_range(panel: Panel) -> tuple[float, float]:
    """Range of a panel: its own, or that of its data with the nearer levels, plus a margin. Never empty."""
    if panel.y_range is not None:
        return panel.y_range
    finite = [trace.y[np.isfinite(trace.y)] for trace in panel.traces]
    finite = [y for y in finite if len(y)]
    if not finite:
        return (-1.0, 1.0)
    low = min(float(y.min()) for y in finite)
    high = max(float(y.max()) for y in finite)
    if any(trace.area for trace in panel.traces):
        low, high = min(low, 0.0), max(high, 0.0)
    reach = 2.0 * max(abs(low), abs(high))
    for level in panel.levels:
        if abs(level.value) <= reach:
            low, high = min(low, level.value), max(high, level.value)
    if high - low < panel.min_span:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * panel.min_span, middle + 0.5 * panel.min_span
    margin = 0.07 * (high - low)
    return (low - margin, high + margin)


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.3f}".rstrip("0").rstrip(".") + "%"


def _spread(items: list[tuple[float, str]], least: float) -> list[tuple[float, str]]:
    """Drop labels that stand nearer than ``least`` to one already placed; the outermost are placed first."""
    placed: list[tuple[float, str]] = []
    for at, text in sorted(items, key=lambda item: -abs(item[0] - 0.5)):
        if all(abs(at - other) >= least for other, _ in placed):
            placed.append((at, text))
    return placed


def legend_html(entries: Sequence[tuple[str, str, bool]]) -> str:
    """Legend above the plot: (class, name, has a read-out). It stands outside the axes, so it cannot cover data."""
    items = "".join(
        f'<span class="key"><i class="{cls}"></i>{escape(name)}{"<output></output>" if live else ""}</span>'
        for cls, name, live in entries
    )
    return f'<div class="legend">{items}</div>'


def render_panel(panel: Panel, axis: TimeAxis, last: bool = True) -> str:
    """One panel as HTML: heading with unit and legend, and the SVG. ``last`` adds the caption of the time axis."""
    low, high = auto_range(panel)
    end_s = axis.end_s

    def across(value: float) -> float:
        return (high - value) / (high - low)

    back: list[str] = []
    if axis.settle_s > 0.0:
        width = min(axis.settle_s / end_s, 1.0) * WIDTH
        back.append(f'<rect class="settle" x="0" y="0" width="{width:.0f}" height="{HEIGHT}"/>')
    for band in panel.bands:
        top, bottom = (min(max(across(v), 0.0), 1.0) * HEIGHT for v in (band.high, band.low))
        if bottom > top:
            back.append(f'<rect class="{band.style}" x="0" y="{top:.0f}" width="{WIDTH}" height="{bottom - top:.0f}"/>')
    y_ticks = list(panel.ticks) if panel.ticks is not None else nice_ticks(low, high, max(3, panel.height_px // 27))
    x_ticks = nice_ticks(0.0, end_s * 1.002, 9)  # the last cycle starts one period before the end
    grid = "".join(f"M0 {across(v) * HEIGHT:.0f}h{WIDTH}" for v in y_ticks)
    grid += "".join(f"M{v / end_s * WIDTH:.0f} 0v{HEIGHT}" for v in x_ticks)
    back.append(f'<path class="grid" d="{grid}"/>')
    if low < 0.0 < high:
        back.append(f'<path class="zero" d="M0 {across(0.0) * HEIGHT:.0f}h{WIDTH}"/>')
    levels = [level for level in panel.levels if low <= level.value <= high]
    if levels:
        lines = "".join(f"M0 {across(level.value) * HEIGHT:.0f}h{WIDTH}" for level in levels)
        back.append(f'<path class="level" d="{lines}"/>')
    if axis.marks_s:
        marks = "".join(f"M{t / end_s * WIDTH:.0f} 0v{HEIGHT}" for t in axis.marks_s)
        back.append(f'<path class="mark" d="{marks}"/>')

    lines_out: list[str] = []
    shown = False
    for k, trace in enumerate(panel.traces):
        path = path_of(trace, axis, (low, high))
        if not path:
            continue
        shown = True
        if trace.area:
            zero = min(max(across(0.0), 0.0), 1.0) * HEIGHT
            for run in path.split("M")[1:]:
                first = int(run.split(" ", 1)[0])
                end = first + sum(int(step) for step in run.split("l")[1].split()[::2])
                closed = f"M{first} {zero:.0f}L{run}L{end} {zero:.0f}z"
                lines_out.append(f'<path class="area {trace.style}" d="{closed}"/>')
        soft = (" soft" if trace.soft else "") + (" bold" if trace.bold else "")
        lines_out.append(f'<path class="trace {trace.style}{soft}" data-k="{k}" d="{path}"/>')

    texts: list[str] = []
    for value, label in zip(y_ticks, tick_labels(y_ticks), strict=True):
        texts.append(f'<text x="-8" y="{_percent(across(value))}" dy=".35em" text-anchor="end">{label}</text>')
    for value, label in zip(x_ticks, tick_labels(x_ticks), strict=True):
        texts.append(f'<text x="{_percent(value / end_s)}" y="100%" dy="1.5em" text-anchor="middle">{label}</text>')
    side = _spread([(across(level.value), level.label) for level in levels], 15.0 / panel.height_px)
    for at, label in side:
        texts.append(f'<text class="side" x="100%" dx="7" y="{_percent(at)}" dy=".35em">{escape(label)}</text>')
    if not shown:
        texts.append('<text class="none" x="50%" y="50%" dy=".35em" text-anchor="middle">not in this log</text>')
    entries = [(f"{t.style}{' soft' if t.soft else ''}{' area' if t.area else ''}", t.name, True) for t in panel.traces]
    unit = f" <small>{escape(panel.unit)}</small>" if panel.unit else ""
    note = f'<p class="note">{escape(panel.note)}</p>' if panel.note else ""
    data = f'data-x1="{end_s:.9g}" data-y0="{low:.9g}" data-y1="{high:.9g}"'
    caption = f"{panel.title}, {panel.unit}, over time"
    return (
        f'<div class="panel"><div class="head"><h4>{escape(panel.title)}{unit}</h4>{legend_html(entries)}</div>'
        f'<svg xmlns="http://www.w3.org/2000/svg" class="plot" style="height:{panel.height_px + 34}px" role="img" '
        f'aria-label="{escape(caption)}" {data}>'
        f'<svg width="100%" height="100%" viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none">'
        f"{''.join(back)}{''.join(lines_out)}</svg>"
        f'<rect class="frame" width="100%" height="100%"/>{"".join(texts)}'
        f'<line class="cursor" x1="0" x2="0" y1="0" y2="100%" visibility="hidden"/></svg>'
        f"{'<p class=xlabel>time, s</p>' if last else ''}{note}</div>"
    )
