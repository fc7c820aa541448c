"""Replay of a log file: its own rig and scenario files come out of the log."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from spsp_ctrl.config.loader import apply_overrides, load_rig, load_scenario
from spsp_ctrl.messages import Control, Measurement, OperatorRequest
from spsp_ctrl.recording.reader import LogError, messages, read_log
from spsp_ctrl.runtime.identity import law_digest
from spsp_ctrl.runtime.replay import ReplayResult, replay


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
    with tempfile.TemporaryDirectory() as folder:
        for name in ("rig.yaml", "scenario.yaml"):
            (Path(folder) / name).write_bytes(data.attachments[name])
        loaded = load_rig(config if config is not None else Path(folder) / "rig.yaml")
        if overrides:
            loaded = apply_overrides(loaded, overrides)
        scenario = load_scenario(Path(folder) / "scenario.yaml").model
    measurements, controls = data.topics["/measurement"], data.topics["/control"]
    total = min(len(measurements), len(controls))
    if (measurements["cycle"][:total] != controls["cycle"][:total]).any():
        raise LogError(f"{log}: cannot be replayed: /measurement and /control do not belong to the same cycles (records lost?)")
    requests = [
        OperatorRequest(int(r["stamp_ns"]), str(r["verb"]), float(r["value"]), str(r["source"])) for r in data.operator
    ]
    recorded = data.metadata.get("run", {}).get("law_digest", "")
    return replay(
        loaded.model,
        scenario,
        zip(messages(measurements, Measurement), messages(controls, Control), strict=False),
        requests,
        exact=recorded == law_digest(),
        progress=lambda done: progress(done, total),
    )
