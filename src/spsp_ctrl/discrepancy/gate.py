"""The gate: whether a log can be understood at all. What fails here is never blamed on the plant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml

from spsp_ctrl.discrepancy.records import Record
from spsp_ctrl.discrepancy.replica import smooth
from spsp_ctrl.discrepancy.statistics import rms
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis_controller import MAX_SPAN, replay
from spsp_ctrl.plant.axis_model import AxisModel
from spsp_ctrl.plant.layout import A

MOST_LOST = 0.02
"""Share of cycles that may be missing."""
MOST_SKEW = 0.02
FACTORS = (1000.0, 1e-3, 100.0, 0.01, 180.0 / np.pi, np.pi / 180.0, 60.0, 1.0 / 60.0, 2.0 * np.pi, 0.5 / np.pi, 1.0 / 0.0254, 0.0254, -1.0)
"""Ratios that a wrong unit makes."""
MOST_DRIFT, LEAST_DRIFT = 1e-3, 5e-5
"""Change of a clock's rate within a record that is refused, and that is told."""
COLDEST_C, HOTTEST_C = -60.0, 150.0
REPLAYED = 0.02
"""Share of the command that a replay of the stated controller may miss."""


@dataclass
class Gate:
    """What was looked at, and what is wrong."""

    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    lost: int = 0
    controller_replay: float | None = None
    """Share of the command that the replayed controller misses; None without a stated controller."""

    @property
    def passed(self) -> bool:
        """Whether the plant may be judged by this log."""
        return not self.problems


def judge(record: Record, model: AxisModel) -> Gate:
    """Look at time base, values, units, signs and the controller of a record."""
    gate, rows = Gate(), record.rows
    _values(gate, record)
    if gate.problems:
        return gate
    if abs(record.rate_hz / model.file.rate_hz - 1.0) > 1e-3:
        gate.problems.append(f"the log has {record.rate_hz:g} Hz, the model {model.file.rate_hz:g} Hz")
    _time(gate, record)
    if rows["velocity_mode"].any():
        _velocity(gate, record, model)
    if not rows["enabled"].all():
        gate.problems.append(f"the drive was off in {int((~rows['enabled']).sum())} cycles; cut the log to where it was on")
    _units(gate, record, model)
    _controller(gate, record, model)
    return gate


def _velocity(gate: Gate, record: Record, model: AxisModel) -> None:
    """Velocity mode: what the drive was told is a speed, what it gave is at best a measured current."""
    rows = record.rows
    if model.file.bare or model.file.controller.kind == "cascade":
        gate.problems.append("the drive was in velocity mode: a model of force and cascade does not describe its own speed loop")
        return
    if not rows["velocity_mode"].all():
        gate.problems.append("the drive changes between velocity and current mode; cut the log to one of them")
        return
    motor = record.motor_rad(float(model.parameters()[A.resolver_counts]) or 2.0 * np.pi)
    told, speed = np.asarray(rows["command_rad_s"], np.float64), np.gradient(motor) * record.rate_hz
    if np.ptp(told) == 0.0:
        gate.problems.append("command_rad_s never changes in velocity mode: the channel is lacking")
        return
    _ratio(gate, "speed by resolver_counts against command_rad_s", slope(told, np.asarray(speed)), band=0.2)
    if np.ptp(rows["current_a"]) == 0.0:
        gate.remarks.append("velocity mode without a measured current: only what stands between motor and ruler is judged")
    else:
        gate.remarks.append("velocity mode: the measured current stands for the torque; what lies between command and current is not judged")


def _values(gate: Gate, record: Record) -> None:
    for name in record.rows.dtype.names or ():
        values = record.rows[name]
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            bad = np.flatnonzero(~np.isfinite(values))
            gate.problems.append(f"{name} is not a number in {len(bad)} cycles, first in cycle {int(record.rows['cycle'][bad[0]])}")


def _time(gate: Gate, record: Record) -> None:
    cycles, stamps = record.rows["cycle"], record.rows["stamp_ns"]
    steps, times = np.diff(cycles), np.diff(stamps)
    if (steps <= 0).any() or (times <= 0).any():
        at = int(np.flatnonzero((steps <= 0) | (times <= 0))[0])
        gate.problems.append(f"time runs backwards after cycle {int(cycles[at])}")
        return
    gate.lost = int(np.sum(steps - 1))
    if gate.lost > MOST_LOST * len(cycles):
        gate.problems.append(f"{gate.lost} of {len(cycles)} cycles are missing")
    elif gate.lost:
        gate.remarks.append(f"{gate.lost} cycles are missing: they were filled with the sample before")
    period = float(np.median(times / steps)) * 1e-9
    skew = period * record.rate_hz - 1.0
    if abs(skew) > MOST_SKEW:
        gate.problems.append(f"the stamps say {1.0 / period:.6g} Hz, the log {record.rate_hz:g} Hz")
    elif abs(skew) > 2e-5:
        gate.remarks.append(f"clock skew: the stamps run {skew * 1e6:.0f} ppm off the stated rate")
    _drift(gate, np.asarray(cycles, np.float64), np.asarray(stamps - stamps[0], np.float64) * 1e-9, period)
    jitter = float(np.std(times * 1e-9 - steps * period))
    if jitter > 0.05 * period:
        gate.remarks.append(f"the stamps jitter by {jitter * 1e6:.0f} us")


def _drift(gate: Gate, cycles: Array, stamps_s: Array, period: float) -> None:
    """A clock that changes its rate: the slope of the stamps in the first and the last fifth."""
    fifth = len(cycles) // 5
    if fifth < 50:
        return
    early, late = slope(cycles[:fifth], stamps_s[:fifth]), slope(cycles[-fifth:], stamps_s[-fifth:])
    change = (late - early) / period
    if abs(change) > MOST_DRIFT:
        gate.problems.append(f"the clock drifts: its rate changes by {change * 1e6:.0f} ppm from the first to the last fifth")
    elif abs(change) > LEAST_DRIFT:
        gate.remarks.append(f"the clock drifts by {change * 1e6:.0f} ppm from the first to the last fifth")


def _units(gate: Gate, record: Record, model: AxisModel) -> None:
    """Travel by motor and by ruler must be the same thing; a ratio near a known factor is a wrong unit."""
    p = model.parameters()
    for name in ("screw_c", "ambient_c"):
        low, high = float(record.rows[name].min()), float(record.rows[name].max())
        if low < COLDEST_C or high > HOTTEST_C:
            unit = "; kelvin would be 273.15 higher" if low > 250.0 and high < 273.15 + HOTTEST_C else ""
            gate.problems.append(f"{name} reaches {low:.4g} to {high:.4g} degC: wrong unit{unit}")
    load = np.asarray(record.rows["load_m"], np.float64)
    if float(np.ptp(load)) == 0.0:
        gate.problems.append("load_m never changes: the channel is lacking")
    counts = float(p[A.resolver_counts])
    if counts > 0.0 and np.ptp(record.rows["resolver_counts"]) > 0:
        motor = record.motor_rad(counts) * model.travel_per_rad
        ratio = slope(motor, load)
        _ratio(gate, "load_m against resolver_counts", ratio)
    elif not model.file.bare:
        gate.problems.append("resolver_counts never changes: the channel is lacking")
    if model.file.bare:
        if model.file.controller.kind == "cascade" and np.ptp(record.rows["reference_m"]) > 0:
            _ratio(gate, "load_m against reference_m", slope(np.asarray(record.rows["reference_m"], np.float64), load))
        return
    if record.rows["velocity_mode"].any():
        return
    if np.ptp(record.rows["current_a"]) == 0.0:
        gate.problems.append("current_a never changes: the channel is lacking")
        return
    command, current = np.asarray(record.rows["command_a"], np.float64), np.asarray(record.rows["current_a"], np.float64)
    # a drive that saturates or lags gives less than it is told, so only a ratio far off is a unit, and it is taken over quiet stretches
    half = max(1, round(0.025 * record.rate_hz))
    ratio = slope(smooth(command, half), smooth(current, half))
    if ratio < 0.0 or not 0.02 < ratio < 5.0:
        _ratio(gate, "current_a against command_a", ratio)


def slope(x: Array, y: Array) -> float:
    """Slope of ``y`` over ``x``."""
    x, y = x - x.mean(), y - y.mean()
    power = float(x @ x)
    return float(x @ y) / power if power > 0.0 else float("nan")


def _ratio(gate: Gate, what: str, ratio: float, band: float = 0.1) -> None:
    if not np.isfinite(ratio) or abs(ratio - 1.0) <= band:
        return
    near = next((f for f in FACTORS if abs(ratio / f - 1.0) < 0.2), None)
    if near is not None:
        gate.problems.append(f"{what}: {'the sign is reversed' if near == -1.0 else f'a factor of {near:.6g}, so a wrong unit'} (ratio {ratio:.5g})")
    elif not 0.6 < ratio < 1.6:
        gate.problems.append(f"{what}: a ratio of {ratio:.4g} where 1 was expected; unit or scaling is wrong")


def _controller(gate: Gate, record: Record, model: AxisModel) -> None:
    """Replay the stated cascade from recorded readings before the plant is blamed."""
    stated = _stated(record, model)
    if stated is None:
        if record.controller == "cascade":
            gate.remarks.append("the log says `cascade` but does not hold it: the commands are taken as recorded")
        return
    rows, p = record.rows, model.parameters()
    if stated["feedback"] == "load":
        position = np.asarray(rows["load_m"], np.float64)
    else:
        position = record.motor_rad(float(p[A.resolver_counts])) * model.travel_per_rad
    command = np.asarray(rows["command_a"], np.float64)
    again = replay(
        np.asarray(rows["reference_m"], np.float64), np.asarray(rows["reference_m_s"], np.float64), position, record.rate_hz,
        kp=stated["kp"], kv=stated["kv"], feedforward=stated["feedforward"], limit=stated["limit"], rate_span=int(stated["span"]),
    )  # fmt: skip
    kept = slice(MAX_SPAN + 1, None)
    level = rms(command[kept])
    gate.controller_replay = rms(again[kept] - command[kept]) / level if level > 0.0 else None
    if gate.controller_replay is not None and gate.controller_replay > REPLAYED:
        factor = slope(again[kept], command[kept])
        gate.problems.append(
            f"the stated controller does not give the recorded command: {gate.controller_replay:.1%} of it is left (ratio {factor:.4g}); "
            "unit, gain or reference is wrong, so the plant is not judged"
        )


def _stated(record: Record, model: AxisModel) -> dict[str, Any] | None:
    c = model.file.controller
    if c.kind == "cascade":
        return {"feedback": c.feedback, "kp": c.kp_1_s, "kv": c.kv, "feedforward": c.feedforward, "limit": c.limit, "span": c.rate_span}
    if record.controller != "cascade" or "controller.yaml" not in record.attachments:
        return None
    try:
        raw = yaml.safe_load(record.attachments["controller.yaml"])
        raw = raw.get("controller", raw)
        return {
            "feedback": str(raw.get("feedback", "load")), "kp": float(raw["kp_1_s"]), "kv": float(raw["kv"]),
            "feedforward": float(raw.get("feedforward", 0.0)), "limit": float(raw.get("limit", 1e9)), "span": int(raw.get("rate_span", 1)),
        }  # fmt: skip
    except (yaml.YAMLError, KeyError, TypeError, ValueError, AttributeError):
        return None


def filled(record: Record) -> Record:
    """The record on an unbroken time base: a missing cycle repeats the sample before it."""
    cycles = record.rows["cycle"]
    if len(cycles) < 2 or int(cycles[-1] - cycles[0]) == len(cycles) - 1:
        return record
    index = np.searchsorted(cycles, np.arange(cycles[0], cycles[-1] + 1), side="right") - 1
    place = np.searchsorted(index, [m.start for m in record.motions])
    from dataclasses import replace

    ends = [*place[1:], len(index)]
    motions = tuple(replace(m, start=int(a), stop=int(b)) for m, a, b in zip(record.motions, place, ends, strict=True))
    return replace(record, rows=record.rows[index], motions=motions)
