"""Lost steps of the azimuth stepper, as far as the loop can know them. A pure step.

The stepper counts what it was told, not what it did, and the yaw of the carrier is measured by nobody. Two things betray a slip, which is always by
whole teeth (four full steps):

``HEADING``  heading by the IMU less the count is the yaw of the carrier (and what tilt adds to it): a carrier turns smoothly, a slip is a jump. Its
             second difference over :data:`WINDOW_S` sees one at once. A carrier that yaws with more than tolerance / window^2 looks the same.
``HOME``     the vane of the zero switch must be passed where it was at homing. Late, but sure, and it also sees slips that crept.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import pi, radians
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.mechanism.frames import roll_from_imu, wrap_angle
from spsp_ctrl.messages import Measurement
from spsp_ctrl.safety.faults import BY_ID, Fault

WINDOW_S = 0.1
TOLERANCE_DEG = 0.2
"""Two thirds of the smallest slip of the rig as designed (0.3 deg); play, wind-up of the motor and sampling make up to 0.1 deg."""
TILT_DEG = 25.0
"""Heading means nothing near the zenith; beyond this tilt of the platform it is not judged."""
VANE_LEAST_DEG = 0.25
"""A pass shorter than this is no pass: the joint turned back inside the vane."""
LOST: Fault = BY_ID["steps-lost"]


class Means(IntEnum):
    """How a loss was noticed."""

    NONE = 0
    HEADING = 1
    HOME = 2


@dataclass(frozen=True, slots=True)
class StepLimits:
    """Constants in SI."""

    rad_per_microstep: float
    tolerance_rad: float
    lag_s: float
    frame_ns: int
    frames: int
    """IMU frames in a window."""


def step_limits(config: RigConfig) -> StepLimits:
    """From the rig file."""
    a = config.azimuth
    per_step = 2.0 * pi / (a.full_steps_per_turn * a.microsteps * a.gear_ratio)
    frames = max(1, round(WINDOW_S * config.imu.rate_hz))
    return StepLimits(per_step, radians(TOLERANCE_DEG), config.imu.attitude_lag_ms * 1e-3, round(1e9 / config.imu.rate_hz), frames)


class StepState(NamedTuple):
    """Newest stepper sample and IMU frame, the last two windows of apparent yaw, where the vane was entered, and what was found."""

    azimuth_seq: int
    microsteps: int
    home: bool
    entered_rad: float | None
    imu_stamp_ns: int
    yaw_rad: tuple[float, ...]
    means: int
    """``Means`` of the last alarm."""
    alarms: int
    """How many so far; one slip sets the heading alarm off once."""
    size_rad: float
    """Size of the last."""


START = StepState(-1, 0, False, None, 0, (), 0, 0, 0.0)


def step(state: StepState, p: StepLimits, m: Measurement) -> StepState:
    """One cycle."""
    seq, count, home, entered, imu_stamp, yaw, means, alarms, size = state
    azimuth, imu = m.azimuth, m.imu
    if azimuth.seq != seq and azimuth.seq >= 0:
        if seq >= 0 and azimuth.home_switch != home:
            edge = 0.5 * (count + azimuth.microsteps) * p.rad_per_microstep
            if azimuth.home_switch:
                entered = edge
            else:
                if entered is not None and abs(edge - entered) > radians(VANE_LEAST_DEG):
                    middle = 0.5 * (edge + entered)
                    if abs(middle) > p.tolerance_rad:
                        means, alarms, size = int(Means.HOME), alarms + 1, middle
                entered = None
        seq, count, home = azimuth.seq, azimuth.microsteps, azimuth.home_switch
    if imu.stamp_ns != imu_stamp and imu.seq >= 0 and imu.valid and seq >= 0:
        if imu.stamp_ns - imu_stamp > 1.5 * p.frame_ns:
            yaw = ()
        imu_stamp = imu.stamp_ns
        tilt = max(abs(imu.pitch_rad), abs(roll_from_imu(imu.roll_rad)))
        if tilt > radians(TILT_DEG):
            return StepState(seq, count, home, entered, imu_stamp, (), means, alarms, size)
        back_s = (imu_stamp - azimuth.stamp_ns) * 1e-9 - p.lag_s
        joint = (count + azimuth.rate_microsteps_s * back_s) * p.rad_per_microstep
        yaw = (*yaw[-2 * p.frames :], imu.yaw_rad - joint)
        if len(yaw) > 2 * p.frames:
            jump = wrap_angle(yaw[-1] - yaw[p.frames]) - wrap_angle(yaw[p.frames] - yaw[0])
            if abs(jump) > p.tolerance_rad:
                means, alarms, size, yaw = int(Means.HEADING), alarms + 1, jump, ()
    return StepState(seq, count, home, entered, imu_stamp, yaw, means, alarms, size)
