"""The report of one run: a single HTML file that needs nothing else, to be read, printed and handed on."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from spsp_ctrl.report import figures, timing_text
from spsp_ctrl.report.data import ARCMIN_PER_RAD, DEG_PER_RAD, RunData, Signals
from spsp_ctrl.report.page import details, facts, page, section, table, tile
from spsp_ctrl.report.svg import TimeAxis, legend_html
from spsp_ctrl.report.text import DASH, PRIME, grouped, number

MAX_EVENTS = 200
_EVENT_KEYS = {"stamp_ns", "id", "kind", "text", "level"}
_TAGS = {"fault": "fail", "skip": "warn", "operator": "warn"}


def write_report(out: Path, data: RunData, summary: Mapping[str, Any]) -> None:
    """Write the report of a run to ``out`` (one HTML file, UTF-8).

    ``summary`` is the content of ``summary.json``. Whatever is missing in data or summary is left out or shown as
    a dash; only an unwritable ``out`` raises (:class:`OSError`).
    """
    signals = Signals(data)
    settle_s = _number(summary.get("settle_s")) or 0.0
    end_s = signals.end_s or _number(summary.get("duration_s")) or 1.0
    axis = TimeAxis(end_s, settle_s, tuple(t for t, _ in signals.fault_times())[:20])
    limits = figures.limits_of(data)
    key = _time_key(axis)
    sections = [
        _verdict(signals, summary, settle_s),
        _run(data, summary, signals),
        section(
            "Attitude of table and platform",
            "What the carrier does to the platform, and what is left of it. Both axes share one scale.",
            figures.attitude(signals, axis),
            key=key,
        ),
        section(
            "Attitude error",
            f"Reference minus attitude in inertial space. The green zone ends at 3{PRIME}, the amber one at 5{PRIME}.",
            figures.attitude_error(signals, axis) + _error_table(summary),
            key=key,
        ),
        section(
            "Azimuth",
            "Heading held over the ground by the stepper in series.",
            figures.azimuth(signals, axis),
            key=key,
        ),
        section(
            "Rods",
            "Travel of the two lead screws from level, load side; speed is travel over 10 ms.",
            figures.rods(signals, axis, limits),
            key=key,
        ),
        section(
            "Drives and compensation",
            "Currents as the drives report them; the corrections as the controller applies them.",
            figures.drives(signals, axis, limits),
            key=key,
        ),
        section("Loop timing", timing_text.lead(summary), timing_text.body(signals, summary)),
        section("Events", "Mode changes, faults and operator requests.", _events(signals, data)),
        section("Record", "What is needed to repeat this run.", _record(data, summary), cls="record"),
    ]
    title = _text(summary.get("scenario")) or "run"
    badges = [_text(summary.get("mode")), "virtual rig" if summary.get("virtual") else "hardware"]
    marks = "".join(f'<span class="badge">{escape(text)}</span>' for text in badges if text)
    header = (
        f'<header><div><div class="brand">spsp-ctrl · run report</div><h1>{escape(title)}</h1></div>'
        f"<div>{marks}</div></header>"
    )
    footer = "Plots show the smallest and the largest sample of every pixel column: no spike is lost. "
    footer += "Point at a plot to read all signals at that time."
    out.write_text(page(f"{title} · spsp-ctrl", header, sections, footer), encoding="utf-8")


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _text(value: Any) -> str:
    return "" if value is None else str(value)


def _show(value: Any, decimals: int | None = None) -> str:
    found = _number(value)
    return DASH if found is None else number(found, decimals)


def _count(value: Any) -> str:
    found = _number(value)
    return DASH if found is None else grouped(found)


def _at(summary: Mapping[str, Any], *path: str) -> Any:
    node: Any = summary
    for key in path:
        node = node.get(key) if isinstance(node, Mapping) else None
    return node


def _rows(summary: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    rows = summary.get("acceptance")
    return [row for row in rows if isinstance(row, Mapping)] if isinstance(rows, Sequence) else []


def _headline(summary: Mapping[str, Any], task: str) -> tuple[str, str]:
    """Verdict and its colour class."""
    rows, ended = _rows(summary), _text(summary.get("ended")) or "completed"
    held = {"level": "Held level", "attitude": "Followed its attitude reference"}.get(
        task, "Followed its joint reference"
    )
    failed = [row for row in rows if not row.get("pass")]
    if ended.startswith("fault"):
        return f"Stopped by a {ended}", "fail"
    if ended.startswith("stopped"):
        return ended.capitalize(), "fail"
    if failed:
        count = "1 acceptance row" if len(failed) == 1 else f"{len(failed)} acceptance rows"
        return f"Not accepted: {count} of {len(rows)} failed", "fail"
    if ended == "interrupted":
        return "Interrupted; all rows passed up to then" if rows else "Interrupted", "warn"
    if not rows:
        return "Completed; no acceptance rows to judge", "warn"
    if any(row.get("touched_by_skips") for row in rows):
        return f"{held}; some rows touched by skipped cycles", "warn"
    return held, "pass"


def _verdict(signals: Signals, summary: Mapping[str, Any], settle_s: float) -> str:
    title, cls = _headline(summary, signals.task(settle_s))
    source, key = ("true", "true_max") if _has_true(summary) else ("IMU-measured", "imu_max")
    tiles = []
    for axis in ("pitch", "roll"):
        value = _at(summary, "error_arcmin", axis, key)
        tiles.append(tile(_show(value, 2), "arcmin", f"largest {axis} error, {source}"))
    swings, ratio = _swings(signals, settle_s)
    if swings:
        tiles.append(tile(f"±{number(swings[0], 1)}° · ±{number(swings[1], 1)}°", "", "table swing, pitch · roll"))
    if ratio is not None:
        tiles.append(tile(f"{grouped(float(f'{ratio:.2g}'))} : 1", "", "rms table swing : rms error"))
    if not swings:
        tiles.append(tile(_show(_at(summary, "timing_us", "skipped")), "", "skipped cycles"))
    judged = (
        f"Figures from {number(settle_s)} s on, after the start-up." if settle_s > 0 else "Figures over the whole run."
    )
    return section(title, judged, f'<div class="tiles">{"".join(tiles)}</div>{_acceptance(summary)}', f"verdict {cls}")


def _has_true(summary: Mapping[str, Any]) -> bool:
    return all(_number(_at(summary, "error_arcmin", axis, "true_max")) is not None for axis in ("pitch", "roll"))


def _swings(signals: Signals, settle_s: float) -> tuple[list[float], float | None]:
    """Largest table swing in degrees per axis, and rms table motion over rms platform error (both axes together)."""
    swings: list[float] = []
    base_square = error_square = 0.0
    for axis in ("pitch", "roll"):
        base = signals.base(axis)
        error = signals.error(axis, true=signals.has_truth)
        if base is None or error is None or not len(base.after(settle_s)) or not len(error.after(settle_s)):
            return [], None
        swings.append(float(np.abs(base.after(settle_s)).max()) * DEG_PER_RAD)
        base_square += float(np.mean(base.after(settle_s) ** 2))
        error_square += float(np.mean(error.after(settle_s) ** 2))
    # A table at rest says nothing about isolation.
    still = base_square < (1.0 / ARCMIN_PER_RAD) ** 2 or error_square <= 0.0
    return swings, None if still else math.sqrt(base_square / error_square)


def _acceptance(summary: Mapping[str, Any]) -> str:
    rows = _rows(summary)
    if not rows:
        return '<p class="note">The scenario names no acceptance rows.</p>'
    cells, touched = [], False
    for row in rows:
        value, limit, unit = _number(row.get("value")), _number(row.get("limit")), _text(row.get("unit"))
        passed, skip = bool(row.get("pass")), bool(row.get("touched_by_skips"))
        touched |= skip
        share = min(abs(value / limit), 1.0) if value is not None and limit else 0.0
        bar = f'<div class="bar{"" if passed else " fail"}"><i style="width:{100 * share:.0f}%"></i></div>'
        verdict = f'<span class="tag {"pass" if passed else "fail"}">{"✓ pass" if passed else "✗ fail"}</span>'
        if skip:
            verdict += ' <span class="tag warn">† skips</span>'
        name = escape(_text(row.get("name")))
        shown = DASH if value is None else number(value, 3)
        cells.append([name, shown, DASH if limit is None else number(limit), escape(unit), bar, verdict])
    html = table(
        ["Acceptance", "Value", "Limit", "Unit", "Share of limit", "Verdict"], cells, numeric=(1, 2), cls="rows"
    )
    if touched:
        text = "† Cycles were skipped while this figure was taken: the machine, not the law, may be the cause."
        html += f'<p class="note">{text}</p>'
    return html


def _run(data: RunData, summary: Mapping[str, Any], signals: Signals) -> str:
    clock = {"lock-step": "in lock-step (simulated time)", "real-time": "in real time"}.get(
        _text(summary.get("mode")), _text(summary.get("mode"))
    )
    lead = (
        f"{_text(summary.get('rig')) or 'The rig'} played {_text(summary.get('scenario')) or 'a scenario'} "
        f"under the law {_text(summary.get('law')) or DASH} {clock}: {_show(summary.get('duration_s'))} s at "
        f"{_show(summary.get('rate_hz'))} Hz."
    )
    items = [
        ("Rig", _text(summary.get("rig")) or DASH),
        ("Scenario", _text(summary.get("scenario")) or DASH),
        ("Law", _text(summary.get("law")) or DASH),
        ("Seed", _text(summary.get("seed")) or DASH),
        ("Ended", _text(summary.get("ended")) or DASH),
        ("Log", f"{_count(_at(summary, 'log', 'records'))} records, {_count(_at(summary, 'log', 'lost'))} lost"),
    ]
    versions = next((v for k, v in data.metadata.items() if "version" in k.lower()), {})
    if versions:
        items.append(("Versions", ", ".join(f"{k} {v}" for k, v in versions.items())))
    body = facts(items)
    if not signals.has_truth:
        body += (
            '<p class="note">This log holds no true states (real hardware, or not recorded): the true attitude '
            "and true errors are left out, and every error is as the IMU sees it.</p>"
        )
    if signals.base("pitch") is None:
        body += '<p class="note">No swing-table attitude in this log: the table is left out of the figures.</p>'
    return section("The run", lead, body)


def _time_key(axis: TimeAxis) -> str:
    """What the shading means, once per figure."""
    entries = []
    if axis.settle_s > 0.0:
        entries.append(("start", f"start-up, to {number(axis.settle_s)} s: not judged", False))
    if axis.marks_s:
        entries.append(("mark", "fault", False))
    return legend_html(entries) if entries else ""


def _error_table(summary: Mapping[str, Any]) -> str:
    cells = []
    for axis in ("pitch", "roll"):
        values = [
            _show(_at(summary, "error_arcmin", axis, k), 3) for k in ("imu_max", "imu_rms", "true_max", "true_rms")
        ]
        cells.append([axis, *values])
    head = ["Error after start-up, arcmin", "IMU max", "IMU rms", "true max", "true rms"]
    return "<h3>In figures</h3>" + table(head, cells, numeric=(1, 2, 3, 4))


def _events(signals: Signals, data: RunData) -> str:
    rows: list[tuple[float, str, str]] = []
    for event in data.events:
        stamp = event.get("stamp_ns")
        t_s = (stamp - signals.t0_ns) * 1e-9 if isinstance(stamp, int) else math.nan
        extra = ", ".join(f"{k} {v}" for k, v in event.items() if k not in _EVENT_KEYS and v not in ("", None))
        text = " · ".join(part for part in (_text(event.get("text")), extra) if part)
        rows.append((t_s, _kind(event), text))
    kinds = {kind for _, kind, _ in rows}
    if "mode" not in kinds:
        rows += [(t, "mode", text) for t, text in signals.mode_changes()]
    if "fault" not in kinds:
        rows += [(t, "fault", f"fault number {fault}") for t, fault in signals.fault_times()]
    rows += [(t, "operator", text) for t, text in signals.operator_requests()]
    if not rows:
        return '<p class="note">No events in this log.</p>'
    rows.sort(key=lambda row: (math.isnan(row[0]), row[0]))
    rows = _merged(rows)
    cells = [
        [number(t, 3), f'<span class="tag {_TAGS.get(kind, "")}">{escape(kind)}</span>', _event_text(text)]
        for t, kind, text in rows[:MAX_EVENTS]
    ]
    html = table(["Time, s", "Kind", "What happened"], cells, numeric=(0,), cls="log")
    if len(rows) > MAX_EVENTS:
        html += f'<p class="note">{len(rows) - MAX_EVENTS} later events are in the log only.</p>'
    return html


def _kind(event: Mapping[str, Any]) -> str:
    name = _text(event.get("id") or event.get("kind")) or "event"
    return "fault" if event.get("level") == "error" else name


def _merged(rows: list[tuple[float, str, str]]) -> list[tuple[float, str, str]]:
    """Put consecutive skips into one row: a slow machine must not bury the rest."""
    out: list[tuple[float, str, str]] = []
    for kind, group in groupby(rows, key=lambda row: row[1]):
        run = list(group)
        if kind == "skip" and len(run) > 2:
            text = f"cycles skipped at {len(run)} times, the last at {number(run[-1][0], 3)} s"
            out.append((run[0][0], kind, text))
        else:
            out += run
    return out


def _event_text(text: str) -> str:
    first, _, rest = text.partition("\n")
    return escape(first) + (details("more", rest) if rest.strip() else "")


def _record(data: RunData, summary: Mapping[str, Any]) -> str:
    parts = [details("summary.json", json.dumps(summary, indent=2, ensure_ascii=False, default=str))]
    for name, record in data.metadata.items():
        parts.append(details(f"Metadata: {name}", "\n".join(f"{k}: {v}" for k, v in record.items())))
    parts += [details(f"{name}", text) for name, text in data.attachments.items()]
    return "".join(parts)
