"""A ruler that does not lie in the line of the load: guide-rail slope times Abbe offset."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="guide_slope",
    stage="sensors",
    doc="Ruler reading off by a slope and a curvature over the travel; nothing else moves.",
    parameters=(
        Parameter("guide_slope", "m/m", -0.01, 0.01, "reading error per travel"),
        Parameter("guide_curve_1_m", "1/m", -0.1, 0.1, "reading error per squared travel"),
    ),
    per_axis=False,
    kind="axis",
    hypotheses=(
        Hypothesis(
            name="guide_slope",
            free=(Free("guide_slope", -5e-3, 5e-3, (-2e-4, 2e-4)), Free("guide_curve_1_m", -0.05, 0.05, (-5e-3, 5e-3))),
            channels=("ruler",),
            regimes=("position",),
            twins=("lead_error",),
            source="Abbe error: ISO 230-1, pitch and yaw of a guide times the offset of the scale",
        ),
    ),
)


@stage
def ruler_error(travel: float, slope: float, curve: float) -> float:
    """Error of the reading in m."""
    if slope == 0.0 and curve == 0.0:
        return 0.0
    return slope * travel + curve * travel * travel
