"""Regimes of a platform log: where and when a residual may live, for the part of the rig to which its channel belongs."""

from __future__ import annotations

import numpy as np

from spsp_ctrl.discrepancy.masks import Mask, _after_reversal
from spsp_ctrl.discrepancy.platform_replica import AXES, WHERE, PlatformReplica
from spsp_ctrl.discrepancy.replica import smooth
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, A, G


def platform_regimes(one: PlatformReplica, channel: str) -> dict[str, Mask]:
    """Every regime by name, one flag for each cycle of the record."""
    rate, where = one.record.rate_hz, WHERE[channel]
    p = one.model.parameters()
    if where in AXES:
        k = AXES.index(where)
        travel = one.measured[f"motor_{where}"] / p[k * N_AXIS_PARAMETERS + A.gear_ratio]
    elif where == "azimuth":
        travel = one.targets[:, 4] / p[G.az_gear_ratio]
    else:
        travel = np.unwrap(one.record.column("base.roll_rad")) + one.record.column("base.pitch_rad")
    out = _motion(travel, rate)
    if where in AXES:
        for quarter in range(4):
            out[f"screw turn quarter {quarter + 1}"] = np.floor((travel / (2 * np.pi) % 1.0) * 4).astype(int) == quarter
        command = one.measured[f"command_{where}"]
        out["near saturation"] = np.abs(command) > 0.9 * float(np.max(np.abs(command)))
        change = np.abs(np.gradient(smooth(command, 2)))
        out["command slope steep"] = change > np.quantile(change, 0.9)
    half = np.arange(len(travel)) < len(travel) // 2
    out["early"], out["late"] = half, ~half
    return out


def _motion(raw: Array, rate: float) -> dict[str, Mask]:
    travel = smooth(raw, max(1, round(0.01 * rate)))
    speed = np.gradient(travel) * rate
    moving = np.abs(speed) > 0.02 * max(float(np.max(np.abs(speed))), 1e-9)
    out: dict[str, Mask] = {"moving": moving, "still": ~moving, "forward": moving & (speed > 0), "backward": moving & (speed < 0)}
    out["after reversal (time)"], out["after reversal (travel)"] = _after_reversal(travel, speed, moving, rate)
    level = np.abs(speed[moving]) if moving.any() else np.zeros(1)
    low, high = np.quantile(level, 0.33), np.quantile(level, 0.67)
    out["slow"], out["fast"] = moving & (np.abs(speed) <= low), moving & (np.abs(speed) >= high)
    third = np.quantile(travel, [0.33, 0.67])
    out["travel low"], out["travel middle"], out["travel high"] = travel < third[0], (travel >= third[0]) & (travel <= third[1]), travel > third[1]
    return out
