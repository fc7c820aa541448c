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
    """When the frame arrived, on the control clock."""
    seq: int
    valid: bool
    """The unit's own validity flag."""
    roll_rad: float
    """Roll of the IMU, right-handed about its x axis (the opposite sign of ``platform_roll_rad``)."""
    pitch_rad: float
    """Pitch of the IMU."""
    yaw_rad: float
    """Heading of the IMU."""
    gyro_x_rad_s: float
    """Angular velocity about the IMU's x axis."""
    gyro_y_rad_s: float
    """The same about y."""
    gyro_z_rad_s: float
    """The same about z."""


class ResolverSample(NamedTuple):
    """One resolver frame: multi-turn position of the motor shaft in counts, and the converter's fault bits."""

    stamp_ns: int
    seq: int
    counts: int
    """Position of the motor shaft, multi-turn."""
    status: int
    """Fault bits of the converter, see ``ResolverStatus``; 0 is good."""


class DriveSample(NamedTuple):
    """One status frame of an actuator drive."""

    stamp_ns: int
    seq: int
    enabled: bool
    """The power stage is on."""
    fault_code: int
    """Error code of the drive, 0 for none."""
    current_a: float
    """Measured motor current."""
    bus_voltage_v: float
    """Supply voltage at the drive."""


class AzimuthSample(NamedTuple):
    """One status frame of the azimuth stepper: microsteps counted by the driver (not measured) and the switches."""

    stamp_ns: int
    seq: int
    enabled: bool
    """The stepper is powered."""
    microsteps: int
    """Position counted by the stepper driver."""
    rate_microsteps_s: float
    """Rate that the driver is generating."""
    left_switch: bool
    """Travel switch at the positive end."""
    right_switch: bool
    """Travel switch at the negative end."""
    home_switch: bool
    """Photoelectric zero."""


class TemperatureSample(NamedTuple):
    """Slow temperatures."""

    stamp_ns: int
    seq: int
    screw_pitch_c: float
    """Screw of the pitch leg."""
    screw_roll_c: float
    """Screw of the roll leg."""
    column_c: float
    """Column."""
    frame_c: float
    """Base and moving plate."""


class BaseSample(NamedTuple):
    """Swing-table encoders. Logged, never read by the law."""

    stamp_ns: int
    seq: int
    pitch_rad: float
    """Pitch axis of the swing table."""
    roll_rad: float
    """Its roll axis."""
    yaw_rad: float
    """Its yaw axis."""


class Measurement(NamedTuple):
    """Newest sample of each signal at one SYNC."""

    stamp_ns: int
    cycle: int
    imu: ImuSample
    """Newest IMU frame."""
    resolver_pitch: ResolverSample
    """Resolver of the pitch leg."""
    resolver_roll: ResolverSample
    """Resolver of the roll leg."""
    drive_pitch: DriveSample
    """Drive of the pitch leg."""
    drive_roll: DriveSample
    """Drive of the roll leg."""
    azimuth: AzimuthSample
    """Azimuth stepper."""
    temperature: TemperatureSample
    """Temperatures."""
    base: BaseSample
    """Swing-table encoders."""


class Estimate(NamedTuple):
    """What the estimator makes of a measurement."""

    platform_pitch_rad: float
    """Attitude by the newest IMU frame, or dead-reckoned from it while coasting."""
    platform_roll_rad: float
    """The same for roll."""
    heading_rad: float
    """Heading of the platform, likewise."""
    platform_pitch_rate_rad_s: float
    """Rate of the platform in space."""
    platform_roll_rate_rad_s: float
    """The same for roll."""
    attitude_dt_s: float
    """Time since the previous attitude when this cycle brings a new one, else 0."""
    joint_pitch_rad: float
    """Pitch joint, from the rods."""
    joint_roll_rad: float
    """Roll joint, from the rods."""
    azimuth_rad: float
    """Azimuth joint, from the microsteps."""
    joint_pitch_rate_rad_s: float
    """Rate of the pitch joint."""
    joint_roll_rate_rad_s: float
    """Rate of the roll joint."""
    azimuth_rate_rad_s: float
    """Rate of the azimuth joint."""
    rod_pitch_m: float
    """Travel of the pitch leg from level, load side (after backlash and thermal compensation)."""
    rod_roll_m: float
    """The same for the roll leg."""
    screw_pitch_m: float
    """Travel of the nut from level: the rod and what gap and wind-up hold back of it."""
    screw_roll_m: float
    """The same for the roll leg."""
    thermal_pitch_m: float
    """Elongation of the rod by Eq (13), as the compensation believes it."""
    thermal_roll_m: float
    """The same for the roll leg."""
    lever_pitch_m_rad: float
    """Rod travel per angle: d l1 / d pitch."""
    lever_cross_m_rad: float
    """d l2 / d pitch."""
    lever_roll_m_rad: float
    """d l2 / d roll."""
    motor_pitch_rate_rad_s: float
    """Motor speed of the pitch leg, from the observer."""
    motor_roll_rate_rad_s: float
    """The same for the roll leg."""
    motor_pitch_disturbance_rad_s2: float
    """Acceleration of the motor that its current does not explain: friction, load, a wrong motor constant."""
    motor_roll_disturbance_rad_s2: float
    """The same for the roll leg."""
    base_pitch_rad: float
    """Tilt of the base, predicted to now (with everything that the kinematics does not know)."""
    base_roll_rad: float
    """The same in roll."""
    base_pitch_rate_rad_s: float
    """Euler rate of the base, predicted to when the command of this cycle acts."""
    base_roll_rate_rad_s: float
    """The same in roll."""
    base_yaw_rate_rad_s: float
    """The same in yaw."""
    base_pitch_accel_rad_s2: float
    """Its acceleration in pitch."""
    base_roll_accel_rad_s2: float
    """The same in roll."""
    imu_age_s: float
    """Age of the newest IMU frame."""
    coasting: bool
    """The IMU is silent; the attitude is dead-reckoned."""


class Reference(NamedTuple):
    """What the platform shall do now."""

    kind: int
    """See ``ReferenceKind``."""
    pitch_rad: float
    """Demanded pitch."""
    roll_rad: float
    """Demanded roll."""
    heading_rad: float
    """Demanded heading."""
    pitch_rate_rad_s: float
    """Its rate."""
    roll_rate_rad_s: float
    """Its rate."""
    heading_rate_rad_s: float
    """Its rate."""


class AxisTerms(NamedTuple):
    """Every term of one actuator's cascade in one cycle."""

    error_rad: float
    """Reference minus measured angle."""
    p_rad_s: float
    """Proportional term of the attitude loop."""
    i_rad_s: float
    """Its integral term."""
    d_rad_s: float
    """Its derivative term."""
    ff_rad_s: float
    """Feed-forward: the joint rate that base motion and reference ask for."""
    rod_speed_ref_m_s: float
    """Rod speed demanded, after the limits."""
    motor_speed_ref_rad_s: float
    """Motor speed demanded, with the backlash take-up."""
    speed_error_rad_s: float
    """Motor speed demanded minus estimated."""
    speed_p_a: float
    """Proportional term of the speed loop."""
    speed_i_a: float
    """Its integral term."""
    accel_ff_a: float
    """Feed-forward of the acceleration."""
    friction_ff_a: float
    """Feed-forward of the motor friction."""
    u_unlimited_a: float
    """Sum of the terms."""
    u_a: float
    """The same after the current limit."""
    backlash_m: float
    """Screw travel taken up by the gap, as the compensation believes it."""
    limited: int
    """Which limits acted, see ``Limited``."""


class AzimuthTerms(NamedTuple):
    """Every term of the azimuth law in one cycle."""

    error_rad: float
    """Reference minus measured heading (or azimuth)."""
    p_rad_s: float
    """Proportional term."""
    i_rad_s: float
    """Integral term."""
    ff_rad_s: float
    """Feed-forward."""
    rate_unlimited_rad_s: float
    """Sum of the terms."""
    rate_rad_s: float
    """The same after the limits."""
    limited: int
    """Which limits acted, see ``Limited``."""


class Command(NamedTuple):
    """What is sent to the drives. In torque mode a drive follows ``current_a``, in velocity mode ``speed_rad_s``."""

    stamp_ns: int
    seq: int
    enable: bool
    """Power stages on."""
    pitch_current_a: float
    """Current (torque mode) or its feed-forward (velocity mode), pitch leg."""
    pitch_speed_rad_s: float
    """Motor speed, pitch leg."""
    roll_current_a: float
    """The same as for the pitch leg."""
    roll_speed_rad_s: float
    """The same as for the pitch leg."""
    azimuth_rate_rad_s: float
    """Rate of the azimuth joint."""


class Control(NamedTuple):
    """Outcome of one cycle of the law: written to the log as one message."""

    stamp_ns: int
    cycle: int
    mode: int
    """Mode of the supervisor, see ``Mode``."""
    fault: int
    """Number of the first fault (``safety.faults``), 0 for none."""
    law_step: int
    """How many plainer laws have taken over: 0 is the configured one."""
    law_reason: int
    """Why the last of them did (``control.watch.Reason``)."""
    estimate: Estimate
    """What the estimator makes of the measurement."""
    reference: Reference
    """What the platform shall do."""
    pitch: AxisTerms
    """Terms of the pitch leg."""
    roll: AxisTerms
    """Terms of the roll leg."""
    azimuth: AzimuthTerms
    """Terms of the azimuth."""
    command: Command
    """What was really sent."""


class Timing(NamedTuple):
    """Wall-clock quantities of one cycle: the only message that differs between two runs with the same seed."""

    stamp_ns: int
    cycle: int
    lateness_ns: int
    """Begin of the cycle after its SYNC."""
    skipped: int
    """Cycles left out before this one."""
    read_ns: int
    """Time taken to read the rig."""
    control_ns: int
    """Time taken by judge, estimate and law."""
    write_ns: int
    """Time taken to hand over the command."""
    record_ns: int
    """Hand-over to the recorder in the previous cycle."""
    compute_ns: int
    """From the start of the cycle until its command was written."""


class Truth(NamedTuple):
    """True state of a virtual rig. ``diagnose`` never opens it."""

    stamp_ns: int
    cycle: int
    platform_pitch_rad: float
    """True attitude in space."""
    platform_roll_rad: float
    """True attitude in space."""
    heading_rad: float
    """True heading."""
    joint_pitch_rad: float
    """True pitch joint."""
    joint_roll_rad: float
    """True roll joint."""
    azimuth_rad: float
    """True azimuth joint."""
    joint_pitch_rate_rad_s: float
    """Its rate."""
    joint_roll_rate_rad_s: float
    """Its rate."""
    azimuth_rate_rad_s: float
    """Its rate."""
    rod_pitch_m: float
    """True rod travel from level."""
    rod_roll_m: float
    """The same for the roll leg."""
    screw_pitch_m: float
    """Free travel of the nut: what the rod would do with no gap and no load."""
    screw_roll_m: float
    """The same for the roll leg."""
    rod_force_pitch_n: float
    """Force in the pitch rod."""
    rod_force_roll_n: float
    """Force in the roll rod."""
    motor_pitch_rate_rad_s: float
    """True motor speed."""
    motor_roll_rate_rad_s: float
    """True motor speed."""
    current_pitch_a: float
    """True motor current."""
    current_roll_a: float
    """True motor current."""
    base_pitch_rad: float
    """True swing-table axis."""
    base_roll_rad: float
    """True swing-table axis."""
    base_yaw_rad: float
    """True swing-table axis."""
    screw_pitch_c: float
    """True screw temperature."""
    screw_roll_c: float
    """True screw temperature."""
    lost_steps: float
    """Full steps that the stepper has lost."""
    end_stop: float
    """Bits: 1 pitch leg, 2 roll leg, 4 azimuth on a hard stop."""


class AxisSample(NamedTuple):
    """One cycle of a single axis: one drive, screw and moving mass with a measurement at the load (the push-rod bench, a positioning axis)."""

    stamp_ns: int
    cycle: int
    enabled: bool
    """The power stage is on."""
    velocity_mode: bool
    """The drive follows ``command_rad_s`` with its own speed loop, else ``command_a``."""
    reference_m: float
    """Travel that the motion asks of the load, 0 if it asks for none."""
    reference_m_s: float
    """Its rate."""
    command_a: float
    """Current command given at this SYNC; it acts until the next one. Volt for a drive that is commanded in volts. 0 in velocity mode."""
    command_rad_s: float
    """Motor speed command (velocity mode), likewise."""
    current_a: float
    """Measured motor current."""
    bus_voltage_v: float
    """Supply voltage at the drive."""
    resolver_counts: int
    """Position of the motor shaft, multi-turn."""
    load_m: float
    """Travel of the load from zero, by the ruler."""
    load_force_n: float
    """Known outer force on the load, positive against positive travel: an input."""
    load_mass_kg: float
    """Known mass added to the carriage: an input."""
    screw_c: float
    """Temperature sensor at the screw nut, which lags the screw: an input."""
    ambient_c: float
    """Temperature of the surroundings: an input."""


class OperatorRequest(NamedTuple):
    """One request on the operator channel, with the cycle time at which it was taken."""

    stamp_ns: int
    verb: str
    """``arm``, ``disarm``, ``stop``, ``reset``, ``home``, ``heading``, ``target`` (one sample of a stream), ``jog-pitch``, ``jog-roll``, ``present``
    (the operator is there), ``fault`` (seen outside the measurement)."""
    value: float
    """Angle in rad for ``heading``, ``target`` and ``jog-...``, number of the fault for ``fault``, else 0."""
    source: str
    """Who asked: ``screen``, ``ctl``, ``completed`` (end of the scenario), ``interrupted`` (Ctrl-C), ``loop`` (a fault)."""
    rate: float = 0.0
    """Rate of a ``target`` in rad/s, else 0."""


NO_IMU = ImuSample(0, 0, -1, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NO_RESOLVER = ResolverSample(0, -1, 0, 0)
NO_DRIVE = DriveSample(0, -1, False, 0, 0.0, 0.0)
NO_AZIMUTH = AzimuthSample(0, -1, False, 0, 0.0, False, False, False)
NO_TEMPERATURE = TemperatureSample(0, -1, 20.0, 20.0, 20.0, 20.0)
NO_BASE = BaseSample(0, -1, 0.0, 0.0, 0.0)
NO_MEASUREMENT = Measurement(
    0, -1, NO_IMU, NO_RESOLVER, NO_RESOLVER, NO_DRIVE, NO_DRIVE, NO_AZIMUTH, NO_TEMPERATURE, NO_BASE
)
