"""The law: attitude PID -> joint rates -> rod speeds -> motor speed PI -> current, and the azimuth profile.

``step`` is pure: ``(state, estimate, reference, dt, gate) -> (command values, terms, state)``. Two ways to close the position loop share everything
below it: on the IMU (platform level in space; with or without base-rate feed-forward) or on the resolvers through the kinematics (joint angles).
"""

from __future__ import annotations

from enum import IntEnum
from math import cos, exp, sin
from typing import NamedTuple

from spsp_ctrl.control import backlash
from spsp_ctrl.control.backlash import GapState
from spsp_ctrl.control.limits import limit_rate
from spsp_ctrl.control.params import AxisParams, LawParams
from spsp_ctrl.mechanism.frames import body_to_tilt_motion, body_to_tilt_rates, euler_rates_to_body, wrap_angle
from spsp_ctrl.mechanism.kinematics import rods_and_jacobian
from spsp_ctrl.mechanism.levelling import base_motion_on_platform, tilt_joints
from spsp_ctrl.messages import AxisTerms, AzimuthTerms, Estimate, Limited, Reference, ReferenceKind

CURRENT_LIMITED = int(Limited.CURRENT)
INERTIAL = int(ReferenceKind.INERTIAL)


class Gate(IntEnum):
    """What the supervisor lets the law do."""

    OFF = 0
    """Drives disabled: observers run, integrators are held at zero, so that arming does not jump."""
    STOP = 1
    """Brake to standstill with the drives enabled."""
    ALIGN = 2
    """Go to the reference at a limited platform rate."""
    ACTIVE = 3


OFF, ALIGN = int(Gate.OFF), int(Gate.ALIGN)
_new = tuple.__new__


class AttitudeState(NamedTuple):
    """Attitude PID of one axis; its terms are held between IMU frames."""

    integral: float
    error: float
    p: float
    d: float


class AxisState(NamedTuple):
    """Rod and motor stages of one axis."""

    rod_speed: float
    integral_a: float
    limited: int
    slow_1: float
    slow_2: float
    """The fed-forward rod speed through two low-passes, in m/s: what of it is motion and not noise or ringing."""
    envelope: float
    """Its decaying peak: whether the axis is being moved on purpose."""
    friction: float
    """Direction of the motor-side friction, -1..1."""


class LawState(NamedTuple):
    """Memory of the law."""

    attitude_pitch: AttitudeState
    attitude_roll: AttitudeState
    axis_pitch: AxisState
    axis_roll: AxisState
    gap_pitch: GapState
    gap_roll: GapState
    heading_integral: float
    azimuth_rate: float
    turn_rate: float
    """What the base asks of the azimuth rate, through the tracking filter, in rad/s, and its slope."""
    turn_slope: float


_ATTITUDE = AttitudeState(0.0, 0.0, 0.0, 0.0)
_AXIS = AxisState(0.0, 0.0, 0, 0.0, 0.0, 0.0, 0.0)
START = LawState(_ATTITUDE, _ATTITUDE, _AXIS, _AXIS, backlash.START, backlash.START, 0.0, 0.0, 0.0, 0.0)


class Output(NamedTuple):
    """What the law asks of the drives, with every term."""

    pitch: AxisTerms
    roll: AxisTerms
    azimuth: AzimuthTerms


def _attitude(
    state: AttitudeState, p: LawParams, error: float, rate_error: float, dt: float, limited: int, limit: float
) -> AttitudeState:
    """PID step on a new attitude. ``rate_error`` is the wanted minus the measured platform rate (gyro), used when feed-forward is on."""
    d = p.kp * p.td * (rate_error if p.feedforward else (error - state.error) / dt)
    integral = state.integral
    # conditional anti-windup: an integrator never pushes further into a limit
    if not limited or error * (integral + p.kp * error) < 0.0:
        integral += p.ki * error * dt
    integral = min(limit, max(-limit, integral))
    return AttitudeState(integral, error, p.kp * error, d)


def _clip(value: float, limit: float) -> float:
    return limit if value > limit else -limit if value < -limit else value


STANDSTILL_M_S = 0.4e-3
MOVING_M_S = 1.0e-3
STILL_SHARE = 0.5


def _smoothstep(x: float) -> float:
    return 0.0 if x <= 0.0 else 1.0 if x >= 1.0 else x * x * (3.0 - 2.0 * x)


def _track(value: float, slope: float, seen: float, corner_rad_s: float, dt: float) -> tuple[float, float]:
    """Second-order tracking filter (critically damped, no lag behind a ramp): value and slope."""
    share = corner_rad_s * dt
    value += slope * dt
    error = seen - value
    return value + 2.0 * share * error, slope + corner_rad_s * share * error


def _rod(
    axis: AxisState,
    ap: AxisParams,
    p: LawParams,
    gap: GapState,
    attitude: AttitudeState,
    error_rad: float,
    ff_rad_s: float,
    wanted_m_s: float,
    planned_m_s: float,
    accel_a: float,
    gravity_n: float,
    rod_m: float,
    flank_m: float,
    motor_rate: float,
    dt: float,
    enabled: bool,
) -> tuple[AxisTerms, AxisState, GapState]:
    """Rod speed demand -> limits -> backlash take-up -> motor speed PI -> current."""
    rod_speed, integral_before, _, slow_1, slow_2, envelope, friction = axis
    speed, bits = limit_rate(
        wanted_m_s, rod_speed, rod_m, p.rod_min_m, p.rod_max_m, p.rod_speed_m_s, p.rod_accel_m_s2, dt
    )
    # compensations that follow the direction of motion fade out at standstill, where that direction is noise
    slow_1 += p.envelope_share * (planned_m_s - slow_1)
    slow_2 += p.envelope_share * (slow_1 - slow_2)
    planned = abs(slow_2)
    envelope *= p.envelope_decay
    if planned > envelope:
        envelope = planned
    moving = _smoothstep((envelope - STANDSTILL_M_S) / (MOVING_M_S - STANDSTILL_M_S))
    if p.gap is not None:
        _, _, rate_before, _, _, _ = gap
        gap = backlash.step(gap, p.gap, speed, moving, gravity_n, dt)
        _, offset_m, rate_m_s, force_n, _, _ = gap
        if p.accelerate:
            accel_a += ap.accel_ff_a * (rate_m_s - rate_before) / dt
        motor_ref = (speed + rate_m_s) / ap.travel_per_rad_m
    else:
        _, offset_m, _, force_n, _, _ = gap
        motor_ref = speed / ap.travel_per_rad_m
    if not enabled:
        # nobody leads the nut: arming starts from where it sits
        gap = gap._replace(offset_m=flank_m, rate_m_s=0.0)
        terms = _new(
            AxisTerms,
            (error_rad, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, gap.offset_m, 0),
        )
        return terms, _AXIS, gap
    error = motor_ref - motor_rate
    p_a = p.speed_kp * error
    friction_a = 0.0
    if ap.friction_a:
        # friction turns round with travel (presliding), not with speed: it holds on until the motor has really reversed
        target = 1.0 if motor_ref > 0.0 else -1.0
        friction = target + (friction - target) * exp(-abs(motor_ref) * dt / p.presliding_rad)
        load_a = force_n * ap.load_a_n
        ratio = motor_ref / ap.stribeck_rad_s
        level = ap.friction_a + ap.stiction_a * exp(-ratio * ratio) + ap.load_friction * abs(load_a)
        friction_a = moving * (load_a + level * friction)
    # at standstill a fast integral hunts between the two signs of stiction
    integral = integral_before + p.speed_ki * (STILL_SHARE + (1.0 - STILL_SHARE) * moving) * error * dt
    unlimited = p_a + integral + accel_a + friction_a
    limit = p.current_a
    current = limit if unlimited > limit else -limit if unlimited < -limit else unlimited
    if current != unlimited:
        bits |= CURRENT_LIMITED
        # conditional integration: never further into the limit
        if (unlimited - current) * error > 0.0:
            integral = integral_before
    attitude_i, _, attitude_p, attitude_d = attitude
    terms = _new(
        AxisTerms,
        (
            error_rad,
            attitude_p,
            attitude_i,
            attitude_d,
            ff_rad_s,
            speed,
            motor_ref,
            error,
            p_a,
            integral,
            accel_a,
            friction_a,
            unlimited,
            current,
            offset_m,
            bits,
        ),
    )
    return terms, _new(AxisState, (speed, integral, bits, slow_1, slow_2, envelope, friction)), gap


def reseed(state: LawState, p: LawParams, e: Estimate) -> LawState:
    """The memory for another law ``p`` that takes over while moving: rods go on at the speed they have.

    A law that follows the base by itself needs nothing; one without feed-forward must already have in its integral what it fed forward.
    """
    if p.observe or p.feedforward:
        return state._replace(attitude_pitch=_ATTITUDE, attitude_roll=_ATTITUDE)
    pitch_rate = state.axis_pitch.rod_speed / e.lever_pitch_m_rad
    roll_rate = (state.axis_roll.rod_speed - e.lever_cross_m_rad * pitch_rate) / e.lever_roll_m_rad
    return state._replace(
        attitude_pitch=_ATTITUDE._replace(integral=pitch_rate), attitude_roll=_ATTITUDE._replace(integral=roll_rate)
    )


class _Wanted(NamedTuple):
    """What a position loop asks of the joints and the rods."""

    attitude_pitch: AttitudeState
    attitude_roll: AttitudeState
    ff_pitch: float
    ff_roll: float
    rod_pitch_m_s: float
    rod_roll_m_s: float
    planned_pitch_m_s: float
    """The part of it that is fed forward."""
    planned_roll_m_s: float
    accel_pitch_a: float
    accel_roll_a: float


_NOTHING = _Wanted(_ATTITUDE, _ATTITUDE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _by_attitude(
    state: LawState, p: LawParams, e: Estimate, r: Reference, error_pitch: float, error_roll: float, heading_rate: float,
    base_x: float, base_y: float, accel_x: float, accel_y: float, gate: int,
) -> _Wanted:  # fmt: skip
    """Attitude PID on the IMU, with or without base-rate feed-forward."""
    att_pitch, att_roll = state.attitude_pitch, state.attitude_roll
    if e.attitude_dt_s > 0.0:
        top = p.align_rate_rad_s if gate == ALIGN else p.rod_speed_m_s / p.radius_m
        rate_error = r.pitch_rate_rad_s - e.platform_pitch_rate_rad_s
        att_pitch = _attitude(att_pitch, p, error_pitch, rate_error, e.attitude_dt_s, state.axis_pitch.limited, top)
        rate_error = r.roll_rate_rad_s - e.platform_roll_rate_rad_s
        att_roll = _attitude(att_roll, p, error_roll, rate_error, e.attitude_dt_s, state.axis_roll.limited, top)
    rate_pitch = att_pitch.p + att_pitch.integral + att_pitch.d + r.pitch_rate_rad_s
    rate_roll = att_roll.p + att_roll.integral + att_roll.d + r.roll_rate_rad_s
    if gate == ALIGN:
        rate_pitch = _clip(rate_pitch, p.align_rate_rad_s)
        rate_roll = _clip(rate_roll, p.align_rate_rad_s)
    joint_pitch, joint_roll = e.joint_pitch_rad, e.joint_roll_rad
    j11, j21, j22 = e.lever_pitch_m_rad, e.lever_cross_m_rad, e.lever_roll_m_rad
    wx, wy, _ = euler_rates_to_body(-e.platform_roll_rad, e.platform_pitch_rad, -rate_roll, rate_pitch, heading_rate)
    accel1 = accel2 = 0.0
    if p.feedforward:
        wx -= base_x
        wy -= base_y
    if p.accelerate:
        accel_pitch, accel_roll = body_to_tilt_rates(joint_pitch, joint_roll, -accel_x, -accel_y, 0.0)
        accel1 = p.pitch.accel_ff_a * j11 * accel_pitch
        accel2 = p.roll.accel_ff_a * (j21 * accel_pitch + j22 * accel_roll)
    dp, dr = body_to_tilt_rates(joint_pitch, joint_roll, wx, wy, state.azimuth_rate)
    # what is fed forward or stands in the integrals is motion; P and D answer to noise
    planned_p, planned_r = dp - att_pitch.p - att_pitch.d, dr - att_roll.p - att_roll.d
    return _new(
        _Wanted,
        (
            att_pitch,
            att_roll,
            dp - rate_pitch,
            dr - rate_roll,
            j11 * dp,
            j21 * dp + j22 * dr,
            j11 * planned_p,
            j21 * planned_p + j22 * planned_r,
            accel1,
            accel2,
        ),
    )


def _by_rods(
    p: LawParams, screw_pitch_m: float, screw_roll_m: float, j11: float, j21: float, j22: float, error_pitch: float, error_roll: float,
    pitch: float, roll: float, pitch_rate: float, roll_rate: float, pitch_accel: float, roll_accel: float, lead_pitch_m: float, lead_roll_m: float,
    gate: int,
) -> _Wanted:  # fmt: skip
    """Rod position loop on the resolvers, towards joint angles that are given with their rates and accelerations."""
    ref1, ref2, k11, k21, k22 = rods_and_jacobian(pitch, roll, p.height_m, p.radius_m, p.static_radius_m)
    # the nut is led, by as much as the take-up wants it ahead of the rod
    p1 = p.rod_kp * (ref1 - p.level_m + lead_pitch_m - screw_pitch_m)
    p2 = p.rod_kp * (ref2 - p.level_m + lead_roll_m - screw_roll_m)
    if gate == ALIGN:
        top = p.align_rate_rad_s * p.radius_m
        p1, p2 = _clip(p1, top), _clip(p2, top)
    p_pitch = p1 / j11
    p_roll = (p2 - j21 * p_pitch) / j22
    planned1, planned2 = k11 * pitch_rate, k21 * pitch_rate + k22 * roll_rate
    accel1 = accel2 = 0.0
    if p.accelerate:
        accel1 = p.pitch.accel_ff_a * k11 * pitch_accel
        accel2 = p.roll.accel_ff_a * (k21 * pitch_accel + k22 * roll_accel)
    return _new(
        _Wanted,
        (
            _new(AttitudeState, (0.0, error_pitch, p_pitch, 0.0)),
            _new(AttitudeState, (0.0, error_roll, p_roll, 0.0)),
            pitch_rate,
            roll_rate,
            planned1 + p1,
            planned2 + p2,
            planned1,
            planned2,
            accel1,
            accel2,
        ),
    )


def step(state: LawState, p: LawParams, e: Estimate, r: Reference, dt: float, gate: int) -> tuple[Output, LawState]:
    """One cycle of the law. ``gate`` is a ``Gate``."""
    # unpacked as a whole: a named field costs as much as unpacking ten
    (
        platform_pitch, platform_roll, heading, _, _, _, joint_pitch, joint_roll, az, _, _, _, rod1, rod2, screw1, screw2, _, _, j11, j21, j22,
        motor_rate1, motor_rate2, _, _, base_pitch, base_roll, base_pitch_rate, base_roll_rate, base_yaw_rate, base_pitch_accel, base_roll_accel,
        _, _,
    ) = e  # fmt: skip
    kind, ref_pitch, ref_roll, ref_heading, ref_pitch_rate, ref_roll_rate, ref_heading_rate = r
    gap_pitch, gap_roll = state.gap_pitch, state.gap_roll
    inertial = kind == INERTIAL
    if inertial:
        error_pitch = ref_pitch - platform_pitch
        error_roll = ref_roll - platform_roll
        error_heading = wrap_angle(ref_heading - heading)
    else:
        error_pitch = ref_pitch - joint_pitch
        error_roll = ref_roll - joint_roll
        error_heading = ref_heading - az

    lead1 = gap_pitch.offset_m if p.gap is not None else 0.0
    lead2 = gap_roll.offset_m if p.gap is not None else 0.0
    wanted = _NOTHING
    heading_integral = azimuth_wanted = azimuth_p = azimuth_ff = turn_rate = turn_slope = 0.0
    if gate >= ALIGN:
        limit = 0.25 * p.azimuth_rate_rad_s
        heading_integral = _clip(state.heading_integral + p.heading_ki * error_heading * dt, limit)
        azimuth_p = p.heading_kp * error_heading
        heading_rate = azimuth_p + heading_integral + ref_heading_rate
        if inertial:
            if p.observe:
                pitch, roll = tilt_joints(base_pitch, base_roll, az, ref_pitch, ref_roll)
            else:
                pitch, roll = joint_pitch, joint_roll
            base_x, base_y, base_z, accel_x, accel_y = base_motion_on_platform(
                base_pitch, base_roll, base_pitch_rate, base_roll_rate, base_yaw_rate, base_pitch_accel, base_roll_accel, az, pitch, roll
            )
            if not p.accelerate:
                accel_x = accel_y = 0.0
            wx, wy, wz = euler_rates_to_body(-platform_roll, platform_pitch, -ref_roll_rate, ref_pitch_rate, heading_rate)
            if p.observe:
                # the azimuth rate asked for: the one that there is comes in steps of the stepper's service and of its play
                dp, dr, ddp, ddr, cp, cr, sr = body_to_tilt_motion(
                    pitch, roll, wx - base_x, wy - base_y, state.azimuth_rate, -accel_x, -accel_y
                )
                wanted = _by_rods(
                    p, screw1, screw2, j11, j21, j22, error_pitch, error_roll, pitch, roll, dp, dr, ddp, ddr, lead1, lead2, gate
                )
            else:
                wanted = _by_attitude(
                    state, p, e, r, error_pitch, error_roll, heading_rate, base_x, base_y, accel_x, accel_y, gate
                )
                cp, cr, sr = cos(pitch), cos(roll), sin(roll)
            azimuth_wanted = (wz * cr - wy * sr) / cp
            if p.heading_feedforward:
                turn_rate, turn_slope = _track(
                    state.turn_rate, state.turn_slope, (base_y * sr - base_z * cr) / cp, p.heading_corner_rad_s, dt
                )
                azimuth_wanted += turn_rate
            azimuth_ff = azimuth_wanted - azimuth_p - heading_integral
        else:
            wanted = _by_rods(
                p, screw1, screw2, j11, j21, j22, error_pitch, error_roll, ref_pitch, ref_roll, ref_pitch_rate, ref_roll_rate, 0.0, 0.0,
                lead1, lead2, gate,
            )
            azimuth_ff, azimuth_wanted = r.heading_rate_rad_s, heading_rate

    gravity1 = gravity2 = 0.0
    if p.gap is not None:
        gravity1, gravity2 = backlash.gravity_forces(p.gap, platform_pitch, platform_roll, j11, j21, j22)
    enabled = gate != OFF
    attitude_pitch, attitude_roll, ff_pitch, ff_roll, speed1, speed2, planned1, planned2, accel1, accel2 = wanted
    pitch_terms, axis_pitch, gap_pitch = _rod(
        state.axis_pitch, p.pitch, p, gap_pitch, attitude_pitch, error_pitch, ff_pitch, speed1, planned1, accel1, gravity1, rod1,
        screw1 - rod1, motor_rate1, dt, enabled,
    )  # fmt: skip
    roll_terms, axis_roll, gap_roll = _rod(
        state.axis_roll, p.roll, p, gap_roll, attitude_roll, error_roll, ff_roll, speed2, planned2, accel2, gravity2, rod2,
        screw2 - rod2, motor_rate2, dt, enabled,
    )  # fmt: skip
    azimuth_rate, azimuth_bits = limit_rate(
        azimuth_wanted,
        state.azimuth_rate,
        az,
        p.azimuth_min_rad,
        p.azimuth_max_rad,
        p.azimuth_rate_rad_s,
        p.azimuth_accel_rad_s2,
        dt,
    )
    if azimuth_bits and error_heading * heading_integral > 0.0:
        heading_integral = state.heading_integral
    if not enabled:
        azimuth_rate = 0.0
    azimuth = _new(
        AzimuthTerms,
        (error_heading, azimuth_p, heading_integral, azimuth_ff, azimuth_wanted, azimuth_rate, azimuth_bits),
    )
    return _new(Output, (pitch_terms, roll_terms, azimuth)), _new(
        LawState,
        (
            attitude_pitch,
            attitude_roll,
            axis_pitch,
            axis_roll,
            gap_pitch,
            gap_roll,
            heading_integral,
            azimuth_rate,
            turn_rate,
            turn_slope,
        ),
    )
