"""The fixed-gain observers of the law as steady-state Kalman filters, from stated noise (``filterpy``).

All are integrator chains with noise on every state of which the law knows less than its chain says:

motor observer  angle, speed, disturbance acceleration at the control rate; the mean current over the cycle is its input. Measured: resolver counts
                (uniform, one count wide) with the converter's noise, both from the plant model. Noise on the angle (the resolver's periodic error),
                on the speed (torque that comes and goes: cogging, ripple, the reported current's noise) and on the disturbance (friction, load).
base observer   angle, rate, acceleration of the carrier at the IMU rate. Measured: attitude and gyro taken back through the joints, through the IMU's
                lags. White jerk, and a random walk of the angle for what the kinematics does not know (lead error, wind-up).
yaw pair        rate and acceleration of base yaw at the IMU rate. Measured: gyro. White jerk and a random walk of the rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians
from typing import Any

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from spsp_ctrl.plant.layout import A
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning.blocks import innovation_matrix

Real = NDArray[np.float64]
ARCMIN = radians(1.0 / 60.0)


@dataclass(frozen=True, slots=True)
class MotorNoise:
    """Noise of the motor observer: standard deviation of one reading, and spectral densities of what drives the states."""

    angle_rad: float
    """Standard deviation of one resolver reading."""
    angle_walk_rad2_s: float
    """Of the angle."""
    white_rad2_s3: float
    """Of the speed: white acceleration."""
    walk_rad2_s5: float
    """Of the disturbance: (rad/s2)^2 per second."""


@dataclass(frozen=True, slots=True)
class BaseNoise:
    """Noise of the base observer."""

    attitude_rad: float
    """Standard deviation of one base tilt seen."""
    gyro_rad_s: float
    """Standard deviation of one base rate seen."""
    jerk_rad2_s5: float
    """Spectral density of the jerk: (rad/s3)^2 per Hz."""
    walk_rad2_s: float
    """Of the random walk of the angle."""


@dataclass(frozen=True, slots=True)
class YawNoise:
    """Noise of the yaw pair."""

    gyro_rad_s: float
    """Standard deviation of one rate seen."""
    jerk_rad2_s5: float
    """Spectral density of the jerk: (rad/s3)^2 per Hz."""
    walk_rad2_s3: float
    """Of the random walk of the rate."""


def resolver_noise_rad(model: PlantModel) -> float:
    """Standard deviation of one resolver reading, from a plant model (pitch actuator)."""
    p = model.parameters()
    return float(np.hypot(2.0 * pi / p[A.resolver_counts] / np.sqrt(12.0), p[A.res_noise_rad]))


def chain(dim: int, dt: float) -> Real:
    """Transition matrix of ``dim`` integrators in a row."""
    f = np.eye(dim)
    for i in range(dim):
        for j in range(i + 1, dim):
            f[i, j] = f[i, j - 1] * dt / (j - i)
    return f


def motor_filter(noise: MotorNoise, dt: float) -> Any:
    """The Kalman filter of the motor: state angle, speed, disturbance; input acceleration."""
    kf = KalmanFilter(dim_x=3, dim_z=1, dim_u=1)
    kf.F, kf.H = chain(3, dt), np.array([[1.0, 0.0, 0.0]])
    kf.B = np.array([[0.5 * dt * dt], [dt], [0.0]])
    kf.R = np.array([[noise.angle_rad**2]])
    kf.Q = Q_continuous_white_noise(3, dt, noise.walk_rad2_s5) + np.diag([noise.angle_walk_rad2_s * dt, noise.white_rad2_s3 * dt, 0.0])
    return kf


def base_filter(noise: BaseNoise, attitude_lag_s: float, gyro_lag_s: float, dt: float) -> Any:
    """The Kalman filter of one tilt of the base: state angle, rate, acceleration; measurements attitude and gyro."""
    kf = KalmanFilter(dim_x=3, dim_z=2)
    kf.F, kf.H = chain(3, dt), innovation_matrix(attitude_lag_s, gyro_lag_s)
    kf.R = np.diag([noise.attitude_rad**2, noise.gyro_rad_s**2])
    kf.Q = Q_continuous_white_noise(3, dt, noise.jerk_rad2_s5) + np.diag([noise.walk_rad2_s * dt, 0.0, 0.0])
    return kf


def yaw_filter(noise: YawNoise, gyro_lag_s: float, dt: float) -> Any:
    """The Kalman filter of base yaw: state rate and acceleration; measurement gyro."""
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.F, kf.H = chain(2, dt), np.array([[1.0, -gyro_lag_s]])
    kf.R = np.array([[noise.gyro_rad_s**2]])
    kf.Q = Q_continuous_white_noise(2, dt, noise.jerk_rad2_s5) + np.diag([noise.walk_rad2_s3 * dt, 0.0])
    return kf


def steady_gain(kf: Any, tolerance: float = 1e-12, limit: int = 200_000) -> Real:
    """Run a filter until its gain stands still; returns the gain (states by measurements). Raises ``ArithmeticError`` where it does not."""
    before = np.zeros((kf.dim_x, kf.dim_z))
    for _ in range(limit):
        kf.predict()
        kf.update(np.zeros((kf.dim_z, 1)))
        gain = np.asarray(kf.K, dtype=float)
        if np.all(np.abs(gain - before) <= tolerance * np.abs(gain)):
            return gain
        before = gain.copy()
    raise ArithmeticError(f"the Kalman gain has not settled after {limit} steps")
