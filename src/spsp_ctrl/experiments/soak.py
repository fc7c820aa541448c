"""Identification of the thermal compensation from a warm soak: the same poses cold and warm, rod by the IMU less rod by the resolver.

Eq (13) compensates ``alpha l0 dT``. From rod and temperature only the product of ``alpha`` and ``l0`` can be known, not the two apart: the product is
identified, in um/K, and given also as ``alpha`` over the length that the rig file states. Pose by pose the cold reading is taken off the warm one, so
that lead error, zero offset and the IMU's bias fall out; every pose is reached from the same side, so that the nut lies on the same flank.
"""

from __future__ import annotations

import numpy as np

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.signals import Figures, Topics, imu_frames, resolver_rods, rods_from_attitude

LEAST_K = 2.0
"""Readings less warm than this say nothing about an elongation per kelvin."""


def readings(topics: Topics, config: RigConfig, scenario: Scenario) -> list[tuple[float, float, float, float]]:
    """Pose in deg, screw temperature, rods by IMU less by resolver (pitch, roll) in m: means over the end of each dwell of the staircase."""
    stairs, plan = scenario.reference.staircase, scenario.reference
    if stairs is None:
        return []
    m = topics["/measurement"]
    cycle_s = m["stamp_ns"] * 1e-9
    frames = imu_frames(topics)
    seen = rods_from_attitude(frames.pitch_rad, frames.roll_rad, config)
    frame_s = frames.stamp_s - config.imu.attitude_lag_ms * 1e-3
    rods = [np.interp(frame_s, cycle_s, rod) for rod in resolver_rods(topics, config)]
    found = []
    for k, pose in enumerate(stairs.values_deg):
        end = plan.start_s + (k + 1) * stairs.dwell_s
        at = (frames.stamp_s > end - stairs.read_s) & (frames.stamp_s <= end)
        warm = (cycle_s > end - stairs.read_s) & (cycle_s <= end)
        if end > scenario.duration_s or not at.any() or not warm.any():
            continue
        grown = [float((seen[axis][at] - rods[axis][at]).mean()) for axis in (0, 1)]
        screw = 0.5 * (m["temperature.screw_pitch_c"][warm] + m["temperature.screw_roll_c"][warm])
        found.append((pose, float(screw.mean()), grown[0], grown[1]))
    return found


def figures(topics: Topics, config: RigConfig, scenario: Scenario) -> Figures:
    """Elongation per kelvin by least squares over the poses read cold and warm, with its standard deviation from their scatter."""
    found = readings(topics, config, scenario)
    if not found:
        return {}
    last = {pose: k for k, (pose, *_) in enumerate(found)}
    first: dict[float, int] = {}
    for k, (pose, *_) in enumerate(found):
        first.setdefault(pose, k)
    rise, grown = [], []
    for pose, k in last.items():
        cold, warm = found[first[pose]], found[k]
        if warm[1] - cold[1] >= LEAST_K:
            rise += [warm[1] - cold[1]] * 2
            grown += [warm[2] - cold[2], warm[3] - cold[3]]
    if len(rise) < 4:
        return {}
    x, y = np.array(rise), np.array(grown)
    slope = float(x @ y / (x @ x))
    by_rod = [float(x[k::2] @ y[k::2] / (x[k::2] @ x[k::2])) for k in (0, 1)]
    # scatter of the poses, and what both rods differ by: the slow wander of the IMU between cold and warm is one for all poses of a rod
    spread = float(np.hypot(np.sqrt(np.sum((y - slope * x) ** 2) / (len(x) - 1) / (x @ x)), 0.5 * (by_rod[0] - by_rod[1])))
    length_m = config.compensation.thermal.screw_length_mm * 1e-3
    return {
        "soak_readings": len(x),
        "soak_um_k": slope * 1e6,
        "soak_std_um_k": spread * 1e6,
        "soak_ppm_k": slope / length_m * 1e6,
        "soak_std_ppm_k": spread / length_m * 1e6,
    }
