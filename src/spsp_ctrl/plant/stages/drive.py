"""Drive stage: command -> current -> motor motion. The rod force comes in as a reaction."""

from __future__ import annotations

from math import exp

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.effects.cogging import cogging_torque
from spsp_ctrl.plant.effects.motor_friction import lugre
from spsp_ctrl.plant.layout import A, X


@stage
def clip(value: float, low: float, high: float) -> float:
    """Limit ``value`` to ``low``..``high``."""
    if value < low:
        return low
    return high if value > high else value


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
    limit = p[pb + A.current_limit_a]
    if enable == 0.0:
        reference = 0.0
        x[xb + X.drive_integral] = 0.0
    elif velocity_mode != 0.0:
        error = speed_ref - speed
        integral = x[xb + X.drive_integral] + p[pb + A.drive_ki_a_rad] * error * dt
        integral = clip(integral, -limit, limit)
        x[xb + X.drive_integral] = integral
        reference = current_ref + p[pb + A.drive_kp_a_s_rad] * error + integral
    else:
        reference = current_ref
    reference = clip(reference, -limit, limit)
    current = x[xb + X.current]
    resistance = p[pb + A.resistance_ohm]
    inductance = p[pb + A.inductance_h]
    kt = p[pb + A.torque_constant_nm_a]
    back_emf = resistance * current + kt * speed
    voltage = back_emf + inductance * (reference - current) / p[pb + A.current_lag_s]
    bus = p[pb + A.bus_voltage_v]
    if -bus <= voltage <= bus:
        new_current = reference + (current - reference) * exp(-dt / p[pb + A.current_lag_s])
    else:
        new_current = current + dt * (clip(voltage, -bus, bus) - back_emf) / inductance
    torque = kt * 0.5 * (current + new_current)
    x[xb + X.current] = new_current

    load_torque = rod_force * travel_per_rad
    added = p[pb + A.mf_load_factor] * abs(load_torque)
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
    cogging = cogging_torque(x[xb + X.angle], p[pb + A.cogging_nm], p[pb + A.cogging_order])
    speed += dt * (torque - cogging - friction - load_torque) / p[pb + A.rotor_inertia_kg_m2]
    x[xb + X.speed] = speed
    x[xb + X.angle] += dt * speed
    return abs(friction * speed)
