"""Geometric errors of the mechanism and zero offsets of the rods."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

ZERO_OFFSET = Effect(
    name="zero_offset",
    stage="transmission",
    doc="Rod length at motor zero differs from level: shifts the error curves as in Fig 16.",
    parameters=(Parameter("zero_offset_m", "m", -5e-3, 5e-3, "rod length error at motor zero"),),
    hypotheses=(
        Hypothesis(
            name="zero_offset",
            free=(Free("zero_offset_m", -2e-3, 2e-3, (-1e-5, 1e-5)),),
            channels=("ruler", "imu"),
            regimes=("always",),
            twins=("thermal_expansion", "imu_bias"),
            source="constant difference of two zeros",
        ),
    ),
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
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="geometric_error",
            free=tuple(Free(name, -2e-3, 2e-3, (-5e-5, 5e-5)) for name in ("dh_m", "dr_upper_m", "dr_lower_m")),
            channels=("imu",),
            regimes=("position",),
            twins=("lead_error", "imu_scale", "zero_offset"),
            source="Eq (11) of the paper",
        ),
    ),
)
