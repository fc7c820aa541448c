"""The law: attitude PID -> joint rates -> rod speeds -> motor speed PI -> current, and the azimuth profile.

``step`` is pure: ``(state, estimate, reference, dt, gate) -> (command values, terms, state)``. Two ways to close the position loop share everything
below it: on the IMU (platform level in space; with or without base-rate feed-forward) or on the resolvers through the kinematics (joint angles).
"""

from __future__ import annotations

from enum import IntEnum
from math import cos, sin, tanh
from typing import NamedTuple

from spsp_ctrl.control import backlash
from spsp_ctrl.control.backlash import GapState
from spsp_ctrl.control.limits import limit_rate
from spsp_ctrl.control.params import AxisParams, LawParams
from spsp_ctrl.mechanism.frames import body_to_tilt_rates, euler_rates_to_body, wrap_angle
from spsp_ctrl.mechanism.kinematics import jacobian, rod_lengths
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


_ATTITUDE = AttitudeState(0.0, 0.0, 0.0, 0.0)
_AXIS = AxisState(0.0, 0.0, 0)
START = LawState(_ATTITUDE, _ATTITUDE, _AXIS, _AXIS, backlash.START, backlash.START, 0.0, 0.0)


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


def _rod(
    axis: AxisState,
    ap: AxisParams,
    p: LawParams,
    gap: GapState,
    attitude: AttitudeState,
    error_rad: float,
    ff_rad_s: float,
    wanted_m_s: float,
    accel_a: float,
    gravity_n: float,
    rod_m: float,
    motor_rate: float,
    dt: float,
    enabled: bool,
) -> tuple[AxisTerms, AxisState, GapState]:
    """Rod speed demand -> limits -> backlash take-up -> motor speed PI -> current."""
    speed, bits = limit_rate(
        wanted_m_s, axis.rod_speed, rod_m, p.rod_min_m, p.rod_max_m, p.rod_speed_m_s, p.rod_accel_m_s2, dt
    )
    if p.gap is not None:
        gap = backlash.step(gap, p.gap, speed, gravity_n, dt)
        motor_ref = (speed + gap.rate_m_s) / ap.travel_per_rad_m
    else:
        motor_ref = speed / ap.travel_per_rad_m
    if not enabled:
        terms = _new(
            AxisTerms,
            (error_rad, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, gap.offset_m, 0),
        )
        return terms, _AXIS, gap
    error = motor_ref - motor_rate
    p_a = p.speed_kp * error
    friction_a = ap.friction_a * tanh(motor_ref / p.friction_smooth_rad_s) if ap.friction_a else 0.0
    integral = axis.integral_a + p.speed_ki * error * dt
    unlimited = p_a + integral + accel_a + friction_a
    limit = p.current_a
    current = limit if unlimited > limit else -limit if unlimited < -limit else unlimited
    if current != unlimited:
        bits |= CURRENT_LIMITED
        # conditional integration: never further into the limit
        if (unlimited - current) * error > 0.0:
            integral = axis.integral_a
    terms = _new(
        AxisTerms,
        (
            error_rad,
            attitude.p,
            attitude.integral,
            attitude.d,
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
            gap.offset_m,
            bits,
        ),
    )
    return terms, _new(AxisState, (speed, integral, bits)), gap


def step(state: LawState, p: LawParams, e: Estimate, r: Reference, dt: float, gate: int) -> tuple[Output, LawState]:
    """One cycle of the law. ``gate`` is a ``Gate``."""
    inertial = r.kind == INERTIAL
    j11, j21, j22 = e.lever_pitch_m_rad, e.lever_cross_m_rad, e.lever_roll_m_rad
    if inertial:
        error_pitch = r.pitch_rad - e.platform_pitch_rad
        error_roll = r.roll_rad - e.platform_roll_rad
        error_heading = wrap_angle(r.heading_rad - e.heading_rad)
    else:
        error_pitch = r.pitch_rad - e.joint_pitch_rad
        error_roll = r.roll_rad - e.joint_roll_rad
        error_heading = r.heading_rad - e.azimuth_rad

    att_pitch = att_roll = _ATTITUDE
    ff_pitch = ff_roll = wanted1 = wanted2 = accel1 = accel2 = 0.0
    heading_integral = azimuth_wanted = azimuth_p = azimuth_ff = 0.0
    if gate >= ALIGN:
        limit = 0.25 * p.azimuth_rate_rad_s
        heading_integral = state.heading_integral + p.heading_ki * error_heading * dt
        heading_integral = limit if heading_integral > limit else max(heading_integral, -limit)
        azimuth_p = p.heading_kp * error_heading
        heading_rate = azimuth_p + heading_integral + r.heading_rate_rad_s
        if inertial:
            att_pitch, att_roll = state.attitude_pitch, state.attitude_roll
            if e.attitude_dt_s > 0.0:
                top = p.align_rate_rad_s if gate == ALIGN else p.rod_speed_m_s / p.radius_m
                rate_error = r.pitch_rate_rad_s - e.platform_pitch_rate_rad_s
                att_pitch = _attitude(
                    att_pitch, p, error_pitch, rate_error, e.attitude_dt_s, state.axis_pitch.limited, top
                )
                rate_error = r.roll_rate_rad_s - e.platform_roll_rate_rad_s
                att_roll = _attitude(att_roll, p, error_roll, rate_error, e.attitude_dt_s, state.axis_roll.limited, top)
            rate_pitch = att_pitch.p + att_pitch.integral + att_pitch.d + r.pitch_rate_rad_s
            rate_roll = att_roll.p + att_roll.integral + att_roll.d + r.roll_rate_rad_s
            if gate == ALIGN:
                rate_pitch = _clip(rate_pitch, p.align_rate_rad_s)
                rate_roll = _clip(rate_roll, p.align_rate_rad_s)
            joint_pitch, joint_roll = e.joint_pitch_rad, e.joint_roll_rad
            wx, wy, wz = euler_rates_to_body(
                -e.platform_roll_rad, e.platform_pitch_rad, -rate_roll, rate_pitch, heading_rate
            )
            wy_azimuth = wy
            if p.feedforward:
                wx -= e.base_rate_x_rad_s
                wy -= e.base_rate_y_rad_s
                if p.accel_ff_a[0]:
                    accel_pitch, accel_roll = body_to_tilt_rates(
                        joint_pitch, joint_roll, -e.base_accel_x_rad_s2, -e.base_accel_y_rad_s2, 0.0
                    )
                    accel1 = p.accel_ff_a[0] * j11 * accel_pitch
                    accel2 = p.accel_ff_a[1] * (j21 * accel_pitch + j22 * accel_roll)
            if p.heading_feedforward:
                wz -= e.base_rate_z_rad_s
                wy_azimuth -= e.base_rate_y_rad_s
            azimuth_wanted = (wz * cos(joint_roll) - wy_azimuth * sin(joint_roll)) / cos(joint_pitch)
            azimuth_ff = azimuth_wanted - azimuth_p - heading_integral
            dp, dr = body_to_tilt_rates(joint_pitch, joint_roll, wx, wy, state.azimuth_rate)
            ff_pitch, ff_roll = dp - rate_pitch, dr - rate_roll
            wanted1 = j11 * dp
            wanted2 = j21 * dp + j22 * dr
        else:
            ref1, ref2 = rod_lengths(r.pitch_rad, r.roll_rad, p.height_m, p.radius_m, p.static_radius_m)
            k11, k21, k22 = jacobian(r.pitch_rad, r.roll_rad, ref1, ref2, p.height_m, p.radius_m, p.static_radius_m)
            ff_pitch, ff_roll = r.pitch_rate_rad_s, r.roll_rate_rad_s
            p1 = p.rod_kp * (ref1 - p.level_m - e.rod_pitch_m)
            p2 = p.rod_kp * (ref2 - p.level_m - e.rod_roll_m)
            if gate == ALIGN:
                p1 = _clip(p1, p.align_rate_rad_s * p.radius_m)
                p2 = _clip(p2, p.align_rate_rad_s * p.radius_m)
            wanted1 = k11 * ff_pitch + p1
            wanted2 = k21 * ff_pitch + k22 * ff_roll + p2
            p_pitch = p1 / j11
            att_pitch = AttitudeState(0.0, error_pitch, p_pitch, 0.0)
            att_roll = AttitudeState(0.0, error_roll, (p2 - j21 * p_pitch) / j22, 0.0)
            azimuth_ff, azimuth_wanted = r.heading_rate_rad_s, heading_rate

    gravity1 = gravity2 = 0.0
    if p.gap is not None:
        gravity1, gravity2 = backlash.gravity_forces(p.gap, e.platform_pitch_rad, e.platform_roll_rad, j11, j21, j22)
    enabled = gate != OFF
    pitch, axis_pitch, gap_pitch = _rod(
        state.axis_pitch, p.pitch, p, state.gap_pitch, att_pitch, error_pitch, ff_pitch, wanted1, accel1, gravity1,
        e.rod_pitch_m, e.motor_pitch_rate_rad_s, dt, enabled,
    )  # fmt: skip
    roll, axis_roll, gap_roll = _rod(
        state.axis_roll, p.roll, p, state.gap_roll, att_roll, error_roll, ff_roll, wanted2, accel2, gravity2,
        e.rod_roll_m, e.motor_roll_rate_rad_s, dt, enabled,
    )  # fmt: skip
    azimuth_rate, azimuth_bits = limit_rate(
        azimuth_wanted,
        state.azimuth_rate,
        e.azimuth_rad,
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
    return _new(Output, (pitch, roll, azimuth)), _new(
        LawState, (att_pitch, att_roll, axis_pitch, axis_roll, gap_pitch, gap_roll, heading_integral, azimuth_rate)
    )
