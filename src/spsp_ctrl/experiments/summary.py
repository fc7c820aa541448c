"""Figures of a run from its log: errors, timing, acceptance rows. The one place where they are defined; special ones have a module each.

Errors come in three kinds that are never mixed:

``imu``       by the IMU that closes the loop, as the paper measures: reference minus the frames of the IMU;
``unbiased``  true, without the constant bias of the IMU, which no loop closed on that IMU can see;
``true``      true in full.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Acceptance, Scenario
from spsp_ctrl.experiments import open_loop, pointing, warming
from spsp_ctrl.experiments.signals import (
    ARCMIN_PER_RAD,
    DEG_PER_RAD,
    UM_PER_M,
    Array,
    Curves,
    Figures,
    Topics,
    imu_frames,
    judged,
    thin,
    wrap,
)
from spsp_ctrl.messages import ReferenceKind
from spsp_ctrl.recording.schema import CYCLIC, TOPICS

__all__ = ["ImuBias", "acceptance", "curves", "errors", "judged", "look_up", "measures", "timing", "within"]


class ImuBias(NamedTuple):
    """Constant error of the IMU of a virtual rig, in the platform's own angles."""

    pitch_rad: float
    roll_rad: float


SLOW_S = 2.0
SECTIONS = {"stations": "open_loop", "open_loop": "open_loop", "heading": "pointing", "thermal": "thermal"}
"""Section of a summary that an entry of a scenario's ``figures`` adds."""
NO_BIAS = ImuBias(0.0, 0.0)


def _spread(error: Array, scale: float, name: str) -> Figures:
    if error.size == 0:
        return {f"{name}_max": None, f"{name}_rms": None}
    return {
        f"{name}_max": float(np.abs(error).max() * scale),
        f"{name}_rms": float(np.sqrt(np.mean(error**2)) * scale),
    }


def _above_slow(t: Array, error: Array) -> Array:
    """The error less its mean over ``SLOW_S``: what moves faster than the slow wander of the IMU."""
    if len(t) < 2 or t[-1] - t[0] < 2.0 * SLOW_S:
        return np.empty(0)
    width = round(SLOW_S / float(np.median(np.diff(t))))
    total = np.cumsum(np.insert(error, 0, 0.0))
    mean = (total[width:] - total[:-width]) / width
    first = width // 2
    return np.asarray(error[first : first + len(mean)] - mean)


def attitude_errors(topics: Topics, settle_s: float, duration_s: float, bias: ImuBias) -> dict[str, dict[str, tuple[Array, Array]]]:
    """Time in s and error in rad by axis and kind (see the head of this module), of the cycles or frames that count.

    A joint reference is followed on the resolvers: its ``imu`` error is by the controller's own joint angle.
    """
    control = topics["/control"]
    keep = judged(control, settle_s, duration_s)
    c = control[keep]
    t = c["stamp_ns"] * 1e-9
    truth = topics.get("/truth")
    true = truth[keep] if truth is not None and len(truth) == len(control) else None
    joint = _is_joint(c)
    source = "joint" if joint else "platform"
    frames = imu_frames(topics).among(keep)
    at = np.clip(np.searchsorted(control["stamp_ns"] * 1e-9, frames.stamp_s - 1e-9), 0, max(0, len(control) - 1))
    result: dict[str, dict[str, tuple[Array, Array]]] = {}
    for axis in ("pitch", "roll"):
        reference = c[f"reference.{axis}_rad"]
        kinds: dict[str, tuple[Array, Array]] = {}
        if joint:
            kinds["imu"] = (t, reference - c[f"estimate.joint_{axis}_rad"])
        else:
            seen = frames.pitch_rad if axis == "pitch" else frames.roll_rad
            kinds["imu"] = (frames.stamp_s, control[f"reference.{axis}_rad"][at] - seen)
        if true is not None:
            full = reference - true[f"{source}_{axis}_rad"]
            if not joint:
                kinds["unbiased"] = (t, full - getattr(bias, f"{axis}_rad"))
            kinds["true"] = (t, full)
        result[axis] = kinds
    return result


def _is_joint(control: NDArray[Any]) -> bool:
    return bool(len(control)) and bool((control["reference.kind"] == int(ReferenceKind.JOINT)).all())


def errors(topics: Topics, settle_s: float, duration_s: float, bias: ImuBias = NO_BIAS) -> Figures:
    """Attitude errors in arcmin by kind, heading errors in deg and rod errors in um."""
    control = topics["/control"]
    keep = judged(control, settle_s, duration_s)
    c = control[keep]
    truth = topics.get("/truth")
    true = truth[keep] if truth is not None and len(truth) == len(control) else None
    joint = _is_joint(c)
    result: Figures = {"samples": int(keep.sum()), "error_arcmin": {}, "rod_error_um": {}}
    by_axis = attitude_errors(topics, settle_s, duration_s, bias)
    for axis, kinds in by_axis.items():
        row: Figures = {}
        for kind, (_, error) in kinds.items():
            row |= _spread(error, ARCMIN_PER_RAD, kind)
        for kind in ("imu", "true"):
            if kind in kinds:
                error = kinds[kind][1]
                row[f"{kind}_range"] = float(np.ptp(error) * ARCMIN_PER_RAD) if error.size else None
        if "true" in kinds:
            fast = _above_slow(*kinds["true"])
            row["fast_range"] = float(np.ptp(fast) * ARCMIN_PER_RAD) if fast.size else None
        result["error_arcmin"][axis] = row
        if true is not None:
            rod = true[f"rod_{axis}_m"] - c[f"estimate.rod_{axis}_m"]
            result["rod_error_um"][axis] = _spread(rod, UM_PER_M, "true") | {
                "true_mean": float(rod.mean() * UM_PER_M) if rod.size else None
            }
    result["error_arcmin"]["worst"] = {
        name: max((row[name] for row in result["error_arcmin"].values() if row.get(name) is not None), default=None)
        for name in result["error_arcmin"]["roll"]
    }
    heading = c["estimate.azimuth_rad"] if joint else c["estimate.heading_rad"]
    row = _spread(wrap(c["reference.heading_rad"] - heading), DEG_PER_RAD, "imu")
    if true is not None:
        at = true["azimuth_rad"] if joint else true["heading_rad"]
        row |= _spread(wrap(c["reference.heading_rad"] - at), DEG_PER_RAD, "true")
    result["azimuth_error_deg"] = row
    return result


def measures(topics: Topics, config: RigConfig, scenario: Scenario, bias: ImuBias = NO_BIAS) -> Figures:
    """Every figure of a run but timing: errors always, the others as the scenario's ``figures`` ask for."""
    result = errors(topics, scenario.settle_s, scenario.duration_s, bias)
    asked = scenario.figures
    if "stations" in asked or "open_loop" in asked:
        result["open_loop"] = open_loop.figures(topics, config, scenario, bias)
    if "heading" in asked:
        result["pointing"] = pointing.figures(topics, config, scenario)
    if "thermal" in asked:
        result["thermal"] = warming.figures(topics, config, scenario)
    return result


def curves(topics: Topics, config: RigConfig, scenario: Scenario, bias: ImuBias = NO_BIAS) -> Curves:
    """What the pictures of the scenario's ``figures`` need, in report units, thinned to what a page can show."""
    result: Curves = {}
    asked = scenario.figures
    if "errors" in asked:
        for axis, kinds in attitude_errors(topics, scenario.settle_s, scenario.duration_s, bias).items():
            for kind, (t, error) in kinds.items():
                result[f"error.{axis}.{kind}"] = thin(t, error * ARCMIN_PER_RAD)
    if "base" in asked:
        m = topics["/measurement"]
        for axis in ("pitch", "roll"):
            result[f"base.{axis}"] = thin(m["stamp_ns"] * 1e-9, m[f"base.{axis}_rad"] * DEG_PER_RAD)
    if "stations" in asked or "open_loop" in asked:
        result |= open_loop.curves(topics, config, scenario)
    if "heading" in asked:
        result |= pointing.curves(topics, config, scenario)
    if "thermal" in asked:
        result |= warming.curves(topics, config, scenario)
    return result


def timing(topics: Topics, settle_s: float = 0.0, duration_s: float = float("inf")) -> Figures:
    """Lateness and computing time of the cycles in us, skipped cycles in all and in the time that is judged."""
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
    t = rows["stamp_ns"] * 1e-9
    figures["skipped_judged"] = int(rows["skipped"][(t >= settle_s) & (t <= duration_s)].sum())
    return figures


def names() -> tuple[str, ...]:
    """Every figure that a summary can hold, as dotted paths: what an acceptance row may name."""
    empty = {topic: np.zeros(0, TOPICS[topic].dtype) for topic in CYCLIC}
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


def within(row: Acceptance, value: float | None) -> bool:
    """Does a figure keep the bounds of a row (not for rows with ``across``)?"""
    if value is None:
        return False
    if row.limit is not None:
        return abs(value) <= row.limit
    return (row.min is None or value >= row.min) and (row.max is None or value <= row.max)


def acceptance(rows: Sequence[Acceptance], figures: Figures, law: str = "") -> list[Figures]:
    """Verdict of a single run, one row each: passed when the figure exists and is within its bounds. Rows touched by skipped cycles say so.

    Rows that compare variants, or that belong to another law or to a variant, are left to ``spsp-ctrl experiment``.
    """
    touched = bool(figures["timing_us"]["skipped_judged"])
    verdict = []
    for row in rows:
        if row.across or row.relative_to or any(row.variants) or (row.law is not None and law and row.law != law):
            continue
        value = look_up(figures, row.value)
        limit = row.limit if row.limit is not None else row.max if row.max is not None else row.min
        verdict.append(
            {
                "name": row.name,
                "value": value,
                "limit": limit,
                "unit": row.unit,
                "pass": within(row, value),
                "touched_by_skips": touched,
            }
            | ({"min": row.min} if row.min is not None else {})
        )
    return verdict
