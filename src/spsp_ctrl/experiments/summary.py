"""Figures of a run from its log: errors, timing, acceptance rows. The one place where they are defined."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.scenario import Acceptance
from spsp_ctrl.messages import Mode, ReferenceKind
from spsp_ctrl.recording.schema import TOPICS

ARCMIN_PER_RAD = 10800.0 / np.pi
DEG_PER_RAD = 180.0 / np.pi
UM_PER_M = 1e6

Topics = Mapping[str, NDArray[Any]]
Figures = dict[str, Any]
Array = NDArray[np.float64]


def _wrap(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _spread(error: Array, scale: float, name: str) -> Figures:
    if error.size == 0:
        return {f"{name}_max": None, f"{name}_rms": None}
    return {
        f"{name}_max": float(np.abs(error).max() * scale),
        f"{name}_rms": float(np.sqrt(np.mean(error**2)) * scale),
    }


def judged(control: NDArray[Any], settle_s: float, duration_s: float) -> NDArray[np.bool_]:
    """Cycles that count: after the start-up transient, before the final stop, while the loop is active."""
    t = control["stamp_ns"] * 1e-9
    return np.asarray((t >= settle_s) & (t <= duration_s) & (control["mode"] == int(Mode.ACTIVE)))


def errors(topics: Topics, settle_s: float, duration_s: float) -> Figures:
    """Attitude errors in arcmin, heading errors in deg and rod errors in um; ``imu`` as the sensor sees them, ``true`` on a virtual rig."""
    control = topics["/control"]
    keep = judged(control, settle_s, duration_s)
    c = control[keep]
    truth = topics.get("/truth")
    true = truth[keep] if truth is not None and len(truth) == len(control) else None
    joint = bool(len(c)) and bool((c["reference.kind"] == int(ReferenceKind.JOINT)).all())
    source = "joint" if joint else "platform"
    result: Figures = {"samples": int(keep.sum()), "error_arcmin": {}, "rod_error_um": {}}
    for axis in ("pitch", "roll"):
        reference = c[f"reference.{axis}_rad"]
        row = _spread(reference - c[f"estimate.{source}_{axis}_rad"], ARCMIN_PER_RAD, "imu")
        if true is not None:
            row |= _spread(reference - true[f"{source}_{axis}_rad"], ARCMIN_PER_RAD, "true")
            rod = true[f"rod_{axis}_m"] - c[f"estimate.rod_{axis}_m"]
            result["rod_error_um"][axis] = _spread(rod, UM_PER_M, "true") | {
                "true_mean": float(rod.mean() * UM_PER_M) if rod.size else None
            }
        result["error_arcmin"][axis] = row
    heading = c["estimate.azimuth_rad"] if joint else c["estimate.heading_rad"]
    row = _spread(_wrap(c["reference.heading_rad"] - heading), DEG_PER_RAD, "imu")
    if true is not None:
        at = true["azimuth_rad"] if joint else true["heading_rad"]
        row |= _spread(_wrap(c["reference.heading_rad"] - at), DEG_PER_RAD, "true")
    result["azimuth_error_deg"] = row
    return result


def timing(topics: Topics) -> Figures:
    """Lateness and computing time of the cycles in us."""
    rows = topics["/timing"]
    figures: Figures = {}
    for name in ("lateness", "compute"):
        values = rows[f"{name}_ns"] * 1e-3
        q = np.quantile(values, (0.5, 0.99, 0.999)) if len(values) else (0.0, 0.0, 0.0)
        figures[name] = {
            "p50": float(q[0]),
            "p99": float(q[1]),
            "p99_9": float(q[2]),
            "max": float(values.max()) if len(values) else 0.0,
        }
    figures["skipped"] = int(rows["skipped"].sum()) if len(rows) else 0
    return figures


def names() -> tuple[str, ...]:
    """Every figure that a summary can hold, as dotted paths: what an acceptance row may name."""
    empty = {topic: np.zeros(0, codec.dtype) for topic, codec in TOPICS.items()}
    figures = errors(empty, 0.0, 0.0) | {"timing_us": timing(empty), "log": {"records": 0, "lost": 0}, "duration_s": 0.0}

    def walk(node: Figures, prefix: str) -> Iterator[str]:
        for key, value in node.items():
            if isinstance(value, dict):
                yield from walk(value, f"{prefix}{key}.")
            else:
                yield prefix + key

    return tuple(walk(figures, ""))


def look_up(figures: Figures, path: str) -> float | None:
    """A figure by its dotted path; None when the run does not have it (for instance a true error on hardware)."""
    value: Any = figures
    for part in path.split("."):
        if not isinstance(value, dict) or part not in value:
            return None
        value = value[part]
    return float(value) if isinstance(value, int | float) else None


def acceptance(rows: Sequence[Acceptance], figures: Figures) -> list[Figures]:
    """One row each: passed when the figure exists and is within the limit. Rows touched by skipped cycles say so."""
    touched = bool(figures["timing_us"]["skipped"])
    verdict = []
    for row in rows:
        value = look_up(figures, row.value)
        verdict.append(
            {
                "name": row.name,
                "value": value,
                "limit": row.limit,
                "unit": row.unit,
                "pass": value is not None and abs(value) <= row.limit,
                "touched_by_skips": touched,
            }
        )
    return verdict
