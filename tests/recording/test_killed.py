"""How a session ends: killed, interrupted, or with an exception; in each case the log tells what happened until then."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.sessions import RIG, command, run_short

from spsp_ctrl.messages import Measurement, Mode
from spsp_ctrl.recording.reader import read_log
from spsp_ctrl.rig.simulated import SimulatedRig

pytestmark = pytest.mark.realtime

ATTEMPTS = 3
"""Other work on the machine can hold the loop itself up for longer than a tenth of a second; it does so rarely."""


class Session:
    """``spsp-ctrl run`` in real time in a process group of its own."""

    def __init__(self, folder: Path) -> None:
        self.log = folder / "run.mcap"
        self.folder = folder
        arguments = ["run", "--config", str(RIG), "--duration", "30", "--no-screen", "--out", str(folder)]
        program = "from spsp_ctrl.cli import main; main()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )

    def wait_until(self, mode: str) -> None:
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            assert self.process.poll() is None, self.process.communicate()
            if self.log.exists() and self.log.stat().st_size > 8:
                texts = [event["text"] for event in read_log(self.log, ()).events]
                if any(text.endswith(mode) for text in texts):
                    return
            time.sleep(0.1)
        raise AssertionError(f"never {mode}")

    def end(self) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=60.0)
        return self.process.returncode, out, err


@pytest.fixture
def started(tmp_path: Path) -> Iterator[list[Session]]:
    sessions: list[Session] = []
    yield sessions
    for session in sessions:
        if session.process.poll() is None:
            os.killpg(session.process.pid, signal.SIGKILL)
        session.process.communicate()


def readable_info(log: Path) -> dict[str, Any]:
    result = command("log", "info", log, "--json")
    assert result.exit_code == 0
    info: dict[str, Any] = json.loads(result.stdout)
    return info


def missing_s(info: dict[str, Any], killed_ns: int) -> float:
    """Log time between the last readable record and the kill: the log holds where time 0 lies on the monotonic clock, which all processes share."""
    return float((killed_ns - int(info["metadata"]["clock"]["monotonic_ns"])) * 1e-9 - info["end_s"])


@pytest.mark.parametrize("whole_group", [False, True], ids=["controller", "controller-and-writer"])
def test_killed_session_leaves_a_log_up_to_a_tenth_of_a_second_before(tmp_path: Path, started: list[Session], whole_group: bool) -> None:
    seen = []
    for attempt in range(ATTEMPTS):
        session = Session(tmp_path / str(attempt))
        started.append(session)
        session.wait_until("ACTIVE")
        time.sleep(0.5)
        killed_ns = time.monotonic_ns()
        if whole_group:
            os.killpg(session.process.pid, signal.SIGKILL)
        else:
            session.process.kill()
        assert session.end()[0] == -signal.SIGKILL
        if not whole_group:
            # the writer sees the end of its input and finishes the file
            deadline = time.monotonic() + 10.0
            while not read_log(session.log, ()).complete and time.monotonic() < deadline:
                time.sleep(0.05)
        info = readable_info(session.log)
        assert info["complete"] is not whole_group
        if whole_group:
            assert info["problem"]
        assert set(info["attachments"]) == {"rig.yaml", "scenario.yaml", "model.yaml"}
        assert info["topics"]["/control"]["messages"] > 500
        assert not (session.folder / "summary.json").exists()
        seen.append(missing_s(info, killed_ns))
        assert seen[-1] > -0.002, "a record from after the kill: the clocks are not the same"
        if seen[-1] <= 0.1:
            break
    assert seen[-1] <= 0.1, seen


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_is_a_controlled_stop(tmp_path: Path, started: list[Session], name: str) -> None:
    session = Session(tmp_path / "run")
    started.append(session)
    session.wait_until("ACTIVE")
    # as a terminal does it: to everyone in the group, the writer included
    os.killpg(session.process.pid, getattr(signal, name))
    code, _, err = session.end()
    assert code == 130, err
    assert "Traceback" not in err
    log = read_log(session.log)
    assert log.complete, log.problem
    assert [event["text"] for event in log.events if event["id"] == "mode"][-2:] == ["ACTIVE -> STOPPING", "STOPPING -> DISARMED"]
    assert [(row["verb"], row["source"]) for row in log.operator] == [("stop", "interrupted")]
    assert not log.topics["/control"]["command.enable"][-1]
    summary = json.loads((session.folder / "summary.json").read_text())
    assert summary["ended"] == "interrupted"
    assert summary["log"]["lost"] == 0
    assert summary["log"]["records"] == sum(map(len, log.topics.values())) + len(log.events) + len(log.operator)
    assert (session.folder / "report.html").exists()


class Again(SimulatedRig):
    """A rig during which the operator presses Ctrl-C, in the middle of a swing."""

    presses: tuple[int, ...] = ()

    def read(self, now_ns: int) -> Measurement:
        m = super().read(now_ns)
        if m.cycle in self.presses:
            os.kill(os.getpid(), signal.SIGINT)
        return m


@pytest.mark.parametrize(("presses", "last_mode"), [((2900,), Mode.DISARMED), ((2900, 2902), Mode.STOPPING)], ids=["once", "twice"])
def test_second_interrupt_ends_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, presses: tuple[int, ...], last_mode: Mode) -> None:
    monkeypatch.setattr("spsp_ctrl.rig.simulated.SimulatedRig", Again)
    monkeypatch.setattr(Again, "presses", presses)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have started us with Ctrl-C ignored
    result = run_short(tmp_path / "run", 4.0)
    assert result.loop.ended == "interrupted"
    assert result.log.complete
    control = result.log.topics["/control"]
    assert control["mode"][-1] == last_mode
    if len(presses) == 1:
        assert control["cycle"][-1] > 2910, "braking took time, so that there is something to cut short"
    else:
        assert control["cycle"][-1] <= 2903
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, "the handlers are given back"


def test_an_exception_takes_the_power_and_leaves_a_replayable_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stops: list[int] = []
    read, stop = SimulatedRig.read, SimulatedRig.stop

    def failing(self: SimulatedRig, now_ns: int) -> Measurement:
        if now_ns >= 900_000_000:
            raise ValueError("resolver cable pulled")
        return read(self, now_ns)

    def counted(self: SimulatedRig) -> None:
        stops.append(1)
        stop(self)

    monkeypatch.setattr(SimulatedRig, "read", failing)
    monkeypatch.setattr(SimulatedRig, "stop", counted)
    folder = tmp_path / "run"
    result = command("run", "-c", RIG, "--fast", "--duration", "3", "--out", folder, "--json")
    assert result.exit_code == 3, result.output
    assert stops
    assert json.loads(result.stdout)["ended"] == "fault: exception"
    log = read_log(folder / "run.mcap")
    assert log.complete
    last = log.events[-1]
    assert (last["id"], last["level"], last["stamp_ns"]) == ("exception", "error", 899_000_000)
    assert "resolver cable pulled" in last["text"]
    assert "Traceback (most recent call last)" in last["text"]
    assert log.topics["/control"]["mode"][-1] == Mode.ACTIVE
    replayed = command("replay", folder / "run.mcap")
    assert replayed.exit_code == 0, replayed.output
    assert "0 differences" in replayed.stdout
