"""Judge resolver and drive of one actuator, before anything uses them. A pure step.

A resolver angle is only believed when its converter is content and the motor could have got there; otherwise the last motion is carried on for at
most ``coast`` samples. Commanded and measured travel are held against each other in a leaky sum, the measured current against the
command of that cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, pi
from typing import NamedTuple

from spsp_ctrl.config.rig import Actuator, RigConfig
from spsp_ctrl.messages import NO_RESOLVER, DriveSample, ResolverSample
from spsp_ctrl.safety.faults import BY_ID, Fault

FOLLOW_MEMORY_S = 0.1
FOLLOW_RAD = 1.5
FOLLOW_S = 0.02
"""The following error may be ``FOLLOW_RAD`` and this time of speed (healthy: 0.25 rad)."""
STUCK_RAD = 0.15
NOISE_COUNTS = 25.0
"""At 14 bits; rms of what is left of a step beyond full current and the stamp (healthy: 0)."""
NOISE_MEMORY_S = 0.05
REACH_MARGIN = 1.9
"""Times what full current can do by the rig file: torque constant and inertia may each be 30 % off."""
STAMP_CYCLES = 0.25
"""A stamp on wires is off by so much of a cycle, and an angle in motion with it."""
JUMP_MARGIN = 3.0
"""Times what full current can do."""
JUMP_COUNTS = 20.0
"""At 14 bits; noise on top."""
CURRENT_MEMORY_S = 0.02
CURRENT_ERROR_A = 0.75
"""At ``limits.current_a`` of 6 A: an eighth of it (healthy: 0.02 A)."""
CURRENT_RMS_A = 1.5
"""The same, rms: a command that arrives disturbed."""
OVERCURRENT = 1.25
DENSITY_SHARE = 0.15
SWITCH_NS = 150_000_000
"""A drive may take so long to show that it was switched (heartbeats of 100 ms); once shown, it must stay."""

_R_STALE, _R_FAULT, _R_JUMP, _R_STUCK = BY_ID["resolver-stale"], BY_ID["resolver-fault"], BY_ID["resolver-jump"], BY_ID["resolver-stuck"]
_R_NOISE, _R_DENSITY, _FOLLOWING = BY_ID["resolver-noise"], BY_ID["resolver-density"], BY_ID["following-error"]
_D_STALE, _D_FAULT, _D_STATE, _D_DENSITY = BY_ID["drive-stale"], BY_ID["drive-fault"], BY_ID["drive-state"], BY_ID["drive-density"]
_OVERCURRENT, _CURRENT, _SUPPLY, _NOT_FINITE = BY_ID["overcurrent"], BY_ID["current-error"], BY_ID["supply"], BY_ID["not-finite"]
_new = tuple.__new__


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Constants of one actuator."""

    stale_ns: int
    coast: int
    per_ns: float
    """Cycles per ns."""
    rad_per_count: float
    reach_counts_cycle2: float
    """What full current may do to the step of a cycle."""
    jump_counts_cycle2: float
    jump_counts: float
    noise_counts2: float
    follow_keep: float
    noise_share: float
    current_share: float
    over_a: float
    current_error_a: float
    current_power_a2: float
    torque_mode: bool
    supply_min_v: float
    supply_max_v: float
    density_s: float
    state_ns: int
    over_ns: int
    supply_ns: int
    converter_ns: int


def axis_limits(config: RigConfig, actuator: Actuator) -> AxisLimits:
    """From the rig file."""
    s, period_s = config.supervisor, 1.0 / config.rate_hz
    rad = 2.0 * pi / 2**actuator.resolver_bits
    fine = 2.0 ** (actuator.resolver_bits - 14)
    accel = actuator.torque_constant_nm_a * config.limits.current_a / actuator.rotor_inertia_kg_m2
    return AxisLimits(
        round(s.signal_timeout_ms * 1e6),
        s.coast_samples,
        config.rate_hz * 1e-9,
        rad,
        REACH_MARGIN * accel / rad * period_s * period_s,
        JUMP_MARGIN * accel / rad * period_s * period_s,
        JUMP_COUNTS * fine,
        (NOISE_COUNTS * fine) ** 2,
        exp(-period_s / FOLLOW_MEMORY_S),
        1.0 - exp(-period_s / NOISE_MEMORY_S),
        1.0 - exp(-period_s / CURRENT_MEMORY_S),
        OVERCURRENT * config.limits.current_a,
        CURRENT_ERROR_A * config.limits.current_a / 6.0,
        (CURRENT_RMS_A * config.limits.current_a / 6.0) ** 2,
        actuator.mode == "torque",
        s.supply_min_v,
        s.supply_max_v,
        _R_DENSITY.debounce_ms * 1e-3,
        round(_D_STATE.debounce_ms * 1e6),
        round(_OVERCURRENT.debounce_ms * 1e6),
        round(_SUPPLY.debounce_ms * 1e6),
        round(_R_FAULT.debounce_ms * 1e6),
    )


class AxisState(NamedTuple):
    """Newest good angle and its motion, what is summed up, and since when conditions hold (``0``: they do not)."""

    resolver: ResolverSample
    """What the law may use."""
    step: float
    """Counts per cycle that it moves on with."""
    known: int
    """Good angles so far, up to 2: a motion takes two."""
    bad: int
    """Angles carried on in a row."""
    noise_counts2: float
    idle_rad: float
    """Travel commanded since the angle last changed."""
    follow_rad: float
    resolver_gap_s: float
    """Bucket of missing or bad resolver frames."""
    drive_seq: int
    drive_gap_s: float
    current_error_a: float
    converter_since: int
    state_since: int
    over_since: int
    supply_since: int
    seq: int
    """Sequence of the newest resolver frame of all."""
    drive: DriveSample | None
    """Newest good status: what the law may use."""
    current_power_a2: float
    doubted: int
    """Of the angles carried on, those that came and were not believed: they give the motor no more time to get there."""
    agreed: bool
    """The drive has shown what it was told since it was told."""


START = AxisState(NO_RESOLVER, 0.0, 0, 0, 0.0, 0.0, 0.0, 0.0, -1, 0.0, 0.0, 0, 0, 0, 0, -1, None, 0.0, 0, False)


class Told(NamedTuple):
    """What the drive was told: motor speed asked for in the last cycle, current and enable of the command that acts on this measurement."""

    speed_rad_s: float
    current_a: float
    enable: bool
    settled: bool
    """The power stage has been told the same for longer than one cycle."""


def step(
    s: AxisState, p: AxisLimits, resolver: ResolverSample, drive: DriveSample, told: Told, now_ns: int, dt: float
) -> tuple[Fault | None, AxisState]:
    """One cycle."""
    (
        good, motion, known, bad, noise, idle, follow, gap, drive_seq, drive_gap, current_error,
        converter_since, state_since, over_since, supply_since, last_seq, good_drive, power, doubted, agreed,
    ) = s  # fmt: skip
    stamp, seq, counts, status = resolver
    told_speed, told_current, told_on, settled = told
    fault: Fault | None = None

    # resolver: converter bits first, then whether the motor can have got there
    drop = DENSITY_SHARE / (1.0 - DENSITY_SHARE) * dt
    old_counts = good[2]
    fresh = seq > last_seq and stamp <= now_ns
    believed = False
    n = 1.0
    if fresh and not status:
        n = (stamp - good[0]) * p.per_ns
        off = counts - old_counts - n * motion
        free = n - doubted
        if known < 2 or (n > 0.0 and abs(off) <= p.jump_counts + p.jump_counts_cycle2 * free * free):
            believed = True
            if known >= 2 and not bad:
                left = abs(off) - p.reach_counts_cycle2 * n * n - STAMP_CYCLES * abs(motion)
                noise += p.noise_share * ((left * left if left > 0.0 else 0.0) - noise)
    if status:
        converter_since = converter_since or now_ns or 1
        if now_ns - converter_since >= p.converter_ns:
            fault = _R_FAULT
    else:
        converter_since = 0
    now_step = 0.0
    if believed:
        now_step = (counts - old_counts) / n if known and n > 0.0 else 0.0
        idle = idle + abs(told_speed) * dt if counts == old_counts else 0.0
        good, motion, known, bad, doubted, last_seq = resolver, now_step, min(2, known + 1), 0, 0, seq
        gap = gap - drop if gap > drop else 0.0
    else:
        bad += 1
        gap += dt
        if seq > last_seq:
            last_seq = seq
            doubted += 1
        if bad > p.coast and fault is None:
            # missing frames are stale, frames that came and were not believed have jumped
            fault = (_R_FAULT if status else _R_JUMP) if fresh else _R_STALE
        if bad > p.coast and fresh and not status:
            # it stays there: a rig at rest is judged anew from here on
            good, motion, known, bad, doubted = resolver, 0.0, 1, 0, 0
    if now_ns - stamp > p.stale_ns or seq < 0:
        fault = fault or _R_STALE
    if fault is None:
        if gap > p.density_s:
            fault = _R_DENSITY
        elif noise > p.noise_counts2:
            fault = _R_NOISE
        elif idle > STUCK_RAD and told_on:
            fault = _R_STUCK
    if told_on and settled:
        follow = follow * p.follow_keep + told_speed * dt - (now_step if believed else motion) * p.rad_per_count
        if fault is None and abs(follow) > FOLLOW_RAD + FOLLOW_S * abs(told_speed):
            fault = _FOLLOWING
    else:
        follow = idle = 0.0

    # drive
    d_stamp, d_seq, d_on, d_code, current, bus_v = drive
    if d_seq > drive_seq and d_stamp <= now_ns:
        drive_gap = drive_gap - drop if drive_gap > drop else 0.0
        drive_seq = d_seq
        if not isfinite(current + bus_v):
            fault = fault or _NOT_FINITE
        else:
            good_drive = drive
            if not (p.torque_mode and told_on and settled):
                current_error = power = 0.0
            elif d_on:
                away = current - told_current
                current_error += p.current_share * (away - current_error)
                power += p.current_share * (away * away - power)
    else:
        drive_gap += dt
        if d_seq >= 0 and drive_gap > p.density_s:
            fault = fault or _D_DENSITY
    if d_seq < 0 or now_ns - d_stamp > p.stale_ns:
        fault = fault or _D_STALE
    if d_code:
        fault = fault or _D_FAULT
    if not settled:
        agreed, state_since = d_on == told_on, 0
    elif d_on != told_on:
        state_since = state_since or now_ns or 1
        if now_ns - state_since >= (p.state_ns if agreed else SWITCH_NS):
            fault = fault or _D_STATE
    else:
        agreed, state_since = True, 0
    if current > p.over_a or -current > p.over_a:
        over_since = over_since or now_ns or 1
        if now_ns - over_since >= p.over_ns:
            fault = fault or _OVERCURRENT
    else:
        over_since = 0
    if current_error > p.current_error_a or -current_error > p.current_error_a or power > p.current_power_a2:
        fault = fault or _CURRENT
    if bus_v < p.supply_min_v or bus_v > p.supply_max_v:
        supply_since = supply_since or now_ns or 1
        if now_ns - supply_since >= p.supply_ns:
            fault = fault or _SUPPLY
    else:
        supply_since = 0
    return fault, _new(
        AxisState,
        (
            good, motion, known, bad, noise, idle, follow, gap, drive_seq, drive_gap, current_error,
            converter_since, state_since, over_since, supply_since, last_seq, good_drive, power, doubted, agreed,
        ),
    )  # fmt: skip


def used_resolver(s: AxisState, p: AxisLimits, now_ns: int) -> ResolverSample:
    """The angle that the law may use: the newest good one, carried on over the cycles since."""
    good = s.resolver
    if s.bad == 0 or s.known < 2:
        return good
    return ResolverSample(now_ns, good.seq, round(good.counts + (now_ns - good.stamp_ns) * p.per_ns * s.step), 0)
