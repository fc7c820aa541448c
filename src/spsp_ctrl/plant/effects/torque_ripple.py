"""Torque ripple of one order of the motor turn, with its phase: screw and nut, commutation."""

from __future__ import annotations

from math import sin

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="torque_ripple",
    stage="drive",
    doc="Periodic torque of a free order (below 1: slower than the motor, as of a geared screw) and phase.",
    prefix="ripple_",
    parameters=(
        Parameter("ripple_nm", "N m", 0.0, 1.0, "amplitude"),
        Parameter("ripple_order", "1", 0.0, 1000.0, "periods per motor turn"),
        Parameter("ripple_phase_rad", "rad", -7.0, 7.0, "its phase"),
    ),
    hypotheses=(
        Hypothesis(
            name="torque_ripple",
            free=(
                Free("ripple_nm", 0.0, 0.1, (5e-4, 4e-3)),
                Free("ripple_order", 0.05, 48.0, (1.0 / 3.0, 1.0, 2.0, 4.0, 6.0, 12.0)),
                Free("ripple_phase_rad", -7.0, 7.0, (0.0, 1.57, 3.14, -1.57), nuisance=True),
            ),
            channels=("current", "resolver"),
            regimes=("motor_phase", "screw_phase"),
            twins=("resolver_eccentricity", "periodic_lead_error", "cogging"),
            source="harmonic torque: Holtz and Springob, IEEE Trans. Ind. Electron. 43 (1996)",
        ),
    ),
)


@stage
def ripple_torque(angle: float, amplitude: float, order: float, phase: float) -> float:
    """Torque in N m against positive rotation."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * sin(order * angle + phase)
