"""Synthetic runs for the report tests: the default swing with realistic errors, without plant or controller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, get_type_hints

import numpy as np
import pytest
from numpy.typing import NDArray

from spsp_ctrl.messages import Control, Measurement, Mode, Timing, Truth
from spsp_ctrl.report.data import RunData

ARCMIN = np.pi / 180.0 / 60.0

RIG_YAML = """\
schema: spsp-ctrl/rig/1
name: Virtual rig
rate_hz: 1000
mechanism: {column_height_mm: 265.5, moving_radius_mm: 100.0, stroke_min_mm: -34.1, stroke_max_mm: 34.3}
limits: {rod_speed_mm_s: 80.0, rod_accel_mm_s2: 400.0, current_a: 6.0}
"""


_OPERATOR = [("stamp_ns", "i8"), ("verb", "O"), ("value", "f8"), ("source", "O")]


def leaves(message: type[NamedTuple], prefix: str = "") -> list[tuple[str, str]]:
    """Dotted leaf names of a message with a numpy type each."""
    out: list[tuple[str, str]] = []
    for name, kind in get_type_hints(message).items():
        if kind in (float, int, bool):
            out.append((prefix + name, {float: "f8", int: "i8", bool: "?"}[kind]))
        else:
            out += leaves(kind, f"{prefix}{name}.")
    return out


def empty(message: type[NamedTuple], count: int) -> NDArray[Any]:
    return np.zeros(count, dtype=leaves(message))


def synthetic_run(
    duration_s: float = 10.0, rate_hz: int = 500, truth: bool = True, bad: bool = False, seed: int = 1
) -> tuple[RunData, dict[str, Any]]:
    """Base sines 6°/4 s and 15°/8 s, errors of some tenths of an arcmin with spikes at reversals."""
    rng = np.random.default_rng(seed)
    count = int(duration_s * rate_hz)
    t = np.arange(count) / rate_hz
    stamps = np.rint(t * 1e9).astype(np.int64)
    grow = np.clip((t - 1.0) / 2.0, 0.0, 1.0) ** 2 * (t > 1.0)
    base = {
        "pitch": np.deg2rad(6.0) * np.sin(2 * np.pi * (t - 1) / 4.0) * grow,
        "roll": np.deg2rad(15.0) * np.sin(2 * np.pi * (t - 1) / 8.0) * grow,
    }
    control, measurement = empty(Control, count), empty(Measurement, count)
    timing, true = empty(Timing, count), empty(Truth, count)
    for array in (control, measurement, timing, true):
        array["stamp_ns"] = stamps
        array["cycle"] = np.arange(count)
    control["mode"] = np.select([t < 0.2, t < 0.5, t < 2.0], [Mode.DISARMED, Mode.READY, Mode.ALIGNING], Mode.ACTIVE)
    errors: dict[str, dict[str, float]] = {}
    drift = 0.15 * np.sin(2 * np.pi * t / 37.0)
    for axis, period, radius in (("pitch", 4.0, 100.0), ("roll", 8.0, 100.0)):
        speed = np.gradient(base[axis], t)
        slow = np.convolve(rng.standard_normal(count), np.hanning(rate_hz // 8 + 2), "same") / np.sqrt(
            rate_hz / 8 * 0.375
        )
        error = 0.10 * slow + 0.08 * speed / 0.2
        for k in range(int(2 * duration_s / period) + 1):  # backlash traverse at each reversal of the table
            at = 1.0 + period / 4.0 + k * period / 2.0
            error += (-1) ** k * (0.45 + 0.1 * rng.standard_normal()) * np.exp(-(((t - at - 0.04) / 0.03) ** 2))
        error += 12.0 * np.exp(-((t / 0.9) ** 2))
        if bad:
            error *= 8.0
        measured = error + 0.04 * rng.standard_normal(count)
        control[f"estimate.platform_{axis}_rad"] = -measured * ARCMIN
        true[f"platform_{axis}_rad"] = -(error + drift) * ARCMIN
        true[f"base_{axis}_rad"] = base[axis]
        measurement[f"base.{axis}_rad"] = base[axis]
        rod = radius * 1e-3 * np.tan(-base[axis])
        control[f"estimate.rod_{axis}_m"] = rod
        measurement[f"drive_{axis}.current_a"] = (
            0.25 * np.tanh(np.gradient(rod, t) * 400) + 0.05 + 0.04 * rng.standard_normal(count)
        )
        control[f"{axis}.backlash_m"] = 6e-6 * np.tanh(np.gradient(rod, t) * 400)
        control[f"estimate.thermal_{axis}_m"] = 0.25 * 11.5e-6 * (4.0 * t / 40.0)
        after = t >= 6.0
        late = slice(None) if not after.any() else after
        errors[axis] = {
            "imu_max": float(np.abs(measured[late]).max()),
            "imu_rms": float(np.sqrt(np.mean(measured[late] ** 2))),
            "true_max": float(np.abs((error + drift)[late]).max()),
            "true_rms": float(np.sqrt(np.mean((error + drift)[late] ** 2))),
        }
    demand = np.deg2rad(30.0) * np.clip(t / 3.0, 0, 1)
    control["reference.heading_rad"] = demand
    heading_error = np.deg2rad(0.03) * np.sin(2 * np.pi * t / 4.0) + np.deg2rad(0.01) * rng.standard_normal(count)
    control["estimate.heading_rad"] = demand - heading_error
    true["heading_rad"] = demand - np.deg2rad(0.03) * np.sin(2 * np.pi * t / 4.0)
    control["estimate.azimuth_rad"] = demand + np.deg2rad(0.8) * np.sin(2 * np.pi * t / 4.0) * grow
    lateness_us = rng.lognormal(np.log(9.0), 0.5, count)
    lateness_us[rng.integers(0, max(count, 1), 6 if count else 0)] = rng.uniform(200, 1800, 6 if count else 0)
    compute_us = rng.lognormal(np.log(140.0), 0.18, count)
    timing["lateness_ns"], timing["compute_ns"] = lateness_us * 1e3, compute_us * 1e3

    def stats(values: NDArray[np.float64]) -> dict[str, float]:
        q = np.quantile(values, [0.5, 0.99, 0.999, 1.0]) if len(values) else np.zeros(4)
        return dict(zip(("p50", "p99", "p99_9", "max"), map(float, q), strict=True))

    if not truth:
        for figures in errors.values():
            del figures["true_max"], figures["true_rms"]
    summary: dict[str, Any] = {
        "duration_s": duration_s, "rate_hz": rate_hz, "seed": seed, "rig": "Virtual rig", "scenario": "swing_2dof",
        "law": "stabiliser", "mode": "real-time", "settle_s": 6.0, "virtual": True,
        "ended": "fault: IMU silent" if bad else "completed",
        "error_arcmin": errors,
        "azimuth_error_deg": {"true_max": 0.03, "true_rms": 0.02, "imu_max": 0.06, "imu_rms": 0.024},
        "acceptance": [
            {"name": f"{a} error, IMU", "value": errors[a]["imu_max"], "limit": 2.0, "unit": "arcmin",
             "pass": errors[a]["imu_max"] <= 2.0, "touched_by_skips": bad}
            for a in errors
        ] + [{"name": "heading error", "value": 0.06, "limit": 0.2, "unit": "deg", "pass": True}],
        "timing_us": {"lateness": stats(lateness_us), "compute": stats(compute_us), "skipped": 1},
        "log": {"records": 4 * count, "lost": 0},
        "realtime_granted": {"scheduler": "SCHED_FIFO 80", "memory_locked": True, "affinity": "core 1",
                             "garbage_collector": "frozen", "kernel": "PREEMPT_DYNAMIC"},
    }  # fmt: skip
    topics = {"/control": control, "/measurement": measurement, "/timing": timing}
    if truth:
        topics["/truth"] = true
    else:
        measurement["base.seq"] = -1
    if bad and count:
        control["fault"][count * 3 // 4 :] = 3
        control["mode"][count * 3 // 4 :] = Mode.FAULT
    events = [
        {"stamp_ns": 0, "level": "info", "id": "mode", "text": "DISARMED"},
        {"stamp_ns": 200_000_000, "level": "info", "id": "mode", "text": "DISARMED -> READY"},
        {"stamp_ns": 500_000_000, "level": "info", "id": "mode", "text": "READY -> ALIGNING"},
        {"stamp_ns": 2_000_000_000, "level": "info", "id": "mode", "text": "ALIGNING -> ACTIVE"},
    ]
    request = np.array([(8_000_000_000, "heading", np.deg2rad(30.0), "keys")], dtype=_OPERATOR)
    topics["/operator"] = request[: 1 if count else 0]
    if bad:
        events += [
            {"stamp_ns": 9_000_000_000 + k * 2_000_000, "level": "warning", "id": "skip", "text": "1 cycle(s) skipped"}
            for k in range(5)
        ]
        text = "FAULT: no IMU frame for longer than the loop may coast. Check: IMU cable and supply"
        events.append({"stamp_ns": int(0.75e9 * duration_s), "level": "error", "id": "imu-stale", "text": text})
    data = RunData(
        topics,
        events if count else [],
        {"versions": {"spsp-ctrl": "0.1.0", "python": "3.11.9"}, "run": {"seed": str(seed), "law hash": "9f3c12ab"}},
        {"rig.yaml": RIG_YAML},
    )
    return data, summary


@pytest.fixture(scope="session")
def synthetic() -> Callable[..., tuple[RunData, dict[str, Any]]]:
    """Maker of synthetic runs."""
    return synthetic_run
