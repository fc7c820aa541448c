"""Sensor stage: truth -> readings. Noise comes in as standard normal numbers, so a run is a function of its inputs."""

from __future__ import annotations

from math import asin, atan2, cos, exp, pi, sin, sqrt

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.effects.imu_error import quantise
from spsp_ctrl.plant.effects.resolver_error import resolver_counts
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_AXIS_STATE, A, G, O, S, U, X
from spsp_ctrl.plant.stages.azimuth import microstep_angle
from spsp_ctrl.plant.stages.drive import clip
from spsp_ctrl.plant.stages.mechanism import to_platform

GRAVITY = 9.80665


@stage
def lag_step(state: float, before: float, now: float, time_constant: float, dt: float) -> float:
    """First-order lag over one cycle, exact for an input that moves linearly from ``before`` to ``now``."""
    if time_constant <= 0.0:
        return now
    a = exp(-dt / time_constant)
    return a * state + (1.0 - a) * before + (now - before) * (1.0 - time_constant / dt * (1.0 - a))


@stage
def attitude_step(x: Array, p: Array, u: Array, out: Array, initialise: float, dt: float) -> None:
    """True platform attitude and rate in space; the lags and slow errors of the IMU."""
    az, pitch, roll = x[S.azimuth], x[S.pitch], x[S.roll]
    ca, sa, cp, sp, cr, sr = cos(az), sin(az), cos(pitch), sin(pitch), cos(roll), sin(roll)
    # columns of Rz(az) Ry(pitch) Rx(-roll): images of the platform axes in base axes
    e0x, e0y, e0z = ca * cp, sa * cp, -sp
    e1x, e1y, e1z = -ca * sp * sr - sa * cr, -sa * sp * sr + ca * cr, -cp * sr
    e2x, e2y, e2z = ca * sp * cr - sa * sr, sa * sp * cr + ca * sr, cp * cr
    r00 = u[U.base_r00] * e0x + u[U.base_r01] * e0y + u[U.base_r02] * e0z
    r10 = u[U.base_r10] * e0x + u[U.base_r11] * e0y + u[U.base_r12] * e0z
    r20 = u[U.base_r20] * e0x + u[U.base_r21] * e0y + u[U.base_r22] * e0z
    r21 = u[U.base_r20] * e1x + u[U.base_r21] * e1y + u[U.base_r22] * e1z
    r22 = u[U.base_r20] * e2x + u[U.base_r21] * e2y + u[U.base_r22] * e2z
    imu_pitch = -asin(clip(r20, -1.0, 1.0))
    imu_roll = atan2(r21, r22)
    yaw = atan2(r10, r00)
    out[O.platform_pitch_rad] = imu_pitch
    out[O.platform_roll_rad] = -imu_roll
    out[O.heading_rad] = yaw

    wx, wy, wz = to_platform(u[U.base_omega_x], u[U.base_omega_y], u[U.base_omega_z], ca, sa, cp, sp, cr, sr)
    wx += -sp * x[S.azimuth_rate] - x[S.roll_rate]
    wy += -sr * cp * x[S.azimuth_rate] + cr * x[S.pitch_rate]
    wz += cr * cp * x[S.azimuth_rate] + sr * x[S.pitch_rate]

    # small rotation of the IMU on the platform
    mx, my, mz = p[G.imu_mount_x_rad], p[G.imu_mount_y_rad], p[G.imu_mount_z_rad]
    if mx != 0.0 or my != 0.0 or mz != 0.0:
        imu_roll += mx + mz * imu_pitch
        imu_pitch += my - mz * imu_roll
        yaw += mz
        gx = wx + mz * wy - my * wz
        gy = wy - mz * wx + mx * wz
        gz = wz + my * wx - mx * wy
        wx, wy, wz = gx, gy, gz

    if initialise != 0.0:
        x[S.in_roll] = x[S.lag_roll] = imu_roll
        x[S.in_pitch] = x[S.lag_pitch] = imu_pitch
        x[S.in_yaw] = x[S.lag_yaw] = yaw
        x[S.in_gyro_x] = x[S.lag_gyro_x] = wx
        x[S.in_gyro_y] = x[S.lag_gyro_y] = wy
        x[S.in_gyro_z] = x[S.lag_gyro_z] = wz
        return
    while yaw - x[S.in_yaw] > pi:
        yaw -= 2.0 * pi
    while yaw - x[S.in_yaw] < -pi:
        yaw += 2.0 * pi
    tau = p[G.imu_attitude_lag_s] + p[G.imu_added_lag_s]
    x[S.lag_roll] = lag_step(x[S.lag_roll], x[S.in_roll], imu_roll, tau, dt)
    x[S.lag_pitch] = lag_step(x[S.lag_pitch], x[S.in_pitch], imu_pitch, tau, dt)
    x[S.lag_yaw] = lag_step(x[S.lag_yaw], x[S.in_yaw], yaw, tau, dt)
    x[S.in_roll], x[S.in_pitch], x[S.in_yaw] = imu_roll, imu_pitch, yaw
    tau = p[G.imu_gyro_lag_s] + p[G.imu_added_lag_s]
    x[S.lag_gyro_x] = lag_step(x[S.lag_gyro_x], x[S.in_gyro_x], wx, tau, dt)
    x[S.lag_gyro_y] = lag_step(x[S.lag_gyro_y], x[S.in_gyro_y], wy, tau, dt)
    x[S.lag_gyro_z] = lag_step(x[S.lag_gyro_z], x[S.in_gyro_z], wz, tau, dt)
    x[S.in_gyro_x], x[S.in_gyro_y], x[S.in_gyro_z] = wx, wy, wz

    level = p[G.imu_levelling_time_s]
    if level > 0.0:
        # horizontal acceleration in heading axes; a level platform under a_x sees the vertical tilted by a_x / g in pitch
        hx = u[U.base_r00] * u[U.base_f_x] + u[U.base_r01] * u[U.base_f_y] + u[U.base_r02] * u[U.base_f_z]
        hy = u[U.base_r10] * u[U.base_f_x] + u[U.base_r11] * u[U.base_f_y] + u[U.base_r12] * u[U.base_f_z]
        cy, sy = cos(yaw), sin(yaw)
        forward = cy * hx + sy * hy
        left = -sy * hx + cy * hy
        x[S.level_pitch] += dt / level * (-forward / GRAVITY - x[S.level_pitch])
        x[S.level_roll] += dt / level * (left / GRAVITY - x[S.level_roll])


@stage
def imu_sample(x: Array, p: Array, u: Array, out: Array) -> None:
    """One IMU frame: adds slow errors, noise and quantisation to the lagged truth."""
    dt = 1.0 / p[G.imu_rate_hz]
    time = p[G.imu_drift_time_s]
    sigma = p[G.imu_drift_rad]
    if sigma > 0.0 and time > 0.0:
        a = exp(-dt / time)
        b = sigma * sqrt(1.0 - a * a)
        x[S.drift_roll] = a * x[S.drift_roll] + b * u[U.noise_drift_roll]
        x[S.drift_pitch] = a * x[S.drift_pitch] + b * u[U.noise_drift_pitch]
    x[S.drift_yaw] += p[G.imu_yaw_drift_rad_s] * dt + p[G.imu_yaw_walk_rad_sqrt_s] * sqrt(dt) * u[U.noise_drift_yaw]
    noise, step = p[G.imu_noise_rad], p[G.imu_step_rad]
    roll_scale, pitch_scale, gyro_scale = 1.0 + p[G.imu_roll_scale], 1.0 + p[G.imu_pitch_scale], 1.0 + p[G.gyro_scale]
    roll = roll_scale * x[S.lag_roll] + p[G.imu_roll_bias_rad] + x[S.drift_roll] + x[S.level_roll] + noise * u[U.noise_imu_roll]
    pitch = pitch_scale * x[S.lag_pitch] + p[G.imu_pitch_bias_rad] + x[S.drift_pitch] + x[S.level_pitch] + noise * u[U.noise_imu_pitch]
    yaw = x[S.lag_yaw] + p[G.imu_yaw_bias_rad] + x[S.drift_yaw] + noise * u[U.noise_imu_yaw]
    while yaw > pi:
        yaw -= 2.0 * pi
    while yaw <= -pi:
        yaw += 2.0 * pi
    out[O.imu_roll] = quantise(roll, step)
    out[O.imu_pitch] = quantise(pitch, step)
    out[O.imu_yaw] = quantise(yaw, step)
    noise, step = p[G.gyro_noise_rad_s], p[G.gyro_step_rad_s]
    out[O.gyro_x] = quantise(gyro_scale * x[S.lag_gyro_x] + p[G.gyro_bias_x_rad_s] + noise * u[U.noise_gyro_x], step)
    out[O.gyro_y] = quantise(gyro_scale * x[S.lag_gyro_y] + p[G.gyro_bias_y_rad_s] + noise * u[U.noise_gyro_y], step)
    out[O.gyro_z] = quantise(gyro_scale * x[S.lag_gyro_z] + p[G.gyro_bias_z_rad_s] + noise * u[U.noise_gyro_z], step)


@stage
def axis_sensors(x: Array, p: Array, u: Array, axis: int, out: Array) -> None:
    """Resolver counts, reported current and bus voltage of one actuator."""
    xb = axis * N_AXIS_STATE
    pb = axis * N_AXIS_PARAMETERS
    out[O.counts_pitch + axis] = resolver_counts(
        x[xb + X.angle],
        p[pb + A.res_first_rad],
        p[pb + A.res_first_phase_rad],
        p[pb + A.res_second_rad],
        p[pb + A.res_second_phase_rad],
        p[pb + A.res_noise_rad] * u[U.noise_resolver_pitch + axis],
        p[pb + A.resolver_counts],
        p[pb + A.res_step_rad],
    )
    out[O.measured_current_pitch + axis] = x[xb + X.current] + p[pb + A.current_noise_a] * u[U.noise_current_pitch + axis]
    out[O.bus_voltage_pitch + axis] = p[pb + A.bus_voltage_v]


@stage
def azimuth_sensors(x: Array, p: Array, out: Array) -> None:
    """Step counter and switches of the azimuth axis."""
    step = microstep_angle(p)
    out[O.microsteps] = (x[S.step_angle] / step + 0.5) // 1.0
    out[O.microstep_rate] = x[S.step_rate] / step
    az = x[S.azimuth]
    out[O.left_switch] = 1.0 if az >= p[G.az_switch_rad] else 0.0
    out[O.right_switch] = 1.0 if az <= -p[G.az_switch_rad] else 0.0
    out[O.home_switch] = 1.0 if abs(az) <= p[G.az_home_half_rad] else 0.0
    tooth = 2.0 * pi / p[G.az_teeth]
    out[O.lost_steps] = 4.0 * ((x[S.step_angle] - x[S.rotor_angle]) / tooth + 0.5 - ((x[S.step_angle] - x[S.rotor_angle]) / tooth + 0.5) % 1.0)
