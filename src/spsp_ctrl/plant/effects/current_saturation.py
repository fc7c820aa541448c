"""A current limit below the one that is set: fold-back of a hot drive, a wrong peak setting."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="current_saturation",
    stage="drive",
    doc="Current limit below that of the model.",
    parameters=(Parameter("current_ceiling_a", "A", 0.0, 500.0, "current that the drive really gives"),),
    hypotheses=(
        Hypothesis(
            name="current_saturation",
            free=(Free("current_ceiling_a", 0.05, 20.0, (0.3, 1.0, 3.0)),),
            channels=("current", "resolver"),
            regimes=("saturation", "slope"),
            twins=("voltage_saturation",),
            source="clipping of the current command",
        ),
    ),
)
