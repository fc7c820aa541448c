"""Status from the loop's messages, the link to the screen process, and the closing table."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from math import radians
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast, get_type_hints

import pytest
from rich.console import Console

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.messages import NO_MEASUREMENT, Control, Measurement, Mode, Timing, Truth
from spsp_ctrl.report.live import LiveStatus
from spsp_ctrl.report.screen import print_summary
from spsp_ctrl.report.screen_link import ScreenLink


def zero(message: type[NamedTuple]) -> Any:
    """A message of zeros."""
    return message(
        *(kind(0) if kind in (int, float, bool) else zero(kind) for kind in get_type_hints(message).values())
    )


RIG = cast(
    RigConfig,
    SimpleNamespace(
        name="rig",
        rate_hz=1000,
        mechanism=SimpleNamespace(stroke_min_mm=-34.1, stroke_max_mm=34.3, azimuth_limit_deg=160.0),
    ),
)
SCENARIO = Scenario(schema="spsp-ctrl/scenario/1", name="swing", settle_s=1.0)


def control(t_s: float, pitch_arcmin: float, mode: Mode = Mode.ACTIVE, fault: int = 0) -> Control:
    base: Control = zero(Control)
    estimate = base.estimate._replace(platform_pitch_rad=radians(-pitch_arcmin / 60.0), rod_roll_m=0.012)
    return base._replace(stamp_ns=round(t_s * 1e9), mode=mode, fault=fault, estimate=estimate)


def timing(lateness_us: float, skipped: int = 0) -> Timing:
    base: Timing = zero(Timing)
    return base._replace(lateness_ns=round(lateness_us * 1e3), compute_ns=140_000, skipped=skipped)


def test_spikes_between_two_statuses_are_not_lost() -> None:
    live = LiveStatus(RIG, SCENARIO, "real-time", 40.0, counts=lambda: (7, 1))
    quiet = control(2.0, 0.1)
    for k in range(50):
        live.note(control(2.0, -3.5 if k == 20 else 0.1), timing(900.0 if k == 30 else 9.0, skipped=int(k == 31)))
    first = live.status(NO_MEASUREMENT, quiet, timing(9.0), None)
    assert first["error_pitch_arcmin"] == pytest.approx(3.5)
    assert first["error_pitch_max_arcmin"] == pytest.approx(3.5)
    assert first["lateness_max_us"] == pytest.approx(900.0)
    assert first["lateness_p50_us"] == pytest.approx(9.0)
    assert (first["skipped"], first["log_records"], first["log_lost"]) == (1, 7, 1)
    assert first["rod_roll_mm"] == pytest.approx(12.0)
    assert first["base_pitch_deg"] is None
    live.note(quiet, timing(9.0))
    second = live.status(NO_MEASUREMENT, quiet, timing(9.0), zero(Truth)._replace(base_pitch_rad=radians(6.0)))
    assert second["error_pitch_arcmin"] == pytest.approx(0.1)
    assert second["error_pitch_max_arcmin"] == pytest.approx(3.5)
    assert second["base_pitch_deg"] == pytest.approx(6.0)
    json.dumps(second, allow_nan=False)


def test_maximum_starts_after_the_settling_time() -> None:
    live = LiveStatus(RIG, SCENARIO, "lock-step", 40.0)
    live.note(control(0.5, 100.0), timing(0.0))
    assert live.status(NO_MEASUREMENT, control(0.5, 100.0), timing(0.0), None)["error_pitch_max_arcmin"] is None
    live.note(control(1.0, 0.4), timing(0.0))
    assert live.status(NO_MEASUREMENT, control(1.0, 0.4), timing(0.0), None)["error_pitch_max_arcmin"] == pytest.approx(
        0.4
    )


def test_mode_changes_and_faults_are_told() -> None:
    live = LiveStatus(RIG, SCENARIO, "real-time", 40.0)
    live.note(control(0.0, 0.0, Mode.ALIGNING), timing(0.0))
    last = control(1.5, 0.0, Mode.FAULT, fault=1)
    live.note(last, timing(0.0))
    encoders: Measurement = NO_MEASUREMENT._replace(base=NO_MEASUREMENT.base._replace(seq=3, roll_rad=radians(15.0)))
    status = live.status(encoders, last, timing(0.0), None)
    assert (status["event"], status["event_t_s"]) == ("ALIGNING → FAULT", 1.5)
    assert "IMU" in status["fault"]
    assert status["mode"] == "FAULT"
    assert status["base_roll_deg"] == pytest.approx(15.0)


@pytest.fixture
def link(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ScreenLink]:
    """A link to a stand-in for the screen: a script with the two descriptors in ``S`` and ``R``."""

    def make(script: str) -> ScreenLink:
        real = subprocess.Popen

        def fake(command: list[str], pass_fds: tuple[int, ...]) -> subprocess.Popen[bytes]:
            source = f"import os,time\nS,R={pass_fds}\n{script}"
            return real([sys.executable, "-c", source], pass_fds=pass_fds)

        monkeypatch.setattr(subprocess, "Popen", fake)
        monkeypatch.setattr(sys, "stdout", SimpleNamespace(isatty=lambda: True))
        found = ScreenLink.start()
        assert found is not None
        return found

    return make


def test_no_screen_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    assert ScreenLink.start() is None


def test_link_never_waits_for_a_stuck_screen_and_closes_it(
    link: Callable[[str], ScreenLink], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("spsp_ctrl.report.screen_link._CLOSE_TIMEOUT_S", 0.3)
    stuck = link("time.sleep(60)")
    for _ in range(2000):  # far more than a pipe holds
        stuck.send({"event": "x" * 200})
    stuck.close()
    stuck.close()
    stuck.send({})
    assert stuck.requests() == []


def test_link_carries_whole_lines_both_ways(link: Callable[[str], ScreenLink]) -> None:
    # The stand-in reads late, so that lines are cut short, and answers with the count of lines that are not whole.
    script = """
import json
time.sleep(0.3)
bad = n = 0
for line in os.fdopen(S):
    n += 1
    try: json.loads(line)
    except ValueError: bad += 1
    if 'last' in line: break
os.write(R, b'rubbish\\n{"verb": "explode"}\\n[]\\n{"verb": "heading", "value": "x"}\\n')
os.write(R, ('{"verb": "heading", "value": %d}\\n{"verb": "stop"}\\n' % (1000 + bad if n > 10 else 0)).encode())
for line in os.fdopen(S): pass
"""
    both = link(script)
    for _ in range(1000):
        both.send({"event": "y" * 333})
    found: list[dict[str, Any]] = []
    while len(found) < 2:
        both.send({"event": "last"})
        found += both.requests()
    assert found == [{"verb": "heading", "value": 1000.0}, {"verb": "stop", "value": 0.0}]
    both.close()


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_summary_table(synthetic: Callable[..., tuple[Any, dict[str, Any]]], terminal: bool, encoding: str) -> None:
    _, summary = synthetic(duration_s=8.0, bad=True)
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding, errors="strict", newline="")
    folder = Path("runs") / ("2026-01-01T00-00-00Z-" + "long" * 30)
    print_summary(summary, Console(file=stream, force_terminal=terminal, width=80), folder)
    stream.flush()
    text = raw.getvalue().decode(encoding)
    assert ("\x1b[" in text) == terminal
    assert text.isascii() or encoding == "utf-8"
    assert ("╭" in text) == (terminal and encoding == "utf-8")
    for part in (
        "fault: IMU silent",
        "pitch error, IMU",
        "FAIL",
        "(skips)",
        "pass",
        "arcmin",
        "skipped cycles",
        os.fspath(folder),
    ):
        assert part in text, part


def test_summary_table_of_nothing() -> None:
    stream = io.StringIO()
    print_summary({}, Console(file=stream, width=60))
    assert "skipped cycles" in stream.getvalue()
