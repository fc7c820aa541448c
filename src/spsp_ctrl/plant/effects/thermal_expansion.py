"""Thermal expansion of the screw, Eq (13): length times coefficient times temperature rise."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="thermal_expansion",
    stage="transmission",
    doc="Elongation of the screw over its length l0, Eq (13) of the paper, from a screw temperature that lags its heating.",
    parameters=(
        Parameter("screw_expansion_1_k", "1/K", -1e-4, 1e-4, "expansion coefficient of the screw"),
        Parameter("screw_length_m", "m", 0.0, 5.0, "length l0 that expands"),
    ),
    hypotheses=(
        Hypothesis(
            name="thermal_expansion",
            free=(Free("screw_expansion_1_k", -1e-4, 1e-4, (5e-6, 1.2e-5, 3e-5)),),
            channels=("ruler", "imu"),
            regimes=("temperature",),
            twins=("zero_offset", "lead_error"),
            along=(("screw_length_m", 0.25),),
            source="Eq (13) of the paper",
        ),
    ),
)


@stage
def elongation(temperature: float, reference: float, coefficient: float, length: float) -> float:
    """Elongation in m."""
    if coefficient == 0.0:
        return 0.0
    return coefficient * length * (temperature - reference)
