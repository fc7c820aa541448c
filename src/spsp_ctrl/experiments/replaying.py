"""Replay of a log file: its own rig and scenario files come out of the log."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from spsp_ctrl.config.loader import ConfigError, ConfigProblem, apply_overrides, load_rig, load_scenario
from spsp_ctrl.messages import Control, Measurement, Mode, OperatorRequest
from spsp_ctrl.recording.reader import LogData, LogError, messages, read_log
from spsp_ctrl.rig.injection import Fault
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.identity import law_digest
from spsp_ctrl.runtime.replay import ReplayResult, replay
from spsp_ctrl.safety.faults import BY_NUMBER
from spsp_ctrl.safety.judge import hold_faults

L = TypeVar("L")


def replay_log(
    log: Path, config: Path | None, overrides: tuple[str, ...], progress: Callable[[int, int], None]
) -> ReplayResult:
    """Replay ``log``. Raises ``LogError`` for a log that cannot be replayed, ``ConfigError`` for a bad ``config`` or override."""
    data = read_log(log)
    missing = [name for name in ("rig.yaml", "scenario.yaml") if name not in data.attachments]
    if missing:
        raise LogError(f"{log}: cannot be replayed: it has no attachment {' and no '.join(missing)} (see docs/log-format.md)")
    for topic in ("/measurement", "/control"):
        if topic not in data.topics or len(data.topics[topic]) == 0:
            raise LogError(f"{log}: cannot be replayed: no messages on {topic}")
    recorded_rig, scenario = attached(data, "rig.yaml", load_rig), attached(data, "scenario.yaml", load_scenario).model
    loaded = recorded_rig if config is None else load_rig(config)
    if overrides:
        loaded = apply_overrides(loaded, overrides)
    measurements, controls = data.topics["/measurement"], data.topics["/control"]
    total = min(len(measurements), len(controls))
    if (measurements["cycle"][:total] != controls["cycle"][:total]).any():
        raise LogError(f"{log}: cannot be replayed: /measurement and /control do not belong to the same cycles (records lost?)")
    _no_gap(data, total)
    requests = _requests(data)
    recorded = data.metadata.get("run", {}).get("law_digest", "")
    result = replay(
        loaded.model,
        scenario,
        zip(messages(measurements, Measurement), messages(controls, Control), strict=False),
        requests,
        exact=recorded == law_digest(),
        progress=lambda done: progress(done, total),
    )
    return replace(result, log_problem=data.problem)


@dataclass(frozen=True, slots=True)
class FaultedReplay:
    """What the controller made of a recorded run whose signals were hurt."""

    fault: str
    """First fault that stopped it; empty: none did."""
    time_s: float
    mode: str
    notes: tuple[str, ...]
    """Faults that were only said."""
    cycles: int

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return asdict(self)


def replay_faulted(log: Path, scenario: Path, progress: Callable[[int, int], None]) -> FaultedReplay:
    """Play the recorded measurements, hurt by the ``faults:`` of ``scenario``, to a fresh controller until a fault stops it.

    Commands act on nothing: what counts is which fault is named, and when. Raises ``LogError``, and ``ConfigError`` for a bad scenario or one that
    hurts commands.
    """
    loaded = load_scenario(scenario)
    for i, injection in enumerate(loaded.model.faults):
        if injection.signal.startswith("command"):
            line, column = loaded.locate(("faults", i, "signal"))
            text = f"faults.{i}.signal = {injection.signal!r}: a recorded run cannot be told another command; hurt a signal that was measured"
            raise ConfigError([ConfigProblem(loaded.path, line, column, text)])
    data = read_log(log)
    config, plan = attached(data, "rig.yaml", load_rig).model, attached(data, "scenario.yaml", load_scenario).model
    measurements = data.topics["/measurement"]
    requests = defaultdict(list)
    for request in _requests(data):
        requests[request.stamp_ns].append(request)
    faults = [Fault(injection, 1) for injection in loaded.model.faults]
    controller, state = cycle.controller(config), cycle.start(config, plan.reference)
    last_ns, said, control = -round(1e9 / config.rate_hz), 0, None
    done = 0
    for m in messages(measurements, Measurement):
        now_ns = m.stamp_ns
        row: list[Any] = list(m)
        for fault in faults:
            row[fault.signal.sample] = fault.frame(row[fault.signal.sample], now_ns)
        control, state = cycle.step(state, controller, Measurement(*row), tuple(requests.pop(now_ns, ())), now_ns, (now_ns - last_ns) * 1e-9)
        last_ns, done = now_ns, done + 1
        if any(fault.active(now_ns) for fault in faults):
            said |= state.said
        if done % 1000 == 0:
            progress(done, len(measurements))
        if control.fault:
            break
    notes = tuple(f.id for f in hold_faults() if said >> f.number & 1)
    if control is None:
        raise LogError(f"{log}: cannot be replayed: no messages on /measurement")
    name = BY_NUMBER[control.fault].id if control.fault else ""
    return FaultedReplay(name, last_ns * 1e-9, Mode(control.mode).name, notes, done)


def _requests(data: LogData) -> list[OperatorRequest]:
    return [
        OperatorRequest(int(r["stamp_ns"]), str(r["verb"]), float(r["value"]), str(r["source"]), float(r.get("rate", 0.0)))
        for r in data.operator
    ]


def attached(data: LogData, name: str, load: Callable[[Path], L]) -> L:
    """An attachment of a log, loaded as the file that it was. Raises ``LogError``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data.attachments[name])
        try:
            return load(path)
        except ConfigError as error:
            text = str(error).splitlines()[0].replace(f"{folder}/", "")
            raise LogError(f"{data.path}: cannot be replayed: its attachment {text}") from None


def _no_gap(data: LogData, total: int) -> None:
    """Cycles that the loop skipped are replayed as skipped; cycles whose records were lost make every later command unknowable."""
    cycles = data.topics["/measurement"]["cycle"][:total]
    timing = data.topics.get("/timing")
    if timing is None:
        return
    n = min(total, len(timing))
    lost = np.flatnonzero(np.diff(cycles[:n]) != 1 + timing["skipped"][1:n])
    if lost.size:
        first = int(lost[0])
        raise LogError(f"{data.path}: cannot be replayed: records lost between cycles {cycles[first]} and {cycles[first + 1]}")
