"""Real-time settings: asked, granted or refused with a reason, given back; and what a missed deadline and a lost log lead to."""

from __future__ import annotations

import gc
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.sessions import RIG, command, run_short

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.experiments import session
from spsp_ctrl.messages import Measurement, Mode
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.runtime import realtime
from spsp_ctrl.runtime.clock import MonotonicClock
from spsp_ctrl.runtime.realtime import RealTime, Wishes, degraded


def state() -> tuple[int, set[int], bool, int]:
    locked = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmLck"))
    return os.sched_getscheduler(0) & 0xFF, os.sched_getaffinity(0), gc.isenabled(), int(locked.split()[1])


def test_what_is_granted_holds_and_is_given_back() -> None:
    before = state()
    core = max(before[1])
    with RealTime(Wishes(priority=3, cpu=core)) as real_time:
        granted = real_time.granted
        policy, cores, collecting, locked = state()
        assert (policy == os.SCHED_FIFO) == (granted["fifo"] is True)
        assert (cores == {core}) == (granted["cpu"] is True)
        assert (locked > 10_000) == (granted["memory_locked"] is True)
        assert granted["collector_frozen"] is True
        assert not collecting
        assert [name for name, _ in degraded(granted)] == [name for name, value in granted.items() if isinstance(value, str)]
    assert state() == before


def test_refused_wishes_are_named_with_their_reason_and_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(realtime, "_lock_memory", refuse)
    before = state()
    with RealTime(Wishes(cpu=1023)) as real_time:
        assert dict(degraded(real_time.granted)) == {
            "memory_locked": "refused: Operation not permitted",
            "cpu": "refused: Invalid argument",
            "fifo": "refused: Operation not permitted",
        } | {k: v for k, v in degraded(real_time.granted) if k == "cpu_dma_latency"}
    assert state() == before


def test_in_lock_step_nothing_is_asked() -> None:
    before = state()
    with RealTime(None) as real_time:
        assert real_time.granted == {"requested": False, "collector_frozen": True}
        assert state()[:2] == before[:2]


def test_degraded_is_said_everywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(priority: int) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(realtime, "_fifo", refuse)
    result = command("run", "-c", RIG, "--duration", "0.5", "--no-screen", "--out", tmp_path / "run")
    assert "degraded: not granted by the operating system: fifo" in result.stderr
    assert "fifo refused: Operation not permitted" in result.stdout
    assert ">degraded<" in (tmp_path / "run" / "report.html").read_text()


def test_spinning_clock_is_on_the_grid_and_not_early() -> None:
    clock = MonotonicClock(1_000_000, spin_ns=100_000)
    clock.start()
    origin = clock._origin_ns
    for _ in range(50):
        tick = clock.tick()
        assert time.monotonic_ns() - origin >= tick.now_ns + tick.lateness_ns
        assert tick.now_ns == tick.cycle * 1_000_000


def test_spin_is_limited_to_a_share_of_the_period() -> None:
    config = load_rig(RIG).model
    fast = config.model_copy(update={"rate_hz": 5000, "realtime": config.realtime.model_copy(update={"spin_us": 200.0})})
    assert session.spin_ns(fast) == 80_000
    assert session.spin_ns(fast.model_copy(update={"realtime": config.realtime.model_copy(update={"enabled": False})})) == 0


def slow_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read, done = SimulatedRig.read, []

    def slow(self: SimulatedRig, now_ns: int) -> Measurement:
        if now_ns >= 1_200_000_000 and not done:
            done.append(now_ns)
            time.sleep(0.01)
        return read(self, now_ns)

    monkeypatch.setattr(SimulatedRig, "read", slow)


@pytest.mark.parametrize("policy", ["go_on", "stop"])
def test_a_missed_deadline_does_what_the_rig_file_declares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, policy: str) -> None:
    slow_once(monkeypatch)
    run = command("run", "-c", RIG, "--set", f"realtime.on_miss={policy}", "--duration", "1.6", "--no-screen", "--out", tmp_path / "run", "--json")
    log = session._read_back(tmp_path / "run" / "run.mcap", session.RecorderStats(0, 0, ""))[0]
    control = log.topics["/control"]
    skips = np.flatnonzero(log.topics["/timing"]["skipped"])
    assert len(skips), "the delay was not seen"
    assert not control["command.enable"][-1]
    if policy == "go_on":
        assert run.exit_code == 0, run.output
        assert control["stamp_ns"][-1] >= 1.6e9
    else:
        # a busy machine may have missed one before
        assert run.exit_code == 3, run.output
        (request,) = log.operator
        assert (request["verb"], request["source"]) == ("stop", "stopped: deadline missed")
        assert control["stamp_ns"][-1] < 1.6e9
        assert Mode(int(control["mode"][-1])) in (Mode.DISARMED, Mode.READY)


@pytest.mark.parametrize(("policy", "clock"), [("go_on", True), ("stop", True), ("stop", False)])
def test_a_lost_log_does_what_the_rig_file_declares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, policy: str, clock: bool) -> None:
    read, done = SimulatedRig.read, []

    def killing(self: SimulatedRig, now_ns: int) -> Measurement:
        if now_ns >= 900_000_000 and not done:
            done.append(writer_pid())
            os.kill(done[0], 9)
        return read(self, now_ns)

    monkeypatch.setattr(SimulatedRig, "read", killing)
    config = load_rig(RIG).model
    changed = config.model_copy(update={"realtime": config.realtime.model_copy(update={"on_log_failure": policy})})
    result = run_short(tmp_path / "run", 1.6, real_time=clock, config=changed)
    (event,) = [e for e in result.loop.events if e["id"] == "log-failed"]
    assert "killed by signal 9" in str(event["text"])
    seen_ns = event["stamp_ns"]
    assert isinstance(seen_ns, int)
    assert 0.9e9 <= seen_ns <= 1.3e9, "noticed at once"
    if policy == "go_on":
        assert result.loop.ended == "completed"
        assert "goes on" in str(event["text"])
    else:
        assert result.loop.ended == "stopped: no log"
        assert result.loop.last_ns < 1.6e9
        assert [e["text"] for e in result.loop.events if e["id"] == "mode"][-1].endswith("STOPPING -> DISARMED")
    assert len(result.log.topics["/control"]) > 700, "what was written is readable"


def writer_pid() -> int:
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return next(int(p) for p in children if b"writer_process" in Path(f"/proc/{p}/cmdline").read_bytes())
