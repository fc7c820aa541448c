"""Motion profiles in closed form: the smooth start of a periodic motion, and the jerk-limited way to a target.

Pure; no numpy, so that the control loop can call it. :func:`smooth_ramp` is plain arithmetic and serves floats and
arrays alike.
"""

from __future__ import annotations

from bisect import bisect_right
from math import sqrt
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Real = TypeVar("Real", float, "NDArray[np.float64]")


def smooth_ramp(fraction: Real, ramp_s: float) -> tuple[Real, Real, Real, Real]:
    """Quintic smoothstep: value and its first and second time derivative (1/s, 1/s^2) and its time integral (s).

    ``fraction`` is the time since the start over ``ramp_s``, held to 0..1 by the caller; float or array. Value and
    derivatives are exactly 0 at 0, and exactly 1, 0, 0 at 1. The integral holds within the ramp; it is ``ramp_s / 2``
    at its end and grows by 1 s per s after it.
    """
    s = fraction
    square = s * s
    rest = 1.0 - s
    value = square * s * (10.0 - s * (15.0 - 6.0 * s))
    rate = (30.0 / ramp_s) * square * rest * rest
    accel = (60.0 / (ramp_s * ramp_s)) * s * rest * (1.0 - 2.0 * s)
    integral = ramp_s * square * square * (2.5 - s * (3.0 - s))
    return value, rate, accel, integral


def staircase(after_s: float, values: tuple[float, ...], dwell_s: float, move_s: float) -> tuple[float, float]:
    """Value and rate of a staircase ``after_s`` s after its start: each value for ``dwell_s``, reached by a quintic move of ``move_s`` (0: a step).

    Before the start the first value holds, after the end the last.
    """
    place = int(after_s // dwell_s) if after_s > 0.0 else 0
    if place >= len(values):
        return values[-1], 0.0
    value = values[place]
    if place == 0 or move_s == 0.0:
        return value, 0.0
    fraction = (after_s - place * dwell_s) / move_s
    if fraction >= 1.0:
        return value, 0.0
    way = value - values[place - 1]
    grown, rate, _, _ = smooth_ramp(fraction, move_s)
    return values[place - 1] + way * grown, way * rate


class Piece(NamedTuple):
    """Constant acceleration from ``start_s`` until the next piece."""

    start_s: float
    position: float
    rate: float
    accel: float


class TargetProfile(NamedTuple):
    """A demand that goes to targets with limited rate, acceleration and jerk.

    Inside runs a trapezoidal profile, made of pieces of constant acceleration. What comes out is its mean over the last
    ``smoothing_s``: a mean never exceeds what it is taken of, so the limits hold, the acceleration is continuous, the
    jerk is at most ``2 accel_limit / smoothing_s``, and a new target may come at any time. Mean and rate are exact
    integrals, not sampled. A move ends ``smoothing_s`` after the trapezoid does, exactly on its target.
    """

    pieces: tuple[Piece, ...]
    starts_s: tuple[float, ...]
    rate_limit: float
    accel_limit: float
    smoothing_s: float

    @classmethod
    def at_rest(cls, position: float, rate_limit: float, accel_limit: float, smoothing_s: float) -> TargetProfile:
        """Standing at ``position`` since ever.

        Raises ``ValueError`` for a limit or a smoothing time that is not positive and finite.
        """
        for name, value in (
            ("rate limit", rate_limit),
            ("acceleration limit", accel_limit),
            ("smoothing time", smoothing_s),
        ):
            if not 0.0 < value < float("inf"):
                raise ValueError(f"{name} of a target profile must be positive and finite, not {value!r}")
        start = float("-inf")
        return cls((Piece(start, position, 0.0, 0.0),), (start,), rate_limit, accel_limit, smoothing_s)

    def trapezoid(self, t_s: float) -> tuple[float, float]:
        """Position and rate of the inner trapezoidal profile."""
        piece = self.pieces[max(0, bisect_right(self.starts_s, t_s) - 1)]
        if piece.rate == 0.0 and piece.accel == 0.0:
            return piece.position, 0.0
        dt = max(0.0, t_s - piece.start_s)
        return piece.position + dt * (piece.rate + 0.5 * piece.accel * dt), piece.rate + piece.accel * dt

    def at(self, t_s: float) -> tuple[float, float]:
        """Position and its exact rate."""
        pieces, starts_s, _, _, window = self
        begin = t_s - window
        last = max(0, bisect_right(starts_s, t_s) - 1)
        start, position, rate, accel = pieces[last]
        if rate == 0.0 and accel == 0.0:
            now = position
            if start <= begin:
                return now, 0.0
        else:
            dt = max(0.0, t_s - start)
            now = position + dt * (rate + 0.5 * accel * dt)
            if start <= begin:
                rate += accel * dt
                return now - window * (0.5 * rate - accel * window / 6.0), rate - 0.5 * accel * window
        # the window spans several pieces: the area under each, relative to now so that nothing cancels
        area = 0.0
        end = t_s
        for start, position, rate, accel in reversed(pieces[: last + 1]):
            a = max(start, begin)
            length = end - a
            if rate == 0.0 and accel == 0.0:
                at_a = position
                area += (position - now) * length
            else:
                u, v = max(0.0, a - start), end - start
                at_a = position + u * (rate + 0.5 * accel * u)
                at_end = position + v * (rate + 0.5 * accel * v)
                area += (0.5 * (at_a + at_end) - now - accel * length * length / 12.0) * length
            if start <= begin:
                break
            end = start
        return now + area / window, (now - at_a) / window

    def retargeted(self, t_s: float, target: float, keep_history: bool = False) -> TargetProfile:
        """The profile that leaves this one at ``t_s`` and comes to rest at ``target``.

        Valid from ``t_s`` on: what no later mean can reach is dropped, so that a stream of targets does not grow. With
        ``keep_history`` it stays, and the result equals this profile before ``t_s``.
        """
        position, rate = self.trapezoid(t_s)
        first = 0 if keep_history else max(0, bisect_right(self.starts_s, t_s - self.smoothing_s) - 1)
        pieces = (
            *(piece for piece in self.pieces[first:] if piece.start_s < t_s),
            *_trapezoid(t_s, position, rate, target, self.rate_limit, self.accel_limit),
        )
        return self._replace(pieces=pieces, starts_s=tuple(piece.start_s for piece in pieces))

    def relative_to(self, t_s: float, position: float, rate: float) -> TargetProfile:
        """The same motion seen from a frame that is at ``position`` at ``t_s`` and moves at ``rate``."""
        start = t_s if self.starts_s[0] == float("-inf") and rate else None
        pieces = self.pieces
        if start is not None:
            # a rest since ever has no place in a moving frame: it begins a window before anything that is still asked for
            first = min(t_s, self.starts_s[1] if len(self.starts_s) > 1 else t_s) - 2.0 * self.smoothing_s
            pieces = (pieces[0]._replace(start_s=first), *pieces[1:])
        moved = tuple(
            piece._replace(
                position=piece.position - position - (rate * (piece.start_s - t_s) if rate else 0.0), rate=piece.rate - rate
            )
            for piece in pieces
        )
        return self._replace(pieces=moved, starts_s=tuple(piece.start_s for piece in moved))


def stopping(profile: TargetProfile, t_s: float) -> float:
    """Where a profile would come to rest if it braked from ``t_s`` on."""
    position, rate = profile.trapezoid(t_s)
    return position + rate * abs(rate) / (2.0 * profile.accel_limit)


def _trapezoid(
    t_s: float, position: float, rate: float, target: float, rate_limit: float, accel_limit: float
) -> list[Piece]:
    """Time-optimal pieces from a moving start to rest at ``target``: accelerate, cruise, brake, hold."""
    way = target - position
    # which side the target lies on, seen from where the profile would stop if it braked now
    sign = 1.0 if way >= rate * abs(rate) / (2.0 * accel_limit) else -1.0
    distance, v = sign * way, sign * rate
    peak = sqrt(max(0.0, accel_limit * distance + 0.5 * v * v))
    cruise_s = 0.0
    if peak > rate_limit:
        peak = rate_limit
        cruise_s = max(0.0, (distance - (2.0 * peak * peak - v * v) / (2.0 * accel_limit)) / peak)
    peak = max(peak, v, 0.0)
    up_s = (peak - v) / accel_limit
    up_way = 0.5 * (v + peak) * up_s
    brake_s = peak / accel_limit
    t1 = t_s + up_s
    t2 = t1 + cruise_s
    return [
        Piece(t_s, position, rate, sign * accel_limit),
        Piece(t1, position + sign * up_way, sign * peak, 0.0),
        Piece(t2, position + sign * (up_way + peak * cruise_s), sign * peak, -sign * accel_limit),
        Piece(t2 + brake_s, target, 0.0, 0.0),
    ]
