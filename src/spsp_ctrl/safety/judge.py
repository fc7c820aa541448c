"""Judge every signal of a measurement before anything uses it, and hand on only what can be believed. A pure step.

Bad data never overwrites good: the measurement that comes out holds the last good IMU frame and temperature, and resolver angles carried on over
missing or impossible ones. The raw measurement stays in the log.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import NO_DRIVE, Command, Estimate, Measurement
from spsp_ctrl.safety import axis, azimuth, consistency, imu, temperature
from spsp_ctrl.safety.axis import AxisLimits, AxisState, Told, axis_limits, used_resolver
from spsp_ctrl.safety.azimuth import AzimuthLimits, AzimuthState, azimuth_limits
from spsp_ctrl.safety.consistency import ConsistencyLimits, ConsistencyState, consistency_limits
from spsp_ctrl.safety.faults import BY_ID, FAULTS, Fault, Reaction
from spsp_ctrl.safety.imu import ImuLimits, ImuState, imu_limits
from spsp_ctrl.safety.temperature import TemperatureLimits, TemperatureState, temperature_limits

LATE_S = 0.02
LATE_SHARE = 0.04
"""Cycles left out: more than this share of the time fills a bucket of ``LATE_S``."""
_LATE = BY_ID["loop-late"]
_new = tuple.__new__


@dataclass(frozen=True, slots=True)
class JudgeLimits:
    """Constants of a session."""

    imu: ImuLimits
    pitch: AxisLimits
    roll: AxisLimits
    azimuth: AzimuthLimits
    temperature: TemperatureLimits
    consistency: ConsistencyLimits
    period_s: float


def judge_limits(config: RigConfig) -> JudgeLimits:
    """From the rig file."""
    return JudgeLimits(
        imu_limits(config),
        axis_limits(config, config.pitch_actuator),
        axis_limits(config, config.roll_actuator),
        azimuth_limits(config),
        temperature_limits(config),
        consistency_limits(config),
        1.0 / config.rate_hz,
    )


class JudgeState(NamedTuple):
    """Memory between cycles."""

    imu: ImuState
    pitch: AxisState
    roll: AxisState
    azimuth: AzimuthState
    temperature: TemperatureState
    consistency: ConsistencyState
    late_s: float
    last: Command | None
    """The command of the last cycle, and the one before: this measurement shows them."""
    before: Command | None
    speed_pitch_rad_s: float
    """Motor speeds asked for in the last cycle."""
    speed_roll_rad_s: float
    turned_rad: float
    """Azimuth travel commanded since its last frame."""


START = JudgeState(imu.START, axis.START, axis.START, azimuth.START, temperature.START, consistency.START, 0.0, None, None, 0.0, 0.0, 0.0)


class Found(NamedTuple):
    """Every fault of this cycle that a part has named; most are None."""

    pitch: Fault | None
    roll: Fault | None
    imu: Fault | None
    azimuth: Fault | None
    temperature: Fault | None
    late: Fault | None


NOTHING = Found(None, None, None, None, None, None)


def gravest(found: tuple[Fault | None, ...]) -> Fault | None:
    """The one with the strongest reaction; the first of equals."""
    worst: Fault | None = None
    for fault in found:
        if fault is not None and (worst is None or fault.reaction > worst.reaction):
            worst = fault
    return worst


def bits(found: tuple[Fault | None, ...]) -> int:
    """Faults as bits, ``1 << number``: what is said to the operator although the run goes on."""
    mask = 0
    for fault in found:
        if fault is not None:
            mask |= 1 << fault.number
    return mask


def judge(s: JudgeState, p: JudgeLimits, m: Measurement, homed: bool, now_ns: int, dt: float) -> tuple[Found, Measurement, JudgeState]:
    """What is wrong, what may be used, and the memory. ``homed``: the azimuth count is known to be its angle."""
    s_imu, s_pitch, s_roll, s_azimuth, s_temperature, s_consistency, late, last, before, speed1, speed2, turned = s
    stamp, cycle, _, _, _, drive1, drive2, stepper, _, base = m
    if last is not None and before is not None:
        on = last[2]
        settled = on == before[2]
        told1 = _new(Told, (speed1, before[3], on, settled))
        told2 = _new(Told, (speed2, before[5], on, settled))
        turned += before[7] * dt
    else:
        on, told1, told2 = False, _IDLE, _IDLE
    pitch_fault, s_pitch = axis.step(s_pitch, p.pitch, m[3], drive1, told1, now_ns, dt)
    roll_fault, s_roll = axis.step(s_roll, p.roll, m[4], drive2, told2, now_ns, dt)
    imu_fault, s_imu = imu.step(s_imu, p.imu, m[2], now_ns, dt)
    counted = s_azimuth[1]
    azimuth_fault, s_azimuth = azimuth.step(s_azimuth, p.azimuth, stepper, turned, on, homed, now_ns, dt)
    if s_azimuth[1] != counted:
        turned = 0.0
    temperature_fault, s_temperature = temperature.step(s_temperature, p.temperature, m[8], now_ns)
    out = dt - 1.5 * p.period_s
    late_fault = None
    if out > 0.0:
        late += dt - p.period_s
        if late > LATE_S:
            late_fault = _LATE
    elif late > 0.0:
        late = max(0.0, late - LATE_SHARE * dt)
    used: Measurement = _new(
        Measurement,
        (
            stamp,
            cycle,
            s_imu[0],
            used_resolver(s_pitch, p.pitch, now_ns),
            used_resolver(s_roll, p.roll, now_ns),
            s_pitch[16] or NO_DRIVE,
            s_roll[16] or NO_DRIVE,
            s_azimuth[0],
            s_temperature[0],
            base,
        ),
    )
    found: Found = _new(Found, (pitch_fault, roll_fault, imu_fault, azimuth_fault, temperature_fault, late_fault))
    return found, used, _new(
        JudgeState, (s_imu, s_pitch, s_roll, s_azimuth, s_temperature, s_consistency, late, last, before, speed1, speed2, turned)
    )


_IDLE = Told(0.0, 0.0, False, False)


def estimate_is_finite(e: Estimate) -> bool:
    """Whether every number that reaches the law is finite."""
    return isfinite(sum(e))


def command_is_finite(c: Command) -> bool:
    """Whether every number that would reach a drive is finite."""
    return isfinite(
        c.pitch_current_a + c.pitch_speed_rad_s + c.roll_current_a + c.roll_speed_rad_s + c.azimuth_rate_rad_s
    )


def hold_faults() -> tuple[Fault, ...]:
    """Rows that do not stop a run."""
    return tuple(f for f in FAULTS if f.reaction == Reaction.HOLD)
