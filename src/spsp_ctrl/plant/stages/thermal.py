"""Thermal stage: first-order temperatures of screws, column and frame."""

from __future__ import annotations

from math import exp

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_AXIS_STATE, A, G, S, U, X


@stage
def thermal_step(x: Array, p: Array, u: Array, power_pitch: float, power_roll: float, dt: float) -> None:
    """Advance all temperatures by one cycle; ``power`` is the mean friction power of each actuator in W."""
    ambient = u[U.ambient]
    for axis in range(2):
        xb = axis * N_AXIS_STATE
        pb = axis * N_AXIS_PARAMETERS
        if u[U.heater_on] != 0.0:
            x[xb + X.screw_temperature] = u[U.heater_c]
        else:
            power = power_pitch if axis == 0 else power_roll
            target = ambient + p[pb + A.screw_heat_k_w] * power
            x[xb + X.screw_temperature] = target + (x[xb + X.screw_temperature] - target) * exp(-dt / p[pb + A.screw_heat_time_s])
    x[S.column_temperature] = ambient + (x[S.column_temperature] - ambient) * exp(-dt / p[G.column_heat_time_s])
    x[S.frame_temperature] = ambient + (x[S.frame_temperature] - ambient) * exp(-dt / p[G.frame_heat_time_s])
