"""Everything that passes through one control cycle. Imports nothing of ours.

Every message is an immutable :class:`typing.NamedTuple` of floats, ints and bools (or of other messages), so that one
generic codec (``recording.schema``) can lay it out in a log and a replay can rebuild it exactly. Tuples are used rather
than frozen slotted dataclasses because they are built two to four times faster, and a cycle builds about ten of them.

Code that runs every cycle builds them with ``tuple.__new__(Class, values)``, which skips the keyword handling of a NamedTuple's own constructor
(0.13 instead of 0.33 us); the field order is then the contract, and a test holds the lengths.

Units are in the names and SI throughout. ``stamp_ns`` is the time on the control clock at which the value was valid;
``seq`` counts samples of one signal, starts at 0 and is -1 while nothing has been received yet.

Signs: ``pitch`` is the paper's theta_x, ``roll`` its theta_y (see ``mechanism.frames``).
"""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import NamedTuple


class Mode(IntEnum):
    """Operating mode of the supervisor."""

    DISARMED = 0
    HOMING = 1
    READY = 2
    ALIGNING = 3
    ACTIVE = 4
    STOPPING = 5
    FAULT = 6


class Limited(IntFlag):
    """Which limits changed a command in this cycle."""

    NONE = 0
    TRAVEL = 1
    SPEED = 2
    ACCELERATION = 4
    CURRENT = 8


class ResolverStatus(IntFlag):
    """Fault bits of a resolver-to-digital converter (AD2S1210 data sheet, fault register)."""

    OK = 0
    LOSS_OF_SIGNAL = 1
    DEGRADATION = 2
    LOSS_OF_TRACKING = 4


class ReferenceKind(IntEnum):
    """What the reference is measured against."""

    INERTIAL = 0
    """Attitude in inertial space, closed on the IMU."""
    JOINT = 1
    """Joint angles, closed on the resolvers through the kinematics ("open loop" in the paper's sense)."""


class ImuSample(NamedTuple):
    """One IMU frame. ZYX Euler angles of the IMU in the local level frame and the gyro in the IMU frame."""

    stamp_ns: int
    received_ns: int
    seq: int
    valid: bool
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    gyro_x_rad_s: float
    gyro_y_rad_s: float
    gyro_z_rad_s: float


class ResolverSample(NamedTuple):
    """One resolver frame: multi-turn position of the motor shaft in counts, and the converter's fault bits."""

    stamp_ns: int
    seq: int
    counts: int
    status: int


class DriveSample(NamedTuple):
    """One status frame of an actuator drive."""

    stamp_ns: int
    seq: int
    enabled: bool
    fault_code: int
    current_a: float
    bus_voltage_v: float


class AzimuthSample(NamedTuple):
    """One status frame of the azimuth stepper: microsteps counted by the driver (not measured) and the switches."""

    stamp_ns: int
    seq: int
    enabled: bool
    microsteps: int
    rate_microsteps_s: float
    left_switch: bool
    right_switch: bool
    home_switch: bool


class TemperatureSample(NamedTuple):
    """Slow temperatures."""

    stamp_ns: int
    seq: int
    screw_pitch_c: float
    screw_roll_c: float
    column_c: float
    frame_c: float


class BaseSample(NamedTuple):
    """Swing-table encoders. Logged, never read by the law."""

    stamp_ns: int
    seq: int
    pitch_rad: float
    roll_rad: float
    yaw_rad: float


class Measurement(NamedTuple):
    """Newest sample of each signal at one SYNC."""

    stamp_ns: int
    cycle: int
    imu: ImuSample
    resolver_pitch: ResolverSample
    resolver_roll: ResolverSample
    drive_pitch: DriveSample
    drive_roll: DriveSample
    azimuth: AzimuthSample
    temperature: TemperatureSample
    base: BaseSample


class Estimate(NamedTuple):
    """What the estimator makes of a measurement."""

    platform_pitch_rad: float
    """Attitude by the newest IMU frame, or dead-reckoned from it while coasting."""
    platform_roll_rad: float
    heading_rad: float
    platform_pitch_rate_rad_s: float
    platform_roll_rate_rad_s: float
    attitude_dt_s: float
    """Time since the previous attitude when this cycle brings a new one, else 0."""
    joint_pitch_rad: float
    joint_roll_rad: float
    azimuth_rad: float
    joint_pitch_rate_rad_s: float
    joint_roll_rate_rad_s: float
    azimuth_rate_rad_s: float
    rod_pitch_m: float
    """Travel of the pitch leg from level, load side (after backlash and thermal compensation)."""
    rod_roll_m: float
    screw_pitch_m: float
    """Travel of the nut from level: the rod and what gap and wind-up hold back of it."""
    screw_roll_m: float
    thermal_pitch_m: float
    """Elongation of the rod by Eq (13), as the compensation believes it."""
    thermal_roll_m: float
    lever_pitch_m_rad: float
    """Rod travel per angle: d l1 / d pitch."""
    lever_cross_m_rad: float
    """d l2 / d pitch."""
    lever_roll_m_rad: float
    """d l2 / d roll."""
    motor_pitch_rate_rad_s: float
    motor_roll_rate_rad_s: float
    motor_pitch_disturbance_rad_s2: float
    """Acceleration of the motor that its current does not explain: friction, load, a wrong motor constant."""
    motor_roll_disturbance_rad_s2: float
    base_pitch_rad: float
    """Tilt of the base, predicted to now (with everything that the kinematics does not know)."""
    base_roll_rad: float
    base_pitch_rate_rad_s: float
    """Euler rates and accelerations of the base, predicted to when the command of this cycle acts."""
    base_roll_rate_rad_s: float
    base_yaw_rate_rad_s: float
    base_pitch_accel_rad_s2: float
    base_roll_accel_rad_s2: float
    imu_age_s: float
    coasting: bool


class Reference(NamedTuple):
    """What the platform shall do now."""

    kind: int
    pitch_rad: float
    roll_rad: float
    heading_rad: float
    pitch_rate_rad_s: float
    roll_rate_rad_s: float
    heading_rate_rad_s: float


class AxisTerms(NamedTuple):
    """Every term of one actuator's cascade in one cycle."""

    error_rad: float
    p_rad_s: float
    i_rad_s: float
    d_rad_s: float
    ff_rad_s: float
    rod_speed_ref_m_s: float
    motor_speed_ref_rad_s: float
    speed_error_rad_s: float
    speed_p_a: float
    speed_i_a: float
    accel_ff_a: float
    friction_ff_a: float
    u_unlimited_a: float
    u_a: float
    backlash_m: float
    """Screw travel taken up by the gap, as the compensation believes it."""
    limited: int


class AzimuthTerms(NamedTuple):
    """Every term of the azimuth law in one cycle."""

    error_rad: float
    p_rad_s: float
    i_rad_s: float
    ff_rad_s: float
    rate_unlimited_rad_s: float
    rate_rad_s: float
    limited: int


class Command(NamedTuple):
    """What is sent to the drives. In torque mode a drive follows ``current_a``, in velocity mode ``speed_rad_s``."""

    stamp_ns: int
    seq: int
    enable: bool
    pitch_current_a: float
    pitch_speed_rad_s: float
    roll_current_a: float
    roll_speed_rad_s: float
    azimuth_rate_rad_s: float


class Control(NamedTuple):
    """Outcome of one cycle of the law: written to the log as one message."""

    stamp_ns: int
    cycle: int
    mode: int
    fault: int
    """Number of the first fault (``safety.faults``), 0 for none."""
    law_step: int
    """How many plainer laws have taken over: 0 is the configured one."""
    law_reason: int
    """Why the last of them did (``control.watch.Reason``)."""
    estimate: Estimate
    reference: Reference
    pitch: AxisTerms
    roll: AxisTerms
    azimuth: AzimuthTerms
    command: Command
    """What was really sent."""


class Timing(NamedTuple):
    """Wall-clock quantities of one cycle: the only message that differs between two runs with the same seed."""

    stamp_ns: int
    cycle: int
    lateness_ns: int
    skipped: int
    read_ns: int
    control_ns: int
    write_ns: int
    record_ns: int
    """Hand-over to the recorder in the previous cycle."""
    compute_ns: int
    """From the start of the cycle until its command was written."""


class Truth(NamedTuple):
    """True state of a virtual rig. ``diagnose`` never opens it."""

    stamp_ns: int
    cycle: int
    platform_pitch_rad: float
    platform_roll_rad: float
    heading_rad: float
    joint_pitch_rad: float
    joint_roll_rad: float
    azimuth_rad: float
    joint_pitch_rate_rad_s: float
    joint_roll_rate_rad_s: float
    azimuth_rate_rad_s: float
    rod_pitch_m: float
    """True rod travel from level."""
    rod_roll_m: float
    screw_pitch_m: float
    """Free travel of the nut: what the rod would do with no gap and no load."""
    screw_roll_m: float
    rod_force_pitch_n: float
    rod_force_roll_n: float
    motor_pitch_rate_rad_s: float
    motor_roll_rate_rad_s: float
    current_pitch_a: float
    current_roll_a: float
    base_pitch_rad: float
    base_roll_rad: float
    base_yaw_rad: float
    screw_pitch_c: float
    screw_roll_c: float
    lost_steps: float
    end_stop: float
    """Bits: 1 pitch leg, 2 roll leg, 4 azimuth on a hard stop."""


class OperatorRequest(NamedTuple):
    """One request on the operator channel, with the cycle time at which it was taken."""

    stamp_ns: int
    verb: str
    """``arm``, ``disarm``, ``stop``, ``reset``, ``heading``."""
    value: float
    source: str


NO_IMU = ImuSample(0, 0, -1, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_RESOLVER = ResolverSample(0, -1, 0, 0)
NO_DRIVE = DriveSample(0, -1, False, 0, 0.0, 0.0)
NO_AZIMUTH = AzimuthSample(0, -1, False, 0, 0.0, False, False, False)
NO_TEMPERATURE = TemperatureSample(0, -1, 20.0, 20.0, 20.0, 20.0)
NO_BASE = BaseSample(0, -1, 0.0, 0.0, 0.0)
NO_MEASUREMENT = Measurement(
    0, -1, NO_IMU, NO_RESOLVER, NO_RESOLVER, NO_DRIVE, NO_DRIVE, NO_AZIMUTH, NO_TEMPERATURE, NO_BASE
)
