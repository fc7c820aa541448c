"""Judge what only the estimate shows: IMU against resolvers through the kinematics, and room to brake before the end of the stroke. A pure step."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, radians
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import Estimate
from spsp_ctrl.safety.faults import BY_ID, Fault

PART_RAD = radians(1.0)
"""Rms of the innovations of the carrier observer (healthy: 0.5 arcmin; a carrier that jerks: 10)."""
PART_MEMORY_S = 0.1
STOP_M = 0.5e-3
"""A rod may run so far past the travel that the law keeps to."""
OUTSIDE_M = 2e-3
BRAKE_MARGIN = 0.5
"""Braking distances are for this times the acceleration that brakes: a fault is declared when that is no longer enough."""

_APART, _TRAVEL, _NOT_REFERENCED = BY_ID["imu-resolver"], BY_ID["rod-travel"], BY_ID["not-referenced"]


@dataclass(frozen=True, slots=True)
class ConsistencyLimits:
    """Constants."""

    frame_share: float
    low_m: float
    high_m: float
    twice_accel_m_s2: float
    pitch_m_rad: float
    """Rod travel per motor angle."""
    roll_m_rad: float
    travel_ns: int


def consistency_limits(config: RigConfig) -> ConsistencyLimits:
    """From the rig file."""
    a, b = config.pitch_actuator, config.roll_actuator
    turn = 2.0 * 3.141592653589793
    return ConsistencyLimits(
        1.0 - exp(-1.0 / (config.imu.rate_hz * PART_MEMORY_S)),
        config.mechanism.stroke_min_mm * 1e-3,
        config.mechanism.stroke_max_mm * 1e-3,
        2.0 * config.limits.rod_accel_mm_s2 * 1e-3 / BRAKE_MARGIN,
        a.screw_lead_mm * 1e-3 / (turn * a.gear_ratio),
        b.screw_lead_mm * 1e-3 / (turn * b.gear_ratio),
        round(_TRAVEL.debounce_ms * 1e6),
    )


class ConsistencyState(NamedTuple):
    """Mean square of the innovations, and since when a rod has too little room (0: it has)."""

    part_rad2: float
    travel_since: int


START = ConsistencyState(0.0, 0)


def _cramped(rod_m: float, speed_m_s: float, p: ConsistencyLimits) -> bool:
    """Whether the rod is past its end and going on, or will be."""
    room = (p.high_m - rod_m if speed_m_s > 0.0 else rod_m - p.low_m) + STOP_M
    return speed_m_s * speed_m_s > p.twice_accel_m_s2 * room if room > 0.0 else speed_m_s != 0.0


def step(
    s: ConsistencyState, p: ConsistencyLimits, e: Estimate, innovation_sq: float, now_ns: int
) -> tuple[Fault | None, ConsistencyState]:
    """One cycle. ``innovation_sq`` is the sum of both squared attitude innovations of the newest frame."""
    part, since = s
    if e[5] > 0.0 and not e[-1]:
        part += p.frame_share * (innovation_sq - part)
    rod1, rod2 = e[12], e[13]
    fault: Fault | None = None
    if rod1 > p.high_m + OUTSIDE_M or rod1 < p.low_m - OUTSIDE_M or rod2 > p.high_m + OUTSIDE_M or rod2 < p.low_m - OUTSIDE_M:
        fault = _NOT_REFERENCED
    if part > PART_RAD * PART_RAD:
        fault = _APART
    if _cramped(rod1, e[21] * p.pitch_m_rad, p) or _cramped(rod2, e[22] * p.roll_m_rad, p):
        since = since or now_ns or 1
        if now_ns - since >= p.travel_ns:
            fault = _TRAVEL
    else:
        since = 0
    return fault, ConsistencyState(part, since)
