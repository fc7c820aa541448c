"""Rig file: which rig, what its controller knows about it, and the controller itself. Units are in the key names."""

from __future__ import annotations

from collections.abc import Iterator
from math import atan2, cos, degrees, hypot, radians
from typing import Literal

from pydantic import Field, model_validator

from spsp_ctrl.config.devices import BusDriver as BusDriver
from spsp_ctrl.config.devices import Driver
from spsp_ctrl.config.devices import SimulatedDriver as SimulatedDriver
from spsp_ctrl.config.scenario import Strict

RIG_SCHEMA = "spsp-ctrl/rig/1"
MECHANISM_SCHEMA = "spsp-ctrl/mechanism/1"


class Mechanism(Strict):
    """The geometry of the mechanism and its travel (Table 1 of the paper)."""

    column_height_mm: float = Field(gt=10.0, le=5000.0)
    """Height of the U joint above the static hinges."""
    moving_radius_mm: float = Field(gt=5.0, le=2000.0)
    """Hinge radius of the moving platform."""
    static_radius_mm: float | None = Field(default=None, gt=5.0, le=2000.0)
    """Hinge radius of the static platform; the same as the moving one when absent."""
    pitch_limit_deg: float = Field(gt=0.0, le=40.0)
    """Travel of the pitch joint, both ways."""
    roll_limit_deg: float = Field(gt=0.0, le=40.0)
    """Travel of the roll joint, both ways."""
    azimuth_limit_deg: float = Field(gt=0.0, le=170.0)
    """Travel of the azimuth, both ways."""
    stroke_min_mm: float = Field(lt=0.0, ge=-1000.0)
    """Rod travel from level: the end of the retraction."""
    stroke_max_mm: float = Field(gt=0.0, le=1000.0)
    """The end of the extension."""

    @model_validator(mode="after")
    def _possible(self) -> Mechanism:
        height = self.column_height_mm
        for name in ("moving_radius_mm", "static_radius_mm"):
            radius = getattr(self, name)
            if radius is not None and radius >= height:
                raise ValueError(
                    f"impossible geometry: {name} ({radius:g}) must be smaller than "
                    f"column_height_mm ({height:g}), else the rods pass through the table"
                )
        singular = degrees(atan2(height * cos(radians(self.pitch_limit_deg)), 1e3 * self.static_radius_m))
        if self.roll_limit_deg >= singular:
            raise ValueError(
                f"impossible geometry: roll_limit_deg ({self.roll_limit_deg:g}) must be smaller than {singular:.2f}, where the roll rod "
                f"cannot turn the platform any more (tan roll = column height / static radius * cos pitch, at pitch_limit_deg)"
            )
        if self.stroke_min_mm <= -1e3 * self.level_m:
            raise ValueError(
                f"impossible geometry: stroke_min_mm ({self.stroke_min_mm:g}) leaves nothing of a rod of {1e3 * self.level_m:.2f} mm at level"
            )
        return self

    @property
    def height_m(self) -> float:
        """Height of the U joint above the hinges of the static platform."""
        return self.column_height_mm * 1e-3

    @property
    def moving_radius_m(self) -> float:
        """Hinge radius of the moving platform."""
        return self.moving_radius_mm * 1e-3

    @property
    def static_radius_m(self) -> float:
        """Hinge radius of the static platform."""
        return (self.moving_radius_mm if self.static_radius_mm is None else self.static_radius_mm) * 1e-3

    @property
    def level_m(self) -> float:
        """Length of both rods at level."""
        return hypot(self.height_m, self.moving_radius_m - self.static_radius_m)

    @property
    def lengths_m(self) -> tuple[float, float, float]:
        """Height, moving and static radius: the last arguments of every function of ``mechanism.kinematics``."""
        return self.height_m, self.moving_radius_m, self.static_radius_m


class MechanismFile(Strict):
    """A mechanism alone: what the ``mechanism`` commands need of a rig file."""

    schema_: Literal["spsp-ctrl/mechanism/1"] = Field(alias="schema")
    name: str = Field(default="", max_length=60)
    mechanism: Mechanism


class Actuator(Strict):
    """One lead-screw actuator as the controller knows it (design values; the plant has its own truth)."""

    screw_lead_mm: float = Field(gt=0.1, le=50.0)
    """Travel per screw turn."""
    gear_ratio: float = Field(gt=0.1, le=1000.0)
    """Motor turns per screw turn."""
    resolver_bits: int = Field(ge=8, le=24)
    """Counts per motor turn are two to this power."""
    zero_offset_um: float = Field(default=0.0, ge=-5000.0, le=5000.0)
    """Rod length at motor zero, from a calibration."""
    mode: Literal["torque", "velocity"] = "torque"
    """``torque``: current to the drive (CST); ``velocity``: speed with torque feed-forward (CSV)."""
    torque_constant_nm_a: float = Field(gt=0.0, le=10.0)
    """Motor torque per ampere."""
    rotor_inertia_kg_m2: float = Field(gt=0.0, le=1.0)
    """Rotor and train, at the motor."""
    friction_nm: float = Field(default=0.0, ge=0.0, le=10.0)
    """Coulomb level used by the friction feed-forward."""
    static_friction_nm: float = Field(default=0.0, ge=0.0, le=10.0)
    """Break-away level; below ``friction_nm`` it is taken as equal to it."""
    stribeck_rad_s: float = Field(default=6.0, gt=0.0, le=1000.0)
    """Motor speed over which friction falls from break-away to Coulomb level."""
    load_friction: float = Field(default=0.0, ge=0.0, le=5.0)
    """Friction added per screw torque of the load: 0.35 for a ball screw, 1.3 for a trapezoidal one."""


class AzimuthDrive(Strict):
    """The azimuth stepper as the controller knows it."""

    gear_ratio: float = Field(gt=0.1, le=1000.0)
    """Motor turns per azimuth turn."""
    full_steps_per_turn: int = Field(ge=4, le=1000)
    """Full steps of the motor per turn."""
    microsteps: int = Field(ge=1, le=256)
    """Microsteps per full step."""
    rate_hz: float = Field(default=100.0, ge=1.0, le=1000.0)
    """Rate at which the stepper is served."""
    play_mrad: float = Field(default=0.0, ge=0.0, le=20.0)
    """Total play of the gear at the azimuth axis: after a reversal the platform stands still for as long."""


class ImuConfig(Strict):
    """The IMU as the controller knows it."""

    rate_hz: float = Field(ge=10.0, le=1000.0)
    """Frames per second."""
    delay_ms: float = Field(ge=0.0, le=50.0)
    """Transport delay: device stamp to arrival."""
    attitude_lag_ms: float = Field(ge=0.0, le=50.0)
    """Output filter of the attitude."""
    gyro_lag_ms: float = Field(ge=0.0, le=50.0)
    """Output filter of the gyro."""


class SpeedLoop(Strict):
    """Motor speed PI, one per actuator, designed by ``tools/design_gains.py``."""

    kp_a_s_rad: float = Field(ge=0.0, le=100.0)
    """Proportional gain."""
    ki_a_rad: float = Field(ge=0.0, le=10_000.0)
    """Integral gain."""


class Observer(Strict):
    """Fixed-gain observer of motor angle, speed and disturbance acceleration (steady-state Kalman gains)."""

    l_angle: float = Field(ge=0.0, le=1.0)
    """Correction of the angle."""
    l_speed_1_s: float = Field(ge=0.0, le=1e5)
    """Correction of the speed."""
    l_disturbance_1_s2: float = Field(ge=0.0, le=1e8)
    """Correction of the disturbance."""


class PositionLoop(Strict):
    """Attitude PID on the IMU angle to platform rate."""

    kp_1_s: float = Field(ge=0.0, le=1000.0)
    """Proportional gain."""
    ki_1_s2: float = Field(ge=0.0, le=100_000.0)
    """Integral gain."""
    td_s: float = Field(ge=0.0, le=1.0)
    """Derivative time."""


class AttitudeGains(Strict):
    """Kalman gains of the base observer on the attitude innovation (angle, rate, acceleration per angle)."""

    l_angle: float = Field(ge=0.0, le=1.0)
    l_rate_1_s: float = Field(ge=0.0, le=1e4)
    l_accel_1_s2: float = Field(ge=0.0, le=1e6)


class GyroGains(Strict):
    """Kalman gains of the base observer on the gyro innovation (angle, rate, acceleration per rate)."""

    l_angle_s: float = Field(ge=0.0, le=1.0)
    l_rate: float = Field(ge=0.0, le=1.0)
    l_accel_1_s: float = Field(ge=0.0, le=1e4)


class YawGains(Strict):
    """The same for base yaw, which has rate and acceleration only."""

    l_rate: float = Field(ge=0.0, le=1.0)
    """Correction of the rate."""
    l_accel_1_s: float = Field(ge=0.0, le=1e4)
    """Correction of the acceleration."""


class AdaptiveFrequency(Strict):
    """Learning of the swing frequency that the base observer predicts with."""

    enabled: bool = True
    """The switch; off, constant acceleration is the model."""
    memory_s: float = Field(default=4.0, ge=0.5, le=600.0)
    """Time constant of the powers of rate and acceleration that it is learnt from."""
    rate_floor_deg_s: float = Field(default=0.3, gt=0.0, le=10.0)
    """Rates (rms) below this teach nothing."""
    period_min_s: float = Field(default=1.0, ge=0.2, le=60.0)
    """Shortest swing period that is believed."""


class BaseObserver(Strict):
    """Observer of the carrier from IMU minus joints; steady-state Kalman gains at the IMU rate."""

    attitude: AttitudeGains
    """By the attitude."""
    gyro: GyroGains
    """By the gyro."""
    yaw: YawGains
    """Of base yaw, by the gyro."""
    lead_ms: float = Field(default=0.0, ge=0.0, le=100.0)
    """Prediction beyond "now": until a command acts and the motor loop has followed."""
    adaptive: AdaptiveFrequency = AdaptiveFrequency()


class ScrewMapConfig(Strict):
    """Learning of the periodic lead error from the innovations of the base observer."""

    rate: float = Field(default=0.004, ge=0.0, le=0.1)
    """LMS step per IMU frame."""
    speed_mm_s: float = Field(default=3.0, gt=0.0, le=100.0)
    """Slower than this nothing is learnt."""
    limit_um: float = Field(default=20.0, gt=0.0, le=1000.0)


class CascadeGains(Strict):
    """Gains of the position loops."""

    speed: SpeedLoop
    attitude: PositionLoop
    """Attitude loop."""
    rod: float = Field(ge=0.0, le=1000.0, alias="rod_kp_1_s")
    """Gain of the rod position loop: used when the loop is closed on the resolvers."""


class StabiliserTerms(Strict):
    """What the stabiliser adds to the plain cascade, each with its switch."""

    base_rate: bool = True
    """Feed-forward of the base rate (gyro minus joints)."""
    acceleration: bool = True
    """Feed-forward of the base acceleration as motor current."""
    base_observer: bool = True
    """Rods follow the observed tilt of the base; off: attitude PID on the IMU."""
    screw_map: bool = True
    """Learning of the periodic lead error."""


class PerformanceGains(Strict):
    """Stiffer inner loops. Only for a motor whose constant and inertia are identified to 15 %: else they chatter at the first structural mode."""

    enabled: bool = False
    """The switch."""
    speed: SpeedLoop
    """Motor speed PI."""
    rod: float = Field(ge=0.0, le=1000.0, alias="rod_kp_1_s")
    """Gain of the rod position loop."""


class StabiliserGains(CascadeGains):
    """Gains and terms of the stabiliser. The default gains hold for +-30 % of motor constant and inertia."""

    performance: PerformanceGains
    """A stiffer set for an identified motor."""
    terms: StabiliserTerms = StabiliserTerms()
    """What acts."""


class Watch(Strict):
    """When a plainer law takes over by itself: performance gains -> stabiliser -> cascade."""

    enabled: bool = True
    """The switch."""
    chatter_a: float = Field(default=0.2, gt=0.0, le=100.0)
    """Rms of a motor current above ``corner_hz``, over ``window_s``."""
    corner_hz: float = Field(default=40.0, ge=5.0, le=400.0)
    """Currents slower than this are no chatter."""
    window_s: float = Field(default=0.5, ge=0.05, le=10.0)
    """Over which both are judged."""
    divergence_arcmin: float = Field(default=20.0, gt=0.0, le=600.0)
    """Rms of the innovations of the base observer, over the same window."""


class HeadingLoop(Strict):
    """Azimuth: heading PI on the IMU, to stepper rate."""

    kp_1_s: float = Field(ge=0.0, le=100.0)
    """Proportional gain."""
    ki_1_s2: float = Field(ge=0.0, le=1000.0)
    """Integral gain."""
    base_rate_feedforward: bool = True
    """Turn against the base as the gyro feels it."""
    feedforward_hz: float = Field(default=2.0, gt=0.0, le=50.0)
    """Corner up to which it does: above, the gyro feels the azimuth axis rattle in its play."""


class ControlConfig(Strict):
    """The law."""

    law: Literal["stabiliser", "cascade"] = "stabiliser"
    """Which gain set acts: ``stabiliser`` is ours, ``cascade`` the paper's."""
    observer: Observer
    """Motor observer."""
    base: BaseObserver
    """Observer of the carrier."""
    screw_map: ScrewMapConfig = ScrewMapConfig()
    """Learning of the periodic lead error."""
    stabiliser: StabiliserGains
    """Our law."""
    cascade: CascadeGains
    """The paper's law."""
    watch: Watch = Watch()
    """When a plainer law takes over."""
    heading: HeadingLoop
    """Azimuth loop."""


class BacklashCompensation(Strict):
    """Where the nut sits in its play, from an estimate of the rod force (friction by travel, gravity by tilt), and its take-up."""

    enabled: bool = True
    """The switch."""
    gap_um: float = Field(ge=0.0, le=1000.0)
    """Total play at the rod."""
    stiffness_n_um: float = Field(gt=0.0, le=10_000.0)
    """Axial stiffness: elastic wind-up is part of the correction."""
    friction_n: float = Field(ge=0.0, le=10_000.0)
    """Friction of hinges and guide at the rod."""
    presliding_um: float = Field(gt=0.0, le=1000.0)
    """Rod travel after a reversal over which that friction turns round."""
    moving_mass_kg: float = Field(ge=0.0, le=1000.0)
    """What tilts, with its load."""
    cog_height_mm: float = Field(ge=-1000.0, le=1000.0)
    """Centre of gravity of what tilts, above the U joint."""
    cog_x_mm: float = Field(default=0.0, ge=-500.0, le=500.0)
    """Its offset towards the pitch leg."""
    cog_y_mm: float = Field(default=0.0, ge=-500.0, le=500.0)
    """Its offset towards the roll leg."""
    width_n: float = Field(default=2.0, gt=0.0, le=1000.0)
    """Rod force over which the gap is taken as crossed."""
    time_constant_ms: float = Field(default=3.5, ge=0.5, le=100.0)
    """Second-order shaping of the take-up."""


class ThermalCompensation(Strict):
    """Eq (13): elongation of the screw l0 * alpha * (T - T_ref)."""

    enabled: bool = True
    """The switch."""
    screw_length_mm: float = Field(gt=0.0, le=5000.0)
    """l0 of Eq (13)."""
    expansion_ppm_k: float = Field(ge=-100.0, le=100.0)
    """alpha of Eq (13)."""
    reference_c: float = Field(default=20.0, ge=-40.0, le=85.0)
    """Temperature at which lengths are nominal."""


class FrictionCompensation(Strict):
    """Feed-forward of the motor-side Coulomb friction by the travel of the speed reference."""

    enabled: bool = False
    """The switch."""
    presliding_mrad: float = Field(default=7.0, gt=0.0, le=1000.0)
    """Motor travel over which friction turns round after a reversal."""


class Compensation(Strict):
    """Corrections, each with its own switch."""

    backlash: BacklashCompensation
    """Play in gear and screw."""
    thermal: ThermalCompensation
    """Elongation of the screws."""
    friction: FrictionCompensation = FrictionCompensation()
    """Motor friction."""


class Limits(Strict):
    """Limits of motion that the controller keeps."""

    rod_speed_mm_s: float = Field(gt=0.0, le=1000.0)
    """Rod speed."""
    rod_accel_mm_s2: float = Field(gt=0.0, le=50_000.0)
    """Rod acceleration, also for braking before the end of the stroke."""
    current_a: float = Field(gt=0.0, le=200.0)
    """Motor current."""
    travel_margin_mm: float = Field(default=0.2, ge=0.0, le=50.0)
    """Kept free before each end of the stroke."""
    azimuth_rate_deg_s: float = Field(gt=0.0, le=720.0)
    """Azimuth rate."""
    azimuth_accel_deg_s2: float = Field(gt=0.0, le=10_000.0)
    """Azimuth acceleration."""
    align_rate_deg_s: float = Field(default=5.0, gt=0.0, le=60.0)
    """Platform rate while the platform is brought to its reference after arming."""


class SupervisorConfig(Strict):
    """When the rig may move and when it must stop."""

    auto_arm: bool = True
    """Arm as soon as the rig is ready, without an operator. On a real rig leave this off."""
    imu_timeout_ms: float = Field(default=30.0, ge=5.0, le=1000.0)
    """Age of the newest IMU frame beyond its normal age at which a coasting loop faults."""
    signal_timeout_ms: float = Field(default=5.0, ge=1.0, le=1000.0)
    """The same for resolvers and drives."""
    align_tolerance_deg: float = Field(default=0.2, gt=0.0, le=5.0)
    """Attitude error below which the platform counts as aligned."""
    align_timeout_s: float = Field(default=20.0, gt=0.0, le=600.0)
    """Time allowed for it after arming."""
    tilt_fault_deg: float = Field(default=3.0, gt=0.0, le=40.0)
    """Attitude error in ACTIVE above which the loop is considered lost."""
    stop_timeout_s: float = Field(default=2.0, gt=0.0, le=60.0)
    """Time allowed for braking."""


class RealTimeConfig(Strict):
    """What the process asks of the operating system in real time; what was granted is reported. See [real time](realtime.md)."""

    enabled: bool = True
    """Ask for it at all."""
    priority: int = Field(default=50, ge=1, le=90)
    """SCHED_FIFO priority."""
    cpu: int | None = Field(default=None, ge=0, le=1023)
    """Core to stay on; the log writer is then kept off it. Left out: any core."""
    spin_us: float = Field(default=0.0, ge=0.0, le=200.0)
    """The last so many us before a deadline the loop watches the clock instead of sleeping."""
    lock_memory: bool = True
    """Lock all memory and touch what a cycle may need."""
    cpu_dma_latency: bool = True
    """Keep the processor out of deep sleep."""
    freeze_collector: bool = True
    """No garbage collection while the loop runs."""
    on_miss: Literal["go_on", "stop"] = "go_on"
    """A cycle that could not begin within its period is left out and counted, and the last command keeps acting; then go on, or brake and disable."""
    on_log_failure: Literal["go_on", "stop"] = "go_on"
    """The log cannot be written any more (disk full, writer gone): go on without it, or brake and disable."""


class RigConfig(Strict):
    """A complete rig."""

    schema_: Literal["spsp-ctrl/rig/1"] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=60)
    """Name of the rig, for reports."""
    rate_hz: int = Field(ge=100, le=5000)
    """Control cycles per second."""
    scenario: str
    """Scenario file, relative to this file: the motion that ``run`` plays."""
    rig: Driver
    """What the rig is made of."""
    mechanism: Mechanism
    """The mechanism as the controller knows it."""
    pitch_actuator: Actuator
    """Longitudinal actuator at (+r, 0, 0)."""
    roll_actuator: Actuator
    """Transverse actuator at (0, +r, 0)."""
    azimuth: AzimuthDrive
    """Azimuth stepper."""
    imu: ImuConfig
    """Inertial unit."""
    control: ControlConfig
    """The law and its gains."""
    compensation: Compensation
    """Corrections."""
    limits: Limits
    """Limits of motion."""
    supervisor: SupervisorConfig = SupervisorConfig()
    """When it may move and when it must stop."""
    realtime: RealTimeConfig = RealTimeConfig()
    """What is asked of the operating system."""

    def misfits(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """What no single key can know: place and text of everything that does not fit."""
        if isinstance(self.rig, BusDriver):
            for place, text in self.rig.misfits():
                yield ("rig", *place), text
