"""The blocks of one axis's loops as discrete state spaces at the control rate, with named signals, and their connection.

What runs at the rate of the IMU sits between samplers and holds. A sampler here is a gain: ``n`` in the cycle that sees a frame and 0 in the
``n - 1`` others, which with ``1/n`` in the hold is the law exactly; the loop is then periodic, and ``tuning.loops`` treats it so. A gain of 1
throughout is its time-invariant approximation: sampler and hold as ``1/n (1 + z^-1 + ... + z^-(n-1))``, without the images at multiples of the
IMU rate.

Each block mirrors one function of ``spsp_ctrl.control``; nothing else in the project may rely on these copies.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.control.params import AxisParams, LagStep, LawParams
from spsp_ctrl.tuning.plant_model import AxisPlant

Matrix = NDArray[np.float64]


def block(a: Any, b: Any, c: Any, d: Any, period_s: float, inputs: Sequence[str], outputs: Sequence[str]) -> Any:
    """A discrete state space with named signals."""
    return ct.ss(np.atleast_2d(a), np.atleast_2d(b), np.atleast_2d(c), np.atleast_2d(d), period_s, inputs=list(inputs), outputs=list(outputs))


def gain(matrix: Any, period_s: float, inputs: Sequence[str], outputs: Sequence[str]) -> Any:
    """A static block."""
    d = np.atleast_2d(np.asarray(matrix, dtype=float))
    return ct.ss(np.zeros((0, 0)), np.zeros((0, d.shape[1])), np.zeros((d.shape[0], 0)), d, period_s, inputs=list(inputs), outputs=list(outputs))


def fir(taps: Sequence[float] | Matrix, period_s: float, source: str, output: str) -> Any:
    """Weighted sum of the last values: ``taps[0]`` is for the present one."""
    n = len(taps) - 1
    if n == 0:
        return gain(taps[0], period_s, [source], [output])
    return block(np.eye(n, k=-1), np.eye(n, 1), np.asarray(taps[1:])[None, :], taps[0], period_s, [source], [output])


def delay(cycles: int, period_s: float, source: str, output: str) -> Any:
    """A shift by whole cycles."""
    return fir([0.0] * cycles + [1.0], period_s, source, output)


@lru_cache(maxsize=64)
def imu(plant: AxisPlant, period_s: float) -> Any:
    """Lags of the IMU: ``angle`` and ``rate`` of the platform in space to ``attitude_now`` and ``gyro_now``.

    Sampled for inputs that are straight between the cycles, as ``plant.stages.sensors.lag_step``.
    """
    attitude, gyro = (
        ct.c2d(ct.ss(ct.tf([1.0], [max(lag, 1e-6), 1.0])), period_s, "foh") for lag in (plant.attitude_lag_s, plant.gyro_lag_s)
    )
    both = ct.append(attitude, gyro)
    return block(both.A, both.B, both.C, both.D, period_s, ["angle", "rate"], ["attitude_now", "gyro_now"])


def observer(p: LawParams, axis: AxisParams) -> Any:
    """``control.motor_observer.step``: ``resolver`` and ``current`` to ``motor_est`` and ``speed_est``. State: angle, speed, disturbance, drive."""
    t, k = p.period_s, axis.torque_to_accel
    half = 0.5 * t * t
    predict = np.array([[1.0, t, half, 0.5 * half], [0.0, 1.0, t, 0.5 * t], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    drive = np.array([[0.5 * half * k], [0.5 * t * k], [0.0], [k]])
    correct = np.array([[p.l_angle], [p.l_speed], [p.l_disturbance], [0.0]])
    left = np.eye(4) - correct @ np.array([[1.0, 0.0, 0.0, 0.0]])
    a, b = left @ predict, np.hstack((correct, left @ drive))
    return block(a, b, a[:2], b[:2], t, ["resolver", "current"], ["motor_est", "speed_est"])


def lag(step: LagStep, period_s: float, source: str, output: str) -> Any:
    """A first-order lag for inputs that are straight between the cycles (``control.params.lag_step``)."""
    a = [[step.keep, step.old], [0.0, 0.0]]
    return block(a, [[step.new], [1.0]], a[:1], step.new, period_s, [source], [output])


def innovation_matrix(attitude_lag_s: float, gyro_lag_s: float) -> Matrix:
    """What attitude and gyro show of angle, rate and acceleration: a parabola through a lag is ``angle - lag rate + lag^2 acceleration``."""
    return np.array([[1.0, -attitude_lag_s, attitude_lag_s**2], [0.0, 1.0, -gyro_lag_s]])


def base_gain(p: LawParams) -> Matrix:
    """Gains of the base observer, states by measurements."""
    g = p.base
    return np.array(
        [
            [g.angle_by_attitude, g.angle_by_gyro],
            [g.rate_by_attitude, g.rate_by_gyro],
            [g.accel_by_attitude, g.accel_by_gyro],
        ]
    )


def base_observer(p: LawParams, every: int, wait: int, sampler: float) -> Sequence[Any]:
    """``control.base_observer`` with its input and prediction in ``control.estimator``, for omega = 0.

    ``attitude_now``, ``gyro_now``, ``joint`` and ``joint_rate`` to ``base_est``, ``base_rate_est`` and ``base_accel_est`` at the present cycle
    (rate and acceleration ``lead`` ahead). The state is the estimate carried on cycle by cycle from the newest frame, so it lags by ``wait``
    cycles; a frame corrects it.
    """
    t = p.period_s
    predict = np.array([[1.0, t, 0.5 * t * t], [0.0, 1.0, t], [0.0, 0.0, 1.0]])
    correct = base_gain(p) * (sampler / every)
    a = (np.eye(3) - correct @ innovation_matrix(p.base.attitude_lag_s, p.base.gyro_lag_s)) @ predict
    ahead = wait * t
    now = np.array([[1.0, ahead, 0.5 * ahead * ahead], [0.0, 1.0, ahead + p.lead_s], [0.0, 0.0, 1.0]])
    return [
        lag(p.attitude_lag, t, "joint", "joint_lagged"),
        lag(p.gyro_lag, t, "joint_rate", "joint_rate_lagged"),
        gain([[1.0, -1.0]], t, ["attitude_now", "joint_lagged"], ["base_now"]),
        gain([[1.0, -1.0]], t, ["gyro_now", "joint_rate_lagged"], ["base_rate_now"]),
        delay(wait, t, "base_now", "base_seen"),
        delay(wait, t, "base_rate_now", "base_rate_seen"),
        block(
            a, correct, now @ a, now @ correct, t, ["base_seen", "base_rate_seen"], ["base_est", "base_rate_est", "base_accel_est"]
        ),
    ]


def attitude_pid(p: LawParams, every: int, wait: int, sampler: float) -> Sequence[Any]:
    """``control.law._attitude`` (cascade, base observer off) for a reference of zero: ``attitude_now`` and ``gyro_now`` to ``rate_pid``."""
    t = p.period_s
    hold = np.ones(every) / every
    taps = -p.kp * hold
    rate = -p.kp * p.td * hold
    if not p.feedforward:
        # difference of two attitudes instead of the gyro
        taps = np.concatenate((taps, np.zeros(every))) + np.concatenate((rate, -rate)) / (every * t)
        rate = np.zeros(1)
    # an integrator at the slow rate with its hold is one at the fast rate: T_slow / (1 - z^-n) * hold = T / (1 - z^-1)
    integral = block(1.0, 1.0, -p.ki * t, -p.ki * t, t, ["attitude_seen"], ["rate_i"])
    return [
        delay(wait, t, "attitude_now", "attitude_late"),
        delay(wait, t, "gyro_now", "gyro_late"),
        gain(np.eye(2) * sampler, t, ["attitude_late", "gyro_late"], ["attitude_seen", "gyro_seen"]),
        fir(taps, t, "attitude_seen", "rate_pd"),
        integral,
        fir(rate, t, "gyro_seen", "rate_d"),
        gain([[1.0, 1.0, 1.0]], t, ["rate_pd", "rate_i", "rate_d"], ["rate_pid"]),
    ]


def speed_pi(p: LawParams) -> Any:
    """``control.law._rod``: ``motor_ref``, ``speed_est`` and ``accel_ff`` to ``command``."""
    t = p.period_s
    b = [[1.0, -1.0, 0.0]]
    kp, ki = p.speed_kp, p.speed_ki * t
    return block(1.0, b, ki, [[kp + ki, -kp - ki, 1.0]], t, ["motor_ref", "speed_est", "accel_ff"], ["command"])


def connect(blocks: Sequence[Any], cut: Sequence[str] = ()) -> Any:
    """Join every input to the output of its name, except the inputs named in ``cut``.

    Returns the state space from all inputs (added to what the connection brings) to all outputs, with the names of the blocks. An input that no
    output feeds is an outer input.
    """
    whole = ct.append(*blocks)
    inputs = [name for b in blocks for name in b.input_labels]
    outputs = [name for b in blocks for name in b.output_labels]
    if len(set(outputs)) != len(outputs):
        raise ValueError(f"two blocks give the same signal: {sorted(o for o in outputs if outputs.count(o) > 1)}")
    joined = np.array([[float(i == o and i not in cut) for o in outputs] for i in inputs])
    period = blocks[0].dt
    inner = np.linalg.solve(np.eye(len(outputs)) - whole.D @ joined, np.hstack((whole.C, whole.D)))
    n = whole.nstates
    c, d = inner[:, :n], inner[:, n:]
    a, b = whole.A + whole.B @ joined @ c, whole.B + whole.B @ joined @ d
    numbered = [name if inputs.count(name) == 1 else f"{name}:{k}" for k, name in enumerate(inputs)]
    return ct.ss(a, b, c, d, period, inputs=numbered, outputs=outputs)
