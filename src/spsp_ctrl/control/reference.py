"""From the plan of a scenario, and the requests of an operator, to the reference of each cycle.

Pure: a source is immutable and is asked with a time. Scalar code, called once per cycle.
"""

from __future__ import annotations

from math import cos, inf, isfinite, pi, radians, sin

from spsp_ctrl.config.scenario import ReferencePlan, Sine
from spsp_ctrl.mechanism.frames import wrap_angle
from spsp_ctrl.mechanism.profile import TargetProfile, smooth_ramp, staircase, stopping
from spsp_ctrl.messages import Reference, ReferenceKind

HEADING_SMOOTHING_S = 0.2
"""Time over which the heading's acceleration changes; it delays a move by half of it and bounds the jerk."""

_new = tuple.__new__

Waves = tuple[tuple[float, float, float], ...]
"""Amplitude in rad, angular frequency in rad/s, phase in rad."""


class ReferenceSource:
    """The reference of a session as a function of time.

    Pitch and roll are a constant offset plus sines under the smooth envelope of ``plan.start_s`` and ``plan.ramp_s``,
    with their exact rates, or one of them a staircase from ``plan.start_s`` on.
    Heading goes from target to target with limited rate, acceleration and jerk
    (:class:`~spsp_ctrl.mechanism.profile.TargetProfile`), and is given in (-pi, pi] with its exact rate. It stands on a
    target planned at ``at_s = 0`` from the start; before any later first target it is 0. A target that comes while the
    last move still runs replaces it.

    An inertial heading goes the shortest way round. A joint azimuth cannot turn through +-180 degrees, so it goes there
    through zero.

    Raises ``ValueError`` for a limit that is not positive.
    """

    __slots__ = (
        "_heading", "_jog_pitch", "_jog_roll", "_kind", "_line",
        "_pitch", "_pitch_rad", "_ramp_s", "_roll", "_roll_rad", "_stairs", "_start_s", "until_s",
    )  # fmt: skip

    until_s: float
    """When a streamed heading is too old to be followed on; infinity without a stream."""

    def __init__(
        self,
        plan: ReferencePlan,
        heading_rate_limit_rad_s: float,
        heading_accel_limit_rad_s2: float,
        heading_smoothing_s: float = HEADING_SMOOTHING_S,
    ) -> None:
        self._kind = int(ReferenceKind.INERTIAL if plan.kind == "inertial" else ReferenceKind.JOINT)
        self._pitch_rad, self._roll_rad = radians(plan.pitch_deg), radians(plan.roll_deg)
        self._pitch, self._roll = _waves(plan.pitch), _waves(plan.roll)
        self._start_s, self._ramp_s = plan.start_s, plan.ramp_s
        stairs = plan.staircase
        self._stairs = (
            (stairs.axis == "roll", tuple(map(radians, stairs.values_deg)), stairs.dwell_s, stairs.move_s) if stairs else None
        )
        heading = TargetProfile.at_rest(0.0, heading_rate_limit_rad_s, heading_accel_limit_rad_s2, heading_smoothing_s)
        for target in sorted(plan.heading, key=lambda h: h.at_s):
            angle = wrap_angle(radians(target.heading_deg))
            if target.at_s == 0.0:
                heading = TargetProfile.at_rest(
                    angle, heading_rate_limit_rad_s, heading_accel_limit_rad_s2, heading_smoothing_s
                )
            else:
                heading = heading.retargeted(target.at_s, self._way(heading, target.at_s, angle), keep_history=True)
        self._heading = heading
        self._line = (0.0, 0.0, 0.0)
        self.until_s = inf
        self._jog_pitch: TargetProfile | None = None
        self._jog_roll: TargetProfile | None = None

    def at(self, t_s: float) -> Reference:
        """Reference at ``t_s`` s of cycle time."""
        pitch, roll = self._pitch_rad, self._roll_rad
        pitch_rate = roll_rate = 0.0
        after_s = t_s - self._start_s
        if after_s > 0.0 and (self._pitch or self._roll):
            if after_s >= self._ramp_s:
                grown, growth = 1.0, 0.0
            else:
                grown, growth, _, _ = smooth_ramp(after_s / self._ramp_s, self._ramp_s)
            for amplitude, omega, phase in self._pitch:
                angle = omega * after_s + phase
                wave = amplitude * sin(angle)
                pitch += grown * wave
                pitch_rate += growth * wave + grown * amplitude * omega * cos(angle)
            for amplitude, omega, phase in self._roll:
                angle = omega * after_s + phase
                wave = amplitude * sin(angle)
                roll += grown * wave
                roll_rate += growth * wave + grown * amplitude * omega * cos(angle)
        if self._stairs is not None:
            is_roll, values, dwell_s, move_s = self._stairs
            if is_roll:
                roll, roll_rate = staircase(after_s, values, dwell_s, move_s)
            else:
                pitch, pitch_rate = staircase(after_s, values, dwell_s, move_s)
        if self._jog_pitch is not None:
            jog, jog_rate = self._jog_pitch.at(t_s)
            pitch, pitch_rate = pitch + jog, pitch_rate + jog_rate
        if self._jog_roll is not None:
            jog, jog_rate = self._jog_roll.at(t_s)
            roll, roll_rate = roll + jog, roll_rate + jog_rate
        heading, heading_rate = self._heading.at(t_s)
        line_s, line, line_rate = self._line
        if line_rate or line:
            # the profile is a mean over its smoothing time; so is the line under it
            heading += line + line_rate * (t_s - line_s - 0.5 * self._heading.smoothing_s)
            heading_rate += line_rate
        reference: Reference = _new(
            Reference, (self._kind, pitch, roll, wrap_angle(heading), pitch_rate, roll_rate, heading_rate)
        )
        return reference

    def with_heading(self, t_s: float, heading_rad: float) -> ReferenceSource:
        """The source after an operator asked at ``t_s`` for ``heading_rad`` (any turn of it): smoothly there from the
        present demand.

        The operator has taken over: later targets of the plan no longer apply. Valid from ``t_s`` on. Raises
        ``ValueError`` for an infinity or NaN.
        """
        if not isfinite(heading_rad):
            raise ValueError(f"a heading demand must be a finite angle, not {heading_rad!r}")
        other = self._plain(t_s)
        other._heading = other._heading.retargeted(t_s, self._way(other._heading, t_s, wrap_angle(heading_rad)))
        return other

    def with_stream(self, t_s: float, heading_rad: float, rate_rad_s: float, timeout_s: float) -> ReferenceSource:
        """The source after a sample of a heading that is streamed: it is ``heading_rad`` at ``t_s`` and turns at ``rate_rad_s``.

        The demand joins that line smoothly and goes on along it. :attr:`until_s` says until when that may be believed; then :meth:`stream_ended`
        must be called. Raises ``ValueError`` for an infinity or NaN.
        """
        if not (isfinite(heading_rad) and isfinite(rate_rad_s)):
            raise ValueError(f"a streamed heading must be finite, not {heading_rad!r} at {rate_rad_s!r}")
        other = self._plain(t_s)
        heading = other._heading
        start = self._way(heading, t_s, wrap_angle(heading_rad)) + 0.5 * heading.smoothing_s * rate_rad_s
        other._heading = heading.relative_to(t_s, start, rate_rad_s).retargeted(t_s, 0.0)
        other._line = (t_s, start, rate_rad_s)
        other.until_s = t_s + timeout_s
        return other

    def stream_ended(self, t_s: float) -> ReferenceSource:
        """The source after the stream has fallen silent: the demand comes to rest where braking brings it, and stays."""
        other = self._plain(t_s)
        other._heading = other._heading.retargeted(t_s, stopping(other._heading, t_s))
        return other

    def jogged(self, t_s: float, axis: str, step_rad: float, rate_limit_rad_s: float, accel_limit_rad_s2: float) -> ReferenceSource:
        """The source after a jog of ``pitch`` or ``roll``: that demand is moved on by ``step_rad``, smoothly. Raises ``ValueError`` for NaN."""
        if not isfinite(step_rad):
            raise ValueError(f"a jog must be a finite angle, not {step_rad!r}")
        other = self._copy()
        name = "_jog_pitch" if axis == "pitch" else "_jog_roll"
        profile = getattr(self, name) or TargetProfile.at_rest(0.0, rate_limit_rad_s, accel_limit_rad_s2, HEADING_SMOOTHING_S)
        setattr(other, name, profile.retargeted(t_s, profile.pieces[-1].position + step_rad))
        return other

    def _copy(self) -> ReferenceSource:
        other = ReferenceSource.__new__(ReferenceSource)
        for name in ReferenceSource.__slots__:
            setattr(other, name, getattr(self, name))
        return other

    def _plain(self, t_s: float) -> ReferenceSource:
        """The same demand as a profile alone, without a line under it."""
        other = self._copy()
        line_s, line, rate = self._line
        if line or rate:
            other._heading = self._heading.relative_to(line_s, -line, -rate)
            other._line, other.until_s = (0.0, 0.0, 0.0), inf
        return other

    def _way(self, heading: TargetProfile, t_s: float, angle: float) -> float:
        """Where the profile must go for ``angle`` in (-pi, pi]: the angle itself, or its turn nearest to the present
        demand.
        """
        if self._kind == ReferenceKind.JOINT:
            return angle
        position, _ = heading.trapezoid(t_s)
        return position + wrap_angle(angle - position)


def _waves(sines: tuple[Sine, ...]) -> Waves:
    return tuple((radians(s.amplitude_deg), 2.0 * pi / s.period_s, radians(s.phase_deg)) for s in sines)
