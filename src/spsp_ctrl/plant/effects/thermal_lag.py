"""A screw whose temperature sensor lags it."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="thermal_lag",
    stage="thermal",
    doc="Time by which the temperature sensor trails the screw: the screw is ahead by lag times the slope of the reading.",
    parameters=(Parameter("thermal_lag_s", "s", -600.0, 3600.0, "time constant of the sensor"),),
    per_axis=False,
    kind="axis",
    hypotheses=(
        Hypothesis(
            name="thermal_lag",
            free=(Free("thermal_lag_s", -600.0, 3600.0, (30.0, 300.0)),),
            channels=("ruler",),
            regimes=("temperature",),
            twins=("thermal_expansion",),
            along=(("screw_expansion_1_k", 11.5e-6), ("screw_length_m", 0.25)),
            source="first-order sensor, inverted on a slowly changing temperature",
        ),
    ),
)
