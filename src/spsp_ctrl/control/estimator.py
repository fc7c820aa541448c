"""From a measurement to what the law needs: motor speeds, rods, joint angles and rates, attitude, and the motion of the base."""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from spsp_ctrl.control import backlash, base_observer, motor_observer, screw_map
from spsp_ctrl.control.backlash import Flank, GapState
from spsp_ctrl.control.base_observer import BaseState
from spsp_ctrl.control.motor_observer import MotorState
from spsp_ctrl.control.params import AxisParams, LawParams, lag_step
from spsp_ctrl.control.screw_map import ScrewMap
from spsp_ctrl.mechanism.frames import joint_rates_to_body, roll_from_imu, wrap_angle
from spsp_ctrl.mechanism.kinematics import attitude_from_rods, jacobian, rods_and_jacobian
from spsp_ctrl.mechanism.levelling import platform_tilt
from spsp_ctrl.messages import DriveSample, Estimate, Measurement, ResolverSample

COAST_PREDICTION_S = 0.25
"""The motion of the base is extrapolated no longer than this; then it is held."""

Vector = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
_STILL: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_new = tuple.__new__


class EstimatorState(NamedTuple):
    """Memory of the estimator."""

    pitch: MotorState
    roll: MotorState
    joints: Six
    """Joint angles (pitch, roll, azimuth) and the body rate they give, at the previous cycle: input of the lags."""
    history: tuple[Six, ...]
    """The same through the IMU's lags, newest last: aligned with the delayed frames."""
    base: BaseState
    screw_pitch: ScrewMap
    screw_roll: ScrewMap
    imu_seq: int
    imu_stamp_ns: int
    pitch_rad: float
    roll_rad: float
    heading_rad: float
    pitch_rate: float
    roll_rate: float
    since_attitude_s: float
    coasting: bool
    flank_pitch: Flank
    flank_roll: Flank


def history_length(p: LawParams) -> int:
    """Cycles of joint motion to remember: delay of the IMU plus one frame and slack."""
    return int((p.imu_delay_s + p.imu_period_s) / p.period_s) + 4


def start(measurement: Measurement, p: LawParams) -> EstimatorState:
    """At rest where the resolvers say the motors are."""
    pitch = motor_observer.start(measurement.resolver_pitch.counts * p.pitch.rad_per_count)
    roll = motor_observer.start(measurement.resolver_roll.counts * p.roll.rad_per_count)
    l1 = p.level_m + pitch.angle * p.pitch.travel_per_rad_m + p.pitch.zero_offset_m
    l2 = p.level_m + roll.angle * p.roll.travel_per_rad_m + p.roll.zero_offset_m
    try:
        joint_pitch, joint_roll = attitude_from_rods(l1, l2, p.height_m, p.radius_m, p.static_radius_m)
    except ValueError:
        joint_pitch = joint_roll = 0.0
    azimuth = measurement.azimuth.microsteps * p.rad_per_microstep
    joints: Six = (joint_pitch, joint_roll, azimuth, 0.0, 0.0, 0.0)
    return EstimatorState(
        pitch=pitch,
        roll=roll,
        joints=joints,
        history=(joints,) * history_length(p),
        base=base_observer.START,
        screw_pitch=screw_map.START,
        screw_roll=screw_map.START,
        imu_seq=-1,
        imu_stamp_ns=0,
        pitch_rad=0.0,
        roll_rad=0.0,
        heading_rad=0.0,
        pitch_rate=0.0,
        roll_rate=0.0,
        since_attitude_s=0.0,
        coasting=False,
        flank_pitch=Flank(0.0, 0.0, 1.0),
        flank_roll=Flank(0.0, 0.0, 1.0),
    )

def _motor(
    state: MotorState, axis: AxisParams, p: LawParams, resolver: ResolverSample, drive: DriveSample, now_ns: int, dt: float
) -> MotorState:
    angle = resolver.counts * axis.rad_per_count
    late_ns = now_ns - resolver.stamp_ns
    if late_ns:
        # SYNCs on a wire are not equidistant (20 us are 1 % of the speed at 500 Hz), and an answer that has not come is taken to go on:
        # without, the observer would see the motor stop for a cycle. How long that may last is the judge's affair
        angle += state.speed * late_ns * 1e-9
    return motor_observer.step(
        state,
        angle,
        axis.torque_to_accel * drive.current_a,
        dt,
        p.l_angle,
        p.l_speed,
        p.l_disturbance,
    )


def _learn_screws(
    state: EstimatorState, p: LawParams, base: BaseState, pitch: float, roll: float, azimuth: float, rate1: float, rate2: float
) -> tuple[ScrewMap, ScrewMap]:
    """One step of both screw maps, at the (lagged) joint angles that the frame belongs to."""
    l1, l2, j11, j21, j22 = rods_and_jacobian(pitch, roll, p.height_m, p.radius_m, p.static_radius_m)
    # innovations from base axes into those of the joints
    ca, sa = cos(azimuth), sin(azimuth)
    by_pitch = ca * base.pitch_innovation + sa * base.roll_innovation
    by_roll = ca * base.roll_innovation - sa * base.pitch_innovation
    share = p.base.angle_by_attitude
    return (
        screw_map.learn(
            state.screw_pitch,
            (l1 - p.level_m) / p.pitch.travel_per_rad_m * p.pitch.screw_per_rad,
            j11 * by_pitch,
            p.screw_rate if abs(rate1) > p.screw_speed_m_s else 0.0,
            share,
            p.screw_limit_m,
        ),
        screw_map.learn(
            state.screw_roll,
            (l2 - p.level_m) / p.roll.travel_per_rad_m * p.roll.screw_per_rad,
            j21 * by_pitch + j22 * by_roll,
            p.screw_rate if abs(rate2) > p.screw_speed_m_s else 0.0,
            share,
            p.screw_limit_m,
        ),
    )


def step(
    state: EstimatorState, p: LawParams, m: Measurement, gap_pitch: GapState, gap_roll: GapState, now_ns: int, dt: float
) -> tuple[Estimate, EstimatorState]:
    """One cycle. ``gap_*`` are the compensation's states of the previous cycle."""
    pitch = _motor(state.pitch, p.pitch, p, m.resolver_pitch, m.drive_pitch, now_ns, dt)
    roll = _motor(state.roll, p.roll, p, m.resolver_roll, m.drive_roll, now_ns, dt)
    t = m.temperature
    thermal1 = p.thermal_m_k * (t.screw_pitch_c - p.thermal_reference_c)
    thermal2 = p.thermal_m_k * (t.screw_roll_c - p.thermal_reference_c)
    # unpacked as a whole: a named field costs as much as unpacking ten
    (
        motor_pitch, motor_roll, before, lagged, base, screw_pitch, screw_roll, seq, stamp, pitch_rad, roll_rad, heading,
        platform_pitch_rate, platform_roll_rate, since, coasted, flank_pitch, flank_roll,
    ) = state  # fmt: skip
    angle1, speed1, disturbance1, _ = pitch
    angle2, speed2, disturbance2, _ = roll
    axis1, axis2 = p.pitch, p.roll
    travel1, travel2 = axis1.travel_per_rad_m, axis2.travel_per_rad_m
    rod1 = angle1 * travel1 + axis1.zero_offset_m + thermal1
    rod2 = angle2 * travel2 + axis2.zero_offset_m + thermal2
    rate1 = speed1 * travel1
    rate2 = speed2 * travel2
    if p.screw_rate:
        screw_per_rad1, screw_per_rad2 = axis1.screw_per_rad, axis2.screw_per_rad
        offset, slope = screw_map.error(screw_pitch, angle1 * screw_per_rad1)
        rod1 += offset
        rate1 += slope * speed1 * screw_per_rad1
        offset, slope = screw_map.error(screw_roll, angle2 * screw_per_rad2)
        rod2 += offset
        rate2 += slope * speed2 * screw_per_rad2
    screw1, screw2 = rod1, rod2
    gap = p.gap
    if gap is not None:
        _, _, _, _, gravity1, moving1 = gap_pitch
        _, _, _, _, gravity2, moving2 = gap_roll
        flank_pitch = backlash.follow(flank_pitch, gap, (angle1 - motor_pitch[0]) * travel1, gravity1, moving1)
        flank_roll = backlash.follow(flank_roll, gap, (angle2 - motor_roll[0]) * travel2, gravity2, moving2)
        _, offset, share = flank_pitch
        rod1 -= offset
        rate1 *= share
        _, offset, share = flank_roll
        rod2 -= offset
        rate2 *= share
    level, height, radius, static_radius = p.level_m, p.height_m, p.radius_m, p.static_radius_m
    l1, l2 = level + rod1, level + rod2
    try:
        joint_pitch, joint_roll = attitude_from_rods(l1, l2, height, radius, static_radius)
    except ValueError:
        # no attitude has these rods (a resolver jumped): keep the last pose, the supervisor judges the jump
        joint_pitch, joint_roll = before[0], before[1]
    j11, j21, j22 = jacobian(joint_pitch, joint_roll, l1, l2, height, radius, static_radius)
    pitch_rate = rate1 / j11
    roll_rate = (rate2 - j21 * pitch_rate) / j22
    azimuth_stamp, _, _, microsteps, microstep_rate, _, _, _ = m.azimuth
    rad_per_microstep, half_play = p.rad_per_microstep, p.azimuth_half_play_rad
    azimuth_rate = microstep_rate * rad_per_microstep
    # the stepper is served slowly: where it is now, not where it was at its stamp (25 deg/s for 10 ms under 15 deg of tilt are 4 arcmin)
    stepper = microsteps * rad_per_microstep + azimuth_rate * (now_ns - azimuth_stamp) * 1e-9
    azimuth_before = before[2]
    azimuth = backlash.play(azimuth_before, stepper, half_play)
    # while the gear crosses its play the platform does not turn: taken for a turn of the base, that would make the stepper chase itself
    if half_play and (azimuth - azimuth_before) * azimuth_rate <= 0.0:
        azimuth_rate = 0.0

    wx, wy, wz = joint_rates_to_body(joint_pitch, joint_roll, pitch_rate, roll_rate, azimuth_rate)
    if dt == p.period_s:
        (a, b, c), (d, e, f) = p.attitude_lag, p.gyro_lag
    else:
        (a, b, c), (d, e, f) = lag_step(p.attitude_lag_s, dt), lag_step(p.gyro_lag_s, dt)
    o0, o1, o2, o3, o4, o5 = lagged[-1]
    b0, b1, b2, b3, b4, b5 = before
    history = (
        *lagged[1:],
        (
            a * o0 + b * b0 + c * joint_pitch,
            a * o1 + b * b1 + c * joint_roll,
            a * o2 + b * b2 + c * azimuth,
            d * o3 + e * b3 + f * wx,
            d * o4 + e * b4 + f * wy,
            d * o5 + e * b5 + f * wz,
        ),
    )

    imu, g = m.imu, p.base
    since += dt
    attitude_dt = 0.0
    if imu.seq != seq and imu.valid:
        back, rest_ns = divmod(max(0, now_ns - imu.stamp_ns), round(p.period_s * 1e9))
        last = len(history) - 1
        j0, j1, j2, j3, j4, j5 = history[max(0, last - back)]
        if rest_ns and back < last:  # between two cycles
            w = rest_ns * 1e-9 / p.period_s
            i0, i1, i2, i3, i4, i5 = history[last - back - 1]
            j0, j1, j2 = j0 + w * (i0 - j0), j1 + w * (i1 - j1), j2 + w * (i2 - j2)
            j3, j4, j5 = j3 + w * (i3 - j3), j4 + w * (i4 - j4), j5 + w * (i5 - j5)
        gyro = (imu.gyro_x_rad_s, imu.gyro_y_rad_s, imu.gyro_z_rad_s)
        seen = base_observer.see(imu.roll_rad, imu.pitch_rad, gyro, (j0, j1, j2), (j3, j4, j5))
        if seq < 0:
            base = base_observer.start(seen)
            attitude_dt = p.imu_period_s
        else:
            base = base_observer.update(base, g, seen, (imu.stamp_ns - stamp) * 1e-9)
            attitude_dt = since
            if p.screw_rate:
                screw_pitch, screw_roll = _learn_screws(state, p, base, j0, j1, j2, rate1, rate2)
        seq, stamp, since = imu.seq, imu.stamp_ns, 0.0
        pitch_rad, roll_rad, heading = imu.pitch_rad, roll_from_imu(imu.roll_rad), imu.yaw_rad
        platform_pitch_rate, platform_roll_rate = imu.gyro_y_rad_s, -imu.gyro_x_rad_s
    age = (now_ns - stamp) * 1e-9
    reach = age if age < COAST_PREDICTION_S else COAST_PREDICTION_S
    base_pitch, base_roll, base_pitch_rate, base_roll_rate, base_yaw_rate, base_pitch_accel, base_roll_accel = base_observer.forecast(
        base, g, reach, reach + p.lead_s
    )
    coasting = False
    if attitude_dt == 0.0 and seq >= 0 and age > p.imu_delay_s + 1.5 * p.imu_period_s:
        # where the platform is follows from where the base is believed to be and what the joints do
        coasting = True
        before_pitch, before_roll = pitch_rad, roll_rad
        pitch_rad, roll_rad = platform_tilt(base_pitch, base_roll, azimuth, joint_pitch, joint_roll)
        platform_pitch_rate = (pitch_rad - before_pitch) / dt if coasted else platform_pitch_rate
        platform_roll_rate = (roll_rad - before_roll) / dt if coasted else platform_roll_rate
        heading = wrap_angle(heading + (base_yaw_rate + azimuth_rate) * dt)
        if since >= p.imu_period_s - 0.5 * dt:
            attitude_dt, since = since, 0.0

    estimate: Estimate = _new(
        Estimate,
        (
            pitch_rad,
            roll_rad,
            heading,
            platform_pitch_rate,
            platform_roll_rate,
            attitude_dt,
            joint_pitch,
            joint_roll,
            azimuth,
            pitch_rate,
            roll_rate,
            azimuth_rate,
            rod1,
            rod2,
            screw1,
            screw2,
            thermal1,
            thermal2,
            j11,
            j21,
            j22,
            speed1,
            speed2,
            disturbance1,
            disturbance2,
            base_pitch,
            base_roll,
            base_pitch_rate,
            base_roll_rate,
            base_yaw_rate,
            base_pitch_accel,
            base_roll_accel,
            age,
            coasting,
        ),
    )
    return estimate, _new(
        EstimatorState,
        (
            pitch,
            roll,
            (joint_pitch, joint_roll, azimuth, wx, wy, wz),
            history,
            base,
            screw_pitch,
            screw_roll,
            seq,
            stamp,
            pitch_rad,
            roll_rad,
            heading,
            platform_pitch_rate,
            platform_roll_rate,
            since,
            coasting,
            flank_pitch,
            flank_roll,
        ),
    )
