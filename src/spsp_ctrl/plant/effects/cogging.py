"""Cogging: torque ripple of the unpowered motor, locked to the rotor angle."""

from __future__ import annotations

from math import sin

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="cogging",
    stage="drive",
    doc="Torque ripple of a fixed order of the rotor angle.",
    parameters=(
        Parameter("cogging_nm", "N m", 0.0, 1.0, "amplitude"),
        Parameter("cogging_order", "1", 0.0, 1000.0, "periods per motor turn"),
    ),
    hypotheses=(
        Hypothesis(
            name="cogging",
            free=(Free("cogging_nm", 0.0, 0.1, (5e-4, 4e-3)), Free("cogging_order", 1.0, 144.0, (4.0, 6.0, 8.0, 12.0, 24.0))),
            channels=("current", "resolver"),
            regimes=("motor_phase", "speed"),
            twins=("torque_ripple",),
            source="slot harmonic of a permanent-magnet motor",
        ),
    ),
)


@stage
def cogging_torque(angle: float, amplitude: float, order: float) -> float:
    """Torque on the rotor in N m."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * sin(order * angle)
