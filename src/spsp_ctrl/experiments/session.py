"""A session: from checked files to a run folder. Used by ``run`` and by every experiment."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from spsp_ctrl.config.loader import dump_resolved
from spsp_ctrl.config.rig import BusDriver, RealTimeConfig, RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments import summary as figures
from spsp_ctrl.messages import Control, Measurement, OperatorRequest, Timing, Truth
from spsp_ctrl.recording.reader import LogData, LogError, read_log
from spsp_ctrl.recording.schema import CYCLIC, TOPICS
from spsp_ctrl.recording.writer import Recorder, RecorderStats
from spsp_ctrl.rig.base import Rig
from spsp_ctrl.rig.factory import build_rig
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.clock import LockStepClock, MonotonicClock
from spsp_ctrl.runtime.identity import law_digest, versions
from spsp_ctrl.runtime.loop import CycleRecorder, Interrupts, LoopResult, Operator, Policy, StatusSink, run_loop
from spsp_ctrl.runtime.realtime import RealTime, Wishes, degraded

LOG_NAME = "run.mcap"


@dataclass(frozen=True, slots=True)
class Plan:
    """What a session needs, checked."""

    config: RigConfig
    scenario: Scenario
    model_path: Path
    seed: int
    real_time: bool


class Watcher:
    """What a live screen needs from the loop: every cycle, and the operator's requests."""

    operator: Operator | None = None
    status: StatusSink | None = None

    def note(self, control: Control, timing: Timing) -> None:
        """Called in every cycle; must be cheap."""

    def event(self, text: str, t_s: float) -> None:
        """Something happened."""

    def degraded(self, names: str) -> None:
        """What of the real-time settings was not granted."""

    def recording(self, counts: Callable[[], tuple[int, int]]) -> None:
        """Where to ask how many records were handed over and lost."""


class _Watched:
    """A recorder that also tells the watcher."""

    def __init__(self, recorder: Recorder, watcher: Watcher) -> None:
        self._recorder = recorder
        self._watcher = watcher

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        self._recorder.record_cycle(measurement, control, timing, truth)
        self._watcher.note(control, timing)

    def event(self, stamp_ns: int, level: str, id: str, text: str) -> None:
        self._recorder.event(stamp_ns, level, id, text)
        self._watcher.event(text, stamp_ns * 1e-9)

    def operator(self, request: OperatorRequest) -> None:
        self._recorder.operator(request)


class _WithRaw:
    """A recorder that also takes what went over the buses of the rig."""

    def __init__(self, recorder: Recorder, inner: CycleRecorder, raw: Any) -> None:
        self._recorder, self._inner, self._raw = recorder, inner, raw
        self.event, self.operator = inner.event, inner.operator
        raw.start()

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        self._inner.record_cycle(measurement, control, timing, truth)
        self._recorder.raw(measurement.stamp_ns, self._raw.take())


@dataclass(frozen=True, slots=True)
class SessionResult:
    """A finished run."""

    folder: Path
    summary: dict[str, Any]
    log: LogData
    loop: LoopResult


def new_folder(out: Path | None) -> Path:
    """``out``, or ``runs/<UTC>`` in the working folder. Raises ``OSError`` (``FileExistsError`` for a folder that already holds a run)."""
    if out is not None:
        if out.exists() and not out.is_dir():
            raise NotADirectoryError(f"{out}: is a file, not a folder; choose another run folder")
        out.mkdir(parents=True, exist_ok=True)
        if (out / LOG_NAME).exists():
            raise FileExistsError(f"{out} already holds a run ({LOG_NAME}); choose another folder")
        return out
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    for suffix in ["", *(f"-{n}" for n in range(2, 100))]:
        folder = Path("runs") / (stamp + suffix)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        return folder
    raise FileExistsError(f"no free folder name for {stamp}")


@contextmanager
def interruptible() -> Iterator[Interrupts]:
    """Ctrl-C, SIGTERM and SIGHUP ask for a controlled stop instead of raising."""
    interrupts = Interrupts()
    wanted = [s for s in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, s)]
    before = {}
    for name in wanted:
        number = getattr(signal, name)
        before[number] = signal.signal(number, interrupts)
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def prepare(plan: Plan, announce: Callable[[str], None] = lambda text: None) -> Rig:
    """Build and open the rig: everything that can be refused is refused here, before a folder exists and before a clock starts."""
    rig = build_rig(plan.config, plan.model_path, plan.scenario, plan.seed, real_time=plan.real_time, announce=announce)
    rig.open()
    return rig


def run_session(
    plan: Plan,
    rig: Rig,
    folder: Path,
    watcher: Watcher | None = None,
    announce: Callable[[str], None] = lambda text: None,
) -> SessionResult:
    """Run the scenario on an opened rig, record it into ``folder`` and summarise it."""
    config, scenario = plan.config, plan.scenario
    period_ns = round(1e9 / config.rate_hz)
    identity = rig.open()
    # the files beside it under their names there, so that the folder itself can be run again
    own = config.model_copy(update={"scenario": "scenario.yaml", "rig": config.rig.model_copy(update={"model": "model.yaml"})})
    files = {
        "rig.yaml": dump_resolved(own),
        "scenario.yaml": dump_resolved(scenario),
        "model.yaml": plan.model_path.read_text(encoding="utf-8"),
    }
    facts = getattr(rig, "facts", None)
    if facts is not None:
        files["devices.json"] = json.dumps({"identity": identity._asdict(), "facts": facts()}, indent=2) + "\n"
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    mode = "real-time" if plan.real_time else "lock-step"
    about = {
        "law": config.control.law,
        "law_digest": law_digest(),
        "seed": str(plan.seed),
        "mode": mode,
        "rate_hz": str(config.rate_hz),
        "rig": config.name,
        "scenario": scenario.name,
        "vendor": identity.vendor,
        "product": identity.product,
        "serial": identity.serial,
        "firmware": identity.firmware,
        "virtual": str(identity.virtual).lower(),
    }
    recorder = Recorder(folder / LOG_NAME, real_time=plan.real_time, attachments=files, metadata={"run": about, "versions": versions()})
    watched: CycleRecorder = _Watched(recorder, watcher) if watcher is not None else recorder
    raw = getattr(rig, "raw", None)
    if raw is not None:
        watched = _WithRaw(recorder, watched, raw)
    if watcher is not None:
        watcher.recording(recorder.counts)

    def started(origin_ns: int) -> None:
        utc_ns = time.time_ns() - (time.monotonic_ns() - origin_ns)
        recorder.metadata("clock", {"monotonic_ns": str(origin_ns), "utc_ns": str(utc_ns)})

    asked = config.realtime
    clock = MonotonicClock(period_ns, started, spin_ns(config)) if plan.real_time else LockStepClock(period_ns)
    controller = cycle.controller(config)
    state = cycle.start(config, scenario.reference)
    announce(f"running {scenario.name} for {scenario.duration_s:g} s ({mode})")
    realtime = RealTime(wishes(asked) if plan.real_time and asked.enabled else None)
    if plan.real_time and asked.enabled and asked.cpu is not None:
        keep_off(recorder.pid, asked.cpu)
    try:
        with interruptible() as interrupts, realtime:
            refused = degraded(realtime.granted)
            if refused:
                names = ", ".join(name.replace("_", " ") for name, _ in refused)
                announce(f"degraded: not granted by the operating system: {names}")
                if watcher is not None:
                    watcher.degraded(names)
            result = run_loop(
                rig,
                clock,
                controller,
                state,
                round(scenario.duration_s * 1e9),
                watched,
                watcher.operator if watcher else None,
                watcher.status if watcher else None,
                interrupts,
                config.rate_hz,
                policy=Policy(plan.real_time and asked.on_miss == "stop", asked.on_log_failure == "stop"),
                log_problem=lambda: recorder.problem,
            )
    finally:
        rig.stop()
        rig.close()
        recorder.metadata("result", {"realtime_granted": json.dumps(realtime.granted)})
        stats = recorder.close()
    log, stats = _read_back(folder / LOG_NAME, stats)
    summary = summarise(plan, log, result, realtime.granted, stats)
    if hasattr(rig, "figures"):
        summary["buses"] = bus_figures(rig.figures(), log, config.rate_hz)
    text = json.dumps(summary, indent=2, allow_nan=False) + "\n"
    try:
        (folder / "summary.json").write_text(text, encoding="utf-8")
    except OSError as error:  # a full disk: the run is over, its figures are still shown
        with suppress(OSError):
            (folder / "summary.json").unlink()
        stderr(f"{folder / 'summary.json'}: cannot be written: {error.strerror}")
    return SessionResult(folder, summary, log, result)


def wishes(asked: RealTimeConfig) -> Wishes:
    """What the rig file asks of the operating system."""
    return Wishes(asked.priority, asked.cpu, asked.lock_memory, asked.cpu_dma_latency, asked.freeze_collector)


def spin_ns(config: RigConfig) -> int:
    """Time to spin before a deadline: what the rig file asks, at most 40 % of a period (the kernel throttles a real-time task that never sleeps)."""
    return round(min(config.realtime.spin_us * 1e3, 0.4e9 / config.rate_hz)) if config.realtime.enabled else 0


def keep_off(pid: int, cpu: int) -> None:
    """Another process leaves the core of the loop, where there is another one."""
    with suppress(OSError, AttributeError):
        others = os.sched_getaffinity(pid) - {cpu}
        if others:
            os.sched_setaffinity(pid, others)


def _read_back(path: Path, stats: RecorderStats) -> tuple[LogData, RecorderStats]:
    """What really is in the file, and how much that was handed over is not: a writer that died took what was on its way to it."""
    try:
        log = read_log(path)
    except LogError as error:
        log = LogData(path, {}, {}, [], [], {}, {}, False, str(error))
    log = replace(log, topics={topic: np.zeros(0, TOPICS[topic].dtype) for topic in CYCLIC} | log.topics)
    kept = sum(map(len, log.topics.values())) + len(log.events) + len(log.operator) + sum(log.others.values())
    lost = stats.records + stats.lost - kept
    return log, RecorderStats(kept, lost, stats.problem or log.problem)


def summarise(
    plan: Plan, log: LogData, result: LoopResult, granted: dict[str, Any], stats: RecorderStats
) -> dict[str, Any]:
    """``summary.json`` of a run."""
    config, scenario = plan.config, plan.scenario
    summary: dict[str, Any] = {
        "rig": config.name,
        "scenario": scenario.name,
        "law": config.control.law,
        "mode": "real-time" if plan.real_time else "lock-step",
        "virtual": virtual(config),
        "ended": result.ended,
        "duration_s": min(scenario.duration_s, result.last_ns * 1e-9),
        "settle_s": scenario.settle_s,
        "rate_hz": config.rate_hz,
        "seed": plan.seed,
    }
    summary |= figures.measures(log.topics, config, scenario, imu_bias(plan.model_path))
    summary["timing_us"] = figures.timing(log.topics, scenario.settle_s, scenario.duration_s)
    summary["log"] = {"records": stats.records, "lost": stats.lost, "problem": stats.problem}
    summary["realtime_granted"] = granted
    summary["acceptance"] = figures.acceptance(scenario.acceptance, summary, config.control.law)
    return summary


def bus_figures(counted: dict[str, float], log: LogData, rate_hz: int) -> dict[str, float]:
    """What the buses did and what they cost: frames by direction, answers late or lost, time of read and write without the wait for SYNC."""
    timing = log.topics["/timing"]
    frames = {"received": 0, "sent": 0}
    for topic, count in log.others.items():
        if topic.startswith("/raw/"):
            frames["sent" if topic.endswith("/tx") else "received"] += count
    if not len(timing):
        return {**frames, **counted}
    io_us = 1e-3 * float(np.mean(timing["read_ns"] + timing["write_ns"])) - counted.get("waiting_us_mean", 0.0)
    return {**frames, **counted, "io_us_mean": round(io_us, 3), "io_share_of_period": round(io_us * 1e-6 * rate_hz, 5)}


def virtual(config: RigConfig) -> bool:
    """Whether no hardware is behind the rig file."""
    return not isinstance(config.rig, BusDriver) or config.rig.world != "hardware"


def imu_bias(model_path: Path) -> figures.ImuBias:
    """Constant attitude bias of the virtual rig's IMU."""
    from spsp_ctrl.plant.layout import G
    from spsp_ctrl.plant.model import load_model

    p = load_model(model_path).parameters()
    return figures.ImuBias(float(p[G.imu_pitch_bias_rad]), -float(p[G.imu_roll_bias_rad]))


def stderr(text: str) -> None:
    """A progress line for a person, away from machine output."""
    print(text, file=sys.stderr, flush=True)
