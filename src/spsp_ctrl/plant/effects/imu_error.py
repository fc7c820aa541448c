"""IMU: noise and quantisation, bias and drift, misalignment, levelling error."""

from __future__ import annotations

from math import floor

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

NOISE = Effect(
    name="imu_noise",
    stage="sensors",
    doc="White noise and quantisation of attitude and gyro.",
    parameters=(
        Parameter("imu_noise_rad", "rad", 0.0, 0.1, "attitude noise, standard deviation"),
        Parameter("imu_step_rad", "rad", 0.0, 0.1, "attitude quantisation step"),
        Parameter("gyro_noise_rad_s", "rad/s", 0.0, 1.0, "gyro noise, standard deviation"),
        Parameter("gyro_step_rad_s", "rad/s", 0.0, 1.0, "gyro quantisation step"),
    ),
    per_axis=False,
    kind="platform",
)

BIAS = Effect(
    name="imu_bias",
    stage="sensors",
    doc="Constant error of attitude, heading and gyro.",
    parameters=(
        Parameter("imu_roll_bias_rad", "rad", -0.1, 0.1, "roll bias (IMU sign)"),
        Parameter("imu_pitch_bias_rad", "rad", -0.1, 0.1, "pitch bias"),
        Parameter("imu_yaw_bias_rad", "rad", -1.0, 1.0, "heading bias"),
        Parameter("gyro_bias_x_rad_s", "rad/s", -0.1, 0.1, "gyro bias"),
        Parameter("gyro_bias_y_rad_s", "rad/s", -0.1, 0.1, "gyro bias"),
        Parameter("gyro_bias_z_rad_s", "rad/s", -0.1, 0.1, "gyro bias"),
    ),
    per_axis=False,
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="imu_bias",
            free=tuple(Free(name, -0.05, 0.05, (-3e-4, 3e-4)) for name in ("imu_roll_bias_rad", "imu_pitch_bias_rad")),
            channels=("imu",),
            regimes=("always",),
            twins=("zero_offset", "imu_misalignment"),
            source="constant bias: IEEE Std 952",
        ),
        Hypothesis(
            name="gyro_bias",
            free=tuple(Free(f"gyro_bias_{c}_rad_s", -0.02, 0.02, (-1e-4, 1e-4)) for c in "xyz"),
            channels=("gyro",),
            regimes=("always",),
            source="constant bias: IEEE Std 952",
        ),
        Hypothesis(
            name="heading_bias",
            free=(Free("imu_yaw_bias_rad", -0.5, 0.5, (-1e-3, 1e-3)),),
            channels=("imu",),
            regimes=("always",),
            source="constant bias of a heading reference",
        ),
    ),
)

DRIFT = Effect(
    name="imu_drift",
    stage="sensors",
    doc="Slow wander: Gauss-Markov on roll and pitch, random walk plus constant rate on heading.",
    parameters=(
        Parameter("imu_drift_rad", "rad", 0.0, 0.1, "standard deviation of the attitude wander"),
        Parameter("imu_drift_time_s", "s", 0.0, 1e5, "its correlation time"),
        Parameter("imu_yaw_walk_rad_sqrt_s", "rad/s^0.5", 0.0, 0.1, "heading random walk"),
        Parameter("imu_yaw_drift_rad_s", "rad/s", -0.01, 0.01, "heading drift rate"),
    ),
    per_axis=False,
    kind="platform",
)

MISALIGNMENT = Effect(
    name="imu_misalignment",
    stage="sensors",
    doc="Small rotation of the IMU on the platform.",
    parameters=(
        Parameter("imu_mount_x_rad", "rad", -0.2, 0.2, "rotation about platform x"),
        Parameter("imu_mount_y_rad", "rad", -0.2, 0.2, "rotation about platform y"),
        Parameter("imu_mount_z_rad", "rad", -0.2, 0.2, "rotation about platform z"),
    ),
    per_axis=False,
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="imu_misalignment",
            free=tuple(Free(f"imu_mount_{c}_rad", -0.1, 0.1, (-1e-3, 1e-3)) for c in "xyz"),
            channels=("imu",),
            regimes=("position",),
            twins=("imu_bias", "imu_scale"),
            source="small rotation",
        ),
    ),
)

LEVELLING = Effect(
    name="imu_levelling",
    stage="sensors",
    doc="Horizontal acceleration leaks into the vertical: apparent tilt through a first-order levelling loop.",
    parameters=(Parameter("imu_levelling_time_s", "s", 0.0, 1e6, "time constant of the levelling loop"),),
    per_axis=False,
    kind="platform",
)


@stage
def quantise(value: float, step: float) -> float:
    """Round to a multiple of ``step``; zero leaves the value alone."""
    if step == 0.0:
        return value
    return step * floor(value / step + 0.5)
