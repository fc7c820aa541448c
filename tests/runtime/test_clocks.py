"""One loop on two clocks: what holds in lock-step holds in real time, and a cycle that was skipped is counted and reported."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.sessions import command, run_short

from spsp_ctrl.experiments.session import SessionResult
from spsp_ctrl.messages import Measurement, Mode
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.runtime.clock import LockStepClock, MonotonicClock

pytestmark = pytest.mark.realtime

PERIOD_NS = 1_000_000
DURATION_S = 2.0
ORDER = [Mode.DISARMED, Mode.READY, Mode.ALIGNING, Mode.ACTIVE, Mode.STOPPING, Mode.DISARMED]


def modes(control: NDArray[Any]) -> list[int]:
    return [int(mode) for mode in control["mode"][np.flatnonzero(np.diff(control["mode"], prepend=-1))]]


def check_invariants(result: SessionResult) -> None:
    """Stamps on the grid, skips counted once and everywhere the same, modes in order, nothing lost."""
    topics = result.log.topics
    stamps, timing = topics["/control"]["stamp_ns"], topics["/timing"]
    assert len({len(topics[topic]) for topic in ("/measurement", "/control", "/timing", "/truth")}) == 1
    for topic in ("/measurement", "/control", "/timing", "/truth"):
        assert (topics[topic]["stamp_ns"] == stamps).all()
        assert (topics[topic]["cycle"] * PERIOD_NS == stamps).all()
    assert (topics["/control"]["command.stamp_ns"] == stamps).all()
    assert (topics["/control"]["command.seq"] == np.arange(len(stamps))).all()
    assert (np.diff(stamps) // PERIOD_NS == 1 + timing["skipped"][1:]).all()
    assert ((timing["lateness_ns"] >= 0) & (timing["lateness_ns"] < PERIOD_NS)).all()
    skipped = int(timing["skipped"].sum())
    assert result.loop.skipped == result.summary["timing_us"]["skipped"] == skipped
    assert list(result.loop.skipped_stamps_ns) == stamps[timing["skipped"] > 0].tolist()
    assert [event["stamp_ns"] for event in result.log.events if event["id"] == "skip"] == list(result.loop.skipped_stamps_ns)
    assert len(stamps) + skipped == int(topics["/control"]["cycle"][-1]) + 1
    assert modes(topics["/control"]) == ORDER
    stopping = stamps[topics["/control"]["mode"] == Mode.STOPPING]
    assert stopping[0] >= DURATION_S * 1e9
    assert result.loop.ended == "completed"
    assert result.summary["log"]["lost"] == 0
    # a row is touched only by what was skipped while it was judged
    judged = (stamps >= result.summary["settle_s"] * 1e9) & (stamps <= DURATION_S * 1e9)
    assert result.summary["timing_us"]["skipped_judged"] == int(timing["skipped"][judged].sum())
    assert all(row["touched_by_skips"] is bool(timing["skipped"][judged].sum()) for row in result.summary["acceptance"])


@pytest.mark.parametrize("real_time", [False, True], ids=["lock-step", "real-time"])
def test_both_clocks_run_the_same_loop(tmp_path: Path, real_time: bool) -> None:
    before = time.monotonic_ns()
    result = run_short(tmp_path / "run", DURATION_S, real_time=real_time)
    after = time.monotonic_ns()
    check_invariants(result)
    assert result.log.metadata["run"]["mode"] == ("real-time" if real_time else "lock-step")
    if real_time:
        origin = int(result.log.metadata["clock"]["monotonic_ns"])
        assert before < origin < origin + result.loop.last_ns < after, "control time is wall time"
    else:
        assert result.loop.skipped == 0
        assert not result.log.topics["/timing"]["lateness_ns"].any()


def test_injected_delay_is_skipped_counted_and_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """12 ms of sleep in one read: the cycles that could not begin are left out, the next one begins on the grid, and the log replays."""
    read: Callable[[SimulatedRig, int], Measurement] = SimulatedRig.read
    delayed: list[int] = []

    def slow(self: SimulatedRig, now_ns: int) -> Measurement:
        if now_ns >= 1_500_000_000 and not delayed:
            delayed.append(now_ns)
            time.sleep(0.012)
        return read(self, now_ns)

    monkeypatch.setattr(SimulatedRig, "read", slow)
    result = run_short(tmp_path / "run", DURATION_S, real_time=True)
    check_invariants(result)
    timing = result.log.topics["/timing"]
    at = int(np.flatnonzero(timing["stamp_ns"] == delayed[0])[0])
    assert timing["read_ns"][at] >= 12_000_000
    assert timing["skipped"][at + 1] >= 11
    (event,) = [e for e in result.log.events if e["id"] == "skip" and e["stamp_ns"] == timing["stamp_ns"][at + 1]]
    assert event["text"] == f"{timing['skipped'][at + 1]} cycle(s) skipped"
    assert result.summary["timing_us"]["skipped"] >= 11
    replayed = command("replay", result.folder / "run.mcap", "--json")
    assert replayed.exit_code == 0, "skipped cycles are part of the inputs"
    assert json.loads(replayed.stdout)["differing_cycles"] == 0


def test_monotonic_clock_keeps_absolute_deadlines() -> None:
    origins: list[int] = []
    clock = MonotonicClock(PERIOD_NS, origins.append)
    clock.start()
    ticks = []
    for k in range(30):
        tick = clock.tick()
        now = time.monotonic_ns()
        assert now - origins[0] >= tick.now_ns, "began before its deadline"
        ticks.append(tick)
        if k == 10:
            time.sleep(0.0045)
    assert len(origins) == 1
    assert ticks[0].cycle == ticks[0].skipped
    assert all(b.cycle - a.cycle == 1 + b.skipped for a, b in itertools.pairwise(ticks))
    assert all(tick.now_ns == tick.cycle * PERIOD_NS and 0 <= tick.lateness_ns < PERIOD_NS for tick in ticks)
    assert ticks[11].skipped >= 3


def test_lock_step_clock_is_never_late() -> None:
    clock = LockStepClock(PERIOD_NS)
    clock.start()
    assert [clock.tick() for _ in range(3)] == [(k, k * PERIOD_NS, 0, 0) for k in range(3)]
