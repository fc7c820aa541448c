"""Azimuth: heading held over the ground, slews, travel, and lost steps.

The stepper counts what it was told, not what it did. Two independent checks find lost steps afterwards: the azimuth joint by IMU and table encoders
(``/base``, which the law never reads) against the count, and the place at which the photoelectric zero switch is passed.
"""

from __future__ import annotations

from itertools import pairwise
from math import radians

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.signals import DEG_PER_RAD, Array, Curves, Figures, Topics, imu_frames, judged, thin, wrap
from spsp_ctrl.mechanism.frames import Matrix, attitude, joint_angles, multiply
from spsp_ctrl.messages import Measurement
from spsp_ctrl.recording.reader import messages
from spsp_ctrl.safety import steps

SETTLED_DEG = 0.1
SLEW_S = 4.0
"""Time after a new target that is judged as a slew, not as holding."""
LOST_DEG = 0.2
"""A difference between joint and count beyond this is a lost step: a stepper slips by whole teeth, four full steps."""
MEDIAN_FRAMES = 41
SLIP_STEPS = 3.0
"""A slip is by four full steps; the rotor lags by less than two."""
FAST_SLIP_S = 0.1
"""Two teeth lost within this time are a fast slip; a wound-up rotor that lets one tooth go creeps, too slowly for the heading to tell."""


def _targets(scenario: Scenario) -> list[tuple[float, float, float]]:
    """Time, heading before and heading after of each slew."""
    slews, before = [], 0.0
    for target in sorted(scenario.reference.heading, key=lambda h: h.at_s):
        if target.at_s > 0.0:
            slews.append((target.at_s, before, target.heading_deg))
        before = target.heading_deg
    return slews


def _median(values: Array, width: int = MEDIAN_FRAMES) -> Array:
    if len(values) < width:
        return values
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(values, width), axis=1))


def step_gap(topics: Topics, config: RigConfig, scenario: Scenario) -> tuple[Array, Array]:
    """Time in s and azimuth joint by IMU and table encoders less azimuth by the step count, in rad; zero at the start of what counts."""
    m = topics["/measurement"]
    frames = imu_frames(topics).among(judged(topics["/control"], scenario.settle_s, scenario.duration_s))
    t = frames.stamp_s - config.imu.attitude_lag_ms * 1e-3
    cycle_s = m["stamp_ns"] * 1e-9
    base = [np.interp(t, cycle_s, np.unwrap(m[f"base.{axis}_rad"])) for axis in ("yaw", "pitch", "roll")]
    order = scenario.base.axis_order
    joint = np.empty(len(t))
    for i, (yaw, pitch, roll) in enumerate(zip(*(b.tolist() for b in base), strict=True)):
        joint[i] = joint_angles(
            _base_rotation(order, yaw, pitch, roll), float(frames.heading_rad[i]), float(frames.pitch_rad[i]), float(frames.roll_rad[i])
        )[0]
    fresh = np.flatnonzero(np.diff(m["azimuth.seq"], prepend=-1) != 0)
    steps_rad = 2.0 * np.pi / (config.azimuth.full_steps_per_turn * config.azimuth.microsteps * config.azimuth.gear_ratio)
    counted = np.interp(t, m["azimuth.stamp_ns"][fresh] * 1e-9, m["azimuth.microsteps"][fresh] * steps_rad)
    gap = wrap(joint - counted)
    if len(gap):
        gap = wrap(gap - np.median(gap[:MEDIAN_FRAMES]))
    return t, gap


def _base_rotation(order: str, yaw: float, pitch: float, roll: float) -> Matrix:
    if order == "pitch_roll":
        return attitude(yaw, pitch, roll)
    # Rz(yaw) Rx(-roll) Ry(pitch): the same three turns, the last two swapped
    return multiply(attitude(yaw, 0.0, roll), attitude(0.0, pitch, 0.0))


def home_passes(topics: Topics, config: RigConfig) -> Array:
    """Azimuth by the step count in deg at the middle of each complete pass over the zero switch."""
    m = topics["/measurement"]
    fresh = np.flatnonzero(np.diff(m["azimuth.seq"], prepend=-1) != 0)
    home: NDArray[np.bool_] = m["azimuth.home_switch"][fresh]
    degrees = m["azimuth.microsteps"][fresh] * (
        360.0 / (config.azimuth.full_steps_per_turn * config.azimuth.microsteps * config.azimuth.gear_ratio)
    )
    edges = np.flatnonzero(np.diff(home.astype(np.int8))) + 1
    passes = []
    for a, b in pairwise(edges.tolist()):
        # in on one side and out on the other: a turn inside the vane says nothing
        if home[a] and abs(degrees[b] - degrees[a]) > 0.5 * radians(1.0) * DEG_PER_RAD:
            passes.append(0.5 * (degrees[a] + degrees[b]))
    return np.array(passes)


def step_alarms(topics: Topics, config: RigConfig) -> list[tuple[float, int]]:
    """Time in s and means of each alarm for lost steps: the loop's own judge over the recorded measurements."""
    limits, state = steps.step_limits(config), steps.START
    found = []
    for m in messages(topics["/measurement"], Measurement):
        before = state.alarms
        state = steps.step(state, limits, m)
        if state.alarms > before:
            found.append((m.stamp_ns * 1e-9, state.means))
    return found


def _heading_error(topics: Topics, scenario: Scenario) -> tuple[Array, Array]:
    control = topics["/control"]
    frames = imu_frames(topics).among(judged(control, scenario.settle_s, scenario.duration_s))
    at = np.clip(np.searchsorted(control["stamp_ns"] * 1e-9, frames.stamp_s - 1e-9), 0, max(0, len(control) - 1))
    return frames.stamp_s, wrap(control["reference.heading_rad"][at] - frames.heading_rad) * DEG_PER_RAD


def figures(topics: Topics, config: RigConfig, scenario: Scenario) -> Figures:
    """Heading by the IMU in deg while holding, settling times of slews in s, travel, lost steps."""
    t, error = _heading_error(topics, scenario)
    if not len(t):
        return {}
    slews = _targets(scenario)
    hold = np.ones(len(t), dtype=bool)
    for at, _, _ in slews:
        hold &= (t < at) | (t > at + SLEW_S)
    result: Figures = {"slews": len(slews)}
    if hold.any():
        result["hold_deg_max"] = float(np.abs(error[hold]).max())
        result["hold_deg_rms"] = float(np.sqrt(np.mean(error[hold] ** 2)))
    frames = imu_frames(topics)
    settle: list[tuple[float, float]] = []
    for k, (at, before, after) in enumerate(slews):
        end = slews[k + 1][0] if k + 1 < len(slews) else scenario.duration_s
        during = (frames.stamp_s >= at) & (frames.stamp_s < end)
        away = np.abs(wrap(frames.heading_rad[during] - radians(after))) * DEG_PER_RAD > SETTLED_DEG
        times = frames.stamp_s[during]
        settled = float(times[away][-1] - at) if away.any() else 0.0
        settle.append((abs(after - before), settled if away.any() and not away[-1] else end - at if away.any() else 0.0))
    if settle:
        result["settle_s_max"] = max(s for _, s in settle)
        result["settle_30_s_max"] = max((s for size, s in settle if abs(size - 30.0) < 1.0), default=None)
    m = topics["/measurement"]
    keep = judged(topics["/control"], 0.0, scenario.duration_s)
    steps_deg = 360.0 / (config.azimuth.full_steps_per_turn * config.azimuth.microsteps * config.azimuth.gear_ratio)
    result["travel_deg_max"] = float(np.abs(m["azimuth.microsteps"][keep]).max() * steps_deg)
    _, gap = step_gap(topics, config, scenario)
    worst = float(np.abs(_median(gap)).max() * DEG_PER_RAD) if len(gap) else 0.0
    result["step_gap_deg"] = worst
    result["lost_steps_seen"] = worst / (steps_deg * config.azimuth.microsteps)
    result["lost_detected"] = int(worst > LOST_DEG)
    passes = home_passes(topics, config)
    result["home_passes"] = len(passes)
    if len(passes):
        result["home_deg_max"] = float(np.abs(passes).max())
        result["home_detected"] = int(result["home_deg_max"] > LOST_DEG)
    alarms = step_alarms(topics, config)
    result["alarms"] = len(alarms)
    for means in (steps.Means.HEADING, steps.Means.HOME):
        result[f"alarms_{means.name.lower()}"] = sum(how == means for _, how in alarms)
    if "/truth" in topics:
        truth = topics["/truth"]
        slipped = np.flatnonzero(np.abs(np.diff(truth["lost_steps"])) >= SLIP_STEPS) + 1
        if len(slipped):
            at_s = truth["stamp_ns"][slipped] * 1e-9
            fast = np.flatnonzero(np.diff(at_s) < FAST_SLIP_S)
            result["crept_slips"] = float(fast[0] if len(fast) else len(at_s))
            since = float(at_s[fast[0]] if len(fast) else at_s[0])
            for means in (steps.Means.HEADING, steps.Means.HOME):
                seen = [stamp for stamp, how in alarms if how == means and stamp >= since]
                result[f"late_{means.name.lower()}_s"] = seen[0] - since if seen else None
        result["true_travel_deg_max"] = float(np.abs(truth["azimuth_rad"][: len(keep)][keep]).max() * DEG_PER_RAD)
        result["true_lost_steps"] = float(np.abs(truth["lost_steps"]).max())
    return result


def curves(topics: Topics, config: RigConfig, scenario: Scenario) -> Curves:
    """Heading error, demand and heading, joint, and joint less count over time, in deg."""
    t, error = _heading_error(topics, scenario)
    control = topics["/control"]
    keep = judged(control, 0.0, scenario.duration_s)
    time = control["stamp_ns"][keep] * 1e-9
    at, gap = step_gap(topics, config, scenario)
    middle = _median(gap)
    cut = (len(gap) - len(middle)) // 2
    return {
        "heading.error": thin(t, error),
        "heading.demand": thin(time, control["reference.heading_rad"][keep] * DEG_PER_RAD),
        "heading.imu": thin(time, control["estimate.heading_rad"][keep] * DEG_PER_RAD),
        "heading.joint": thin(time, control["estimate.azimuth_rad"][keep] * DEG_PER_RAD),
        "heading.gap": thin(at[cut : cut + len(middle)], middle * DEG_PER_RAD),
    }
