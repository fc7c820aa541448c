"""The rig file turned into the numbers that the law uses, in SI, once at start.

Slotted dataclasses, not named tuples like the messages: they are built once and read a hundred times per cycle, and a slot is
read in a tenth of the time of a named field.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, pi, radians
from typing import NamedTuple

from spsp_ctrl.config.rig import Actuator, BaseObserver, RigConfig, StabiliserTerms
from spsp_ctrl.control.base_observer import BaseGains


@dataclass(frozen=True, slots=True)
class AxisParams:
    """One actuator and its loops."""

    rad_per_count: float
    travel_per_rad_m: float
    """Rod travel per motor angle."""
    screw_per_rad: float
    """Screw angle per motor angle."""
    zero_offset_m: float
    velocity_mode: bool
    torque_to_accel: float
    """Motor acceleration per ampere, Kt/J."""
    accel_ff_a: float
    """Current per rod acceleration, A s2/m."""
    friction_a: float
    """Coulomb friction as a current; zero when the compensation is off."""
    stiction_a: float
    """What break-away adds to it."""
    stribeck_rad_s: float
    load_a_n: float
    """Current per rod force; zero when the compensation is off."""
    load_friction: float


@dataclass(frozen=True, slots=True)
class GapParams:
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


class LagStep(NamedTuple):
    """A first-order lag over one period: weights of its old output, its old input and its new input."""

    keep: float
    old: float
    new: float


def lag_step(tau_s: float, dt: float) -> LagStep:
    """Exact for an input that moves linearly over ``dt``."""
    if tau_s <= 0.0:
        return LagStep(0.0, 0.0, 1.0)
    keep = exp(-dt / tau_s)
    new = 1.0 - tau_s / dt * (1.0 - keep)
    return LagStep(keep, 1.0 - keep - new, new)


@dataclass(frozen=True, slots=True)
class WatchParams:
    """What the watch over the law needs (``control.watch``)."""

    corner_share: float
    """Share of a low-pass at the corner in one period."""
    window_share: float
    frame_share: float
    """The same at the IMU rate."""
    window_s: float
    chatter_a2: float
    divergence_rad2: float


@dataclass(frozen=True, slots=True)
class LawParams:
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
    azimuth_half_play_rad: float
    imu_period_s: float
    imu_delay_s: float
    attitude_lag_s: float
    gyro_lag_s: float
    attitude_lag: LagStep
    gyro_lag: LagStep
    base: BaseGains
    lead_s: float
    screw_rate: float
    """LMS step of the screw map per IMU frame; zero when it is off."""
    screw_speed_m_s: float
    screw_limit_m: float
    l_angle: float
    l_speed: float
    l_disturbance: float
    kp: float
    ki: float
    td: float
    rod_kp: float
    feedforward: bool
    accelerate: bool
    observe: bool
    """Rods follow the observed base tilt, instead of the attitude PID."""
    speed_kp: float
    speed_ki: float
    heading_kp: float
    heading_ki: float
    heading_feedforward: bool
    heading_corner_rad_s: float
    """Corner of the tracking filter on what the base asks of the azimuth."""
    presliding_rad: float
    """Motor travel over which its friction turns round."""
    envelope_share: float
    envelope_decay: float
    """Decay over one period of the envelope that tells motion from standstill."""
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


ENVELOPE_S = 4.0
ENVELOPE_SMOOTHING_S = 0.12

PLAIN = StabiliserTerms(base_rate=False, acceleration=False, base_observer=False, screw_map=False)
"""The paper's cascade has none of the stabiliser's terms."""


def base_gains(base: BaseObserver, attitude_lag_s: float, gyro_lag_s: float) -> BaseGains:
    """Gains of the base observer in SI."""
    attitude, gyro, adaptive = base.attitude, base.gyro, base.adaptive
    return BaseGains(
        attitude.l_angle,
        attitude.l_rate_1_s,
        attitude.l_accel_1_s2,
        gyro.l_angle_s,
        gyro.l_rate,
        gyro.l_accel_1_s,
        base.yaw.l_rate,
        base.yaw.l_accel_1_s,
        attitude_lag_s,
        gyro_lag_s,
        adaptive.enabled,
        adaptive.memory_s,
        radians(adaptive.rate_floor_deg_s),
        2.0 * pi / adaptive.period_min_s,
    )


def watch_params(config: RigConfig) -> WatchParams:
    """Thresholds squared, time constants as shares."""
    w = config.control.watch
    never = float("inf")
    return WatchParams(
        1.0 - exp(-2.0 * pi * w.corner_hz / config.rate_hz),
        1.0 - exp(-1.0 / (w.window_s * config.rate_hz)),
        1.0 - exp(-1.0 / (w.window_s * config.imu.rate_hz)),
        w.window_s,
        w.chatter_a**2 if w.enabled else never,
        radians(w.divergence_arcmin / 60.0) ** 2 if w.enabled else never,
    )


def law_ladder(config: RigConfig) -> tuple[LawParams, ...]:
    """The configured law, and the plainer ones that take over when it chatters or diverges."""
    if config.control.law == "cascade":
        return (law_params(config),)
    plain = config.model_copy(update={"control": config.control.model_copy(update={"law": "cascade"})})
    ladder = (law_params(config), law_params(plain))
    performance = config.control.stabiliser.performance
    if not performance.enabled:
        return ladder
    stiff = replace(
        ladder[0], speed_kp=performance.speed.kp_a_s_rad, speed_ki=performance.speed.ki_a_rad, rod_kp=performance.rod
    )
    return (stiff, *ladder)


def law_params(config: RigConfig) -> LawParams:
    """Collect and convert."""
    control = config.control
    gains = control.stabiliser if control.law == "stabiliser" else control.cascade
    terms = control.stabiliser.terms if control.law == "stabiliser" else PLAIN
    imu, screw = config.imu, control.screw_map
    limits, thermal, gap = config.limits, config.compensation.thermal, config.compensation.backlash
    friction = config.compensation.friction
    actuators = (config.pitch_actuator, config.roll_actuator)

    def axis(actuator: Actuator) -> AxisParams:
        travel = actuator.screw_lead_mm * 1e-3 / (2.0 * pi * actuator.gear_ratio)
        gain = actuator.torque_constant_nm_a / actuator.rotor_inertia_kg_m2
        per_nm = 1.0 / actuator.torque_constant_nm_a if friction.enabled else 0.0
        return AxisParams(
            rad_per_count=2.0 * pi / 2**actuator.resolver_bits,
            travel_per_rad_m=travel,
            screw_per_rad=1.0 / actuator.gear_ratio,
            zero_offset_m=actuator.zero_offset_um * 1e-6,
            velocity_mode=actuator.mode == "velocity",
            torque_to_accel=gain,
            accel_ff_a=1.0 / (gain * travel),
            friction_a=actuator.friction_nm * per_nm,
            stiction_a=max(0.0, actuator.static_friction_nm - actuator.friction_nm) * per_nm,
            stribeck_rad_s=actuator.stribeck_rad_s,
            load_a_n=travel * per_nm,
            load_friction=actuator.load_friction,
        )

    pitch, roll = axis(actuators[0]), axis(actuators[1])
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
        azimuth_half_play_rad=0.5e-3 * config.azimuth.play_mrad,
        imu_period_s=1.0 / config.imu.rate_hz,
        imu_delay_s=config.imu.delay_ms * 1e-3,
        attitude_lag_s=config.imu.attitude_lag_ms * 1e-3,
        gyro_lag_s=config.imu.gyro_lag_ms * 1e-3,
        attitude_lag=lag_step(imu.attitude_lag_ms * 1e-3, 1.0 / config.rate_hz),
        gyro_lag=lag_step(imu.gyro_lag_ms * 1e-3, 1.0 / config.rate_hz),
        base=base_gains(control.base, imu.attitude_lag_ms * 1e-3, imu.gyro_lag_ms * 1e-3),
        lead_s=control.base.lead_ms * 1e-3,
        screw_rate=screw.rate if terms.screw_map else 0.0,
        screw_speed_m_s=screw.speed_mm_s * 1e-3,
        screw_limit_m=screw.limit_um * 1e-6,
        l_angle=config.control.observer.l_angle,
        l_speed=config.control.observer.l_speed_1_s,
        l_disturbance=config.control.observer.l_disturbance_1_s2,
        kp=gains.attitude.kp_1_s,
        ki=gains.attitude.ki_1_s2,
        td=gains.attitude.td_s,
        rod_kp=gains.rod,
        feedforward=terms.base_rate,
        accelerate=terms.acceleration,
        observe=terms.base_observer,
        speed_kp=gains.speed.kp_a_s_rad,
        speed_ki=gains.speed.ki_a_rad,
        heading_kp=config.control.heading.kp_1_s,
        heading_ki=config.control.heading.ki_1_s2,
        heading_feedforward=config.control.heading.base_rate_feedforward,
        heading_corner_rad_s=2.0 * pi * config.control.heading.feedforward_hz,
        presliding_rad=friction.presliding_mrad * 1e-3,
        envelope_share=1.0 - exp(-1.0 / (config.rate_hz * ENVELOPE_SMOOTHING_S)),
        envelope_decay=exp(-1.0 / (config.rate_hz * ENVELOPE_S)),
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
