"""More lag of the IMU output than the model has."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="imu_lag",
    stage="sensors",
    doc="Lag of attitude and gyro beyond that of the data sheet.",
    parameters=(Parameter("imu_added_lag_s", "s", 0.0, 0.1, "time constant added to both lags"),),
    per_axis=False,
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="imu_lag",
            free=(Free("imu_added_lag_s", 0.0, 0.05, (1e-3, 5e-3)),),
            channels=("imu",),
            regimes=("speed", "slope"),
            twins=("imu_delay",),
            source="first-order output filter",
        ),
    ),
)
