"""Figures of a diagnosis as HTML: waterfall of the gap, bars before and after, map of regimes, sketch of the unknown, correlations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from spsp_ctrl.discrepancy.result import Correlation, Curve, Diagnosis, RegimeCell, Step
from spsp_ctrl.discrepancy.show import Gap
from spsp_ctrl.discrepancy.unknown import Sketch
from spsp_ctrl.report.diagnosis_text import shape
from spsp_ctrl.report.page import table
from spsp_ctrl.report.svg import Band, Panel, Style, TimeAxis, Trace, render_panel
from spsp_ctrl.report.text import number
from spsp_ctrl.report.xy import Chart, Line, render_chart

SCALES = {"m": (1e6, "µm"), "rad": (1e3, "mrad"), "A": (1e3, "mA"), "N": (1.0, "N")}
STRETCH_S = 3.0
STYLE = """
.wf{display:grid;grid-template-columns:minmax(120px,max-content) 1fr max-content;gap:6px 14px;align-items:center;
margin:6px 0 4px;font-size:14px}
.wf .track{position:relative;height:20px;background:var(--bg);border-radius:4px;min-width:120px}
.wf .track i{position:absolute;top:0;bottom:0;border-radius:4px}.wf i.left{background:var(--base);opacity:.55}
.wf i.drop{background:var(--good)}.wf i.rise{background:var(--bad)}.wf i.last{background:var(--pitch)}.wf i.first{background:var(--base)}
.wf .track b{position:absolute;top:-3px;bottom:-3px;width:0;border-left:2px dashed var(--muted)}
.wf .num{font-variant-numeric:tabular-nums}.wf small,.swatches{color:var(--muted)}
.wf .track.thin{display:block;height:11px;margin:2px 0}
.swatches{font-size:13px;margin:2px 0 0}
.swatches i{display:inline-block;width:12px;height:12px;border-radius:3px;margin:0 6px 0 14px;vertical-align:-1px}
.swatches i:first-child{margin-left:0}
table.map td{text-align:center;white-space:nowrap;padding:5px 8px;border-bottom:2px solid var(--card);border-right:2px solid var(--card)}
table.map td:first-child{text-align:left;background:none!important}table.map th{text-align:center;padding:5px 8px}
table.map th:first-child{text-align:left}
table.map small{color:var(--muted)}
.story{font-size:16.5px;line-height:1.6;max-width:78ch}.story p{margin:0 0 8px}.story b{font-weight:650}
"""


def shown(value: float, unit: str) -> str:
    """A size in the unit of reports."""
    factor, name = SCALES.get(unit, (1.0, unit))
    return f"{number(float(f'{value * factor:.3g}'))} {name}"


def floors(value: float) -> str:
    """A ratio to the floor."""
    return number(value, 2 if value < 10 else 1 if value < 100 else 0)


def _at(value: float, low: float, high: float) -> float:
    """Place on a logarithmic scale in per cent."""
    return 100.0 * min(1.0, max(0.0, (math.log(max(value, 1e-9)) - math.log(low)) / (math.log(high) - math.log(low))))


def waterfall(steps: Sequence[Step], gaps: dict[str, Gap]) -> str:
    """For each channel with a gap: where it stood, how far each name brings it down, where it ends, against its floor."""
    parts = []
    for channel in [c for c, g in gaps.items() if g.closed is not None and any(c in s.floors for s in steps)]:
        values = [(s.name, s.floors[channel]) for s in steps if channel in s.floors]
        low, high = 0.5, 1.15 * max(2.0, *(v for _, v in values))
        one = f'<b style="left:{_at(1.0, low, high):.2f}%" title="floor"></b>'
        rows, before = [], values[0][1]
        for k, (name, value) in enumerate(values):
            label = name.replace("_", " ")
            a, b = sorted((_at(before, low, high), _at(value, low, high)))
            if k == 0:
                bar = f'<i class="first" style="left:0;width:{_at(value, low, high):.2f}%"></i>'
                text = f"{floors(value)} floors"
            else:
                kind = "drop" if value <= before else "rise"
                bar = f'<i class="left" style="left:0;width:{a:.2f}%"></i><i class="{kind}" style="left:{a:.2f}%;width:{max(b - a, 0.25):.2f}%"></i>'
                share = (before - value) / max(values[0][1] - 1.0, 1e-9)
                text = (
                    f"{number(-100 * share, 0)} % <small>→ {floors(value)}</small>"
                    if abs(share) >= 0.005
                    else f"<small>no change, {floors(value)}</small>"
                )
            before = value
            rows.append(f'<span>{escape(label)}</span><span class="track">{bar}{one}</span><span class="num">{text}</span>')
        last = values[-1][1]
        rows.append(
            f'<span><b>left</b></span><span class="track"><i class="last" style="left:0;width:{_at(last, low, high):.2f}%"></i>{one}</span>'
            f'<span class="num"><b>{floors(last)}</b> floors</span>'
        )
        parts.append(f"<h3>{escape(channel)} <small>floor {escape(shown(gaps[channel].floor, gaps[channel].unit))}</small></h3>")
        parts.append(f'<div class="wf">{"".join(rows)}</div>')
    if not parts:
        return ""
    legend = (
        '<p class="swatches"><i style="background:var(--base)"></i>recalibrated model<i style="background:var(--good)"></i>taken away by this name'
        '<i style="background:var(--bad)"></i>added<i style="background:var(--pitch)"></i>what is left · dashed: floor · logarithmic scale</p>'
    )
    return legend + "".join(parts)


def bars(gaps: dict[str, Gap], words: dict[str, str]) -> str:
    """Size before and after of every channel, in floors."""
    top = 1.15 * max(
        [2.0, *(g.before / g.floor for g in gaps.values() if g.floor > 0.0), *(g.after / g.floor for g in gaps.values() if g.floor > 0.0)]
    )
    rows = []
    for channel, g in gaps.items():
        low, high = g.interval or (0.0, 0.0)
        closed = (
            "at floor"
            if g.closed is None
            else f"<b>{number(100 * g.closed, 1)} %</b> <small>[{number(100 * low, 1)}, {number(100 * high, 1)}]</small>"
        )
        tracks = ""
        if g.floor > 0.0:
            one = f'<b style="left:{_at(1.0, 0.5, top):.2f}%"></b>'
            pair = ((g.before, "first"), (g.after, "last"))
            tracks = "".join(
                f'<span class="track thin"><i class="{cls}" style="left:0;width:{_at(v / g.floor, 0.5, top):.2f}%">'
                f"</i>{one}</span>"
                for v, cls in pair
            )
        name = f"<b>{escape(channel)}</b><br><small>{escape(words.get(channel, ''))}</small>"
        sizes = f"{shown(g.before, g.unit)} → {shown(g.after, g.unit)}<br><small>floor {shown(g.floor, g.unit)}</small>"
        rows.append((name, f'<div class="wf" style="display:block">{tracks}</div>', sizes, closed))
    return table(("channel", "before (grey), after (blue), floor (dashed)", "rms", "closed [95 %]"), rows, (2, 3), cls="gap")


def stretch(curve: Curve) -> tuple[int, int]:
    """Samples of the ``STRETCH_S`` in which the residual before is strongest."""
    n = len(curve.t_s)
    if n < 3:
        return 0, n
    width = min(n, max(3, round(STRETCH_S / max(float(curve.t_s[1] - curve.t_s[0]), 1e-9))))
    sums = np.concatenate([[0.0], np.cumsum(np.asarray(curve.before) ** 2)])
    first = int(np.argmax(sums[width:] - sums[:-width]))
    return first, first + width


def series(answer: Diagnosis) -> Iterator[str]:
    """A held-out stretch of each channel: residual before and after over the band of the floor."""
    for curve in [c for c in answer.curves if len(c.t_s) > 2]:
        factor, unit = SCALES.get(curve.unit, (1.0, curve.unit))
        a, b = stretch(curve)
        t = np.asarray(curve.t_s[a:b] - curve.t_s[a])
        traces = (
            Trace("before", t, np.asarray(curve.before[a:b] * factor), "base", soft=True),
            Trace("after", t, np.asarray(curve.after[a:b] * factor), "pitch"),
        )
        gap = answer.gap.get(curve.channel)
        bands = () if gap is None else (Band(-gap.floor * factor, gap.floor * factor, "good"),)
        note = f"from {curve.t_s[a]:.1f} s of the held-out data on, where the residual before is strongest; tinted: ± floor"
        yield render_panel(Panel(curve.channel, unit, traces, bands=bands, height_px=150, note=note), TimeAxis(end_s=max(float(t[-1]), 1e-3)))


def _shade(value: float) -> str:
    """Colour of a ratio to the floor: green at it, red from thirty times on."""
    share = min(1.0, max(0.0, math.log(max(value, 1.0)) / math.log(30.0)))
    colour = "var(--good)" if share < 0.08 else "var(--bad)"
    strength = 14 if share < 0.08 else 8 + 52 * share
    return f"background:color-mix(in srgb,{colour} {strength:.0f}%,var(--card))"


def regime_table(cells: Sequence[RegimeCell]) -> str:
    """Regimes down, channels across, before and after in floors."""
    channels = list(dict.fromkeys(c.channel for c in cells))
    regimes = list(dict.fromkeys(c.regime for c in cells))
    at = {(c.channel, c.regime): c for c in cells}
    head = "".join(f"<th>{escape(c)}</th>" for c in channels)
    rows = []
    for regime in regimes:
        line = f"<td>{escape(regime)}</td>"
        for channel in channels:
            cell = at.get((channel, regime))
            line += (
                "<td></td>"
                if cell is None
                else f'<td style="{_shade(cell.after)}"><small>{floors(cell.before)} →</small> <b>{floors(cell.after)}</b></td>'
            )
        rows.append(f"<tr>{line}</tr>")
    return f'<div class="scroll"><table class="map"><thead><tr><th>regime</th>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def sketch_chart(sketch: Sketch) -> str:
    """What is left over the variable that orders it, with two standard errors either way."""
    factor, unit = SCALES.get(sketch.unit, (1.0, sketch.unit))
    lines = []
    styles: tuple[Style, Style] = ("pitch", "roll")
    for (name, x, y, e), style in zip(sketch.curves, styles, strict=False):
        label = "mean" if name == "all" else name
        lines.append(Line(label if sketch.kind == "mean" else f"size, {label}", x, np.asarray(y * factor), style, dots=True))
        lines.append(Line("+2σ", x, np.asarray((y + 2 * e) * factor), style, soft=True))
        lines.append(Line("−2σ", x, np.asarray((y - 2 * e) * factor), style, soft=True))
    title, words = f"{sketch.channel} over {sketch.over}", shape(sketch)
    return render_chart(Chart(title, unit, f"{sketch.over}, {sketch.over_unit}", lines, note=f"{words[0].upper()}{words[1:]}."))


def correlation_table(block: Correlation) -> str:
    """Correlations with strong ones tinted."""
    head = "".join(f"<th>{k + 1}</th>" for k in range(len(block.names)))
    rows = []
    for k, name in enumerate(block.names):
        cells = "".join(
            f'<td style="background:color-mix(in srgb,var(--{"roll" if v > 0 else "pitch"}) {60 * abs(float(v)) * (j != k):.0f}%,var(--card))">'
            f"{number(float(v), 2)}</td>"
            for j, v in enumerate(block.matrix[k])
        )
        rows.append(f"<tr><td>{k + 1} {escape(name)}</td>{cells}</tr>")
    return f'<div class="scroll"><table class="map"><thead><tr><th></th>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'
