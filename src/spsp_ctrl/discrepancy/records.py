"""A log of a single axis as arrays of a diagnosis. Topics of the truth are never asked for."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.recording.reader import LogData, LogError, read_log

TOPICS = ("/axis",)
"""The only topics that a diagnosis of an axis opens."""
TWO_PI = 2.0 * np.pi


@dataclass(frozen=True, slots=True)
class Motion:
    """One named motion: rows ``start`` up to ``stop``."""

    name: str
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Record:
    """One session: what was commanded and read, in SI."""

    path: Path
    rows: NDArray[Any]
    rate_hz: float
    controller: str
    motions: tuple[Motion, ...]
    attachments: dict[str, bytes] = field(repr=False)

    @property
    def seconds(self) -> float:
        """Length of the record."""
        return len(self.rows) / self.rate_hz

    def motor_rad(self, counts_per_turn: float) -> Array:
        """Motor angle by the resolver."""
        return np.asarray(self.rows["resolver_counts"], np.float64) * (TWO_PI / counts_per_turn)

    def fingerprint(self) -> str:
        """Digest of the samples: which data a result comes from."""
        return hashlib.sha256(np.ascontiguousarray(self.rows).tobytes()).hexdigest()[:16]


def load_record(path: Path) -> tuple[Record, LogData]:
    """Read a log of an axis. Raises ``LogError`` when it is none, is cut, or has no samples."""
    data = read_log(path, topics=TOPICS)
    run = data.metadata.get("run", {})
    rows = data.topics.get("/axis")
    if rows is None or run.get("kind", "axis") != "axis":
        raise LogError(f"{path}: has no samples on /axis: it is not the log of a single axis (see docs/log-format.md)")
    if not data.complete:
        raise LogError(f"{path}: the log is not complete ({data.problem}); `spsp-ctrl log repair` makes a whole one of what is left")
    if len(rows) < 100:
        raise LogError(f"{path}: {len(rows)} samples on /axis are too few for a diagnosis")
    try:
        rate = float(run["rate_hz"])
    except (KeyError, ValueError):
        raise LogError(f"{path}: metadata `run` does not state rate_hz (see docs/log-format.md)") from None
    return Record(Path(path), rows, rate, run.get("controller", "none"), _motions(rows, data.events), data.attachments), data


def _motions(rows: NDArray[Any], events: list[dict[str, Any]]) -> tuple[Motion, ...]:
    stamps = rows["stamp_ns"]
    marks = sorted((int(e["stamp_ns"]), str(e.get("text", ""))) for e in events if e.get("id") == "motion")
    starts = [(int(np.searchsorted(stamps, at)), name) for at, name in marks]
    starts = [(at, name) for at, name in starts if at < len(rows)]
    if not starts or starts[0][0] > 0:
        starts.insert(0, (0, "start"))
    ends = [at for at, _ in starts[1:]] + [len(rows)]
    return tuple(Motion(name, at, end) for (at, name), end in zip(starts, ends, strict=True) if end > at)
