"""Azimuth stage: commanded rate -> stepper field -> rotor -> gear with play -> torque on the azimuth axis.

The motor pulls its rotor to the field with a torque that is a sine of the tooth angle. Under too much torque the rotor slips by whole
teeth (four full steps): steps are lost as in the real motor, not by a rule.
"""

from __future__ import annotations

from math import floor, pi, sin

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.backlash import contact_force
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.effects.motor_friction import lugre
from spsp_ctrl.plant.layout import G, S
from spsp_ctrl.plant.stages.drive import clip


@stage
def microstep_angle(p: Array) -> float:
    """Motor angle of one microstep in rad."""
    return 2.0 * pi / (4.0 * p[G.az_teeth] * p[G.az_microsteps])


@stage
def azimuth_step(x: Array, p: Array, enable: float, rate_ref: float, dt: float) -> float:
    """Advance the stepper by ``dt``; returns the torque on the azimuth axis in N m."""
    gear = p[G.az_gear_ratio]
    wanted = rate_ref * gear if enable != 0.0 else 0.0
    change = p[G.az_ramp_rad_s2] * gear * dt
    rate = x[S.step_rate] + clip(wanted - x[S.step_rate], -change, change)
    x[S.step_rate] = rate
    x[S.step_angle] += rate * dt
    step = microstep_angle(p)
    field = step * floor(x[S.step_angle] / step + 0.5)

    rotor, rotor_rate = x[S.rotor_angle], x[S.rotor_rate]
    mesh = contact_force(
        rotor / gear - x[S.azimuth],
        rotor_rate / gear - x[S.azimuth_rate],
        p[G.az_gap_rad],
        p[G.az_stiffness_nm_rad],
        p[G.az_damping_nm_s],
    )
    teeth = p[G.az_teeth]
    torque = p[G.az_holding_nm] * sin(teeth * (field - rotor)) - p[G.az_detent_nm] * sin(4.0 * teeth * rotor)
    rotor_rate += dt * (torque - p[G.az_rotor_damping_nm_s] * (rotor_rate - rate) - mesh / gear) / p[G.az_rotor_inertia_kg_m2]
    x[S.rotor_rate] = rotor_rate
    x[S.rotor_angle] = rotor + dt * rotor_rate

    bristle, friction = lugre(
        x[S.azimuth_bristle],
        x[S.azimuth_rate],
        p[G.az_coulomb_nm],
        p[G.az_static_nm],
        p[G.az_stribeck_rad_s],
        p[G.az_bristle_nm_rad],
        p[G.az_bristle_damping_nm_s],
        dt,
    )
    x[S.azimuth_bristle] = bristle
    total = mesh - friction - p[G.az_viscous_nm_s] * x[S.azimuth_rate]
    stop = p[G.az_stop_rad]
    if x[S.azimuth] > stop:
        total += -p[G.az_stop_stiffness_nm_rad] * (x[S.azimuth] - stop) - p[G.az_stop_damping_nm_s] * x[S.azimuth_rate]
    elif x[S.azimuth] < -stop:
        total += -p[G.az_stop_stiffness_nm_rad] * (x[S.azimuth] + stop) - p[G.az_stop_damping_nm_s] * x[S.azimuth_rate]
    return total
