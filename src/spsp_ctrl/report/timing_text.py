"""The section of a run report on loop timing: histograms, stages of the cycle, and what the machine granted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from spsp_ctrl.report.data import Signals
from spsp_ctrl.report.page import facts, table
from spsp_ctrl.report.text import DASH, number
from spsp_ctrl.report.timing_figure import render_histogram
from spsp_ctrl.runtime.realtime import degraded

_STAGES = (("read", "read the rig"), ("control", "judge, estimate, control"), ("write", "write the command"), ("record", "hand over the record"))
QUANTILES = (0.5, 0.99, 0.999, 1.0)


def lead(summary: Mapping[str, Any]) -> str:
    """What the figures mean."""
    if summary.get("mode") == "lock-step":
        return "Lock-step: time waits for the loop, so no cycle can be late. Compute time is wall-clock time."
    skipped = _map(summary.get("timing_us")).get("skipped")
    text = f"Lateness is the wake-up after the deadline; compute is the cycle without pacing. Skipped cycles: {_show(skipped)}."
    return f"{text} A cycle that could not begin within its period is left out and the last command keeps acting."


def body(signals: Signals, summary: Mapping[str, Any]) -> str:
    """The section as HTML."""
    rate = summary.get("rate_hz")
    period_us = 1e6 / rate if isinstance(rate, int | float) and rate > 0 else None
    lock_step = summary.get("mode") == "lock-step"
    figures, cells = [], []
    for key, title, style in (("lateness", "Lateness", "pitch"), ("compute", "Compute time", "third")):
        stats = _map(_map(summary.get("timing_us")).get(key))
        cells.append([title, *(_show(stats.get(k), 1) for k in ("p50", "p99", "p99_9", "max"))])
        values_us = signals.column("/timing", f"{key}_ns") * 1e-3
        if len(values_us) and not (key == "lateness" and lock_step):
            figures.append(render_histogram(title, values_us, stats, "pitch" if style == "pitch" else "third", period_us))
    for key, title in _STAGES:
        values_us = signals.column("/timing", f"{key}_ns") * 1e-3
        if len(values_us):
            cells.append([title, *(_show(float(q), 1) for q in np.quantile(values_us, QUANTILES))])
    if not figures:
        figures.append('<p class="note">No cycle times in this log.</p>')
    html = "".join(figures) + "<h3>In figures</h3>"
    html += table(["µs", "p50", "p99", "p99.9", "max"], cells, numeric=(1, 2, 3, 4))
    return html + _granted(summary.get("realtime_granted"))


def _granted(granted: Any) -> str:
    rows = _flat({k: v for k, v in _map(granted).items() if k != "degraded"})
    if not rows:
        return ""
    refused = degraded(granted)
    note = ""
    if refused:
        names = ", ".join(name.replace("_", " ") for name, _ in refused)
        note = f'<p><span class="tag fail">degraded</span> not granted: {escape(names)}. The figures are those of a loop without it.</p>'
    return "<h3>What the machine granted</h3>" + note + facts(rows)


def _flat(node: Any, prefix: str = "") -> list[tuple[str, str]]:
    if not isinstance(node, Mapping):
        return []
    rows: list[tuple[str, str]] = []
    for key, value in node.items():
        name = f"{prefix}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            rows += _flat(value, f"{name} · ")
        elif isinstance(value, bool):
            rows.append((name, "yes" if value else "no"))
        else:
            rows.append((name, DASH if value is None else str(value)))
    return rows


def _map(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _show(value: Any, decimals: int | None = None) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return DASH
    return number(float(value), decimals)
