"""Play of the azimuth gear pair."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="azimuth_backlash",
    stage="azimuth",
    doc="Play between pinion and large gear, as angle of the large gear.",
    parameters=(Parameter("az_gap_rad", "rad", 0.0, 0.1, "total play at the platform"),),
    per_axis=False,
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="azimuth_backlash",
            free=(Free("az_gap_rad", 0.0, 0.02, (2e-4, 1e-3)),),
            channels=("imu",),
            regimes=("reversal",),
            twins=("azimuth_friction",),
            source="play between two flanks",
        ),
    ),
)
