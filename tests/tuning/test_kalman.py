"""The scalar observers of the loop against filterpy's filters with the same noise, and the gains against python-control."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import control as ct
import numpy as np
import pytest

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.control import backlash, base_observer, estimator, motor_observer
from spsp_ctrl.control.base_observer import BaseGains, BaseSeen
from spsp_ctrl.control.params import law_params
from spsp_ctrl.messages import NO_MEASUREMENT, ImuSample, Measurement
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning import kalman
from spsp_ctrl.tuning.design import DesignSpec, base_noise, motor_noise, yaw_noise

SPEC = DesignSpec()


def motor(model: PlantModel) -> Any:
    return kalman.motor_filter(motor_noise(model, SPEC), 1e-3)


def base(rig: RigConfig) -> Any:
    p = law_params(rig)
    return kalman.base_filter(base_noise(SPEC), p.attitude_lag_s, p.gyro_lag_s, p.imu_period_s)


def yaw(rig: RigConfig) -> Any:
    p = law_params(rig)
    return kalman.yaw_filter(yaw_noise(SPEC), p.gyro_lag_s, p.imu_period_s)


def test_resolver_noise_comes_from_the_model_file(model: PlantModel) -> None:
    assert kalman.resolver_noise_rad(model) == pytest.approx(np.hypot(2.0 * pi / 2**14 / 12**0.5, np.radians(0.3 / 60.0)))


def test_steady_gains_are_those_of_the_riccati_equation(rig: RigConfig, model: PlantModel) -> None:
    for kf in (motor(model), base(rig), yaw(rig)):
        gain = kalman.steady_gain(kf)
        _, p, _ = ct.dlqe(kf.F, np.eye(kf.dim_x), kf.H, kf.Q, kf.R)
        expected = p @ kf.H.T @ np.linalg.inv(kf.H @ p @ kf.H.T + kf.R)
        assert gain == pytest.approx(expected, rel=1e-6)


def test_gains_of_the_rig_file_are_those_of_the_stated_noise(rig: RigConfig, model: PlantModel) -> None:
    control = rig.control
    assert kalman.steady_gain(motor(model))[:, 0] == pytest.approx(list(control.observer.model_dump().values()), rel=0.01)
    found = kalman.steady_gain(base(rig))
    assert found[:, 0] == pytest.approx(list(control.base.attitude.model_dump().values()), rel=2e-3)
    assert found[:, 1] == pytest.approx(list(control.base.gyro.model_dump().values()), rel=2e-3)
    assert kalman.steady_gain(yaw(rig))[:, 0] == pytest.approx(list(control.base.yaw.model_dump().values()), rel=0.01)


def test_motor_observer_is_filterpys_filter(model: PlantModel) -> None:
    """Same data, from rest; after the filter's gain has settled both estimates run together."""
    dt = 1e-3
    kf = kalman.motor_filter(motor_noise(model, SPEC), dt)
    gain = [float(k) for k in kalman.steady_gain(kf)[:, 0]]
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


def gains_of(rig: RigConfig) -> BaseGains:
    """Of the stated noise, unrounded, without the learning of omega."""
    by, turn = kalman.steady_gain(base(rig)), kalman.steady_gain(yaw(rig))[:, 0]
    p = law_params(rig).base
    return BaseGains(*by[:, 0], *by[:, 1], *turn, p.attitude_lag_s, p.gyro_lag_s, False, 4.0, 1.0, 1.0)


def carrier(t: float) -> BaseSeen:
    """Tilts and rates of a carrier that swings in pitch, rolls at another period and turns."""
    w, v = 2.0 * pi / 3.0, 2.0 * pi / 5.0
    return BaseSeen(
        0.17 * np.sin(w * t), -0.1 * np.cos(v * t), 0.17 * w * np.cos(w * t), 0.1 * v * np.sin(v * t), 0.2 * np.sin(0.7 * t)
    )


def test_base_observer_is_filterpys_filter(rig: RigConfig) -> None:
    """Both tilts and yaw: the scalar observer and filterpy's filters on the same noisy frames, from the same start."""
    g, dt = gains_of(rig), law_params(rig).imu_period_s
    filters = {"pitch": base(rig), "roll": base(rig), "yaw": yaw(rig)}
    for kf in filters.values():
        kalman.steady_gain(kf)
    rng = np.random.default_rng(4)
    state, worst, size = base_observer.START, 0.0, 0.0
    for k in range(4000):
        seen = BaseSeen(*(float(v) for v in np.array(carrier(k * dt)) + rng.standard_normal(5) * [3e-5, 3e-5, 1e-3, 1e-3, 1e-3]))
        if k == 0:
            state = base_observer.start(seen)
            filters["pitch"].x = np.array([[seen.pitch], [seen.pitch_rate], [0.0]])
            filters["roll"].x = np.array([[seen.roll], [seen.roll_rate], [0.0]])
            filters["yaw"].x = np.array([[seen.yaw_rate], [0.0]])
            continue
        state = base_observer.update(state, g, seen, dt)
        for name, z in (("pitch", (seen.pitch, seen.pitch_rate)), ("roll", (seen.roll, seen.roll_rate)), ("yaw", (seen.yaw_rate,))):
            filters[name].predict()
            filters[name].update(np.array(z)[:, None])
        got = {"pitch": state[0:3], "roll": state[3:6], "yaw": state[6:8]}
        worst = max(worst, *(float(np.max(np.abs(np.array(got[n]) - filters[n].x[:, 0]))) for n in filters))
        size = max(size, abs(state.pitch_accel))
    assert worst < 1e-9
    assert size > 0.5


def test_estimator_feeds_the_base_observer_with_frames_taken_back_through_the_joints(rig: RigConfig) -> None:
    """Joints at rest at level: base tilt is the attitude, and filterpy's filter on the frames has the estimator's state."""
    p = replace(law_params(rig), base=gains_of(rig), screw_rate=0.0, thermal_m_k=0.0)
    p = replace(p, pitch=replace(p.pitch, zero_offset_m=0.0), roll=replace(p.roll, zero_offset_m=0.0))
    kf = base(rig)
    kalman.steady_gain(kf)
    rng = np.random.default_rng(5)
    state = estimator.start(NO_MEASUREMENT, p)
    every, wait = round(p.imu_period_s / p.period_s), round(p.imu_delay_s / p.period_s)
    frames: list[tuple[float, float]] = []
    worst, size = 0.0, 0.0
    for k in range(4000):
        now_ns = k * 1_000_000
        seq = (k - wait) // every
        imu = NO_MEASUREMENT.imu
        if seq >= 0:
            if seq == len(frames):
                seen = carrier(seq * p.imu_period_s)
                frames.append((float(seen.pitch + 3e-5 * rng.standard_normal()), float(seen.pitch_rate + 1e-3 * rng.standard_normal())))
                if seq == 0:
                    kf.x = np.array([[frames[0][0]], [frames[0][1]], [0.0]])
                else:
                    kf.predict()
                    kf.update(np.array(frames[-1])[:, None])
            angle, rate = frames[seq]
            imu = ImuSample(seq * every * 1_000_000, now_ns, seq, True, 0.0, angle, 0.0, 0.0, rate, 0.0)
        m: Measurement = NO_MEASUREMENT._replace(imu=imu)
        _, state = estimator.step(state, p, m, backlash.START, backlash.START, now_ns, p.period_s)
        if seq >= 0:
            worst = max(worst, float(np.max(np.abs(np.array(state.base[0:3]) - kf.x[:, 0]))))
            size = max(size, abs(state.base.pitch_accel))
    assert worst < 1e-9
    assert size > 0.5


def test_gain_of_a_filter_without_an_end_is_refused(rig: RigConfig) -> None:
    with pytest.raises(ArithmeticError, match="not settled after 10"):
        kalman.steady_gain(base(rig), limit=10)


def test_random_walk_of_two_states_has_kalatas_gains() -> None:
    """An acceleration that is a random walk sampled as steps: alpha-beta filter, beta = 2 (2 - alpha) - 4 sqrt(1 - alpha) (Kalata, 1984), nearly."""
    dt = 5e-3
    alpha, beta_over_dt = kalman.steady_gain(kalman.yaw_filter(kalman.YawNoise(1e-3, 1e-2, 0.0), 0.0, dt))[:, 0]
    assert beta_over_dt * dt == pytest.approx(2.0 * (2.0 - alpha) - 4.0 * (1.0 - alpha) ** 0.5, rel=0.1)
