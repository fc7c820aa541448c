"""From a measurement to what the law needs: motor speeds, rods, joint angles and rates, base rate, attitude.

Base rate is what the gyro sees minus what the joints do, both taken at the same instant and through the same lag: a mismatch of half a
millisecond costs 0.35 arcmin at 15 deg / 8 s. It is filtered with its own slope by a fixed-gain filter and predicted to now, so that the
feed-forward is not late by the delay of the IMU.
"""

from __future__ import annotations

from typing import NamedTuple

from spsp_ctrl.control import motor_observer
from spsp_ctrl.control.backlash import GapState
from spsp_ctrl.control.motor_observer import MotorState
from spsp_ctrl.control.params import AxisParams, LawParams
from spsp_ctrl.mechanism.frames import joint_rates_to_body, roll_from_imu, wrap_angle
from spsp_ctrl.mechanism.kinematics import attitude_from_rods, jacobian
from spsp_ctrl.messages import DriveSample, Estimate, Measurement, ResolverSample

COAST_PREDICTION_S = 0.1
"""Base acceleration is extrapolated no longer than this; then the base rate is held."""

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
_new = tuple.__new__


class EstimatorState(NamedTuple):
    """Memory of the estimator."""

    pitch: MotorState
    roll: MotorState
    joint_lagged: Vector
    """Body rate by the joints through the gyro's lag."""
    history: tuple[Vector, ...]
    """The last values of ``joint_lagged``, newest last: aligned with the delayed gyro."""
    base_rate: Vector
    base_accel: Vector
    imu_seq: int
    imu_stamp_ns: int
    pitch_rad: float
    roll_rad: float
    heading_rad: float
    pitch_rate: float
    roll_rate: float
    since_attitude_s: float
    joint_pitch_rad: float
    joint_roll_rad: float


def history_length(p: LawParams) -> int:
    """Cycles of joint motion to remember: delay of the IMU plus one frame and slack."""
    return int((p.imu_delay_s + p.imu_period_s) / p.period_s) + 4


def start(measurement: Measurement, p: LawParams) -> EstimatorState:
    """At rest where the resolvers say the motors are."""
    return EstimatorState(
        pitch=motor_observer.start(measurement.resolver_pitch.counts * p.pitch.rad_per_count),
        roll=motor_observer.start(measurement.resolver_roll.counts * p.roll.rad_per_count),
        joint_lagged=ZERO,
        history=(ZERO,) * history_length(p),
        base_rate=ZERO,
        base_accel=ZERO,
        imu_seq=-1,
        imu_stamp_ns=0,
        pitch_rad=0.0,
        roll_rad=0.0,
        heading_rad=0.0,
        pitch_rate=0.0,
        roll_rate=0.0,
        since_attitude_s=0.0,
        joint_pitch_rad=0.0,
        joint_roll_rad=0.0,
    )


def _motor(
    state: MotorState, axis: AxisParams, p: LawParams, resolver: ResolverSample, drive: DriveSample, dt: float
) -> MotorState:
    return motor_observer.step(
        state,
        resolver.counts * axis.rad_per_count,
        axis.torque_to_accel * drive.current_a,
        dt,
        p.l_angle,
        p.l_speed,
        p.l_disturbance,
    )


def step(
    state: EstimatorState, p: LawParams, m: Measurement, gap_pitch: GapState, gap_roll: GapState, now_ns: int, dt: float
) -> tuple[Estimate, EstimatorState]:
    """One cycle. ``gap_*`` are the compensation's states of the previous cycle."""
    pitch = _motor(state.pitch, p.pitch, p, m.resolver_pitch, m.drive_pitch, dt)
    roll = _motor(state.roll, p.roll, p, m.resolver_roll, m.drive_roll, dt)
    t = m.temperature
    rod1 = pitch.angle * p.pitch.travel_per_rad_m + p.pitch.zero_offset_m - gap_pitch.offset_m
    rod2 = roll.angle * p.roll.travel_per_rad_m + p.roll.zero_offset_m - gap_roll.offset_m
    thermal1 = p.thermal_m_k * (t.screw_pitch_c - p.thermal_reference_c)
    thermal2 = p.thermal_m_k * (t.screw_roll_c - p.thermal_reference_c)
    rod1 += thermal1
    rod2 += thermal2
    rate1 = pitch.speed * p.pitch.travel_per_rad_m - gap_pitch.rate_m_s
    rate2 = roll.speed * p.roll.travel_per_rad_m - gap_roll.rate_m_s
    l1, l2 = p.level_m + rod1, p.level_m + rod2
    try:
        joint_pitch, joint_roll = attitude_from_rods(l1, l2, p.height_m, p.radius_m, p.static_radius_m)
    except ValueError:
        # no attitude has these rods (a resolver jumped): keep the last pose, the supervisor judges the jump
        joint_pitch, joint_roll = state.joint_pitch_rad, state.joint_roll_rad
    j11, j21, j22 = jacobian(joint_pitch, joint_roll, l1, l2, p.height_m, p.radius_m, p.static_radius_m)
    pitch_rate = rate1 / j11
    roll_rate = (rate2 - j21 * pitch_rate) / j22
    azimuth = m.azimuth.microsteps * p.rad_per_microstep
    azimuth_rate = m.azimuth.rate_microsteps_s * p.rad_per_microstep

    body = joint_rates_to_body(joint_pitch, joint_roll, pitch_rate, roll_rate, azimuth_rate)
    a = p.gyro_lag_decay if dt == p.period_s else p.gyro_lag_decay ** (dt / p.period_s)
    b = 1.0 - a
    old = state.joint_lagged
    lagged = (a * old[0] + b * body[0], a * old[1] + b * body[1], a * old[2] + b * body[2])
    history = (*state.history[1:], lagged)

    base_rate, base_accel = state.base_rate, state.base_accel
    imu = m.imu
    since = state.since_attitude_s + dt
    attitude_dt = 0.0
    seq, stamp = state.imu_seq, state.imu_stamp_ns
    pitch_rad, roll_rad, heading = state.pitch_rad, state.roll_rad, state.heading_rad
    platform_pitch_rate, platform_roll_rate = state.pitch_rate, state.roll_rate
    coasting = False
    if imu.seq != seq and imu.valid:
        back = round((now_ns - imu.stamp_ns) * 1e-9 / p.period_s)
        joints = history[max(0, len(history) - 1 - back)]
        seen = (imu.gyro_x_rad_s - joints[0], imu.gyro_y_rad_s - joints[1], imu.gyro_z_rad_s - joints[2])
        if seq < 0:
            base_rate, base_accel = seen, ZERO
            attitude_dt = p.imu_period_s
        else:
            frame_dt = (imu.stamp_ns - stamp) * 1e-9
            predicted = (
                base_rate[0] + frame_dt * base_accel[0],
                base_rate[1] + frame_dt * base_accel[1],
                base_rate[2] + frame_dt * base_accel[2],
            )
            e0, e1, e2 = seen[0] - predicted[0], seen[1] - predicted[1], seen[2] - predicted[2]
            g, h = p.l_rate, p.l_accel
            base_rate = (predicted[0] + g * e0, predicted[1] + g * e1, predicted[2] + g * e2)
            base_accel = (base_accel[0] + h * e0, base_accel[1] + h * e1, base_accel[2] + h * e2)
            attitude_dt = since
        seq, stamp, since = imu.seq, imu.stamp_ns, 0.0
        pitch_rad, roll_rad, heading = imu.pitch_rad, roll_from_imu(imu.roll_rad), imu.yaw_rad
        platform_pitch_rate, platform_roll_rate = imu.gyro_y_rad_s, -imu.gyro_x_rad_s
    age = (now_ns - stamp) * 1e-9
    ahead = min(age + p.gyro_lag_s, COAST_PREDICTION_S) + p.lead_s
    now_rate = (
        base_rate[0] + ahead * base_accel[0],
        base_rate[1] + ahead * base_accel[1],
        base_rate[2] + ahead * base_accel[2],
    )
    if attitude_dt == 0.0 and seq >= 0 and age > p.imu_delay_s + 1.5 * p.imu_period_s:
        coasting = True
        platform_pitch_rate = now_rate[1] + body[1]
        platform_roll_rate = -(now_rate[0] + body[0])
        pitch_rad += platform_pitch_rate * dt
        roll_rad += platform_roll_rate * dt
        heading = wrap_angle(heading + (now_rate[2] + body[2]) * dt)
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
            thermal1,
            thermal2,
            j11,
            j21,
            j22,
            pitch.speed,
            roll.speed,
            now_rate[0],
            now_rate[1],
            now_rate[2],
            base_accel[0],
            base_accel[1],
            age,
            coasting,
        ),
    )
    return estimate, _new(
        EstimatorState,
        (
            pitch,
            roll,
            lagged,
            history,
            base_rate,
            base_accel,
            seq,
            stamp,
            pitch_rad,
            roll_rad,
            heading,
            platform_pitch_rate,
            platform_roll_rate,
            since,
            joint_pitch,
            joint_roll,
        ),
    )
