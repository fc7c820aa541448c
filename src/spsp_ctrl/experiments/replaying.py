"""Replay of a log file: its own rig and scenario files come out of the log."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from spsp_ctrl.config.loader import ConfigError, apply_overrides, load_rig, load_scenario
from spsp_ctrl.messages import Control, Measurement, OperatorRequest
from spsp_ctrl.recording.reader import LogData, LogError, messages, read_log
from spsp_ctrl.runtime.identity import law_digest
from spsp_ctrl.runtime.replay import ReplayResult, replay

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
    requests = [
        OperatorRequest(int(r["stamp_ns"]), str(r["verb"]), float(r["value"]), str(r["source"])) for r in data.operator
    ]
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
