"""Logs that cannot be used: each gets a clear verdict and exit code, no traceback, no model file; an interrupt leaves nothing."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner
from tests.discrepancy.benches import MODEL, ROOT, samples_of, write

from spsp_ctrl.cli import cli
from spsp_ctrl.discrepancy.gate import judge
from spsp_ctrl.discrepancy.records import load_record
from spsp_ctrl.messages import AxisSample
from spsp_ctrl.plant.axis_model import load_axis_model

Change = Callable[[AxisSample], AxisSample]


@cache
def _clean() -> tuple[AxisSample, ...]:
    return tuple(samples_of("axis-identify", 1, seconds=8.0))


def _log(path: Path, change: Change = lambda s: s) -> Path:
    return write(path, "axis-identify", list(_clean()), change)


def _drifting(s: AxisSample) -> AxisSample:
    t = s.stamp_ns * 1e-9
    return s._replace(stamp_ns=round((t + 0.5 * 2e-3 / 8.0 * t * t) * 1e9))  # 2000 ppm from start to end


BROKEN: dict[str, tuple[Change, str]] = {
    "command in another unit": (lambda s: s._replace(command_a=1.1 * s.command_a), "stated controller does not give the recorded command"),
    "controller with another reference": (lambda s: s._replace(reference_m=s.reference_m + 1e-3), "stated controller does not give"),
    "ruler in mm": (lambda s: s._replace(load_m=1e3 * s.load_m), "a factor of 1000"),
    "ruler in inches": (lambda s: s._replace(load_m=s.load_m / 0.0254), "a factor of 39.3701"),
    "ruler reversed": (lambda s: s._replace(load_m=-s.load_m), "the sign is reversed"),
    "ruler by a factor of two": (lambda s: s._replace(load_m=2.0 * s.load_m), "a ratio of 1.99"),
    "current in mA": (lambda s: s._replace(current_a=1e3 * s.current_a), "current_a against command_a: a factor of 1000"),
    "temperature in kelvin": (lambda s: s._replace(screw_c=s.screw_c + 273.15), "kelvin"),
    "clock of another rate": (lambda s: s._replace(stamp_ns=round(1.03 * s.stamp_ns)), "the stamps say"),
    "clock that drifts": (_drifting, "the clock drifts"),
    "no ruler": (lambda s: s._replace(load_m=0.0), "load_m never changes: the channel is lacking"),
    "no resolver": (lambda s: s._replace(resolver_counts=0), "resolver_counts never changes: the channel is lacking"),
    "no current": (lambda s: s._replace(current_a=0.0), "current_a never changes: the channel is lacking"),
    "NaN": (lambda s: s._replace(load_m=float("nan")) if s.cycle == 77 else s, "load_m is not a number in 1 cycles, first in cycle 77"),
    "infinite": (lambda s: s._replace(current_a=float("inf")) if s.cycle > 4 else s, "current_a is not a number"),
    "drive off": (lambda s: s._replace(enabled=s.cycle < 100), "the drive was off"),
    "time backwards": (lambda s: s._replace(cycle=s.cycle - 5) if s.cycle == 1000 else s, "time runs backwards"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_log_that_cannot_be_used_is_told_so(tmp_path: Path, what: str) -> None:
    change, text = BROKEN[what]
    log, out = _log(tmp_path / "a.mcap", change), tmp_path / "out"
    done = CliRunner().invoke(cli, ["diagnose", str(log), "--model", str(MODEL), "--out", str(out)])
    assert done.exit_code == 4, done.output
    assert text in done.output
    assert "Traceback" not in done.output
    answer = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    assert answer["verdict"] == "not-understood"
    assert (answer["model"], answer["effects"]) == (None, [])
    assert {p.name for p in out.iterdir()} == {"diagnosis.json", "report.html"}


def test_the_clean_log_passes(tmp_path: Path) -> None:
    gate = judge(load_record(_log(tmp_path / "a.mcap"))[0], load_axis_model(MODEL))
    assert gate.problems == []
    assert gate.controller_replay is not None
    assert gate.controller_replay < 1e-9


def test_a_cut_log_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    log = _log(tmp_path / "a.mcap")
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    done = CliRunner().invoke(cli, ["diagnose", str(log), "--model", str(MODEL), "--out", str(tmp_path / "out")])
    assert done.exit_code == 4
    assert "log repair" in done.output
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_an_interrupt_leaves_nothing(tmp_path: Path) -> None:
    log, out = _log(tmp_path / "a.mcap"), tmp_path / "out"
    words = [sys.executable, "-m", "spsp_ctrl.cli", "diagnose", str(log), "--model", str(MODEL), "--out", str(out)]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    # a shell in the background may have made the signal ignored: the child has its default back
    running = subprocess.Popen(
        words, stderr=subprocess.PIPE, text=True, env=environment, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler)
    )
    end = time.monotonic() + 120.0
    while not list(tmp_path.glob(".out-*")) and running.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(0.3)  # inside the work
    assert running.poll() is None, "it must still be at work, or this proves nothing"
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=120)
    assert running.returncode == 130, errors
    assert "Traceback" not in errors
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap"]
