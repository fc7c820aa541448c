"""The rig file turned into the numbers that the law uses, in SI, once at start."""

from __future__ import annotations

from math import exp, pi, radians
from typing import NamedTuple

from spsp_ctrl.config.rig import Actuator, CascadeGains, RigConfig


class AxisParams(NamedTuple):
    """One actuator and its loops."""

    rad_per_count: float
    travel_per_rad_m: float
    """Rod travel per motor angle."""
    zero_offset_m: float
    velocity_mode: bool
    torque_to_accel: float
    """Motor acceleration per ampere, Kt/J."""
    friction_a: float
    """Coulomb friction as a current; zero when the compensation is off."""


class GapParams(NamedTuple):
    """Backlash compensation (``control.backlash``)."""

    half_gap_m: float
    stiffness_n_m: float
    friction_n: float
    presliding_m: float
    weight_nm: float
    """Moment of gravity per sine of tilt: mass * g * height of the centre of gravity."""
    offset_x_nm: float
    offset_y_nm: float
    width_n: float
    time_constant_s: float


class LawParams(NamedTuple):
    """Everything the estimator and the law need."""

    period_s: float
    height_m: float
    radius_m: float
    static_radius_m: float
    level_m: float
    pitch: AxisParams
    roll: AxisParams
    gap: GapParams | None
    thermal_m_k: float
    """Elongation per kelvin, l0 * alpha; zero when the compensation is off."""
    thermal_reference_c: float
    rad_per_microstep: float
    imu_period_s: float
    imu_delay_s: float
    attitude_lag_s: float
    gyro_lag_s: float
    gyro_lag_decay: float
    """Decay of that lag over one period."""
    l_angle: float
    l_speed: float
    l_disturbance: float
    kp: float
    ki: float
    td: float
    rod_kp: float
    feedforward: bool
    l_rate: float
    l_accel: float
    lead_s: float
    accel_ff_a: tuple[float, float]
    """Current per rod acceleration; zero when the feed-forward is off."""
    speed_kp: float
    speed_ki: float
    heading_kp: float
    heading_ki: float
    heading_feedforward: bool
    friction_smooth_rad_s: float
    rod_speed_m_s: float
    rod_accel_m_s2: float
    rod_min_m: float
    rod_max_m: float
    current_a: float
    azimuth_rate_rad_s: float
    azimuth_accel_rad_s2: float
    azimuth_min_rad: float
    azimuth_max_rad: float
    align_rate_rad_s: float


def law_params(config: RigConfig) -> LawParams:
    """Collect and convert."""
    gains: CascadeGains = getattr(config.control, config.control.law)
    limits, thermal, gap = config.limits, config.compensation.thermal, config.compensation.backlash
    friction = config.compensation.friction
    actuators = (config.pitch_actuator, config.roll_actuator)
    base = gains.base_rate

    def axis(actuator: Actuator) -> AxisParams:
        return AxisParams(
            rad_per_count=2.0 * pi / 2**actuator.resolver_bits,
            travel_per_rad_m=actuator.screw_lead_mm * 1e-3 / (2.0 * pi * actuator.gear_ratio),
            zero_offset_m=actuator.zero_offset_um * 1e-6,
            velocity_mode=actuator.mode == "velocity",
            torque_to_accel=actuator.torque_constant_nm_a / actuator.rotor_inertia_kg_m2,
            friction_a=actuator.friction_nm / actuator.torque_constant_nm_a if friction.enabled else 0.0,
        )

    pitch, roll = axis(actuators[0]), axis(actuators[1])
    accel = tuple(
        1.0 / (a.torque_to_accel * a.travel_per_rad_m) if gains.accel_feedforward else 0.0 for a in (pitch, roll)
    )
    margin = limits.travel_margin_mm
    gravity_n = gap.moving_mass_kg * 9.80665
    return LawParams(
        period_s=1.0 / config.rate_hz,
        height_m=config.mechanism.height_m,
        radius_m=config.mechanism.moving_radius_m,
        static_radius_m=config.mechanism.static_radius_m,
        level_m=config.mechanism.level_m,
        pitch=pitch,
        roll=roll,
        gap=GapParams(
            half_gap_m=0.5e-6 * gap.gap_um,
            stiffness_n_m=gap.stiffness_n_um * 1e6,
            friction_n=gap.friction_n,
            presliding_m=gap.presliding_um * 1e-6,
            weight_nm=gravity_n * gap.cog_height_mm * 1e-3,
            offset_x_nm=gravity_n * gap.cog_x_mm * 1e-3,
            offset_y_nm=gravity_n * gap.cog_y_mm * 1e-3,
            width_n=gap.width_n,
            time_constant_s=gap.time_constant_ms * 1e-3,
        )
        if gap.enabled
        else None,
        thermal_m_k=thermal.screw_length_mm * 1e-3 * thermal.expansion_ppm_k * 1e-6 if thermal.enabled else 0.0,
        thermal_reference_c=thermal.reference_c,
        rad_per_microstep=2.0 * pi
        / (config.azimuth.full_steps_per_turn * config.azimuth.microsteps * config.azimuth.gear_ratio),
        imu_period_s=1.0 / config.imu.rate_hz,
        imu_delay_s=config.imu.delay_ms * 1e-3,
        attitude_lag_s=config.imu.attitude_lag_ms * 1e-3,
        gyro_lag_s=config.imu.gyro_lag_ms * 1e-3,
        gyro_lag_decay=exp(-1e3 / (config.rate_hz * config.imu.gyro_lag_ms)) if config.imu.gyro_lag_ms > 0.0 else 0.0,
        l_angle=config.control.observer.l_angle,
        l_speed=config.control.observer.l_speed_1_s,
        l_disturbance=config.control.observer.l_disturbance_1_s2,
        kp=gains.attitude.kp_1_s,
        ki=gains.attitude.ki_1_s2,
        td=gains.attitude.td_s,
        rod_kp=gains.rod,
        feedforward=base is not None,
        l_rate=base.l_rate if base else 0.0,
        l_accel=base.l_accel_1_s if base else 0.0,
        lead_s=base.lead_ms * 1e-3 if base else 0.0,
        accel_ff_a=(accel[0], accel[1]),
        speed_kp=config.control.speed.kp_a_s_rad,
        speed_ki=config.control.speed.ki_a_rad,
        heading_kp=config.control.heading.kp_1_s,
        heading_ki=config.control.heading.ki_1_s2,
        heading_feedforward=config.control.heading.base_rate_feedforward,
        friction_smooth_rad_s=friction.smooth_rad_s,
        rod_speed_m_s=limits.rod_speed_mm_s * 1e-3,
        rod_accel_m_s2=limits.rod_accel_mm_s2 * 1e-3,
        rod_min_m=(config.mechanism.stroke_min_mm + margin) * 1e-3,
        rod_max_m=(config.mechanism.stroke_max_mm - margin) * 1e-3,
        current_a=limits.current_a,
        azimuth_rate_rad_s=radians(limits.azimuth_rate_deg_s),
        azimuth_accel_rad_s2=radians(limits.azimuth_accel_deg_s2),
        azimuth_min_rad=-radians(config.mechanism.azimuth_limit_deg),
        azimuth_max_rad=radians(config.mechanism.azimuth_limit_deg),
        align_rate_rad_s=radians(limits.align_rate_deg_s),
    )
