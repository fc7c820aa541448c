"""Learning of the periodic lead error: rod travel that the nut makes beyond (or short of) the motor angle, once and twice per screw turn.

What is periodic in the screw angle and looks like base motion is not base motion. The innovations of the base observer, turned into rod
travel, are correlated with the sine and cosine of the screw angle (and of twice that) and the coefficients follow by the normalised LMS
rule. The regressors go through the same high-pass as the innovations (the observer takes over what is slow), so that phase is right.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

_new = tuple.__new__


class ScrewMap(NamedTuple):
    """Coefficients in m (sine, cosine, sine twice, cosine twice) and the low-passed regressors."""

    s1: float
    c1: float
    s2: float
    c2: float
    low_s1: float
    low_c1: float
    low_s2: float
    low_c2: float


START = ScrewMap(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def error(state: ScrewMap, screw_rad: float) -> tuple[float, float]:
    """Travel error in m at a screw angle, and its derivative by the angle in m/rad."""
    s1, c1, s2, c2, _, _, _, _ = state
    s, c = sin(screw_rad), cos(screw_rad)
    ss, cc = 2.0 * s * c, c * c - s * s
    return s1 * s + c1 * c + s2 * ss + c2 * cc, s1 * c - c1 * s + 2.0 * (s2 * cc - c2 * ss)


def learn(state: ScrewMap, screw_rad: float, rod_innovation_m: float, rate: float, high_pass: float, limit_m: float) -> ScrewMap:
    """One IMU frame. ``rate`` is the LMS step (0: do not learn), ``high_pass`` the share of an innovation that the observer takes over."""
    s1, c1, s2, c2, l1, l2, l3, l4 = state
    s, c = sin(screw_rad), cos(screw_rad)
    e1, e2, e3, e4 = s - l1, c - l2, 2.0 * s * c - l3, c * c - s * s - l4
    step = rate * rod_innovation_m
    return _new(
        ScrewMap,
        (
            min(limit_m, max(-limit_m, s1 + step * e1)),
            min(limit_m, max(-limit_m, c1 + step * e2)),
            min(limit_m, max(-limit_m, s2 + step * e3)),
            min(limit_m, max(-limit_m, c2 + step * e4)),
            l1 + high_pass * e1,
            l2 + high_pass * e2,
            l3 + high_pass * e3,
            l4 + high_pass * e4,
        ),
    )
