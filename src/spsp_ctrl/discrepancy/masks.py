"""Regimes: where and when a residual may live, as masks over the samples of a record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.discrepancy.replica import Replica, smooth
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import A

Mask = NDArray[np.bool_]


def regimes(replica: Replica) -> dict[str, Mask]:
    """Every regime by name, one flag for each cycle of the record."""
    record, rate = replica.record, replica.record.rate_hz
    motor = replica.measured["motor"] if np.ptp(replica.measured["motor"]) > 0 else replica.measured["load"] / replica.travel_per_rad
    travel = smooth(motor, max(1, round(0.01 * rate))) * replica.travel_per_rad
    speed = np.gradient(travel) * rate
    moving = np.abs(speed) > 0.02 * max(float(np.max(np.abs(speed))), 1e-9)
    out: dict[str, Mask] = {"moving": moving, "still": ~moving, "forward": moving & (speed > 0), "backward": moving & (speed < 0)}
    out["after reversal (time)"], out["after reversal (travel)"] = _after_reversal(travel, speed, moving, rate)
    level = np.abs(speed[moving]) if moving.any() else np.zeros(1)
    low, high = np.quantile(level, 0.33), np.quantile(level, 0.67)
    out["slow"], out["fast"] = moving & (np.abs(speed) <= low), moving & (np.abs(speed) >= high)
    third = np.quantile(travel, [0.33, 0.67])
    out["travel low"], out["travel middle"], out["travel high"] = travel < third[0], (travel >= third[0]) & (travel <= third[1]), travel > third[1]
    p = replica.model.parameters()
    screw = motor / float(p[A.gear_ratio])
    for quarter in range(4):
        out[f"screw turn quarter {quarter + 1}"] = np.floor((screw / (2 * np.pi) % 1.0) * 4).astype(int) == quarter
    rows = record.rows
    for name, values in (("load", rows["load_force_n"]), ("added mass", rows["load_mass_kg"]), ("temperature", rows["screw_c"])):
        if np.ptp(values) > 0:
            middle = 0.5 * (float(values.min()) + float(values.max()))
            out[f"{name} low"], out[f"{name} high"] = values < middle, values >= middle
    command = np.asarray(rows["command_a"], np.float64)
    change = np.abs(np.gradient(smooth(command, 2)))
    out["command slope steep"] = change > np.quantile(change, 0.9)
    out["near saturation"] = np.abs(command) > 0.9 * float(np.max(np.abs(command)))
    half = np.arange(len(rows)) < len(rows) // 2
    out["early"], out["late"] = half, ~half
    return out


def _after_reversal(travel: Array, speed: Array, moving: Mask, rate: float) -> tuple[Mask, Mask]:
    sign = np.where(moving, np.sign(speed), 0.0)
    at = np.flatnonzero(sign != 0.0)
    time, way = np.zeros(len(travel), bool), np.zeros(len(travel), bool)
    if not len(at):
        return time, way
    turns = at[1:][sign[at[1:]] != sign[at[:-1]]]
    reach = 0.02 * float(np.ptp(travel))
    for turn in turns:
        end = min(len(travel), int(turn) + max(1, round(0.15 * rate)))
        time[turn:end] = True
        last = min(len(travel), int(turn) + round(2.0 * rate))
        far = np.flatnonzero(np.abs(travel[turn:last] - travel[turn]) > reach)
        way[turn : turn + (int(far[0]) if len(far) else last - int(turn))] = True
    return time, way


def order_lines(values: Array, angle_rad: Array, orders: NDArray[np.float64]) -> Array:
    """Amplitude of ``values`` at orders of an angle, by projection on cosine and sine (the angle need not be uniform)."""
    centred = values - values.mean()
    phase = np.exp(-1j * np.outer(orders, angle_rad))
    return np.asarray(2.0 * np.abs(phase @ centred) / len(values))
