"""Judge the slow temperatures, and how far they lower the current. A pure step."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import NO_TEMPERATURE, TemperatureSample
from spsp_ctrl.safety.faults import BY_ID, Fault

STALE_NS = 1_500_000_000
JUMP_K = 3.0
LOW_C, HIGH_C = -40.0, 120.0
SHARES = (1.0, 0.8, 0.6, 0.4)
"""Of the current limit, from cool to just below ``supervisor.temperature_max_c``."""
SETTLE = 20
"""Bad samples in a row after which the present value is taken as the new start."""

_STALE, _JUMP, _HOT, _DERATING = BY_ID["temperature-stale"], BY_ID["temperature-jump"], BY_ID["overtemperature"], BY_ID["derating"]


@dataclass(frozen=True, slots=True)
class TemperatureLimits:
    """Constants."""

    derating_from_c: float
    max_c: float
    hot_ns: int


def temperature_limits(config: RigConfig) -> TemperatureLimits:
    """From the rig file."""
    s = config.supervisor
    return TemperatureLimits(s.derating_from_c, s.temperature_max_c, round(_HOT.debounce_ms * 1e6))


class TemperatureState(NamedTuple):
    """Newest good sample, sequence of the newest of all, what was said of it, and the place in ``SHARES``."""

    good: TemperatureSample
    seq: int
    fault: Fault | None
    bad: int
    hot_since: int
    share: int


START = TemperatureState(NO_TEMPERATURE, -1, None, 0, 0, 0)


def _sample(s: TemperatureState, p: TemperatureLimits, t: TemperatureSample, now_ns: int) -> TemperatureState:
    new = (t.screw_pitch_c, t.screw_roll_c, t.column_c, t.frame_c)
    old = (s.good.screw_pitch_c, s.good.screw_roll_c, s.good.column_c, s.good.frame_c)
    possible = isfinite(sum(new)) and min(new) >= LOW_C and max(new) <= HIGH_C
    smooth = s.good.seq < 0 or s.bad >= SETTLE or max(abs(a - b) for a, b in zip(new, old, strict=True)) <= JUMP_K
    if not (possible and smooth):
        return s._replace(seq=t.seq, fault=_JUMP, bad=s.bad + 1)
    hottest = max(t.screw_pitch_c, t.screw_roll_c)
    hot = (s.hot_since or now_ns or 1) if hottest > p.max_c else 0
    share = 0
    fault: Fault | None = None
    if hottest > p.derating_from_c:
        part = (hottest - p.derating_from_c) / (p.max_c - p.derating_from_c)
        share = min(len(SHARES) - 1, 1 + int(part * (len(SHARES) - 1)))
        fault = _HOT if hot and now_ns - hot >= p.hot_ns else _DERATING
    return TemperatureState(t, t.seq, fault, 0, hot, share)


def step(s: TemperatureState, p: TemperatureLimits, t: TemperatureSample, now_ns: int) -> tuple[Fault | None, TemperatureState]:
    """One cycle."""
    if t.seq > s.seq and t.stamp_ns <= now_ns:
        s = _sample(s, p, t, now_ns)
    # one that was never there is not fitted (a drive family without it): nothing has gone silent
    if s.good.seq >= 0 and now_ns - s.good.stamp_ns > STALE_NS:
        return s.fault or _STALE, s
    return s.fault, s
