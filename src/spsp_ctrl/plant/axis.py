"""The kernel of a single axis: one drive, screw and moving mass, from the same stage functions as the platform.

How to call it, with ``model`` from :func:`spsp_ctrl.plant.axis_model.load_axis_model`::

    p = model.parameters()                        # flat, SI; one parameter: p[model.index("gap_m")]
    u = inputs_from(log.topics["/axis"], rate_hz) # (n, N_IN): row k acts from SYNC k to SYNC k + 1
    y = model.simulate(p, u)                      # (n, N_OUT): row k is read at SYNC k, before row k of u acts
    y, states = model.trace(p, u, x0, first)      # the state at every SYNC as well
    y = model.windows(p, u, starts, at)           # multiple shooting: from starts[i] at row at[i] until at[i + 1]
    starts = model.start_states(p, u, at, motor_rad, motor_rad_s, current_a)               # the load where the motor drives it
    starts = model.start_states(p, u, at, motor_rad, motor_rad_s, current_a, load_m, load_m_s)

Columns of inputs, outputs and state are ``IN``, ``OUT`` and ``layout.X``, ``layout.Y``. Nothing here is random: noise, counts and ruler steps
are added by :mod:`spsp_ctrl.plant.axis_bench`, so a simulation is smooth in its parameters. With a cascade in the model (``loop`` of
``layout.L``) the command comes out of the simulated readings and ``IN.command_a`` is not looked at; otherwise the recorded command acts.
"""

from __future__ import annotations

from collections import namedtuple
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis_controller import MAX_SPAN, cascade_step
from spsp_ctrl.plant.compile import compiled, entry
from spsp_ctrl.plant.effects.guide_slope import ruler_error
from spsp_ctrl.plant.effects.imu_error import quantise
from spsp_ctrl.plant.effects.motor_friction import lugre
from spsp_ctrl.plant.effects.resolver_error import eccentric
from spsp_ctrl.plant.effects.sensor_dropout import is_lost
from spsp_ctrl.plant.effects.sentinel import parity_force
from spsp_ctrl.plant.effects.structural_resonance import mode_step
from spsp_ctrl.plant.layout import N_LOAD_STATE, A, L, X, Y
from spsp_ctrl.plant.stages.drive import command_path, drive_step, take_command
from spsp_ctrl.plant.stages.transmission import free_travel, rod_force, stop_force

INPUTS = (
    "enabled", "velocity_mode", "reference_m", "reference_m_s", "command_a", "command_rad_s", "load_force_n", "load_mass_kg",
    "screw_c", "screw_c_s", "ambient_c",
)  # fmt: skip
"""Input columns: those of ``messages.AxisSample``, and ``screw_c_s``, the smoothed slope of the temperature sensor in degC/s."""
OUTPUTS = ("current_a", "motor_rad", "load_m", "command_a", "motor_rad_s", "travel_m", "force_n")
"""Output columns: readings (current, resolver as angle, ruler), the command given at this SYNC, then what no sensor shows: motor speed, true travel
of the load, force in the rod (0 on a rigid axis)."""
IN: Any = namedtuple("AxisInput", INPUTS)(*range(len(INPUTS)))
OUT: Any = namedtuple("AxisOutput", OUTPUTS)(*range(len(OUTPUTS)))
N_IN, N_OUT = len(INPUTS), len(OUTPUTS)
SLOPE_S = 2.0
"""Time over which the slope of the temperature sensor is taken."""


@compiled
def axis_read(x: Array, p: Array, cycle: int, y: Array) -> None:
    """Readings at a SYNC, with the errors of the sensors that are not random."""
    angle = x[X.angle]
    reading = eccentric(
        angle, angle, p[A.res_first_rad], p[A.res_first_phase_rad], p[A.res_second_rad], p[A.res_second_phase_rad]
    )
    reading = quantise(reading, p[A.res_step_rad])
    travel = x[Y.travel]
    ruler = travel + ruler_error(travel, p[L.guide_slope], p[L.guide_curve_1_m]) + x[Y.mode]
    if not is_lost(cycle, 0, p[L.resolver_lost]):
        x[Y.held_resolver] = reading
    if not is_lost(cycle, 1, p[L.ruler_lost]):
        x[Y.held_ruler] = ruler
    y[OUT.current_a] = x[X.current]
    y[OUT.motor_rad] = x[Y.held_resolver]
    y[OUT.load_m] = x[Y.held_ruler]
    y[OUT.motor_rad_s] = x[X.speed]
    y[OUT.travel_m] = travel


@compiled
def feedback(p: Array, y: Array) -> float:
    """What the cascade reads: the ruler, or the nut by the resolver."""
    if p[L.loop] == 2.0:
        return float(y[OUT.motor_rad] / p[A.gear_ratio] * p[A.screw_lead_m] / (2.0 * pi))
    return float(y[OUT.load_m])


@compiled
def axis_command(x: Array, p: Array, u: Array, y: Array, period: float) -> float:
    """Command of this SYNC: the recorded one, or that of the cascade on the simulated reading."""
    if p[L.loop] == 0.0:
        return float(u[IN.command_a])
    position = feedback(p, y)
    span = int(p[L.rate_span])
    before = x[Y.position_1 + span - 1]
    for i in range(3, 0, -1):
        x[Y.position_1 + i] = x[Y.position_1 + i - 1]
    x[Y.position_1] = position
    return cascade_step(
        u[IN.reference_m], u[IN.reference_m_s], position, before, span * period, p[L.kp_1_s], p[L.kv], p[L.feedforward], p[L.limit]
    )


@compiled
def axis_cycle(x: Array, p: Array, u: Array, command: float, cycle: int, substeps: int, period: float) -> float:
    """Advance the axis by one cycle; returns the last rod force in N. ``p`` is changed where the load is rigid (its inertia)."""
    period *= 1.0 + p[L.clock_skew]
    dt = period / substeps
    rigid = p[L.rigid] != 0.0
    mass = p[L.moving_mass_kg] + u[IN.load_mass_kg]
    x[X.screw_temperature] = u[IN.screw_c] + p[L.thermal_lag_s] * u[IN.screw_c_s]
    guide, outer = p[L.guide_coulomb_n], u[IN.load_force_n]
    rotor = p[A.rotor_inertia_kg_m2]
    has_mode = p[L.mode_frequency_hz] != 0.0
    take_command(x, 0, p, 0, command, u[IN.command_rad_s])
    force = 0.0
    for i in range(substeps):
        current, speed = command_path(x, 0, p, 0, command, u[IN.command_rad_s], i * dt, dt, period)
        travel, gain = free_travel(x, 0, p, 0)
        rate = x[Y.rate]
        friction = p[L.guide_viscous_n_s_m] * rate + parity_force(cycle, rate, p[L.sentinel_parity_n])
        if guide != 0.0:
            x[Y.guide], part = lugre(
                x[Y.guide], rate, guide, p[L.guide_static_n], p[L.guide_stribeck_m_s], p[L.guide_bristle_n_m], p[L.guide_bristle_damping_n_s_m], dt
            )
            friction += part
        if rigid:
            p[A.rotor_inertia_kg_m2] = rotor + mass * gain * gain
            drive_step(x, 0, p, 0, u[IN.enabled], u[IN.velocity_mode], current, speed, friction + outer, gain, dt)
            after = gain * x[X.speed]
            x[Y.travel] = free_travel(x, 0, p, 0)[0]
        else:
            force = rod_force(travel, gain * x[X.speed], x[Y.travel], rate, p, 0)
            drive_step(x, 0, p, 0, u[IN.enabled], u[IN.velocity_mode], current, speed, force, gain, dt)
            after = rate + dt * (force + stop_force(x[Y.travel], rate, p, 0) - friction - outer) / mass
            x[Y.travel] += dt * after
        if has_mode:
            x[Y.mode], x[Y.mode_rate] = mode_step(
                x[Y.mode], x[Y.mode_rate], (after - rate) / dt, p[L.mode_frequency_hz], p[L.mode_damping], p[L.mode_gain], dt
            )
        x[Y.rate] = after
    p[A.rotor_inertia_kg_m2] = rotor
    return force


@entry
def axis_rollout(x: Array, p: Array, u: Array, y: Array, states: Array, first: int, substeps: int, period: float) -> None:
    """Cycles ``first`` and on; ``x`` is advanced in place. ``states`` has one row for each of ``u``, or none where nobody asks for them."""
    keep = states.shape[0] > 0
    for k in range(u.shape[0]):
        if keep:
            states[k, :] = x
        axis_read(x, p, first + k, y[k])
        command = axis_command(x, p, u[k], y[k], period)
        y[k, OUT.command_a] = command
        y[k, OUT.force_n] = axis_cycle(x, p, u[k], command, first + k, substeps, period)


@entry
def axis_windows(starts: Array, at: NDArray[np.int64], p: Array, u: Array, y: Array, substeps: int, period: float) -> None:
    """Window i from ``starts[i]`` at row ``at[i]`` until the next one, the last until the end; rows before the first are left alone."""
    none = np.zeros((0, starts.shape[1]))
    for i in range(at.shape[0]):
        end = at[i + 1] if i + 1 < at.shape[0] else u.shape[0]
        axis_rollout(starts[i].copy(), p, u[at[i] : end], y[at[i] : end], none, at[i], substeps, period)


def inputs_from(rows: NDArray[Any], rate_hz: float) -> Array:
    """Inputs of the kernel from rows of ``/axis`` (or any structured array with these fields)."""
    u = np.zeros((len(rows), N_IN))
    for name in INPUTS:
        if name != "screw_c_s":
            u[:, getattr(IN, name)] = rows[name]
    u[:, IN.screw_c_s] = temperature_slope(u[:, IN.screw_c], rate_hz)
    return u


def temperature_slope(screw_c: Array, rate_hz: float) -> Array:
    """Slope of a slow reading in 1/s: of the straight line through ``SLOPE_S`` of it, which keeps noise and steps out."""
    half = max(1, min(round(0.5 * SLOPE_S * rate_hz), (len(screw_c) - 1) // 2))
    if len(screw_c) < 3:
        return np.zeros(len(screw_c))
    before, after = 2.0 * screw_c[0] - screw_c[half:0:-1], 2.0 * screw_c[-1] - screw_c[-2 : -half - 2 : -1]
    lever = np.arange(-half, half + 1, dtype=np.float64)
    return np.asarray(np.convolve(np.concatenate([before, screw_c, after]), lever[::-1], "valid") * (rate_hz / float(lever @ lever)))


def rest_state(p: Array, u: Array, load_m: float) -> Array:
    """At rest with the load at ``load_m``, the screw on the flank that carries the outer force of row 0 of ``u``."""
    x = np.zeros(N_LOAD_STATE)
    x[X.screw_temperature] = u[0, IN.screw_c] + p[L.thermal_lag_s] * u[0, IN.screw_c_s]
    x[Y.travel] = load_m
    x[X.angle] = angle_at(x, p, load_m + wind_up(p, float(u[0, IN.load_force_n])))
    y = np.zeros(N_OUT)
    x[Y.held_resolver], x[Y.held_ruler] = x[X.angle], load_m
    axis_read(x, p, 0, y)
    x[Y.position_1 : Y.position_1 + MAX_SPAN] = feedback(p, y)
    return x


def wind_up(p: Array, force_n: float) -> float:
    """Travel in m that gap and elasticity hold back under a force in the rod."""
    if p[L.rigid] != 0.0:
        return 0.0
    stiffness = p[A.axial_stiffness_n_m] / (1.0 + p[A.axial_stiffness_n_m] * p[A.added_compliance_m_n])
    return float(force_n / stiffness + 0.5 * p[A.gap_m] * np.sign(force_n))


def angle_at(x: Array, p: Array, travel_m: float) -> float:
    """Motor angle at which the nut stands at ``travel_m``, at the screw temperature of ``x``."""
    turned = x.copy()
    for _ in range(20):
        travel, gain = free_travel(turned, 0, p, 0)
        turned[X.angle] += (travel_m - travel) / gain
    return float(turned[X.angle])


def driven_load(x: Array, p: Array, outer_n: float) -> tuple[float, float]:
    """Travel and rate of a load that follows the motor of ``x`` on the flank that drives it."""
    travel, gain = free_travel(x, 0, p, 0)
    rate = gain * x[X.speed]
    force = outer_n + p[L.guide_coulomb_n] * np.sign(rate) + p[L.guide_viscous_n_s_m] * rate
    return float(travel - wind_up(p, float(force))), float(rate)
