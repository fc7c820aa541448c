"""Open-loop positioning (Figs 15, 16): attitude by the IMU against attitude by the resolvers, and both as rod travel, on a level base.

The IMU shows the platform of an earlier instant (its output filter; the device stamp already excludes the transport delay), so the resolvers are
read back at the frame's stamp less that lag: without it 8 deg / 8 s would show 90 arcsec of error that is none.

Three kinds of error, never mixed: ``imu`` as measured (mean of a short time, since a single frame carries 0.1 arcmin of resolution and noise),
``unbiased`` without the constant bias of the IMU (the paper calibrates its IMU against a 20-bit resolver), ``true`` the true angle less the resolver.
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

MEAN_S = 0.1
"""Frames of a moving platform are averaged over this time."""
REVERSAL_S = 1.5
"""A crossing belongs to a reversal of the motion when it comes within this time of it: gravity can turn the rod force before the rod turns."""
BESIDE_S = (0.4, 1.2)
"""The size of a crossing is the step between the means over this span before and after it."""
KINDS = ("imu", "unbiased", "true")


class Comparison(NamedTuple):
    """IMU (or truth) less resolver on one axis, at the IMU's frames."""

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


def compare(topics: Topics, config: RigConfig, scenario: Scenario, bias: tuple[float, float] = (0.0, 0.0)) -> dict[str, Comparison]:
    """The comparison by kind over the part of the run that counts; ``bias`` of the IMU in pitch and roll, rad. No ``true`` without truth."""
    m, axis = topics["/measurement"], moved_axis(scenario)
    frames = imu_frames(topics).among(judged(topics["/control"], scenario.settle_s, scenario.duration_s))
    t = frames.stamp_s - config.imu.attitude_lag_ms * 1e-3
    cycle_s = m["stamp_ns"] * 1e-9
    first, second = resolver_rods(topics, config)
    rods = (np.interp(t, cycle_s, first), np.interp(t, cycle_s, second))
    seen = {
        "imu": (frames.pitch_rad, frames.roll_rad),
        "unbiased": (frames.pitch_rad - bias[0], frames.roll_rad - bias[1]),
    }
    if "/truth" in topics:
        true, true_s = topics["/truth"], topics["/truth"]["stamp_ns"] * 1e-9
        seen["true"] = (np.interp(t, true_s, true["joint_pitch_rad"]), np.interp(t, true_s, true["joint_roll_rad"]))
    k = 0 if axis == "pitch" else 1
    place = attitude_from_rods(rods[0], rods[1], config)[k]
    return {
        kind: Comparison(t, place, angles[k] - place, rods_from_attitude(angles[0], angles[1], config)[k] - rods[k]) for kind, angles in seen.items()
    }


def _averaged(c: Comparison) -> Comparison:
    """Means over ``MEAN_S``, one for each frame."""
    if len(c.t_s) < 2:
        return c
    width = max(1, round(MEAN_S / float(np.median(np.diff(c.t_s)))))
    window = np.full(width, 1.0 / width)
    return Comparison(*(np.convolve(column, window, mode="valid") for column in c))


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
    """Times and sizes (m, signed) at which the rod error changes from one level to the other: the nut crossing its play.

    The levels are those of the whole run; a change counts when the error goes from beyond a quarter of their distance on one side of the middle to
    beyond a quarter on the other.
    """
    if len(c.t_s) < 8:
        return np.empty(0), np.empty(0)
    low, high = np.quantile(c.rod_m, (0.1, 0.9))
    middle, quarter = 0.5 * (low + high), 0.25 * (high - low)
    side = np.where(c.rod_m > middle + quarter, 1, np.where(c.rod_m < middle - quarter, -1, 0))
    sure = np.flatnonzero(side)
    changes = np.flatnonzero(np.diff(side[sure]) != 0)
    times, sizes = [], []
    for k in changes:
        t = 0.5 * (c.t_s[sure[k]] + c.t_s[sure[k + 1]])
        before = (c.t_s > t - BESIDE_S[1]) & (c.t_s < t - BESIDE_S[0])
        after = (c.t_s > t + BESIDE_S[0]) & (c.t_s < t + BESIDE_S[1])
        if before.any() and after.any():
            times.append(t)
            sizes.append(float(c.rod_m[after].mean() - c.rod_m[before].mean()))
    return np.array(times), np.array(sizes)


def _reversals(topics: Topics, scenario: Scenario, low_s: float, high_s: float) -> Array:
    c, axis = topics["/control"], moved_axis(scenario)
    t, rate = c["stamp_ns"] * 1e-9, c[f"reference.{axis}_rate_rad_s"]
    turns = t[1:][np.signbit(rate[1:]) != np.signbit(rate[:-1])]
    return np.asarray(turns[(turns > low_s) & (turns < high_s)])


def figures(topics: Topics, config: RigConfig, scenario: Scenario, bias: tuple[float, float] = (0.0, 0.0)) -> Figures:
    """Largest and smallest errors by kind; for a staircase at its stations, with the two passes compared; for a sine with its reversals."""
    found = compare(topics, config, scenario, bias)
    if not len(found["imu"].t_s):
        return {}
    result: Figures = {}
    stairs = scenario.reference.staircase
    for kind, c in found.items():
        if stairs is not None:
            s = stations(c, stairs, scenario.reference.start_s)
            angle, rod = s.angle_arcsec, s.rod_um
        else:
            mean = _averaged(c)
            angle, rod = mean.angle_rad * ARCSEC_PER_RAD, mean.rod_m * UM_PER_M
        if len(angle):
            result[kind] = {
                "angle_arcsec_max": float(np.abs(angle).max()),
                "angle_arcsec_top": float(angle.max()),
                "angle_arcsec_bottom": float(angle.min()),
                "angle_arcsec_shift": float(0.5 * abs(angle.max() + angle.min())),
                "angle_arcsec_half_range": float(0.5 * np.ptp(angle)),
                "rod_um_max": float(np.abs(rod).max()),
            }
    if stairs is not None:
        s = stations(found["imu"], stairs, scenario.reference.start_s)
        between_angle, between_rod = _passes(s)
        result["stations"] = len(s.value_deg)
        if len(between_angle):
            result["passes_arcsec_mean"] = float(np.abs(between_angle).mean())
            result["passes_arcsec_max"] = float(np.abs(between_angle).max())
            result["passes_um_mean"] = float(np.abs(between_rod).mean())
        return result | _impact(topics, scenario, stairs)
    c = _averaged(found["imu"])
    turns = _reversals(topics, scenario, float(c.t_s[0]) + REVERSAL_S, float(c.t_s[-1]) - REVERSAL_S)
    times, sizes = crossings(c)
    near = [int(((times > t - REVERSAL_S) & (times < t + REVERSAL_S)).sum()) for t in turns]
    result["reversals"] = len(turns)
    result["peaks_per_reversal_min"] = min(near, default=None)
    result["peaks_per_reversal_max"] = max(near, default=None)
    inside = times[(times > turns[0]) & (times < turns[-1])] if len(turns) else times[:0]
    result["peaks_elsewhere"] = sum(not bool((np.abs(turns - t) < REVERSAL_S).any()) for t in inside)
    result["peak_um"] = float(np.median(np.abs(sizes)) * UM_PER_M) if len(sizes) else None
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
    """Error as measured over the station (rising and falling) or over time; over time the true error as well."""
    found = compare(topics, config, scenario)
    stairs = scenario.reference.staircase
    result: Curves = {}
    if stairs is None:
        for kind in ("imu", "true"):
            if kind in found:
                c = _averaged(found[kind])
                result[f"open_loop.angle.{kind}"] = thin(c.t_s, c.angle_rad * ARCSEC_PER_RAD)
                result[f"open_loop.rod.{kind}"] = thin(c.t_s, c.rod_m * UM_PER_M)
        result["open_loop.place"] = thin(found["imu"].t_s, found["imu"].place_rad * DEG_PER_RAD)
        return result
    s = stations(found["imu"], stairs, scenario.reference.start_s)
    rising = s.rising.copy()
    rising[:1] = rising[1:2]  # the first station is the start of the first pass
    for name, pick in (("rising", rising), ("falling", ~rising)):
        result[f"stations.angle.{name}"] = (s.value_deg[pick], s.angle_arcsec[pick])
        result[f"stations.rod.{name}"] = (s.value_deg[pick], s.rod_um[pick])
    return result
