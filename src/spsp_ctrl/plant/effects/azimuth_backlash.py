"""Play of the azimuth gear pair."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Parameter

EFFECT = Effect(
    name="azimuth_backlash",
    stage="azimuth",
    doc="Play between pinion and large gear, as angle of the large gear.",
    parameters=(Parameter("az_gap_rad", "rad", 0.0, 0.1, "total play at the platform"),),
    per_axis=False,
    kind="platform",
)
