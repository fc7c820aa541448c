"""Warm-up: how far the platform drifts from where it stood cold, by IMU and by truth, and what the compensation's coefficient should be."""

from __future__ import annotations

import numpy as np

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments import soak
from spsp_ctrl.experiments.signals import (
    ARCMIN_PER_RAD,
    UM_PER_M,
    Array,
    Curves,
    Figures,
    Topics,
    imu_frames,
    judged,
    resolver_rods,
    rods_from_attitude,
    thin,
)

COLD_S = 1.0
"""The cold reading is the mean of the first second that counts."""
STEADY = 0.1
"""The steady reading is the mean of this last part of the run."""
WINDOW_S = 0.5


def _smooth(t: Array, y: Array) -> tuple[Array, Array]:
    """Means of consecutive windows."""
    slot = ((t - t[0]) / WINDOW_S).astype(np.intp)
    count = np.bincount(slot)
    used = count > 0
    return np.bincount(slot, t)[used] / count[used], np.bincount(slot, y)[used] / count[used]


def _drifts(topics: Topics, config: RigConfig, scenario: Scenario) -> dict[str, tuple[Array, Array]]:
    """Drift from the cold reading over time: attitude error (rad) by truth and by IMU, rod by IMU less resolver (m), screw sensor (K)."""
    control = topics["/control"]
    keep = judged(control, scenario.settle_s, scenario.duration_s)
    c, m = control[keep], topics["/measurement"][keep]
    t = c["stamp_ns"] * 1e-9
    frames = imu_frames(topics).among(keep)
    rods = [np.interp(frames.stamp_s, t, rod[keep]) for rod in resolver_rods(topics, config)]
    seen = rods_from_attitude(frames.pitch_rad, frames.roll_rad, config)
    found: dict[str, tuple[Array, Array]] = {}
    joint = scenario.reference.kind == "joint"
    for k, axis in enumerate(("pitch", "roll")):
        if "/truth" in topics:
            true = topics["/truth"][keep]
            found[f"true.{axis}"] = (t, true[f"{'joint' if joint else 'platform'}_{axis}_rad"] - c[f"reference.{axis}_rad"])
        found[f"imu.{axis}"] = (frames.stamp_s, frames.pitch_rad if axis == "pitch" else frames.roll_rad)
        found[f"rod.{axis}"] = (frames.stamp_s, seen[k] - rods[k])
    found["screw"] = (t, m["temperature.screw_pitch_c"])
    result = {}
    for name, (time, value) in found.items():
        x, y = _smooth(time, value)
        cold = y[x <= x[0] + COLD_S].mean()
        result[name] = (x, y - cold)
    return result


def figures(topics: Topics, config: RigConfig, scenario: Scenario) -> Figures:
    """Drift of the platform in arcmin at the end and at its largest, and the coefficient that Eq (13) would have needed."""
    if not judged(topics["/control"], scenario.settle_s, scenario.duration_s).any():
        return {}
    drifts = _drifts(topics, config, scenario)
    result: Figures = {}
    for kind in ("true", "imu"):
        ends, tops = [], []
        for axis in ("pitch", "roll"):
            if f"{kind}.{axis}" not in drifts:
                continue
            x, y = drifts[f"{kind}.{axis}"]
            steady = y[x >= x[-1] - STEADY * (x[-1] - x[0])].mean()
            ends.append(abs(float(steady)) * ARCMIN_PER_RAD)
            tops.append(float(np.abs(y).max()) * ARCMIN_PER_RAD)
            result[f"{kind}_{axis}_end_arcmin"] = float(steady) * ARCMIN_PER_RAD
        if ends:
            result[f"{kind}_end_arcmin"] = max(ends)
            result[f"{kind}_max_arcmin"] = max(tops)
    x, rise = drifts["screw"]
    warm = float(rise[x >= x[-1] - STEADY * (x[-1] - x[0])].mean())
    result["screw_rise_k"] = warm
    if warm > 1.0:
        # elongation per kelvin of the screw sensor, as a coefficient over the nominal length: least squares over the warm-up, and at its end
        length = config.compensation.thermal.screw_length_mm * 1e-3
        slopes, steady_slopes = [], []
        for axis in ("pitch", "roll"):
            at, grown = drifts[f"rod.{axis}"]
            kelvin = np.interp(at, x, rise)
            slopes.append(float(kelvin @ grown / (kelvin @ kelvin)))
            steady_slopes.append(float(grown[at >= at[-1] - STEADY * (at[-1] - at[0])].mean()) / warm)
        result["identified_ppm_k"] = float(np.mean(slopes)) / length * 1e6
        result["identified_steady_um_k"] = float(np.mean(steady_slopes)) * 1e6
        result["identified_steady_std_um_k"] = 0.5 * abs(steady_slopes[0] - steady_slopes[1]) * 1e6
        result["identified_steady_ppm_k"] = float(np.mean(steady_slopes)) / length * 1e6
    return result | soak.figures(topics, config, scenario)


def curves(topics: Topics, config: RigConfig, scenario: Scenario) -> Curves:
    """Drift over time in arcmin and um, temperature rise in K."""
    result: Curves = {}
    for name, (x, y) in _drifts(topics, config, scenario).items():
        scale = 1.0 if name == "screw" else UM_PER_M if name.startswith("rod") else ARCMIN_PER_RAD
        result[f"thermal.{name}"] = thin(x, y * scale)
    return result
