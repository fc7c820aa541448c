"""IMU frames that are older than believed."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="imu_delay",
    stage="sensors",
    doc="Transport delay of the IMU beyond that of the data sheet, in whole frames and parts of one.",
    parameters=(Parameter("imu_added_delay_s", "s", 0.0, 0.1, "delay added to the transport"),),
    per_axis=False,
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="imu_delay",
            free=(Free("imu_added_delay_s", 0.0, 0.05, (1e-3, 5e-3)),),
            channels=("imu",),
            regimes=("speed", "slope"),
            twins=("imu_lag", "clock_skew"),
            source="pure delay",
        ),
    ),
)
