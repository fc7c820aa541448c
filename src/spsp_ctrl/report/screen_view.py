"""How the live screen looks: pure functions from a status to a rich renderable. No terminal is touched here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from spsp_ctrl.report.status import History, Status
from spsp_ctrl.report.text import DASH, MINUS, PRIME, THIN_SPACE, grouped, number

GREEN_ARCMIN = 3.0
YELLOW_ARCMIN = 5.0
MAX_WIDTH = 118
TILT_RANGE_DEG = 20.0
"""Half range of the level gauges; both gauges of an axis share it, so that they can be compared."""

_SPARK = "▁▂▃▄▅▆▇█"
_MODE_STYLE = {
    "ACTIVE": "bold black on green",
    "ALIGNING": "bold black on cyan",
    "HOMING": "bold black on cyan",
    "READY": "bold white on blue",
    "DISARMED": "bold white on bright_black",
    "STOPPING": "bold black on yellow",
    "FAULT": "bold white on red",
}
_ASCII = str.maketrans(
    dict(zip(_SPARK, "_.:-=+*#", strict=True))
    | {"━": "=", "─": "-", "┼": "+", "●": "o", "├": "|", "┤": "|", "│": "|", "°": " ", "µ": "u", "·": "-"}
    | {"→": ">", "←": "<", "…": ".", MINUS: "-", DASH: "-", PRIME: "'", THIN_SPACE: " "}
)
_KEYS = (("a", "arm"), ("d", "disarm"), ("s", "stop"), ("q", "quit"), ("←→", "heading"), ("r", "reset"), ("?", "help"))
_HELP = (
    "space stops, too. Stop brings the platform to rest under control; quit does so and ends the run. "
    "An arrow turns the heading by 5°. Reset clears a latched fault. Ctrl-C ends the run."
)


def render(status: Status, history: History, show_help: bool = False) -> RenderableType:
    """The screen for ``status``. It fits itself to the width and height at which it is drawn (60 columns and more)."""
    return _Screen(status, history, show_help)


class _Screen:
    def __init__(self, status: Status, history: History, show_help: bool) -> None:
        self._status, self._history, self._show_help = status, history, show_help

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width = max(30, min(options.max_width, MAX_WIDTH))
        height = options.height or options.max_height
        framed = width >= 76 and height >= 22
        plain = options.ascii_only
        lines: list[RenderableType] = [_finish(line, plain) for line in _title(self._status, width)]
        draw = _framed if framed else _bare
        lines += draw(self._status, self._history, width, plain)
        lines += [_finish(line, plain) for line in _foot(self._show_help, width)]
        yield Group(*lines)


def plain_line(status: Status) -> str:
    """One line of text for terminals that cannot be drawn on."""
    pitch, roll = (_fixed(status.get(key), 2) for key in ("error_pitch_arcmin", "error_roll_arcmin"))
    text = (
        f"{_fixed(status.get('elapsed_s'), 1)} s  {_clean(status.get('mode'))}  error pitch {pitch} roll {roll} arcmin"
        f"  skipped {_fixed(status.get('skipped'), 0)}"
    )
    return text.translate(_ASCII)


def _framed(status: Status, history: History, width: int, plain: bool) -> list[RenderableType]:
    wide = width >= 110
    count = 3 if wide else 2
    inner = width // count - 4
    attitude = _panel("Attitude", _attitude(status, history, width - 4), width, plain)
    rods = ("Rods", _rods(status, inner))
    azimuth = ("Azimuth", _azimuth(status, inner))
    loop, log = ("Loop", _loop(status, inner)), ("Log", _log(status, inner))
    if wide:
        blocks = [rods, azimuth, ("Loop", _loop(status, inner)[:2])]
        tail = [_finish(_joined([_skips(status), *_log(status, width)[:1], _event(status, width)], width), plain)]
        return [attitude, _row(blocks, width, plain), *tail]
    return [attitude, _row([rods, azimuth], width, plain), _row([loop, log], width, plain)]


def _bare(status: Status, history: History, width: int, plain: bool) -> list[RenderableType]:
    lines: list[Text] = []
    lines += [_rule("Attitude", width), *_attitude(status, history, width)]
    lines += [_rule("Rods and azimuth", width), *_rods(status, width), *_azimuth(status, width)]
    lines += [_rule("Loop and log", width), *_loop(status, width), *_log(status, width)[:1], _event(status, width)]
    return [_finish(line, plain) for line in lines]


def _panel(title: str, lines: Sequence[Text], width: int, plain: bool) -> Panel:
    body = Group(*(_finish(line, plain) for line in lines))
    return Panel(body, title=Text(title, "bold"), title_align="left", width=width, border_style="bright_black")


def _row(blocks: Sequence[tuple[str, Sequence[Text]]], width: int, plain: bool) -> RenderableType:
    grid = Table.grid(padding=0)
    share = width // len(blocks)
    rows = max(len(lines) for _, lines in blocks)
    cells = []
    for title, lines in blocks:
        filled = [*lines, *[Text("") for _ in range(rows - len(lines))]]
        grid.add_column(width=share)
        cells.append(_panel(title, filled, share, plain))
    grid.add_row(*cells)
    return grid


def _title(status: Status, width: int) -> list[Text]:
    mode = _clean(status.get("mode")) or DASH
    clock = _clean(status.get("clock"))
    left = Text.assemble(
        ("spsp-ctrl ", "bold"),
        (" · ".join(filter(None, (_clean(status.get("rig")), _clean(status.get("scenario"))))), "default"),
    )
    right = Text.assemble(
        (clock + " " if clock else "", "green" if clock == "real-time" else "cyan"),
        (f" {mode} ", _MODE_STYLE.get(mode, "bold reverse")),
    )
    left.truncate(max(0, width - right.cell_len - 1), overflow="ellipsis")
    top = Text.assemble(left, " " * max(1, width - left.cell_len - right.cell_len), right)
    elapsed, duration = _float(status.get("elapsed_s")), _float(status.get("duration_s"))
    label = f" {_fixed(elapsed, 1)} / {_fixed(duration, 1)} s"
    room = max(4, width - len(label))
    share = min(max(elapsed / duration, 0.0), 1.0) if duration and duration > 0.0 and elapsed is not None else 0.0
    done = round(share * room)
    bar = Text.assemble(("━" * done, "cyan"), ("━" * (room - done), "bright_black"), (label, "default"))
    lines = [top, bar]
    fault = _clean(status.get("fault"))
    if fault:
        first, *more = _wrap(fault, width - 8)
        lines.append(Text.assemble((" FAULT ", "bold white on red"), " ", (first.plain, "bold red")))
        lines += [Text(" " * 8 + line.plain, "red") for line in more[:1]]
    return lines


def _attitude(status: Status, history: History, width: int) -> list[Text]:
    gauge = max(3, min(37, (width - 44) // 2))
    gauge -= 1 - gauge % 2  # odd, so that there is a middle
    head = Text(style="bright_black")
    head.append(f"{'':6}{'table':>8} {'':{gauge}}  {'platform':>9} {'':{gauge}}  {'error':>7} {'max':>7}")
    lines = [head]
    for axis in ("pitch", "roll"):
        base, platform = _float(status.get(f"base_{axis}_deg")), _float(status.get(f"platform_{axis}_deg"))
        error, peak = _float(status.get(f"error_{axis}_arcmin")), _float(status.get(f"error_{axis}_max_arcmin"))
        tint = _error_style(error)
        line = Text.assemble(
            (f"{axis:6}", "bold"),
            f"{_signed(base, 2, '°'):>8} ",
            _gauge(base, -TILT_RANGE_DEG, TILT_RANGE_DEG, gauge, "white"),
            f"  {_signed(platform, 3, '°'):>9} ",
            _gauge(platform, -TILT_RANGE_DEG, TILT_RANGE_DEG, gauge, f"bold {tint}"),
            (f"  {_fixed(abs(error) if error is not None else None, 2) + PRIME:>7}", f"bold {tint}"),
            (f" {_fixed(peak, 2) + PRIME:>7}", _error_style(peak)),
        )
        lines.append(line)
    room = width - 12 - 8
    recent = [value for axis in (history.pitch, history.roll) for value in list(axis)[-room:] if math.isfinite(value)]
    top = next((t for t in (0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 60.0) if t >= max(recent, default=0.0)), 600.0)
    for axis, values in (("pitch", history.pitch), ("roll", history.roll)):
        chart = _sparkline(list(values)[-room:], top, room)
        scale = Text(f" 0{DASH}{number(top)}{PRIME}", "bright_black")
        lines.append(Text.assemble((f"error {axis:6}", "bright_black"), chart, scale))
    return lines


def _sparkline(values: Sequence[float], top: float, width: int) -> Text:
    line = Text(" " * (width - len(values)))
    for value in values:
        if math.isfinite(value):
            level = min(int(value / top * len(_SPARK)), len(_SPARK) - 1)
            line.append(_SPARK[level], _error_style(value))
        else:
            line.append(" ")
    return line


def _gauge(value: float | None, low: float, high: float, width: int, style: str, ends: bool = False) -> Text:
    """A level: track with zero mark and bubble. Values outside stick to the end."""
    track = ["─"] * width

    def place(number_: float) -> int:
        return min(max(round((number_ - low) / (high - low) * (width - 1)), 0), width - 1)

    if ends:
        track[0], track[-1] = "├", "┤"
    if low < 0.0 < high:
        track[place(0.0)] = "┼"
    line = Text("".join(track), "bright_black")
    if value is not None and math.isfinite(value) and high > low:
        at = place(value)
        line = Text.assemble(
            ("".join(track[:at]), "bright_black"), ("●", style), ("".join(track[at + 1 :]), "bright_black")
        )
    return line


def _rods(status: Status, width: int) -> list[Text]:
    low, high = _float(status.get("stroke_min_mm")) or -1.0, _float(status.get("stroke_max_mm")) or 1.0
    room = max(5, min(41, width - 6 - 11 - 1))
    lines = []
    for axis in ("pitch", "roll"):
        rod = _float(status.get(f"rod_{axis}_mm"))
        used = max(rod / high, rod / low) if rod is not None and low < 0.0 < high else 0.0
        tint = "red" if used > 0.98 else "yellow" if used > 0.9 else "green"
        lines.append(
            Text.assemble(
                (f"{axis:6}", "bold"),
                f"{_signed(rod, 2, ' mm'):>10} ",
                _gauge(rod, low, high, room, f"bold {tint}", ends=True),
            )
        )
    return lines


def _azimuth(status: Status, width: int) -> list[Text]:
    heading, target = _float(status.get("heading_deg")), _float(status.get("heading_target_deg"))
    joint, limit = _float(status.get("azimuth_deg")), _float(status.get("azimuth_limit_deg")) or 180.0
    first = Text.assemble(
        ("heading", "bold"),
        f"{_signed(heading, 2, '°'):>9}  ",
        ("target ", "bright_black"),
        _signed(target, 1, "°"),
    )
    room = max(5, min(41, width - 7 - 9 - 1))
    second = Text.assemble(
        ("joint  ", "bold"),
        f"{_signed(joint, 1, '°'):>9} ",
        _gauge(joint, -limit, limit, room, "bold cyan", ends=True),
    )
    return [first, second]


def _loop(status: Status, width: int) -> list[Text]:
    def pair(name: str, key: str) -> Text:
        return Text.assemble(
            (f"{name:9}", "bold"),
            ("p50 ", "bright_black"),
            f"{_fixed(status.get(f'{key}_p50_us'), 0):>4}",
            ("  max ", "bright_black"),
            f"{_fixed(status.get(f'{key}_max_us'), 0):>5} µs",
        )

    rate = Text.assemble(("rate ", "bold"), f"{_fixed(status.get('rate_hz'), 0)} Hz   ", _skips(status))
    return [pair("lateness", "lateness"), pair("compute", "compute"), rate]


def _skips(status: Status) -> Text:
    skipped = _float(status.get("skipped"))
    degraded = ("degraded ", "bold red") if status.get("degraded") else ""
    return Text.assemble(degraded, ("skipped ", "bold"), (_count(skipped), "bold yellow" if skipped else "default"))


def _log(status: Status, width: int) -> list[Text]:
    lost = _float(status.get("log_lost"))
    first = Text.assemble(
        ("records ", "bold"),
        _count(_float(status.get("log_records"))),
        ("   lost ", "bold"),
        (_count(lost), "bold red" if lost else "default"),
    )
    event = _clean(status.get("event")) or DASH
    at = _float(status.get("event_t_s"))
    when = Text.assemble(("last event", "bold"), f" at {_fixed(at, 1)} s" if at is not None else "")
    return [first, when, _cut(Text(event), width)]


def _event(status: Status, width: int) -> Text:
    at = _float(status.get("event_t_s"))
    prefix = f" {_fixed(at, 1)} s  " if at is not None else " "
    return _cut(Text.assemble(("event", "bold"), prefix, _clean(status.get("event")) or DASH), width)


def _foot(show_help: bool, width: int) -> list[Text]:
    line = Text()
    for key, name in _KEYS:
        line.append(f" {key} ", "reverse")
        line.append(f" {name} ")
    if line.cell_len > width:
        parts = [Text.assemble((key, "bold"), f" {name}") for key, name in _KEYS]
        line = Text("  ").join(parts)
    lines = [_cut(line, width)]
    if show_help:
        lines += list(_wrap(_HELP, width))
    return lines


def _wrap(text: str, width: int) -> Iterable[Text]:
    line = ""
    for word in text.split():
        if line and len(line) + 1 + len(word) > width:
            yield Text(line, "bright_black")
            line = word
        else:
            line = f"{line} {word}".strip()
    yield Text(line, "bright_black")


def _rule(title: str, width: int) -> Text:
    return Text.assemble((f"─ {title} ", "bold"), ("─" * max(0, width - len(title) - 3), "bright_black"))


def _joined(parts: Sequence[Text], width: int) -> Text:
    return _cut(Text("    ").join(parts), width)


def _cut(line: Text, width: int) -> Text:
    line.truncate(width, overflow="ellipsis")
    return line


def _finish(line: Text, plain: bool) -> Text:
    """Keep a line on one line; in a terminal without Unicode, use ASCII (character for character, so styles stay)."""
    if plain:
        text = line.plain.translate(_ASCII).encode("ascii", "replace").decode("ascii")
        line = Text(text, style=line.style, spans=line.spans)
    line.no_wrap = True
    line.overflow = "crop"
    return line


def _error_style(error_arcmin: float | None) -> str:
    if error_arcmin is None or not math.isfinite(error_arcmin):
        return "bright_black"
    size = abs(error_arcmin)
    return "green" if size < GREEN_ARCMIN else "yellow" if size < YELLOW_ARCMIN else "red"


def _float(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _fixed(value: object, decimals: int) -> str:
    found = _float(value)
    return DASH if found is None else number(found, decimals)


def _signed(value: float | None, decimals: int, unit: str) -> str:
    if value is None:
        return DASH
    text = number(value, decimals)
    return (text if text.startswith(MINUS) else f"+{text}") + unit


def _count(value: float | None) -> str:
    return DASH if value is None else grouped(value)


def _clean(value: object) -> str:
    """Text for a terminal: no control characters, whatever a name in a config may hold."""
    return "" if value is None else "".join(c if c.isprintable() else " " for c in str(value))
