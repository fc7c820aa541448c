"""What a motion asks of the joints and rods: travel, speed and acceleration of each, over the settled part of the motion.

The carrier's motion comes from the swing table itself, the joints from the chain backwards, the rods from the kinematics: all exact
derivatives, sampled at :data:`RATE_HZ`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, lcm

import numpy as np

from spsp_ctrl.config.scenario import BaseMotion, ReferencePlan, Sine
from spsp_ctrl.mechanism import vectorised
from spsp_ctrl.mechanism.chain import JointMotion
from spsp_ctrl.mechanism.vectorised import Array
from spsp_ctrl.mechanism.workspace import Travel
from spsp_ctrl.plant.swing_table import SwingTable

RATE_HZ = 1000
LONGEST_S = 600.0


@dataclass(frozen=True)
class Demand:
    """One joint or rod: extremes of its travel (rad, or m from level), largest speed and acceleration (per s, per s^2)."""

    low: float
    high: float
    speed: float
    accel: float

    @classmethod
    def of(cls, travel: Array, speed: Array, accel: Array) -> Demand:
        """From time series."""
        return cls(
            float(travel.min()), float(travel.max()), float(np.abs(speed).max()), float(np.abs(accel).max())
        )


@dataclass(frozen=True)
class MotionDemand:
    """The whole motion; arrays over ``t_s``."""

    t_s: Array
    joints: JointMotion
    rods: tuple[Array, ...]
    """Travel from level, speed and acceleration of pitch and roll rod: (s1, s2, v1, v2, a1, a2)."""
    pitch_rod: Demand
    roll_rod: Demand
    azimuth: Demand
    pitch: Demand
    roll: Demand


def common_period_s(sines: Sequence[Sine]) -> float:
    """Time after which all sines repeat together (periods to the millisecond), at most :data:`LONGEST_S`."""
    if not sines:
        return 1.0
    return min(lcm(*(max(1, round(1e3 * s.period_s)) for s in sines)) * 1e-3, LONGEST_S)


def _wave(offset_deg: float, sines: tuple[Sine, ...], after_s: Array) -> tuple[Array, Array, Array]:
    """Angle, rate and acceleration of an offset and sines."""
    angle, rate, accel = np.full_like(after_s, np.radians(offset_deg)), np.zeros_like(after_s), np.zeros_like(after_s)
    for s in sines:
        omega = 2.0 * np.pi / s.period_s
        phase = omega * after_s + np.radians(s.phase_deg)
        amplitude = np.radians(s.amplitude_deg)
        angle += amplitude * np.sin(phase)
        rate += amplitude * omega * np.cos(phase)
        accel -= amplitude * omega * omega * np.sin(phase)
    return angle, rate, accel


def motion_demand(
    travel: Travel,
    base: BaseMotion,
    reference: ReferencePlan,
    duration_s: float | None = None,
    seed: int = 1,
    azimuth_locked: bool = False,
) -> MotionDemand:
    """Demand of a scenario's base motion and reference, after both have grown to their full size.

    Without ``duration_s`` one common period is taken. Moves to another heading are not part of it: the heading stands on its
    first target. The reference of kind ``joint`` moves the joints by itself, whatever the carrier does. ``azimuth_locked`` holds the
    platform level with azimuth at zero, its heading free (any other pitch or roll in space has no meaning then: ``ValueError``).
    """
    if azimuth_locked and (reference.pitch or reference.roll or reference.pitch_deg or reference.roll_deg):
        raise ValueError("with azimuth locked the platform can only be held level: the reference must have no pitch and roll")
    start = ceil(max(base.start_s + base.ramp_s, reference.start_s + reference.ramp_s) * RATE_HZ)
    sines = (*reference.pitch, *reference.roll, *(() if reference.kind == "joint" else (*base.pitch, *base.roll, *base.yaw)))
    if duration_s is None:
        duration_s = common_period_s(sines)
    count = max(2, round(duration_s * RATE_HZ) + 1)
    t = np.arange(start, start + count) / RATE_HZ
    after = t - reference.start_s
    pitch, roll = _wave(reference.pitch_deg, reference.pitch, after), _wave(reference.roll_deg, reference.roll, after)
    still = np.zeros_like(t)
    heading = still + np.radians(next((h.heading_deg for h in reference.heading if h.at_s == 0.0), 0.0))
    if reference.kind == "joint":
        joints = JointMotion(heading, pitch[0], roll[0], still, pitch[1], roll[1], still, pitch[2], roll[2])  # type: ignore[arg-type]
    else:
        rows = SwingTable(base, RATE_HZ, seed).block(start, count).T
        carrier = tuple(rows[:9]), tuple(rows[9:12]), tuple(rows[12:15])
        if azimuth_locked:
            joints = vectorised.level_motion(*carrier, still, still, still)
        else:
            demand = heading, pitch[0], roll[0], still, pitch[1], roll[1], still, pitch[2], roll[2]
            joints = vectorised.joint_motion(*carrier, *demand)
    azimuth, p, r, azimuth_rate, p_rate, r_rate, azimuth_accel, p_accel, r_accel = joints
    l1, l2, v1, v2, a1, a2 = vectorised.rod_motion(p, r, p_rate, r_rate, p_accel, r_accel, *travel.lengths_m)
    s1, s2 = l1 - travel.level_m, l2 - travel.level_m
    turned = np.unwrap(np.asarray(azimuth))
    return MotionDemand(
        t - t[0],
        joints,
        (s1, s2, v1, v2, a1, a2),
        Demand.of(s1, v1, a1),
        Demand.of(s2, v2, a2),
        Demand.of(turned, np.asarray(azimuth_rate), np.asarray(azimuth_accel)),
        Demand.of(np.asarray(p), np.asarray(p_rate), np.asarray(p_accel)),
        Demand.of(np.asarray(r), np.asarray(r_rate), np.asarray(r_accel)),
    )
