"""Geometric errors of the mechanism and zero offsets of the rods."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Parameter

ZERO_OFFSET = Effect(
    name="zero_offset",
    stage="transmission",
    doc="Rod length at motor zero differs from level: shifts the error curves as in Fig 16.",
    parameters=(Parameter("zero_offset_m", "m", -5e-3, 5e-3, "rod length error at motor zero"),),
)

EFFECT = Effect(
    name="geometric_error",
    stage="mechanism",
    doc="Height and radius errors dh, dr of Eq (11), the upper and the lower hinge radius apart.",
    parameters=(
        Parameter("dh_m", "m", -5e-3, 5e-3, "column height error"),
        Parameter("dr_upper_m", "m", -5e-3, 5e-3, "moving-platform hinge radius error"),
        Parameter("dr_lower_m", "m", -5e-3, 5e-3, "static-platform hinge radius error"),
    ),
    per_axis=False,
)
