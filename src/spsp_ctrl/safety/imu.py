"""Judge the IMU, frame by frame, before anything uses it. A pure step.

A bad frame never replaces a good one: it is dropped and the loop coasts, until the newest good frame is too old. The fault then carries the reason
why frames were dropped. Attitude and integrated gyro, two ways to the same motion, are held against each other in a leaky sum.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, isfinite, pi, radians, sin
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import NO_IMU, ImuSample
from spsp_ctrl.safety.faults import BY_ID, Fault

ATTITUDE_LIMIT_RAD = radians(60.0)
RATE_LIMIT_RAD_S = radians(200.0)
PART_RAD = radians(20.0 / 60.0)
"""Attitude and integrated gyro may part by this much; healthy units stay below 1 arcmin."""
PART_MEMORY_S = 0.5
NOISE_RAD = radians(2.0 / 60.0)
"""Rms of that contradiction from frame to frame (healthy: 0.07 arcmin)."""
GYRO_STEP_RAD_S = radians(1.5)
"""Rms of the second difference of a gyro channel, in which smooth motion cancels (healthy: 0.06 deg/s)."""
NOISE_MEMORY_S = 0.1
DENSITY_SHARE = 0.15
"""Overdue for more than this share of the time fills the bucket."""
ATTITUDE_STUCK = 5
"""Attitudes are coarser than rates: so many times more frames may be equal."""
OVERDUE_PERIODS = 1.5
LATE_CYCLES = 4
"""Slack of the estimator's memory of joint angles."""

_STALE, _INVALID, _RANGE, _GYRO = BY_ID["imu-stale"], BY_ID["imu-invalid"], BY_ID["imu-range"], BY_ID["imu-gyro"]
_NOISE, _STUCK, _DENSITY = BY_ID["imu-noise"], BY_ID["imu-stuck"], BY_ID["imu-density"]
_new = tuple.__new__


@dataclass(frozen=True, slots=True)
class ImuLimits:
    """Constants."""

    stale_ns: int
    """Normal age and what the loop may coast."""
    overdue_ns: int
    late_ns: int
    """A frame older than this when it arrives is of no use: the joint angles of its time are forgotten."""
    stuck_frames: int
    """Equal gyro frames in a row that count as stuck; 0 switches that off."""
    noisy_frames: int
    """Noisy for so many frames. A law that chatters shakes the unit too, and gives way to a plainer one within ``control.watch.window_s``."""
    density_s: float


def imu_limits(config: RigConfig) -> ImuLimits:
    """From the rig file."""
    period_ms = 1e3 / config.imu.rate_hz
    s = config.supervisor
    return ImuLimits(
        round((config.imu.delay_ms + period_ms + s.imu_timeout_ms) * 1e6),
        round((config.imu.delay_ms + OVERDUE_PERIODS * period_ms) * 1e6),
        round((config.imu.delay_ms + period_ms) * 1e6) + round(LATE_CYCLES * 1e9 / config.rate_hz),
        s.imu_stuck_frames,
        round(_NOISE.debounce_ms * 1e-3 * config.imu.rate_hz),
        _DENSITY.debounce_ms * 1e-3,
    )


class ImuState(NamedTuple):
    """Newest good frame, sequence and stamp of the newest of all, and what is summed up."""

    good: ImuSample
    seq: int
    why: Fault | None
    """Why frames are being dropped."""
    part_roll: float
    """Leaky sum of attitude less integrated gyro."""
    part_pitch: float
    part_yaw: float
    noise_rad2: float
    gyro_power: float
    step_x: float
    """Last change of each gyro channel."""
    step_y: float
    step_z: float
    same_gyro: int
    """Frames for which the least lively channel has not changed."""
    same_attitude: int
    overdue_s: float
    still: tuple[int, int, int, int, int, int]
    """The same for each channel: attitude, then gyro."""
    fault: Fault | None
    """What the newest frame has shown; it holds until the next."""
    noisy: int
    """Noisy frames in a row."""


START = ImuState(NO_IMU, -1, None, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, (0, 0, 0, 0, 0, 0), None, 0)


def _turned(angle: float) -> float:
    return angle - 2.0 * pi if angle > pi else angle + 2.0 * pi if angle < -pi else angle


def _against_gyro(a: ImuSample, b: ImuSample, dt: float) -> tuple[float, float, float]:
    """Attitude change from ``a`` to ``b`` less what the mean gyro makes of it."""
    p = 0.5 * (a.gyro_x_rad_s + b.gyro_x_rad_s)
    q = 0.5 * (a.gyro_y_rad_s + b.gyro_y_rad_s)
    r = 0.5 * (a.gyro_z_rad_s + b.gyro_z_rad_s)
    roll, pitch = 0.5 * (a.roll_rad + b.roll_rad), 0.5 * (a.pitch_rad + b.pitch_rad)
    cr, sr = cos(roll), sin(roll)
    yaw_rate = (q * sr + r * cr) / cos(pitch)
    return (
        b.roll_rad - a.roll_rad - (p + yaw_rate * sin(pitch)) * dt,
        b.pitch_rad - a.pitch_rad - (q * cr - r * sr) * dt,
        _turned(b.yaw_rad - a.yaw_rad) - yaw_rate * dt,
    )


def _form(frame: ImuSample, last_seq: int, good: ImuSample, now_ns: int) -> Fault | None:
    """What can be said of a frame by itself."""
    stamp, _, seq, valid, roll, pitch, yaw, gx, gy, gz = frame
    if not valid or seq <= last_seq or stamp > now_ns or (good.seq >= 0 and stamp <= good.stamp_ns):
        return _INVALID
    if not isfinite(roll + pitch + yaw + gx + gy + gz):
        return _INVALID
    if abs(roll) > ATTITUDE_LIMIT_RAD or abs(pitch) > ATTITUDE_LIMIT_RAD or abs(yaw) > 2.0 * pi:
        return _RANGE
    if abs(gx) > RATE_LIMIT_RAD_S or abs(gy) > RATE_LIMIT_RAD_S or abs(gz) > RATE_LIMIT_RAD_S:
        return _RANGE
    return None


def _take(s: ImuState, p: ImuLimits, frame: ImuSample, now_ns: int) -> ImuState:
    """One new frame."""
    wrong = _form(frame, s.seq, s.good, now_ns)
    if wrong is None and now_ns - frame.stamp_ns > p.late_ns:
        wrong = _DENSITY
    if wrong is not None:
        # a unit that has restarted counts from zero: once the coasting is over its frames are judged afresh
        seq = s.seq if frame.seq > s.seq or now_ns - s.good.stamp_ns <= p.stale_ns else frame.seq
        return s._replace(seq=max(seq, frame.seq) if frame.seq > s.seq else seq, why=wrong)
    good = s.good
    if good.seq < 0 or now_ns - good.stamp_ns > p.stale_ns:
        return START._replace(good=frame, seq=frame.seq, overdue_s=s.overdue_s)
    dt = (frame.stamp_ns - good.stamp_ns) * 1e-9
    keep = exp(-dt / PART_MEMORY_S)
    d_roll, d_pitch, d_yaw = _against_gyro(good, frame, dt)
    part_roll, part_pitch, part_yaw = s.part_roll * keep + d_roll, s.part_pitch * keep + d_pitch, s.part_yaw * keep + d_yaw
    if abs(part_roll) > PART_RAD or abs(part_pitch) > PART_RAD or abs(part_yaw) > PART_RAD:
        # from here on nobody knows which of the two is right
        return s._replace(seq=frame.seq, why=_GYRO)
    share = 1.0 - exp(-dt / NOISE_MEMORY_S)
    noise = s.noise_rad2 + share * (d_roll * d_roll + d_pitch * d_pitch + d_yaw * d_yaw - s.noise_rad2)
    step_x, step_y, step_z = frame.gyro_x_rad_s - good.gyro_x_rad_s, frame.gyro_y_rad_s - good.gyro_y_rad_s, frame.gyro_z_rad_s - good.gyro_z_rad_s
    jerk_x, jerk_y, jerk_z = step_x - s.step_x, step_y - s.step_y, step_z - s.step_z
    gyro = s.gyro_power + share * (jerk_x * jerk_x + jerk_y * jerk_y + jerk_z * jerk_z - s.gyro_power)
    a, b, c, d, e, f = s.still
    still = (
        a + 1 if frame.roll_rad == good.roll_rad else 0,
        b + 1 if frame.pitch_rad == good.pitch_rad else 0,
        c + 1 if frame.yaw_rad == good.yaw_rad else 0,
        d + 1 if step_x == 0.0 else 0,
        e + 1 if step_y == 0.0 else 0,
        f + 1 if step_z == 0.0 else 0,
    )
    same_attitude, same_gyro = max(still[:3]), max(still[3:])
    fault: Fault | None = None
    if p.stuck_frames and (same_gyro >= p.stuck_frames or same_attitude >= ATTITUDE_STUCK * p.stuck_frames):
        fault = _STUCK
    noisy = s.noisy + 1 if noise > NOISE_RAD * NOISE_RAD or gyro > GYRO_STEP_RAD_S * GYRO_STEP_RAD_S else 0
    if fault is None and noisy >= p.noisy_frames:
        fault = _NOISE
    return ImuState(
        frame, frame.seq, None, part_roll, part_pitch, part_yaw, noise, gyro, step_x, step_y, step_z, same_gyro, same_attitude, s.overdue_s,
        still, fault, noisy,
    )  # fmt: skip


def step(s: ImuState, p: ImuLimits, frame: ImuSample, now_ns: int, dt: float) -> tuple[Fault | None, ImuState]:
    """One cycle with the newest frame that the rig has. What the law may use is ``state.good``."""
    if frame[2] != s[1] and frame[2] >= 0:
        s = _take(s, p, frame, now_ns)
    fault = s[15]
    age = now_ns - s[0][0]
    overdue = s[13]
    if age > p.overdue_ns or s[0][2] < 0:
        overdue += dt
        s = s._replace(overdue_s=overdue)
        if s.good.seq < 0 or age > p.stale_ns:
            return s.why or _STALE, s
    elif overdue > 0.0:
        overdue = max(0.0, overdue - DENSITY_SHARE / (1.0 - DENSITY_SHARE) * dt)
        s = s._replace(overdue_s=overdue)
    if fault is None and overdue > p.density_s:
        fault = s.why or _DENSITY
    return fault, s
