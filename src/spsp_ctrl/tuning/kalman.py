"""The two fixed-gain observers of the law as steady-state Kalman filters, from stated noise (``filterpy``).

Both are integrator chains with a measured first state. The measurement noise and the size of the disturbances come from the plant model:

motor observer   angle, speed, disturbance acceleration at the control rate. Measured: resolver counts (uniform, one count wide) with the
                 converter's noise. The disturbance is Coulomb friction that turns round: steps of 2 Tc / J, ``reversals_s`` times a second, which has
                 the intensity of a random walk of (2 Tc / J)^2 * reversals_s. The input is a current with the reported current's noise.
base-rate filter rate and acceleration of the base at the IMU rate. Measured: gyro minus joint rate, so gyro noise and counts plus what the resolver's
                 periodic error makes of a steady joint rate. The base's acceleration is a random walk, its rate takes a white acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from spsp_ctrl.plant.layout import A, G
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning.plant_model import axis_plant

Real = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MotorNoise:
    """Noise of the motor observer."""

    angle_rad: float
    """Standard deviation of one resolver reading."""
    input_rad_s2: float
    """Standard deviation of the acceleration by the reported current, per cycle."""
    walk_rad2_s5: float
    """Spectral density of the white noise that drives the disturbance: (rad/s2)^2 per second."""


@dataclass(frozen=True, slots=True)
class BaseNoise:
    """Noise of the base-rate filter."""

    rate_rad_s: float
    """Standard deviation of one base rate seen (gyro minus joints)."""
    walk_rad2_s5: float
    """Spectral density of the white noise that drives the base's acceleration."""
    white_rad2_s3: float
    """Spectral density of the white acceleration beside it."""


def motor_noise(model: PlantModel, reversals_s: float) -> MotorNoise:
    """From a plant model (pitch actuator)."""
    p = model.parameters()
    inertia = float(p[A.rotor_inertia_kg_m2])
    step = 2.0 * pi / p[A.resolver_counts]
    return MotorNoise(
        angle_rad=float(np.hypot(step / np.sqrt(12.0), p[A.res_noise_rad])),
        input_rad_s2=float(p[A.current_noise_a] * p[A.torque_constant_nm_a]) / inertia,
        walk_rad2_s5=float((2.0 * p[A.mf_coulomb_nm] / inertia) ** 2 * reversals_s),
    )


def base_measurement_rad_s(model: PlantModel, joint_rate_rad_s: float) -> float:
    """Standard deviation of gyro minus joint rate while a joint turns with ``joint_rate_rad_s``."""
    p = model.parameters()
    plant = axis_plant(model, "pitch")
    per_joint = abs(plant.lever_m) / plant.travel_per_rad_m
    motor = per_joint * joint_rate_rad_s
    # rate of the periodic resolver error, once and twice per turn, as joint rate (rms)
    periodic = np.hypot(p[A.res_first_rad], 2.0 * p[A.res_second_rad]) * motor / np.sqrt(2.0) / per_joint
    gyro = np.hypot(p[G.gyro_noise_rad_s], p[G.gyro_step_rad_s] / np.sqrt(12.0))
    return float(np.hypot(gyro, periodic))


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
    kf.Q = Q_continuous_white_noise(3, dt, noise.walk_rad2_s5) + kf.B @ kf.B.T * noise.input_rad_s2**2
    return kf


def base_filter(noise: BaseNoise, dt: float) -> Any:
    """The Kalman filter of the base: state rate and acceleration."""
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.F, kf.H = chain(2, dt), np.array([[1.0, 0.0]])
    kf.R = np.array([[noise.rate_rad_s**2]])
    kf.Q = Q_continuous_white_noise(2, dt, noise.walk_rad2_s5) + np.diag([noise.white_rad2_s3 * dt, 0.0])
    return kf


def steady_gain(kf: Any, tolerance: float = 1e-12, limit: int = 200_000) -> Real:
    """Run a filter until its gain stands still; returns the gain. Raises ``ArithmeticError`` where it does not."""
    before = np.zeros((kf.dim_x, 1))
    for _ in range(limit):
        kf.predict()
        kf.update(np.zeros((kf.dim_z, 1)))
        gain = np.asarray(kf.K, dtype=float)
        if np.all(np.abs(gain - before) <= tolerance * np.abs(gain)):
            return gain[:, 0]
        before = gain.copy()
    raise ArithmeticError(f"the Kalman gain has not settled after {limit} steps")
