"""The scalar observers of the loop against filterpy's filters with the same noise, and the gains against python-control."""

from __future__ import annotations

from math import pi

import control as ct
import numpy as np
import pytest

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.control import backlash, estimator, motor_observer
from spsp_ctrl.control.params import law_params
from spsp_ctrl.messages import NO_MEASUREMENT, ImuSample, Measurement
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning import kalman
from spsp_ctrl.tuning.design import DesignSpec

SPEC = DesignSpec()


def base_noise(model: PlantModel) -> kalman.BaseNoise:
    white = 1e-6
    seen = kalman.base_measurement_rad_s(model, SPEC.joint_rate_rad_s)
    return kalman.BaseNoise(seen, white * (2.0 * pi * SPEC.base_corner_hz) ** 2, white)


def test_noise_of_the_motor_comes_from_the_model_file(model: PlantModel) -> None:
    noise = kalman.motor_noise(model, 0.5)
    assert noise.angle_rad == pytest.approx(np.hypot(2.0 * pi / 2**14 / 12**0.5, np.radians(0.3 / 60.0)))
    assert noise.input_rad_s2 == pytest.approx(5e-3 * 0.05 / 2e-5)
    assert noise.walk_rad2_s5 == pytest.approx((2.0 * 0.010 / 2e-5) ** 2 * 0.5)


def test_steady_gains_are_those_of_the_riccati_equation(model: PlantModel) -> None:
    for kf in (kalman.motor_filter(kalman.motor_noise(model, 0.5), 1e-3), kalman.base_filter(base_noise(model), 5e-3)):
        gain = kalman.steady_gain(kf)
        _, p, _ = ct.dlqe(kf.F, np.eye(kf.dim_x), kf.H, kf.Q, kf.R)
        expected = (p @ kf.H.T / (kf.H @ p @ kf.H.T + kf.R))[:, 0]
        assert gain == pytest.approx(expected, rel=1e-6)


def test_motor_observer_is_filterpys_filter(model: PlantModel) -> None:
    """Same data, from rest; after the filter's gain has settled both estimates run together."""
    dt = 1e-3
    kf = kalman.motor_filter(kalman.motor_noise(model, 0.5), dt)
    gain = [float(k) for k in kalman.steady_gain(kf)]
    rng = np.random.default_rng(3)
    state = motor_observer.start(0.0)
    kf.x = np.zeros((3, 1))
    worst, size, before, speed, angle = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(4000):
        drive = 400.0 * np.sin(2.0 * pi * 1.3 * k * dt) + 12.5 * rng.standard_normal()
        friction = -300.0 * np.tanh(speed)
        accel = 0.5 * (before + drive) + friction
        angle, speed = angle + dt * (speed + 0.5 * dt * accel), speed + dt * accel
        reading = angle + 1.4e-4 * rng.standard_normal()
        kf.predict(u=np.array([[0.5 * (before + drive)]]))
        kf.update(np.array([[reading]]))
        state = motor_observer.step(state, reading, float(drive), dt, *gain)
        before = drive
        if k > 3000:
            got = np.array([state.angle, state.speed, state.disturbance])
            worst = max(worst, float(np.max(np.abs(got - kf.x[:, 0]) / np.maximum(1.0, np.abs(kf.x[:, 0])))))
            size = max(size, abs(state.disturbance))
    assert worst < 1e-9
    assert size > 100.0


def test_base_rate_filter_is_filterpys_filter(rig: RigConfig, model: PlantModel) -> None:
    """The estimator itself on gyro frames with joints at rest: base rate and acceleration of filterpy's filter on the same frames."""
    p = law_params(rig)
    kf = kalman.base_filter(base_noise(model), p.imu_period_s)
    gain = [float(k) for k in kalman.steady_gain(kf)]
    p = p._replace(l_rate=gain[0], l_accel=gain[1])
    rng = np.random.default_rng(4)
    state = estimator.start(NO_MEASUREMENT, p)
    every, wait = round(p.imu_period_s / p.period_s), round(p.imu_delay_s / p.period_s)
    frames: list[float] = []
    worst, size = 0.0, 0.0
    for k in range(20_000):
        now_ns = k * 1_000_000
        seq = (k - wait) // every
        if seq >= 0:
            if seq == len(frames):
                frames.append(0.2 * float(np.sin(2.0 * pi * 0.5 * seq * p.imu_period_s)) + 4e-4 * float(rng.standard_normal()))
                if seq == 0:
                    kf.x = np.array([[frames[0]], [0.0]])
                else:
                    kf.predict()
                    kf.update(np.array([[frames[-1]]]))
            imu = ImuSample(seq * every * 1_000_000, now_ns, seq, True, 0.0, 0.0, 0.0, frames[seq], 0.0, 0.0)
        else:
            imu = NO_MEASUREMENT.imu
        m: Measurement = NO_MEASUREMENT._replace(imu=imu)
        _, state = estimator.step(state, p, m, backlash.START, backlash.START, now_ns, p.period_s)
        if k > 15_000:
            got = np.array([state.base_rate[0], state.base_accel[0]])
            worst = max(worst, float(np.max(np.abs(got - kf.x[:, 0]))))
            size = max(size, abs(got[1]))
    assert worst < 1e-9
    assert size > 0.3


def test_gain_of_a_filter_without_an_end_is_refused() -> None:
    kf = kalman.base_filter(kalman.BaseNoise(1.0, 1e-12, 1e-12), 5e-3)
    with pytest.raises(ArithmeticError, match="not settled after 10"):
        kalman.steady_gain(kf, limit=10)


def test_random_walk_of_two_states_has_kalatas_gains() -> None:
    """An acceleration that is a random walk sampled as steps: alpha-beta filter, beta = 2 (2 - alpha) - 4 sqrt(1 - alpha) (Kalata, 1984), nearly."""
    dt = 5e-3
    alpha, beta_over_dt = kalman.steady_gain(kalman.base_filter(kalman.BaseNoise(1e-3, 1e-2, 0.0), dt))
    assert beta_over_dt * dt == pytest.approx(2.0 * (2.0 - alpha) - 4.0 * (1.0 - alpha) ** 0.5, rel=0.1)
