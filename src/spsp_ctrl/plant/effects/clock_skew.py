"""A clock of the drive that runs at another rate than that of the log."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="clock_skew",
    stage="sensors",
    doc="The cycle lasts longer than the log says, by this share.",
    parameters=(Parameter("clock_skew", "1", -0.05, 0.05, "relative error of the period"),),
    per_axis=False,
    kind="axis",
    hypotheses=(
        Hypothesis(
            name="clock_skew",
            free=(Free("clock_skew", -0.05, 0.05, (-2e-3, 2e-3)),),
            channels=("resolver", "ruler"),
            regimes=("speed",),
            twins=("command_delay", "motor_constant_error"),
            source="ratio of two clocks",
        ),
    ),
)
