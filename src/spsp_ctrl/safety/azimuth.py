"""Judge the azimuth stepper: age, count against command, and the three switches. A pure step, cheap between its frames."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, pi, radians
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import NO_AZIMUTH, AzimuthSample
from spsp_ctrl.safety.faults import BY_ID, Fault

STALE_PERIODS = 5.0
DENSITY_SHARE = 0.3
DENSITY_S = 0.15
FOLLOW_MEMORY_S = 1.0
FOLLOW_RAD = radians(0.5)
FOLLOW_S = 0.06
"""The following error may be ``FOLLOW_RAD`` and this time of rate: service, ramp of the driver."""
JUMP_RAD = radians(1.0)
"""More than what the rate limit allows in one period."""
NEAR_RAD = radians(3.0)
"""Beyond this distance from zero the zero switch cannot be on."""
PASSED_RAD = radians(1.5)
"""Zero counts as passed from this side to that; vanes are about 1 deg wide."""

_STALE, _FOLLOWING, _SWITCH = BY_ID["azimuth-stale"], BY_ID["azimuth-following"], BY_ID["travel-switch"]
_IMPLAUSIBLE, _HOME, _NOT_FINITE = BY_ID["switch-implausible"], BY_ID["home-switch"], BY_ID["not-finite"]


@dataclass(frozen=True, slots=True)
class AzimuthLimits:
    """Constants."""

    stale_ns: int
    overdue_ns: int
    rad_per_microstep: float
    rate_rad_s: float
    switch_ns: int
    home_ns: int


def azimuth_limits(config: RigConfig) -> AzimuthLimits:
    """From the rig file."""
    a = config.azimuth
    period_ns = 1e9 / a.rate_hz
    return AzimuthLimits(
        round(STALE_PERIODS * period_ns) + round(config.supervisor.signal_timeout_ms * 1e6),
        round(1.5 * period_ns) + round(config.supervisor.signal_timeout_ms * 1e6),
        2.0 * pi / (a.full_steps_per_turn * a.microsteps * a.gear_ratio),
        radians(config.limits.azimuth_rate_deg_s),
        round(_SWITCH.debounce_ms * 1e6),
        round(_HOME.debounce_ms * 1e6),
    )


class AzimuthState(NamedTuple):
    """Newest good sample and what is summed up; ``_since`` in ns, 0 for never."""

    good: AzimuthSample
    seq: int
    follow_rad: float
    overdue_s: float
    pressed_since: int
    home_since: int
    side: int
    """Side of zero on which azimuth was last clearly seen; 0 before."""
    vane: bool
    """The zero switch was on since then."""
    lost: bool
    """The last sample was not believed."""
    fault: Fault | None
    """What the newest frame has shown; it holds until the next."""


START = AzimuthState(NO_AZIMUTH, -1, 0.0, 0.0, 0, 0, 0, False, False, None)


def _sample(
    s: AzimuthState, p: AzimuthLimits, a: AzimuthSample, told_rad: float, enabled: bool, homed: bool, now_ns: int
) -> AzimuthState:
    """One new frame."""
    if not isfinite(a.rate_microsteps_s):
        return s._replace(seq=a.seq, lost=True, fault=_NOT_FINITE)
    fault: Fault | None = None
    follow = s.follow_rad
    if s.good.seq >= 0 and not s.lost:
        dt = (a.stamp_ns - s.good.stamp_ns) * 1e-9
        moved = (a.microsteps - s.good.microsteps) * p.rad_per_microstep
        if dt <= 0.0 or abs(moved) > JUMP_RAD + p.rate_rad_s * dt or abs(a.rate_microsteps_s) * p.rad_per_microstep > 2.0 * p.rate_rad_s:
            return s._replace(seq=a.seq, lost=True, fault=_FOLLOWING)
        follow = follow * exp(-dt / FOLLOW_MEMORY_S) + told_rad - moved if enabled else 0.0
        if abs(follow) > FOLLOW_RAD + FOLLOW_S * abs(told_rad) / dt:
            fault = _FOLLOWING
    pressed = s.pressed_since
    if a.left_switch or a.right_switch:
        pressed = pressed or now_ns or 1
        if now_ns - pressed >= p.switch_ns:
            fault = _IMPLAUSIBLE if a.left_switch and a.right_switch else _SWITCH
    else:
        pressed = 0
    side, vane, home = s.side, s.vane or a.home_switch, s.home_since
    if homed:
        angle = a.microsteps * p.rad_per_microstep
        odd = a.home_switch and abs(angle) > NEAR_RAD
        if abs(angle) > PASSED_RAD:
            here = 1 if angle > 0.0 else -1
            if side == -here and not vane:
                fault = fault or _HOME
            side, vane = here, a.home_switch
        home = (home or now_ns or 1) if odd else 0
        if odd and now_ns - home >= p.home_ns:
            fault = fault or _HOME
    return AzimuthState(a, a.seq, follow, s.overdue_s, pressed, home, side, vane, False, fault)


def step(
    s: AzimuthState, p: AzimuthLimits, a: AzimuthSample, told_rad: float, enabled: bool, homed: bool, now_ns: int, dt: float
) -> tuple[Fault | None, AzimuthState]:
    """One cycle. ``told_rad`` is the travel commanded since the last frame, ``homed`` whether the count is known to be the angle."""
    if a[1] > s[1] and a[0] <= now_ns:
        s = _sample(s, p, a, told_rad, enabled, homed, now_ns)
    age, fault = now_ns - s[0][0], s[9]
    if s[0][1] < 0 or age > p.stale_ns:
        return fault or _STALE, s
    if age > p.overdue_ns:
        s = s._replace(overdue_s=s.overdue_s + dt)
        if s.overdue_s > DENSITY_S:
            fault = fault or _STALE
    elif s[3] > 0.0:
        s = s._replace(overdue_s=max(0.0, s.overdue_s - DENSITY_SHARE / (1.0 - DENSITY_SHARE) * dt))
    return fault, s
