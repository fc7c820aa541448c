"""Truth of one lead-screw axis: motor, screw with play and elasticity, carriage on a guide, sensors. SI throughout.

Position Verlet (drift, kick, drift) at ``STEPS`` steps per sample; LuGre bristles on the motor and four Maxwell-slip elements on the guide,
both advanced exactly over a step; the flank of the nut cannot pull (``force >= 0``), so it rebounds. Beside the library's effects some
small ones are always on, and kinds that no library has are there for the open-set cases.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

RATE_HZ = 500
STEPS = 80
"""40 kHz."""

NAMES = (
    # machine as designed
    "rotor_inertia", "moving_mass", "torque_constant", "resistance", "inductance", "current_lag", "current_limit", "bus_voltage",
    "lead", "gear", "stiffness", "damping", "gap", "coulomb", "static", "stribeck_speed", "viscous", "bristle", "bristle_damping",
    "load_factor", "guide_coulomb", "guide_viscous", "guide_bristle", "counts",
    # hidden or as designed: drive
    "coulomb_asymmetry", "viscous_asymmetry", "torque_offset", "ripple", "ripple_order", "ripple_phase", "cogging", "cogging_order",
    "cogging_phase", "deadband", "delay", "extra_lag", "speed_limit",
    # transmission
    "extra_compliance", "slope", "first", "first_phase", "second", "second_phase", "expansion",
    # sensors
    "temperature_lag", "temperature_offset", "zero", "abbe", "ruler_step", "ecc1", "ecc1_phase", "ecc2", "ecc2_phase", "resolver_noise",
    "resolver_step",
    "mode_hz", "mode_damping", "mode_gain", "dropout", "skew",
    # kinds outside the library
    "drag2", "cubic", "bump", "bump_at", "bump_width", "warm", "warm_time", "mode2_hz", "mode2_gain", "crosstalk", "crosstalk_hz",
    "stick", "stick_at", "stick_width", "hysteresis", "hysteresis_width", "half_ripple", "half_phase", "ruler_expansion", "ruler_time",
    # small and always on
    "tiny",
)  # fmt: skip
I: Any = namedtuple("Index", NAMES)(*range(len(NAMES)))  # noqa: E741  # numba reads the fields as literals
N = len(NAMES)


class Inputs(NamedTuple):
    """Sampled inputs of a run, one row per cycle; ``screw_c`` is the screw itself, its sensor trails it."""

    reference_m: Array
    reference_m_s: Array
    load_force_n: Array
    load_mass_kg: Array
    screw_c: Array
    ambient_c: Array


class Law(NamedTuple):
    """The known cascade of docs/log-format.md: a position loop around a speed loop."""

    kp_1_s: float
    kv_a_s_m: float
    feedforward: float
    limit_a: float
    resolver: float
    """1: feedback from the motor shaft, 0: from the ruler."""
    lead_m: float
    """Travel per motor turn and counts per turn, as the controller believes."""
    counts: float


@njit(cache=True, error_model="numpy")
def cascade(law: Array, reference: float, reference_rate: float, counts: float, ruler: float, last: float, first: bool) -> tuple[float, float]:
    """Command of one cycle, and the position it was made of."""
    position = counts / law[6] * law[5] if law[4] > 0.0 else ruler
    rate = 0.0 if first else (position - last) * 500.0
    command = law[1] * (law[0] * (reference - position) + law[2] * reference_rate - rate)
    return min(max(command, -law[3]), law[3]), position


@njit(cache=True, error_model="numpy")
def _guide(slip: Array, move: float, level: float, stiffness: float) -> float:
    """Four Maxwell-slip elements in parallel: force after ``move``."""
    total = 0.0
    for j in range(4):
        cap = level * (0.1 + 0.1 * j)  # 0.1 0.2 0.3 0.4 of the Coulomb level
        k = stiffness * (0.4 - 0.1 * j)
        force = min(max(slip[j] + k * move, -cap), cap)
        slip[j] = force
        total += force
    return total


@njit(cache=True, error_model="numpy")
def sd_per_rad(ratio: float, p: Array, turn: float) -> float:
    """Travel of the nut per motor radian: what carries the force back to the motor."""
    local = p[I.first] * np.cos(turn + p[I.first_phase]) + 2.0 * p[I.second] * np.cos(2.0 * turn + p[I.second_phase])
    return float(ratio * (1.0 + p[I.slope]) + local / p[I.gear])


@njit(cache=True, error_model="numpy")
def run(p: Array, law: Array, closed: bool, given: Array, u: Array, noise: Array, start_m: float, steps: int) -> Array:
    """Simulate; returns one row per cycle: command, current, resolver counts, ruler, load position, motor angle, bus, temperature.

    ``u`` has the columns of :class:`Inputs`, ``noise`` those of :mod:`sensing`. With ``closed`` the cascade of ``law`` makes the
    command of row k from the readings of row k, else ``given`` holds it; it acts from k to k + 1.
    """
    n = u.shape[0]
    out = np.zeros((n, 8))
    dt = (1.0 + p[I.skew]) / 500.0  # a cycle that lasts longer than the log says
    h = dt / steps
    ratio = p[I.lead] / (2.0 * np.pi * p[I.gear])  # m per rad of the motor
    theta, omega = start_m / ratio, 0.0
    x, v = start_m, 0.0
    current, lagged = 0.0, 0.0
    bristle = 0.0
    slip = np.zeros(4)
    slip2 = np.zeros(4)
    q, qd = 0.0, 0.0  # structural mode
    q2, qd2 = 0.0, 0.0  # one that no library knows
    felt = u[0, 4]
    ruler_grown = 0.0
    worked = 0.0  # seconds of motion, for the warm-up
    count_rad = 2.0 * np.pi / p[I.counts]
    command, position, voltage = 0.0, 0.0, 0.0
    pending = np.zeros(64)  # commands still on their way
    k_contact = 1.0 / (1.0 / p[I.stiffness] + p[I.extra_compliance])
    held_ruler = 0.0
    tiny = p[I.tiny]
    for k in range(n):
        t0 = k * dt
        span = dt * (1.0 + ((noise[k + 1, 6] if k + 1 < n else 0.0) - noise[k, 6]))  # from this sampling instant to the next
        h = span / steps
        mass = p[I.moving_mass] + u[k, 3]
        # the sensors at SYNC k
        reading = theta
        reading += p[I.resolver_noise] * noise[k, 1]
        reading += p[I.ecc1] * np.sin(theta + p[I.ecc1_phase]) + p[I.ecc2] * np.sin(2.0 * theta + p[I.ecc2_phase])
        reading += tiny * 1.2e-5 * np.sin(4.0 * theta + 0.3)
        if p[I.resolver_step] > 0.0:
            reading = np.round(reading / p[I.resolver_step]) * p[I.resolver_step]
        counts = np.round(reading / count_rad)
        felt += (u[k, 4] - felt) * min(1.0, dt / max(p[I.temperature_lag], dt))
        ruler = (x + q + q2) * (1.0 + p[I.abbe]) + p[I.zero] + ruler_grown + noise[k, 2]
        ruler = np.round(ruler / p[I.ruler_step]) * p[I.ruler_step]
        if noise[k, 4] < p[I.dropout] and k > 0:
            ruler = held_ruler
        held_ruler = ruler
        ambient_ripple = np.sin(2.0 * np.pi * p[I.crosstalk_hz] * t0)
        measured = current + noise[k, 0] + p[I.crosstalk] * ambient_ripple
        if closed:
            command, position = cascade(law, u[k, 0], u[k, 1], counts, ruler, position, k == 0)
        else:
            command = given[k]
        out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4], out[k, 5] = command, measured, counts, ruler, x, theta
        out[k, 6] = p[I.bus_voltage] * (1.0 - tiny * 0.002 * abs(current)) + noise[k, 3] + (0.15 * ambient_ripple if p[I.crosstalk] > 0.0 else 0.0)
        out[k, 7] = felt + p[I.temperature_offset] + noise[k, 5]
        pending[k % 64] = command
        whole = int(p[I.delay] / dt)
        part = p[I.delay] - whole * dt
        for step in range(steps):
            t = step * h
            back = k - whole - (1 if t < part else 0)
            asked = pending[back % 64] if back >= 0 else 0.0
            asked = max(asked - p[I.deadband], 0.0) + min(asked + p[I.deadband], 0.0)
            if p[I.speed_limit] > 0.0:  # a drive that limits speed takes the torque back above it
                over = abs(omega) - p[I.speed_limit]
                if over > 0.0 and asked * omega > 0.0:
                    asked *= max(0.0, 1.0 - over / (0.02 * p[I.speed_limit]))
            asked = min(max(asked, -p[I.current_limit]), p[I.current_limit])
            if p[I.extra_lag] > 0.0:
                lagged += (asked - lagged) * (1.0 - np.exp(-h / p[I.extra_lag]))
            else:
                lagged = asked
            # current loop: first order, as far as the bus reaches
            rate = (lagged - current) / p[I.current_lag]
            voltage = p[I.resistance] * current + p[I.inductance] * rate + p[I.torque_constant] * omega
            if abs(voltage) > p[I.bus_voltage]:
                voltage = p[I.bus_voltage] if voltage > 0.0 else -p[I.bus_voltage]
                rate = (voltage - p[I.resistance] * current - p[I.torque_constant] * omega) / p[I.inductance]
            current += rate * h / (1.0 + 0.5 * h / p[I.current_lag])
            # drift
            theta += 0.5 * h * omega
            x_before = x
            x += 0.5 * h * v
            if p[I.ruler_time] > 0.0:
                ruler_grown += (p[I.ruler_expansion] * (u[k, 5] - 20.0) * x - ruler_grown) * h / p[I.ruler_time]
            # screw
            turn = theta / p[I.gear]
            s = ratio * theta * (1.0 + p[I.slope]) + p[I.cubic] * (ratio * theta) ** 3 + p[I.expansion] * (u[k, 4] - 20.0)
            s += p[I.first] * np.sin(turn + p[I.first_phase]) + p[I.second] * np.sin(2.0 * turn + p[I.second_phase])
            s += tiny * 4e-8 * np.sin(3.0 * turn + 0.7)
            sd = ratio * omega * (1.0 + p[I.slope])
            d = s - x
            half = 0.5 * p[I.gap]
            push = 0.0
            if d > half:
                push = max(0.0, k_contact * (d - half) + p[I.damping] * (sd - v) * min(1.0, (d - half) / 1e-7))
            elif d < -half:
                push = min(0.0, k_contact * (d + half) + p[I.damping] * (sd - v) * min(1.0, (-half - d) / 1e-7))
            if p[I.hysteresis] > 0.0:  # slip inside the nut: stiffness that remembers
                push += _guide(slip2, (sd - v) * h, p[I.hysteresis] * p[I.hysteresis_width], p[I.hysteresis])
            # motor friction
            level = p[I.coulomb] + (p[I.static] - p[I.coulomb]) * np.exp(-((omega / p[I.stribeck_speed]) ** 2))
            level += p[I.load_factor] * abs(push) * ratio
            side = 1.0 if omega >= 0.0 else -1.0
            level += side * p[I.coulomb_asymmetry]
            where = x - p[I.bump_at]
            if p[I.bump] > 0.0:
                level += p[I.bump] * np.exp(-((where / p[I.bump_width]) ** 2))
            if p[I.warm] > 0.0:
                level *= 1.0 + p[I.warm] * np.exp(-worked / p[I.warm_time])
            level *= 1.0 + tiny * 0.003 * np.sin(120.0 * x)
            level = max(level, 1e-5)
            relax = np.exp(-p[I.bristle] * abs(omega) * h / level)
            goal = side * level / p[I.bristle]
            before = bristle
            bristle = goal + (bristle - goal) * relax if omega != 0.0 else bristle
            friction = p[I.bristle] * bristle + p[I.bristle_damping] * (bristle - before) / h
            friction += (p[I.viscous] + side * p[I.viscous_asymmetry]) * omega + p[I.drag2] * omega * abs(omega)
            torque = p[I.torque_constant] * current - friction - push * sd_per_rad(ratio, p, turn) - p[I.torque_offset]
            torque -= p[I.ripple] * np.sin(p[I.ripple_order] * theta + p[I.ripple_phase])  # against positive rotation: docs/effects.md
            torque -= p[I.cogging] * np.sin(p[I.cogging_order] * theta + p[I.cogging_phase])
            torque += p[I.half_ripple] * np.sin(0.5 * theta + p[I.half_phase])
            torque += tiny * 5e-5 * np.sin(6.0 * theta + 0.2)
            # carriage
            guide_level = p[I.guide_coulomb]
            if p[I.stick] > 0.0:
                guide_level += p[I.stick] * np.exp(-(((x - p[I.stick_at]) / p[I.stick_width]) ** 2))
            drag = _guide(slip, v * h, guide_level, p[I.guide_bristle]) + p[I.guide_viscous] * v
            accel = (push - drag - u[k, 2]) / mass
            # kick, drift
            omega += h * torque / p[I.rotor_inertia]
            v += h * accel
            if p[I.mode_gain] != 0.0:
                w = 2.0 * np.pi * p[I.mode_hz]
                qd += h * (-2.0 * p[I.mode_damping] * w * qd - w * w * q - p[I.mode_gain] * accel)
                q += h * qd
            if p[I.mode2_gain] != 0.0:
                w = 2.0 * np.pi * p[I.mode2_hz]
                qd2 += h * (-0.02 * w * qd2 - w * w * q2 - p[I.mode2_gain] * accel)
                q2 += h * qd2
            theta += 0.5 * h * omega
            x += 0.5 * h * v
            if abs(x - x_before) > 2e-7:
                worked += h
    return out
