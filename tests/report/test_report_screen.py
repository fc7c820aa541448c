"""The live screen: what it draws, what the keys do, and that it leaves the terminal as it found it."""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.cells import cell_len
from rich.console import Console

import spsp_ctrl
from spsp_ctrl.report.screen import History, Status, StatusStream, render
from spsp_ctrl.report.screen_keys import KeyDecoder, Operator
from spsp_ctrl.report.screen_view import plain_line

STATUS: Status = {
    "rig": "Virtual rig", "scenario": "swing_2dof", "virtual": True, "clock": "real-time", "mode": "ACTIVE",
    "fault": "",
    "elapsed_s": 12.4, "duration_s": 40.0, "settle_s": 6.0, "base_pitch_deg": 5.2, "base_roll_deg": -14.9,
    "platform_pitch_deg": 0.004, "platform_roll_deg": -0.011, "error_pitch_arcmin": 0.21, "error_roll_arcmin": 4.2,
    "error_pitch_max_arcmin": 0.64, "error_roll_max_arcmin": 7.5, "rod_pitch_mm": -9.1, "rod_roll_mm": 26.5,
    "stroke_min_mm": -34.1, "stroke_max_mm": 34.3, "azimuth_deg": 29.2, "azimuth_limit_deg": 160.0,
    "heading_deg": 29.98,
    "heading_target_deg": 30.0, "rate_hz": 1000, "lateness_p50_us": 9.0, "lateness_max_us": 212.0,
    "compute_p50_us": 141.0, "compute_max_us": 410.0, "skipped": 3, "log_records": 48123, "log_lost": 0,
    "event": "ALIGNING → ACTIVE", "event_t_s": 2.0,
}  # fmt: skip


def draw(status: Status, width: int, height: int = 24, encoding: str = "utf-8", show_help: bool = False) -> list[str]:
    history = History()
    for k in range(300):
        history.add({"error_pitch_arcmin": 0.01 * k, "error_roll_arcmin": 6.0 if k == 298 else 0.1})
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict", newline="")
    console = Console(file=stream, width=width, height=height, force_terminal=True, color_system=None)
    console.print(render(status, history, show_help))
    stream.flush()
    raw = stream.buffer
    assert isinstance(raw, io.BytesIO)
    return raw.getvalue().decode(encoding).split("\n")[:-1]


@pytest.mark.parametrize("width", [60, 80, 140])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "latin-1"])
def test_everything_is_on_the_screen_and_fits(width: int, encoding: str) -> None:
    lines = draw(STATUS, width, encoding=encoding)
    text = "\n".join(lines)
    assert len(lines) <= 24
    assert max(cell_len(line) for line in lines) <= width
    for part in (
        "Virtual rig", "swing_2dof", "real-time", "ACTIVE", "12.4 / 40.0 s", "5.20", "14.90", "0.21", "4.20", "7.50",
        "9.10 mm", "26.50 mm", "29.98", "30.0", "9", "212", "141", "410", "skipped 3", "lost 0", "help",
    ):  # fmt: skip
        assert part in text, part
    if encoding == "utf-8":
        assert "48\u202f123" in text
        assert text.count("▅") == 1  # the one spike of 6 in a range of 10


@pytest.mark.parametrize("width", [80, 120])
def test_a_degraded_loop_is_said(width: int) -> None:
    degraded: Status = {**STATUS, "degraded": "fifo, memory locked"}
    assert "degraded" in "".join(draw(degraded, width))
    assert "degraded" not in "".join(draw(STATUS, width))


def test_help_appears_on_request_only() -> None:
    assert "space stops" not in "\n".join(draw(STATUS, 60))
    assert "space stops" in "\n".join(draw(STATUS, 60, show_help=True))


def test_level_gauges_follow_the_angle() -> None:
    def bubble(status: Status, column: int) -> int:
        row = next(line for line in draw(status, 80) if "pitch" in line)
        gauges: list[str] = re.findall(r"[─┼●]{5,}", row)
        assert len(gauges) == 2
        return len(gauges[column].split("●")[0])

    middle = bubble(STATUS | {"base_pitch_deg": 0.0}, 0)
    assert bubble(STATUS | {"base_pitch_deg": 15.0}, 0) > middle > bubble(STATUS | {"base_pitch_deg": -15.0}, 0)
    assert bubble(STATUS | {"base_pitch_deg": 400.0}, 0) == 2 * middle
    assert bubble(STATUS, 1) == middle


@pytest.mark.parametrize(("error", "colour"), [(2.9, "green"), (-4.9, "yellow"), (5.1, "red")])
def test_bands_have_colours(error: float, colour: str) -> None:
    console = Console(width=80, height=24, force_terminal=True, file=io.StringIO(), record=True)
    console.print(render(STATUS | {"error_pitch_arcmin": error}, History()))
    ansi = console.export_text(styles=True)
    code = {"green": "32", "yellow": "33", "red": "31"}[colour]
    assert re.search(rf"\x1b\[1;{code}m[^\x1b]*{abs(error):.2f}", ansi)


@pytest.mark.parametrize("width", [20, 60, 80, 140])
@pytest.mark.parametrize(
    "status",
    [
        {},
        {"mode": "SOMETHING", "base_pitch_deg": None, "error_pitch_arcmin": float("nan"), "stroke_min_mm": 0.0},
        {
            "duration_s": 0.0,
            "elapsed_s": 5.0,
            "rig": "x" * 500,
            "event": "\x1b[2J\x07evil\nline",
            "fault": "IMU silent",
        },
    ],
)
def test_missing_and_odd_values_do_not_break_it(status: Any, width: int) -> None:
    text = "\n".join(draw(status, width))
    assert "\x1b[2J" not in text
    assert "\x07" not in text
    assert ("FAULT" in text) == bool(status.get("fault"))


def test_plain_line_is_ascii() -> None:
    line = plain_line(STATUS)
    assert line.isascii()
    assert "0.21" in line
    assert plain_line({}).isascii()


def test_status_stream_joins_pieces_and_drops_rubbish() -> None:
    stream = StatusStream()
    assert stream.feed(b'{"elapsed_s": 1') == []
    assert stream.feed(b'.5}\nnonsense\n[1]\n\xff\xfe\n{"mode": "READY"}\n{"x') == [
        {"elapsed_s": 1.5},
        {"mode": "READY"},
    ]


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"adsrq?", ["a", "d", "s", "r", "q", "?"]),
        (b"A S", ["a", "space", "s"]),
        (b"\x1b[C\x1b[D\x1bOC\x1bOD", ["right", "left", "right", "left"]),
        (b"\x1b[A\x1b[3~\x1b[1;5Cx\x00\xff", []),
        (b"\x1bs", ["s"]),
        (b"\x1b ", ["space"]),
        (b"\x1bd", []),
        (b"\x1b\x1b[C", ["right"]),
    ],
)
def test_keys(data: bytes, keys: list[str]) -> None:
    assert KeyDecoder().feed(data) == keys
    split = KeyDecoder()
    assert [key for k in range(len(data)) for key in split.feed(data[k : k + 1])] == keys


def test_requests_of_keys() -> None:
    operator = Operator()
    for key, verb in (("a", "arm"), ("d", "disarm"), ("s", "stop"), ("space", "stop"), ("r", "reset")):
        assert [r["verb"] for r in operator.requests(key, STATUS, 0.0)] == [verb]
    assert [r["verb"] for r in operator.requests("q", STATUS, 0.0)] == ["stop", "quit"]
    assert operator.requests("?", STATUS, 0.0) == []


def test_heading_steps_add_up_and_wrap() -> None:
    operator = Operator()

    def press(key: str, target: float, now_s: float) -> float:
        (request,) = operator.requests(key, {"heading_target_deg": target}, now_s)
        assert request["verb"] == "heading"
        return float(request["value"])

    assert [press("right", 30.0, 0.1 * k) for k in range(3)] == [35.0, 40.0, 45.0]
    assert press("left", 31.0, 1.0) == 40.0
    assert press("right", 178.0, 100.0) == -177.0
    assert press("left", -178.0, 200.0) == 177.0
    assert operator.requests("right", {}, 300.0)[0]["value"] == 5.0


class Session:
    """The screen in its own process on a pseudo-terminal."""

    def __init__(self, term: str | None, extra: tuple[str, ...] = ()) -> None:
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.slave = slave
        self.before = termios.tcgetattr(slave)
        status_read, self.status = os.pipe()
        self.requests, request_write = os.pipe()
        environment = {k: v for k, v in os.environ.items() if k not in ("TERM", "NO_COLOR", "COLUMNS", "LINES")}
        environment["PYTHONPATH"] = str(Path(spsp_ctrl.__file__).parents[1])
        environment["PYTHONIOENCODING"] = "utf-8"
        if term is not None:
            environment["TERM"] = term
        command = [sys.executable, "-m", "spsp_ctrl.report.screen"]
        command += ["--status-fd", str(status_read), "--request-fd", str(request_write), *extra]
        self.process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, env=environment, pass_fds=(status_read, request_write)
        )
        os.close(status_read)
        os.close(request_write)
        self.output = b""

    def send(self, status: Status) -> None:
        os.write(self.status, json.dumps(status).encode() + b"\n")

    def wait_for(self, pattern: bytes, status: Status = STATUS) -> None:
        """Send statuses and read the screen until it shows ``pattern``."""
        end = time.monotonic() + 15.0
        while not re.search(pattern, self.output):
            assert time.monotonic() < end, self.output[-3000:]
            with contextlib.suppress(BrokenPipeError):
                self.send(status)
            if select.select([self.master], [], [], 0.1)[0]:
                self.output += os.read(self.master, 65536)

    def request(self) -> dict[str, Any]:
        assert select.select([self.requests], [], [], 15.0)[0], self.output[-3000:]
        line = b""
        while not line.endswith(b"\n"):
            line += os.read(self.requests, 1)
        found: dict[str, Any] = json.loads(line)
        return found

    def drain_until_exit(self) -> int:
        end = time.monotonic() + 15.0
        while self.process.poll() is None:
            assert time.monotonic() < end, self.output[-3000:]
            if select.select([self.master], [], [], 0.05)[0]:
                self.output += os.read(self.master, 65536)
        while select.select([self.master], [], [], 0.05)[0]:
            self.output += os.read(self.master, 65536)
        return self.process.returncode

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for fd in (self.master, self.slave, self.requests, self.status):
            with contextlib.suppress(OSError):
                os.close(fd)


@pytest.fixture
def session() -> Iterator[Session]:
    found = Session("xterm-256color")
    yield found
    found.close()


def cooked(session: Session) -> bool:
    return bool(termios.tcgetattr(session.slave)[3] & termios.ICANON)


def test_process_draws_asks_and_restores_the_terminal(session: Session) -> None:
    session.wait_for(b"ACTIVE")
    assert not cooked(session)
    os.write(session.master, b"\x1b[C")
    assert session.request() == {"verb": "heading", "value": 35.0}
    os.write(session.master, b" ")
    assert session.request()["verb"] == "stop"
    os.write(session.master, b"q")
    assert [session.request()["verb"] for _ in range(2)] == ["stop", "quit"]
    session.process.send_signal(signal.SIGINT)
    session.wait_for(b"READY", STATUS | {"mode": "READY"})  # SIGINT has not ended it
    os.close(session.status)
    assert session.drain_until_exit() == 0
    assert termios.tcgetattr(session.slave) == session.before
    assert b"\x1b[?25h" in session.output.rsplit(b"\x1b[?25l", 1)[1]  # the cursor is back
    assert b"Traceback" not in session.output


def test_terminate_restores_the_terminal(session: Session) -> None:
    session.wait_for(b"ACTIVE")
    session.process.terminate()
    assert session.drain_until_exit() == 128 + signal.SIGTERM
    assert termios.tcgetattr(session.slave) == session.before
    assert b"\x1b[?25h" in session.output.rsplit(b"\x1b[?25l", 1)[1]
    assert b"Traceback" not in session.output


@pytest.mark.parametrize("term", [None, "dumb"])
def test_without_a_usable_terminal_it_prints_plain_lines(term: str | None) -> None:
    session = Session(term)
    try:
        session.wait_for(b"error pitch 0.21")
        os.write(session.master, b"s")
        assert session.request()["verb"] == "stop"
        os.close(session.status)
        assert session.drain_until_exit() == 0
        assert b"\x1b" not in session.output
        assert termios.tcgetattr(session.slave) == session.before
    finally:
        session.close()


def test_quit_interrupts_the_parent_once() -> None:
    caught: list[int] = []
    former = signal.signal(signal.SIGINT, lambda number, _: caught.append(number))
    session = Session("xterm", ("--interrupt-pid", str(os.getpid())))
    try:
        session.wait_for(b"ACTIVE")
        os.write(session.master, b"q")
        assert session.request()["verb"] == "stop"
        os.write(session.master, b"qs")
        verbs = [session.request()["verb"] for _ in range(3)]
        os.close(session.status)
        session.drain_until_exit()
        assert verbs == ["stop", "quit", "stop"]  # the second q only asks
        assert caught == [signal.SIGINT]
    finally:
        signal.signal(signal.SIGINT, former)
        session.close()


def test_screen_process_imports_nothing_heavy() -> None:
    code = "import sys, spsp_ctrl.report.screen, spsp_ctrl.report.live as _; "
    code += "print(sorted({'numpy', 'scipy', 'mcap'} & set(sys.modules)))"
    environment = os.environ | {"PYTHONPATH": str(Path(spsp_ctrl.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.strip() == "[]"


def test_wrong_descriptor_is_a_clear_error() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "spsp_ctrl.report.screen", "--status-fd", "77"],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(Path(spsp_ctrl.__file__).parents[1])},
        check=False,
    )
    assert done.returncode == 2
    assert "--status-fd 77 is not an open descriptor" in done.stderr
    assert "Traceback" not in done.stderr
