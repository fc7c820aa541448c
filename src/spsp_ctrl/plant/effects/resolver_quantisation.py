"""A coarser resolver converter than the model has."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="resolver_quantisation",
    stage="sensors",
    doc="Step of the reading, beside the counts of the converter.",
    parameters=(Parameter("res_step_rad", "rad", 0.0, 0.5, "step of the reading at the motor"),),
    hypotheses=(
        Hypothesis(
            name="resolver_quantisation",
            free=(Free("res_step_rad", 0.0, 0.2, (1.5e-3, 6e-3, 2.5e-2)),),
            channels=("resolver",),
            regimes=("speed", "motor_phase"),
            twins=("resolver_noise",),
            source="uniform quantiser",
        ),
    ),
)
