"""Judge every signal of a measurement before anything uses it: age, sequence, converter bits, finite numbers."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import Command, Estimate, Measurement
from spsp_ctrl.safety.faults import BY_ID, Fault

_IMU_STALE = BY_ID["imu-stale"]
_RESOLVER_STALE = BY_ID["resolver-stale"]
_DRIVE_STALE = BY_ID["drive-stale"]
_RESOLVER_FAULT = BY_ID["resolver-fault"]
_DRIVE_FAULT = BY_ID["drive-fault"]
_NOT_FINITE = BY_ID["not-finite"]
_TRAVEL_SWITCH = BY_ID["travel-switch"]


@dataclass(frozen=True, slots=True)
class JudgeLimits:
    """Ages in ns."""

    imu_ns: int
    signal_ns: int


def judge_limits(config: RigConfig) -> JudgeLimits:
    """From the rig file: the IMU may be late by its own delay and period, and by the coasting time on top."""
    s = config.supervisor
    normal_ms = config.imu.delay_ms + 1e3 / config.imu.rate_hz
    return JudgeLimits(round((normal_ms + s.imu_timeout_ms) * 1e6), round(s.signal_timeout_ms * 1e6))


def judge(m: Measurement, limits: JudgeLimits, now_ns: int) -> Fault | None:
    """The gravest thing that is wrong with a measurement, or None."""
    r1, r2, d1, d2, imu, az = m.resolver_pitch, m.resolver_roll, m.drive_pitch, m.drive_roll, m.imu, m.azimuth
    if r1.status or r2.status:
        return _RESOLVER_FAULT
    oldest = now_ns - limits.signal_ns
    if r1.stamp_ns < oldest or r2.stamp_ns < oldest or r1.seq < 0 or r2.seq < 0:
        return _RESOLVER_STALE
    if d1.stamp_ns < oldest or d2.stamp_ns < oldest or d1.seq < 0 or d2.seq < 0:
        return _DRIVE_STALE
    if d1.fault_code or d2.fault_code:
        return _DRIVE_FAULT
    # a sum is finite only if every term is (and cheaper than asking each)
    total = (
        imu.roll_rad + imu.pitch_rad + imu.yaw_rad + imu.gyro_x_rad_s + imu.gyro_y_rad_s + imu.gyro_z_rad_s
        + d1.current_a + d2.current_a + az.rate_microsteps_s
        + m.temperature.screw_pitch_c + m.temperature.screw_roll_c
    )  # fmt: skip
    if not isfinite(total):
        return _NOT_FINITE
    if imu.seq < 0 or not imu.valid or now_ns - imu.stamp_ns > limits.imu_ns:
        return _IMU_STALE
    if az.left_switch or az.right_switch:
        return _TRAVEL_SWITCH
    return None


def estimate_is_finite(e: Estimate) -> bool:
    """Whether every number that reaches the law is finite."""
    return isfinite(sum(e))


def command_is_finite(c: Command) -> bool:
    """Whether every number that would reach a drive is finite."""
    return isfinite(
        c.pitch_current_a + c.pitch_speed_rad_s + c.roll_current_a + c.roll_speed_rad_s + c.azimuth_rate_rad_s
    )
