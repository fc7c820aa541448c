"""Open-loop positioning (Figs 15, 16): attitude by the IMU against attitude by the resolvers, and both as rod travel, on a level base.

The IMU shows the platform of an earlier instant (its output filter; the device stamp already excludes the transport delay), so the resolvers are
read back at the frame's stamp less that lag: without it 8 deg / 8 s would show 90 arcsec of error that is none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario, Staircase
from spsp_ctrl.experiments.signals import (
    ARCSEC_PER_RAD,
    DEG_PER_RAD,
    UM_PER_M,
    Array,
    Curves,
    Figures,
    Topics,
    attitude_from_rods,
    imu_frames,
    judged,
    resolver_rods,
    rods_from_attitude,
    thin,
)

STEP_WINDOW_S = 0.25
"""A crossing of the play is over within this time."""
REVERSAL_S = 1.2
"""A crossing belongs to a reversal of the motion when it comes within this time of it."""


class Comparison(NamedTuple):
    """IMU less resolver on one axis, at the IMU's frames."""

    t_s: Array
    place_rad: Array
    """Angle by the resolvers."""
    angle_rad: Array
    rod_m: Array


def moved_axis(scenario: Scenario) -> str:
    """The axis that the reference moves."""
    plan = scenario.reference
    if plan.staircase is not None:
        return plan.staircase.axis
    return "pitch" if plan.pitch and not plan.roll else "roll"


def compare(topics: Topics, config: RigConfig, scenario: Scenario) -> Comparison:
    """The comparison over the part of the run that counts."""
    m, axis = topics["/measurement"], moved_axis(scenario)
    frames = imu_frames(topics).among(judged(topics["/control"], scenario.settle_s, scenario.duration_s))
    t = frames.stamp_s - config.imu.attitude_lag_ms * 1e-3
    cycle_s = m["stamp_ns"] * 1e-9
    rod_pitch, rod_roll = (np.interp(t, cycle_s, rod) for rod in resolver_rods(topics, config))
    pitch, roll = attitude_from_rods(rod_pitch, rod_roll, config)
    seen_pitch, seen_roll = rods_from_attitude(frames.pitch_rad, frames.roll_rad, config)
    if axis == "pitch":
        return Comparison(t, pitch, frames.pitch_rad - pitch, seen_pitch - rod_pitch)
    return Comparison(t, roll, frames.roll_rad - roll, seen_roll - rod_roll)


class Stations(NamedTuple):
    """One reading per station of a staircase; ``rising`` says from which side it was reached."""

    value_deg: Array
    rising: NDArray[np.bool_]
    angle_arcsec: Array
    rod_um: Array


def stations(c: Comparison, stairs: Staircase, start_s: float) -> Stations:
    """Means over the reading time at the end of each dwell. A station without readings is left out."""
    rows = []
    for k, value in enumerate(stairs.values_deg):
        end = start_s + (k + 1) * stairs.dwell_s
        at = (c.t_s > end - stairs.read_s) & (c.t_s <= end)
        if at.any():
            rising = k > 0 and value > stairs.values_deg[k - 1]
            rows.append((value, rising, c.angle_rad[at].mean() * ARCSEC_PER_RAD, c.rod_m[at].mean() * UM_PER_M))
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return Stations(table[:, 0], table[:, 1] > 0.5, table[:, 2], table[:, 3])


def _passes(s: Stations) -> tuple[Array, Array]:
    """Angle and rod differences between the rising and the falling pass at the same station."""
    angle, rod = [], []
    for value in np.unique(s.value_deg):
        at = s.value_deg == value
        up, down = at & s.rising, at & ~s.rising
        if up.any() and down.any():
            angle.append(s.angle_arcsec[up].mean() - s.angle_arcsec[down].mean())
            rod.append(s.rod_um[up].mean() - s.rod_um[down].mean())
    return np.array(angle), np.array(rod)


def crossings(c: Comparison) -> tuple[Array, Array]:
    """Times and sizes (m, signed) of sudden shifts of the rod error: the nut crossing its play."""
    if len(c.t_s) < 8:
        return np.empty(0), np.empty(0)
    dt = float(np.median(np.diff(c.t_s)))
    half = max(2, round(0.5 * STEP_WINDOW_S / dt))
    kernel = np.concatenate((np.full(half, 1.0 / half), np.full(half, -1.0 / half)))
    shift = np.convolve(c.rod_m, kernel, mode="valid")  # mean after less mean before
    t = c.t_s[half - 1 : half - 1 + len(shift)]
    big = np.abs(shift) > 0.5 * np.abs(shift).max()
    edges = np.flatnonzero(np.diff(big.astype(np.int8), prepend=0, append=0))
    times, sizes = [], []
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        top = a + int(np.argmax(np.abs(shift[a:b])))
        times.append(t[top])
        sizes.append(shift[top])
    return np.array(times), np.array(sizes)


def _reversals(topics: Topics, scenario: Scenario, low_s: float, high_s: float) -> Array:
    c, axis = topics["/control"], moved_axis(scenario)
    t, rate = c["stamp_ns"] * 1e-9, c[f"reference.{axis}_rate_rad_s"]
    turns = t[1:][np.signbit(rate[1:]) != np.signbit(rate[:-1])]
    return np.asarray(turns[(turns > low_s) & (turns < high_s - REVERSAL_S)])


def figures(topics: Topics, config: RigConfig, scenario: Scenario) -> Figures:
    """Largest and smallest errors; for a staircase at its stations, with the two passes compared; for a sine with its reversals."""
    c = compare(topics, config, scenario)
    if not len(c.t_s):
        return {}
    result: Figures = {}
    stairs = scenario.reference.staircase
    if stairs is not None:
        s = stations(c, stairs, scenario.reference.start_s)
        angle, rod = s.angle_arcsec, s.rod_um
        between_angle, between_rod = _passes(s)
        result["stations"] = len(angle)
        if len(between_angle):
            result["passes_arcsec_mean"] = float(np.abs(between_angle).mean())
            result["passes_arcsec_max"] = float(np.abs(between_angle).max())
            result["passes_um_mean"] = float(np.abs(between_rod).mean())
            # what is left when the play, common to all stations, is taken out
            result["passes_um_scatter"] = float(np.std(between_rod))
        result |= _impact(topics, scenario, stairs)
    else:
        angle, rod = c.angle_rad * ARCSEC_PER_RAD, c.rod_m * UM_PER_M
        turns = _reversals(topics, scenario, float(c.t_s[0]), float(c.t_s[-1]))
        times, sizes = crossings(c)
        near = [int(((times > t - REVERSAL_S) & (times < t + REVERSAL_S)).sum()) for t in turns]
        far = [not bool((np.abs(turns - t) < REVERSAL_S).any()) for t in times if turns[0] < t < turns[-1]] if len(turns) else []
        result["reversals"] = len(turns)
        result["peaks_per_reversal_min"] = min(near, default=None)
        result["peaks_per_reversal_max"] = max(near, default=None)
        result["peaks_elsewhere"] = int(sum(far))
        result["peak_um"] = float(np.median(np.abs(sizes))) if len(sizes) else None
    result["angle_arcsec_max"] = float(np.abs(angle).max())
    result["angle_arcsec_top"] = float(angle.max())
    result["angle_arcsec_bottom"] = float(angle.min())
    result["angle_arcsec_shift"] = float(0.5 * (angle.max() + angle.min()))
    result["angle_arcsec_half_range"] = float(0.5 * np.ptp(angle))
    result["rod_um_max"] = float(np.abs(rod).max())
    return result


def _impact(topics: Topics, scenario: Scenario, stairs: Staircase) -> Figures:
    """How hard the commands hit: overshoot beyond the station by the IMU, and the largest rod force of a virtual rig."""
    frames, start = imu_frames(topics), scenario.reference.start_s
    angle = (frames.roll_rad if stairs.axis == "roll" else frames.pitch_rad) * DEG_PER_RAD * 60.0
    over = []
    for k in range(1, len(stairs.values_deg)):
        sign = np.sign(stairs.values_deg[k] - stairs.values_deg[k - 1])
        a, b = start + k * stairs.dwell_s, start + (k + 1) * stairs.dwell_s
        during, rest = (frames.stamp_s > a) & (frames.stamp_s <= b), (frames.stamp_s > b - stairs.read_s) & (frames.stamp_s <= b)
        if rest.any():
            over.append(float((sign * (angle[during] - angle[rest].mean())).max()))
    result: Figures = {"overshoot_arcmin": max(over, default=None)}
    if "/truth" in topics:
        t = topics["/truth"]
        moving = t["stamp_ns"] * 1e-9 > start
        result["rod_force_n_max"] = float(np.abs(t[f"rod_force_{stairs.axis}_n"][moving]).max()) if moving.any() else None
    return result


def curves(topics: Topics, config: RigConfig, scenario: Scenario) -> Curves:
    """Error over the station (rising and falling) or over time."""
    c = compare(topics, config, scenario)
    stairs = scenario.reference.staircase
    if stairs is None:
        return {
            "open_loop.angle": thin(c.t_s, c.angle_rad * ARCSEC_PER_RAD),
            "open_loop.rod": thin(c.t_s, c.rod_m * UM_PER_M),
            "open_loop.place": thin(c.t_s, c.place_rad * DEG_PER_RAD),
        }
    s = stations(c, stairs, scenario.reference.start_s)
    result: Curves = {}
    for name, pick in (("rising", s.rising), ("falling", ~s.rising)):
        result[f"stations.angle.{name}"] = (s.value_deg[pick], s.angle_arcsec[pick])
        result[f"stations.rod.{name}"] = (s.value_deg[pick], s.rod_um[pick])
    return result
