"""The table that a run prints at its end."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from spsp_ctrl.report.text import DASH, MINUS, THIN_SPACE, grouped, number
from spsp_ctrl.runtime.realtime import degraded


def print_summary(summary: Mapping[str, Any], console: Console, folder: Path | None = None) -> None:
    """Print the verdict of a run: acceptance rows, errors, timing, log, and where the folder is.

    ``summary`` is the content of ``summary.json``; missing figures are shown as dashes. In colour on a terminal, plain
    text without frames elsewhere. The folder is printed unwrapped on a line of its own, so that it can be copied.
    """
    terminal = console.is_terminal
    rows = [row for row in summary.get("acceptance") or () if isinstance(row, Mapping)]
    ended = str(summary.get("ended") or "completed")
    good = not ended.startswith(("fault", "stopped")) and all(row.get("pass") for row in rows)
    table = Table(
        box=box.ROUNDED if terminal else None,
        title=_safe(
            Text(f"{summary.get('scenario') or 'run'}: {ended}", "bold green" if good else "bold red"), console
        ),
        title_justify="left",
        border_style="bright_black",
        header_style="bold",
        padding=(0, 1),
    )
    for title, side in (("", "left"), ("value", "right"), ("limit", "right"), ("unit", "left"), ("verdict", "left")):
        table.add_column(title, justify="right" if side == "right" else "left")

    def add(*cells: str | Text) -> None:
        table.add_row(*(_safe(Text(cell) if isinstance(cell, str) else cell, console) for cell in cells))

    for row in rows:
        verdict = Text("pass", "bold green") if row.get("pass") else Text("FAIL", "bold red")
        if row.get("touched_by_skips"):
            verdict.append(" (skips)", "yellow")
        add(
            str(row.get("name", "")),
            _show(row.get("value"), 3),
            _show(row.get("limit")),
            str(row.get("unit", "")),
            verdict,
        )
    if rows:
        table.add_section()
    for axis in ("pitch", "roll"):
        figures = _map(_map(summary.get("error_arcmin")).get(axis))
        for kind, name in (("imu", "IMU"), ("true", "true")):
            if f"{kind}_max" in figures:
                value = f"{_show(figures.get(f'{kind}_max'), 2)} / {_show(figures.get(f'{kind}_rms'), 2)}"
                add(f"{axis}, {name}, max / rms", value, "", "arcmin", "")
    heading = _map(summary.get("azimuth_error_deg"))
    kind = "true" if "true_max" in heading else "imu"
    if f"{kind}_max" in heading:
        value = f"{_show(heading.get(f'{kind}_max'), 3)} / {_show(heading.get(f'{kind}_rms'), 3)}"
        add(f"azimuth, {'true' if kind == 'true' else 'IMU'}, max / rms", value, "", "deg", "")
    table.add_section()
    timing = _map(summary.get("timing_us"))
    for key, name in (("lateness", "lateness"), ("compute", "compute")):
        figures = _map(timing.get(key))
        if figures:
            add(
                f"{name} p50 / p99 / max",
                " / ".join(_show(figures.get(k), 0) for k in ("p50", "p99", "max")),
                "",
                "µs",
                "",
            )
    add("skipped cycles", _count(timing.get("skipped")), "", "", "")
    buses = _map(summary.get("buses"))
    if buses:
        frames = f"{_count(buses.get('received'))} in, {_count(buses.get('sent'))} out"
        add("frames and pieces of bytes", frames, "", "", "")
        answers = f"{_count(buses.get('statuses_late'))}, {_count(buses.get('statuses_lost'))} of {_count(buses.get('statuses_expected'))}"
        add("drive answers late, lost", answers, "", "", "")
        share = buses.get("io_share_of_period")
        percent = f" ({_show(100.0 * share, 1)} %)" if isinstance(share, int | float) else ""
        add("read and write per cycle", _show(buses.get("io_us_mean"), 0) + percent, "", "µs", "")
    log = _map(summary.get("log"))
    add("log records, lost", f"{_count(log.get('records'))}, {_count(log.get('lost'))}", "", "", "")
    refused = degraded(summary.get("realtime_granted"))
    if refused:
        add("real time", _safe(Text("degraded", "bold red"), console), "", "", "")
    console.print(table)
    for name, why in refused:
        console.print(_safe(Text(f"degraded: {name.replace('_', ' ')} {why}", "red"), console))
    settle = summary.get("settle_s")
    if isinstance(settle, int | float) and settle > 0:
        console.print(Text(f"Errors from {settle:g} s on, after the start-up.", "bright_black"))
    if folder is not None:
        console.print(Text(str(folder)), soft_wrap=True)


def _map(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _show(value: Any, decimals: int | None = None) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return DASH
    return number(float(value), decimals)


def _count(value: Any) -> str:
    return grouped(value) if isinstance(value, int | float) and math.isfinite(value) else DASH


def _safe(text: Text, console: Console) -> Text:
    """ASCII where the console cannot encode more."""
    if console.options.ascii_only:
        plain = text.plain.translate({ord(DASH): "-", ord(MINUS): "-", ord(THIN_SPACE): " ", ord("µ"): "u"})
        return Text(plain.encode("ascii", "replace").decode("ascii"), style=text.style, spans=text.spans)
    return text
