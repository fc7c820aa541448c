"""Constant torque: an unbalanced load, an offset of the current sensor."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="torque_offset",
    stage="drive",
    doc="Constant torque against positive motor rotation.",
    parameters=(Parameter("torque_offset_nm", "N m", -10.0, 10.0, "torque against positive rotation"),),
    hypotheses=(
        Hypothesis(
            name="torque_offset",
            free=(Free("torque_offset_nm", -0.2, 0.2, (-2e-3, 2e-3)),),
            channels=("current", "resolver"),
            regimes=("always", "direction"),
            twins=("friction_asymmetry",),
            source="constant term of the inverse dynamic model: Janot, Gautier, Brunot, EMPS benchmark (2019)",
        ),
    ),
)
