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
    # unpacked as a whole: a named field costs as much as a whole unpacking
    _, _, imu, resolver1, resolver2, drive1, drive2, azimuth, temperature, _ = m
    r1_stamp, r1_seq, _, r1_status = resolver1
    r2_stamp, r2_seq, _, r2_status = resolver2
    if r1_status or r2_status:
        return _RESOLVER_FAULT
    oldest = now_ns - limits.signal_ns
    if r1_stamp < oldest or r2_stamp < oldest or r1_seq < 0 or r2_seq < 0:
        return _RESOLVER_STALE
    d1_stamp, d1_seq, _, d1_fault, d1_current, _ = drive1
    d2_stamp, d2_seq, _, d2_fault, d2_current, _ = drive2
    if d1_stamp < oldest or d2_stamp < oldest or d1_seq < 0 or d2_seq < 0:
        return _DRIVE_STALE
    if d1_fault or d2_fault:
        return _DRIVE_FAULT
    imu_stamp, _, imu_seq, imu_valid, roll, pitch, yaw, gyro_x, gyro_y, gyro_z = imu
    _, _, _, _, azimuth_rate, left_switch, right_switch, _ = azimuth
    _, _, screw_pitch, screw_roll, _, _ = temperature
    # a sum is finite only if every term is (and cheaper than asking each)
    total = (
        roll + pitch + yaw + gyro_x + gyro_y + gyro_z + d1_current + d2_current + azimuth_rate + screw_pitch + screw_roll
    )
    if not isfinite(total):
        return _NOT_FINITE
    if imu_seq < 0 or not imu_valid or now_ns - imu_stamp > limits.imu_ns:
        return _IMU_STALE
    if left_switch or right_switch:
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
