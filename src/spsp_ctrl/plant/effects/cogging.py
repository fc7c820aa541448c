"""Cogging: torque ripple of the unpowered motor, locked to the rotor angle."""

from __future__ import annotations

from math import sin

from spsp_ctrl.plant.effects.base import Effect, Parameter, stage

EFFECT = Effect(
    name="cogging",
    stage="drive",
    doc="Torque ripple of a fixed order of the rotor angle.",
    parameters=(
        Parameter("cogging_nm", "N m", 0.0, 1.0, "amplitude"),
        Parameter("cogging_order", "1", 0.0, 1000.0, "periods per motor turn"),
    ),
)


@stage
def cogging_torque(angle: float, amplitude: float, order: float) -> float:
    """Torque on the rotor in N m."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * sin(order * angle)
