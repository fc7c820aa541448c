"""Scale error of the IMU."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="imu_scale",
    stage="sensors",
    doc="Relative error of attitude and gyro.",
    parameters=(
        Parameter("imu_roll_scale", "1", -0.1, 0.1, "roll"),
        Parameter("imu_pitch_scale", "1", -0.1, 0.1, "pitch"),
        Parameter("gyro_scale", "1", -0.1, 0.1, "gyro, all axes"),
    ),
    per_axis=False,
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="imu_scale",
            free=(Free("imu_roll_scale", -0.05, 0.05, (-2e-3, 2e-3)), Free("imu_pitch_scale", -0.05, 0.05, (-2e-3, 2e-3))),
            channels=("imu",),
            regimes=("position",),
            twins=("lead_error", "geometric_error"),
            source="scale factor error: IEEE Std 952",
        ),
        Hypothesis(
            name="gyro_scale",
            free=(Free("gyro_scale", -0.05, 0.05, (-2e-3, 2e-3)),),
            channels=("gyro",),
            regimes=("speed",),
            source="scale factor error: IEEE Std 952",
        ),
    ),
)
