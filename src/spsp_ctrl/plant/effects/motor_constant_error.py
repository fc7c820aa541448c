"""A motor constant that is not the one of the data sheet: magnet tolerance, a hot motor."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="motor_constant_error",
    stage="drive",
    doc="Relative error of the torque constant (and of the back-EMF).",
    parameters=(Parameter("kt_error", "1", -0.5, 0.5, "relative error"),),
    hypotheses=(
        Hypothesis(
            name="motor_constant_error",
            free=(Free("kt_error", -0.4, 0.4, (-0.05, 0.05)),),
            channels=("current", "resolver"),
            regimes=("slope", "always"),
            twins=("coulomb_friction", "viscous_friction", "torque_offset"),
            source="torque = constant x current; a known added mass separates it from mass and friction",
        ),
    ),
)
