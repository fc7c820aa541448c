"""A log of the whole rig as arrays of a diagnosis. Topics of the truth are never asked for."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.loader import ConfigError, load_rig, load_scenario
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.recording.reader import LogData, LogError, read_log

TOPICS = ("/measurement", "/control")
"""The only cyclic topics that a diagnosis of a platform opens."""
LEAST_S = 6.0
"""Shorter than this is no record of a swinging platform."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PlatformRecord:
    """One session in closed loop, only its cycles with both drives on and the law active or aligning."""

    path: Path
    measured: NDArray[Any]
    control: NDArray[Any]
    first: int
    """Row of the log at which the drives were on."""
    config: RigConfig
    scenario: Scenario
    data: LogData = field(repr=False)

    @property
    def rate_hz(self) -> float:
        """Cycles per second."""
        return float(self.config.rate_hz)

    @property
    def seconds(self) -> float:
        """Length of the record."""
        return len(self.measured) / self.rate_hz

    def fingerprint(self) -> str:
        """Digest of the readings: which data a result comes from."""
        return hashlib.sha256(np.ascontiguousarray(self.data.topics["/measurement"]).tobytes()).hexdigest()[:16]

    def column(self, name: str) -> Array:
        """A field of ``/measurement`` as floats."""
        return np.asarray(self.measured[name], np.float64)


def is_platform(data: LogData) -> bool:
    """Whether a log is that of a whole rig."""
    return "/measurement" in data.topics


def load_platform(path: Path) -> PlatformRecord:
    """Read a log of a rig. Raises ``LogError`` when it is none, is cut, or was hardly ever in control."""
    data = read_log(path, topics=TOPICS)
    for topic in TOPICS:
        if topic not in data.topics or len(data.topics[topic]) == 0:
            raise LogError(f"{path}: has no messages on {topic}: it is not the log of a rig (see docs/log-format.md)")
    if not data.complete:
        raise LogError(f"{path}: the log is not complete ({data.problem}); `spsp-ctrl log repair` makes a whole one of what is left")
    missing = [name for name in ("rig.yaml", "scenario.yaml") if name not in data.attachments]
    if missing:
        raise LogError(f"{path}: it has no attachment {' and no '.join(missing)}: mechanism, load and law are not known (see docs/log-format.md)")
    config, scenario = _attached(data, "rig.yaml", load_rig).model, _attached(data, "scenario.yaml", load_scenario).model
    measured, control = data.topics["/measurement"], data.topics["/control"]
    n = min(len(measured), len(control))
    measured, control = measured[:n], control[:n]
    if (measured["cycle"] != control["cycle"]).any():
        raise LogError(f"{path}: /measurement and /control do not belong to the same cycles")
    on = measured["drive_pitch.enabled"] & measured["drive_roll.enabled"] & (measured["imu.seq"] >= 0)
    first, last = _longest(np.asarray(on, bool))
    if last - first < LEAST_S * config.rate_hz:
        raise LogError(f"{path}: the drives were on for {(last - first) / config.rate_hz:.1f} s at a stretch; a diagnosis needs {LEAST_S:g} s")
    return PlatformRecord(Path(path), measured[first:last], control[first:last], first, config, scenario, data)


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """Longest run of true: first row, and row behind the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    if not len(edges):
        return 0, 0
    starts, ends = edges[::2], edges[1::2]
    k = int(np.argmax(ends - starts))
    return int(starts[k]), int(ends[k])


def _attached(data: LogData, name: str, load: Any) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data.attachments[name])
        try:
            return load(path)
        except ConfigError as error:
            text = str(error).splitlines()[0].replace(f"{folder}/", "")
            raise LogError(f"{data.path}: its attachment {text}") from None
