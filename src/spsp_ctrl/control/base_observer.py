"""Observer of the carrier: tilt, rate and acceleration of the base from what the IMU sees minus what the joints do.

The IMU stands on the platform. Its attitude taken back through the joint angles is the attitude of the base, its gyro minus the joint
rates the rate of the base; both are taken at one instant and through the IMU's own lags (a mismatch of 0.5 ms costs 0.35 arcmin at
15 deg / 8 s). A steady-state Kalman filter per axis holds angle, rate and acceleration, with

    d3 beta / dt3 = -omega^2 d beta / dt

as its model: constant acceleration for omega = 0, a sinusoid for the omega of a swing. omega^2 is learnt as the ratio of the powers of
acceleration and rate, which is the best such predictor for *any* stationary motion (the regression of jerk on rate is minus that ratio),
so a multi-sine sea is served as well as one sine. Everything that the kinematics does not know (lead error, zero offset, wind-up) looks
like a tilt of the base and is corrected with the bandwidth of the filter: the observer is the integral action of the attitude loop.

Base attitude: ``Rz(yaw) Ry(pitch) Rx(-roll)``, the same signs as the joints (``mechanism.frames``).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan2, cos, exp, sin, sqrt
from typing import NamedTuple

Vector = tuple[float, float, float]
_new = tuple.__new__


@dataclass(frozen=True, slots=True)
class BaseGains:
    """Steady-state Kalman gains of one tilt axis at the IMU rate, and what the learning of omega needs."""

    angle_by_attitude: float
    rate_by_attitude: float
    accel_by_attitude: float
    angle_by_gyro: float
    rate_by_gyro: float
    accel_by_gyro: float
    yaw_rate: float
    yaw_accel: float
    attitude_lag_s: float
    gyro_lag_s: float
    adaptive: bool
    memory_s: float
    """Time constant over which the powers of rate and acceleration are averaged."""
    rate_floor_rad_s: float
    """Motion slower than this (rms) teaches nothing: omega goes to zero with it."""
    omega_max_rad_s: float


class BaseState(NamedTuple):
    """Estimate at the stamp of the newest IMU frame. Power terms are those of the two tilt rates and accelerations."""

    pitch: float
    pitch_rate: float
    pitch_accel: float
    roll: float
    roll_rate: float
    roll_accel: float
    yaw_rate: float
    yaw_accel: float
    pitch_rate_power: float
    pitch_accel_power: float
    roll_rate_power: float
    roll_accel_power: float
    pitch_innovation: float
    """Attitude innovations of the newest frame."""
    roll_innovation: float


START = BaseState(*(0.0,) * 14)


class BaseSeen(NamedTuple):
    """What one IMU frame says of the base: tilt (through the attitude lag) and Euler rates (through the gyro lag)."""

    pitch: float
    roll: float
    pitch_rate: float
    roll_rate: float
    yaw_rate: float


def see(imu_roll: float, imu_pitch: float, gyro: Vector, joints: Vector, joint_rate: Vector) -> BaseSeen:
    """Base tilt and rates from one IMU frame. ``joints`` (pitch, roll, azimuth) and ``joint_rate`` (body rate) through the IMU's lags."""
    # vertical in platform axes, then through the joints into base axes
    cp, sp = cos(imu_pitch), sin(imu_pitch)
    cr, sr = cos(imu_roll), sin(imu_roll)
    vx, vy, vz = -sp, sr * cp, cr * cp
    wx, wy, wz = gyro[0] - joint_rate[0], gyro[1] - joint_rate[1], gyro[2] - joint_rate[2]
    pitch, roll, azimuth = joints
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    ca, sa = cos(azimuth), sin(azimuth)
    # Rx(-roll), Ry(pitch), Rz(azimuth)
    y, z = cr * vy + sr * vz, cr * vz - sr * vy
    x, z = cp * vx + sp * z, cp * z - sp * vx
    ux, uy, uz = ca * x - sa * y, sa * x + ca * y, z
    y, z = cr * wy + sr * wz, cr * wz - sr * wy
    x, z = cp * wx + sp * z, cp * z - sp * wx
    bx, by, bz = ca * x - sa * y, sa * x + ca * y, z
    base_pitch = -asin(min(1.0, max(-1.0, ux)))
    base_roll = atan2(-uy, uz)
    cr, sr = cos(base_roll), sin(base_roll)
    across = cr * bz - sr * by
    yaw_rate = across / cos(base_pitch)
    return BaseSeen(base_pitch, base_roll, cr * by + sr * bz, -(bx + sin(base_pitch) * yaw_rate), yaw_rate)


def ahead(angle: float, rate: float, accel: float, omega_sq: float, t: float) -> Vector:
    """Angle, rate and acceleration ``t`` s later under the model."""
    x = omega_sq * t * t
    if x < 1e-4:
        # series: the exact form divides by omega
        s, c, k = t * (1.0 - x / 6.0), 1.0 - 0.5 * x, t * t * (0.5 - x / 24.0)
    else:
        omega = sqrt(omega_sq)
        s, c = sin(omega * t) / omega, cos(omega * t)
        k = (1.0 - c) / omega_sq
    return angle + s * rate + k * accel, c * rate + s * accel, c * accel - omega_sq * s * rate


def omega_squared(g: BaseGains, rate_power: float, accel_power: float) -> float:
    """Learnt omega^2 of an axis; fades to zero (constant acceleration) where there is no motion to learn from."""
    if not g.adaptive:
        return 0.0
    floor = g.rate_floor_rad_s * g.rate_floor_rad_s
    learnt = accel_power / (rate_power + floor) * (rate_power / (rate_power + floor))
    limit = g.omega_max_rad_s * g.omega_max_rad_s
    return learnt if learnt < limit else limit


def _forecast(angle: float, rate: float, accel: float, omega_sq: float, t: float, later: float) -> Vector:
    """The angle of :func:`ahead` after ``t`` s, its rate and acceleration after ``later`` s."""
    x = omega_sq * t * t
    if x < 1e-4:
        s, k = t * (1.0 - x / 6.0), t * t * (0.5 - x / 24.0)
    else:
        omega = sqrt(omega_sq)
        s, k = sin(omega * t) / omega, (1.0 - cos(omega * t)) / omega_sq
    x = omega_sq * later * later
    if x < 1e-4:
        later_s, c = later * (1.0 - x / 6.0), 1.0 - 0.5 * x
    else:
        omega = sqrt(omega_sq)
        later_s, c = sin(omega * later) / omega, cos(omega * later)
    return angle + s * rate + k * accel, c * rate + later_s * accel, c * accel - omega_sq * later_s * rate


def forecast(state: BaseState, g: BaseGains, t: float, later: float) -> tuple[float, float, float, float, float, float, float]:
    """Tilt (pitch, roll) ``t`` s after the newest frame; rates (pitch, roll, yaw) and accelerations (pitch, roll) ``later`` s after it."""
    pitch, pitch_rate, pitch_accel, roll, roll_rate, roll_accel, yaw_rate, yaw_accel, pp, pa, rp, ra, _, _ = state
    pitch, pitch_rate, pitch_accel = _forecast(pitch, pitch_rate, pitch_accel, omega_squared(g, pp, pa), t, later)
    roll, roll_rate, roll_accel = _forecast(roll, roll_rate, roll_accel, omega_squared(g, rp, ra), t, later)
    return pitch, roll, pitch_rate, roll_rate, yaw_rate + later * yaw_accel, pitch_accel, roll_accel


def start(seen: BaseSeen) -> BaseState:
    """From the first IMU frame."""
    return START._replace(
        pitch=seen.pitch,
        pitch_rate=seen.pitch_rate,
        roll=seen.roll,
        roll_rate=seen.roll_rate,
        yaw_rate=seen.yaw_rate,
    )


def _axis(
    g: BaseGains, angle: float, rate: float, accel: float, omega_sq: float, t: float, seen_angle: float, seen_rate: float
) -> tuple[float, float, float, float]:
    angle, rate, accel = ahead(angle, rate, accel, omega_sq, t)
    lag = g.attitude_lag_s
    # a first-order lag answers a parabola with angle - lag * rate + lag^2 * accel
    by_attitude = seen_angle - (angle - lag * (rate - lag * accel))
    by_gyro = seen_rate - (rate - g.gyro_lag_s * accel)
    return (
        angle + g.angle_by_attitude * by_attitude + g.angle_by_gyro * by_gyro,
        rate + g.rate_by_attitude * by_attitude + g.rate_by_gyro * by_gyro,
        accel + g.accel_by_attitude * by_attitude + g.accel_by_gyro * by_gyro,
        by_attitude,
    )


def update(state: BaseState, g: BaseGains, seen: BaseSeen, t: float) -> BaseState:
    """Predict over ``t`` s since the last frame and correct with a new one."""
    pp, pa, rp, ra = state[8:12]
    pitch, pitch_rate, pitch_accel, pitch_innovation = _axis(
        g, state.pitch, state.pitch_rate, state.pitch_accel, omega_squared(g, pp, pa), t, seen.pitch, seen.pitch_rate
    )
    roll, roll_rate, roll_accel, roll_innovation = _axis(
        g, state.roll, state.roll_rate, state.roll_accel, omega_squared(g, rp, ra), t, seen.roll, seen.roll_rate
    )
    yaw_rate = state.yaw_rate + t * state.yaw_accel
    error = seen.yaw_rate - (yaw_rate - g.gyro_lag_s * state.yaw_accel)
    keep = exp(-t / g.memory_s)
    new = 1.0 - keep
    return _new(
        BaseState,
        (
            pitch,
            pitch_rate,
            pitch_accel,
            roll,
            roll_rate,
            roll_accel,
            yaw_rate + g.yaw_rate * error,
            state.yaw_accel + g.yaw_accel * error,
            keep * pp + new * pitch_rate * pitch_rate,
            keep * pa + new * pitch_accel * pitch_accel,
            keep * rp + new * roll_rate * roll_rate,
            keep * ra + new * roll_accel * roll_accel,
            pitch_innovation,
            roll_innovation,
        ),
    )
