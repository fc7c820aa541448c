"""Drive stage: command -> current -> motor motion. The rod force comes in as a reaction."""

from __future__ import annotations

from math import exp

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.effects.cogging import cogging_torque
from spsp_ctrl.plant.effects.command_deadband import outside_deadband
from spsp_ctrl.plant.effects.command_delay import delayed, remember
from spsp_ctrl.plant.effects.drive_lag import lagged
from spsp_ctrl.plant.effects.friction_asymmetry import level_difference, viscous_difference
from spsp_ctrl.plant.effects.motor_friction import lugre
from spsp_ctrl.plant.effects.sentinel import sentinel_torque
from spsp_ctrl.plant.effects.stribeck_friction import stribeck_level
from spsp_ctrl.plant.effects.torque_ripple import ripple_torque
from spsp_ctrl.plant.effects.velocity_saturation import folded, limited_speed
from spsp_ctrl.plant.effects.voltage_saturation import lower_limit
from spsp_ctrl.plant.layout import A, X


@stage
def clip(value: float, low: float, high: float) -> float:
    """Limit ``value`` to ``low``..``high``."""
    if value < low:
        return low
    return high if value > high else value


@stage
def take_command(x: Array, xb: int, p: Array, pb: int, current: float, speed: float) -> None:
    """A new cycle begins: the drive remembers its command where a delay needs that."""
    if p[pb + A.command_delay_s] != 0.0:
        remember(x, xb + X.past_current_0, current)
        remember(x, xb + X.past_speed_0, speed)


@stage
def command_path(
    x: Array, xb: int, p: Array, pb: int, current: float, speed: float, time: float, dt: float, period: float
) -> tuple[float, float]:
    """Current and speed command as they reach the loops of the drive in the sub-step that begins ``time`` s after the cycle."""
    delay = p[pb + A.command_delay_s]
    if delay != 0.0:
        current = delayed(x, xb + X.past_current_0, time, dt, delay, period)
        speed = delayed(x, xb + X.past_speed_0, time, dt, delay, period)
    lag = p[pb + A.drive_lag_s]
    if lag != 0.0:
        current = lagged(x[xb + X.lag_current], current, lag, dt)
        speed = lagged(x[xb + X.lag_speed], speed, lag, dt)
        x[xb + X.lag_current], x[xb + X.lag_speed] = current, speed
    return current, speed


@stage
def drive_step(
    x: Array,
    xb: int,
    p: Array,
    pb: int,
    enable: float,
    velocity_mode: float,
    current_ref: float,
    speed_ref: float,
    rod_force: float,
    travel_per_rad: float,
    dt: float,
) -> float:
    """Advance one actuator's motor; returns the friction power in W.

    The current loop is first order as long as the bus can supply the voltage it asks for; beyond that the winding's own equation holds.
    """
    speed = x[xb + X.speed]
    limit = lower_limit(p[pb + A.current_limit_a], p[pb + A.current_ceiling_a])
    ceiling = p[pb + A.speed_ceiling_rad_s]
    if enable == 0.0:
        reference = 0.0
        x[xb + X.drive_integral] = 0.0
    elif velocity_mode != 0.0:
        error = limited_speed(speed_ref, ceiling) - speed
        integral = x[xb + X.drive_integral] + p[pb + A.drive_ki_a_rad] * error * dt
        integral = clip(integral, -limit, limit)
        x[xb + X.drive_integral] = integral
        reference = current_ref + p[pb + A.drive_kp_a_s_rad] * error + integral
    else:
        reference = current_ref
    reference = folded(outside_deadband(reference, p[pb + A.deadband_a]), speed, ceiling)
    reference = clip(reference, -limit, limit)
    current = x[xb + X.current]
    resistance = p[pb + A.resistance_ohm]
    inductance = p[pb + A.inductance_h]
    kt = p[pb + A.torque_constant_nm_a] * (1.0 + p[pb + A.kt_error])
    back_emf = resistance * current + kt * speed
    voltage = back_emf + inductance * (reference - current) / p[pb + A.current_lag_s]
    bus = lower_limit(p[pb + A.bus_voltage_v], p[pb + A.voltage_limit_v])
    if resistance == 0.0 or -bus <= voltage <= bus:  # an axis without winding (plant.axis) has no voltage to run out of
        new_current = reference + (current - reference) * exp(-dt / p[pb + A.current_lag_s])
    else:
        new_current = current + dt * (clip(voltage, -bus, bus) - back_emf) / inductance
    torque = kt * 0.5 * (current + new_current)
    x[xb + X.current] = new_current

    load_torque = rod_force * travel_per_rad
    added = p[pb + A.mf_load_factor] * abs(load_torque)
    added += stribeck_level(speed, p[pb + A.stribeck_excess_nm], p[pb + A.stribeck_speed_rad_s])
    added += level_difference(speed, p[pb + A.asym_coulomb_nm], p[pb + A.mf_coulomb_nm] + added)
    bristle, friction = lugre(
        x[xb + X.bristle],
        speed,
        p[pb + A.mf_coulomb_nm] + added,
        p[pb + A.mf_static_nm] + added,
        p[pb + A.mf_stribeck_rad_s],
        p[pb + A.mf_bristle_nm_rad],
        p[pb + A.mf_bristle_damping_nm_s],
        dt,
    )
    x[xb + X.bristle] = bristle
    friction += p[pb + A.mf_viscous_nm_s] * speed
    friction += viscous_difference(speed, p[pb + A.asym_viscous_nm_s], p[pb + A.mf_viscous_nm_s])
    angle = x[xb + X.angle]
    ripple = cogging_torque(angle, p[pb + A.cogging_nm], p[pb + A.cogging_order]) + p[pb + A.torque_offset_nm]
    ripple += ripple_torque(angle, p[pb + A.ripple_nm], p[pb + A.ripple_order], p[pb + A.ripple_phase_rad])
    ripple += sentinel_torque(angle / p[pb + A.gear_ratio], p[pb + A.sentinel_ripple_nm], p[pb + A.sentinel_ripple_phase_rad])
    speed += dt * (torque - ripple - friction - load_torque) / p[pb + A.rotor_inertia_kg_m2]
    x[xb + X.speed] = speed
    x[xb + X.angle] += dt * speed
    return abs(friction * speed)
