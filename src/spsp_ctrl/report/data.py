"""The data of one run as the report sees them, and the quantities derived from them. Pure functions on arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.messages import Mode, ReferenceKind

FloatArray = NDArray[np.float64]

ARCMIN_PER_RAD = 60.0 * 180.0 / np.pi
DEG_PER_RAD = 180.0 / np.pi
CLOCK_HORIZON_NS = 30 * 86_400 * 10**9
LEVEL_RAD = 1e-6
SPEED_WINDOW_S = 0.010
"""Rod speed is the travel over this time: long against one resolver count, short against the motion."""


@dataclass(frozen=True)
class RunData:
    """One recorded run.

    ``topics``: topic name to a structured array with one record per message and the dotted leaf names of
    :mod:`spsp_ctrl.messages` (``topics["/control"]["estimate.platform_pitch_rad"]``). A topic may be missing or empty.
    ``events``: JSON events in order; ``stamp_ns`` (control clock), ``level``, ``id`` and ``text``; other keys are
    listed behind the text.
    ``metadata``: named records of the log (versions, seed ...). ``attachments``: name to text (resolved config, model).
    """

    topics: Mapping[str, NDArray[Any]]
    events: list[dict[str, Any]] = field(default_factory=list)
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: Mapping[str, str] = field(default_factory=dict)

    def until(self, t_s: float) -> RunData:
        """The run up to ``t_s`` of the control clock: leaves the final stop out of the figures; events stay."""
        last_ns = round(t_s * 1e9)
        topics = {
            name: rows[rows["stamp_ns"] <= last_ns] if "stamp_ns" in (rows.dtype.names or ()) else rows
            for name, rows in self.topics.items()
        }
        return RunData(topics, self.events, self.metadata, self.attachments)


@dataclass(frozen=True)
class Series:
    """One signal over time; ``t_s`` and ``y`` have the same length."""

    t_s: FloatArray
    y: FloatArray

    def scaled(self, factor: float) -> Series:
        """The same signal in another unit."""
        return Series(self.t_s, self.y * factor)

    def after(self, t_s: float) -> FloatArray:
        """Finite values from ``t_s`` on."""
        chosen = self.y[self.t_s >= t_s]
        return chosen[np.isfinite(chosen)]


class Signals:
    """Access to the signals of a run on one time axis, in seconds of the control clock. Absent signals are ``None``."""

    def __init__(self, data: RunData) -> None:
        self._topics = data.topics
        starts = [
            int(data.topics[name]["stamp_ns"][0])
            for name in ("/control", "/measurement", "/truth", "/timing")
            if self._has(name, "stamp_ns")
        ]
        # The control clock starts at 0. A log by other software may carry the time of day: then its start is 0.
        self.t0_ns = starts[0] if starts and starts[0] > CLOCK_HORIZON_NS else 0
        control = self._time("/control")
        self.end_s = float(control[-1]) if control is not None else 0.0

    def _has(self, topic: str, name: str) -> bool:
        array = self._topics.get(topic)
        return array is not None and len(array) > 0 and name in (array.dtype.names or ())

    def _time(self, topic: str) -> FloatArray | None:
        if not self._has(topic, "stamp_ns"):
            return None
        # Subtract as integers: nanoseconds since boot do not fit a float64 exactly.
        stamps = self._topics[topic]["stamp_ns"].astype(np.int64) - self.t0_ns
        return np.asarray(stamps, dtype=np.float64) * 1e-9

    def get(self, topic: str, name: str) -> Series | None:
        """The field ``name`` of ``topic`` as float64, or ``None`` when the log has no such signal."""
        t_s = self._time(topic)
        if t_s is None or not self._has(topic, name):
            return None
        return Series(t_s, np.asarray(self._topics[topic][name], dtype=np.float64))

    def column(self, topic: str, name: str) -> FloatArray:
        """The field as float64 without time; empty when absent."""
        series = self.get(topic, name)
        return series.y if series is not None else np.empty(0)

    @property
    def has_truth(self) -> bool:
        """Whether the log holds true states (virtual rig only)."""
        return self._has("/truth", "stamp_ns")

    def _reference_on(self, t_s: FloatArray, axis: str) -> tuple[FloatArray, NDArray[np.bool_]] | None:
        """Reference of ``axis`` and "is a joint reference", both at the cycle in force at ``t_s``."""
        reference = self.get("/control", f"reference.{axis}_rad")
        kind = self.get("/control", "reference.kind")
        if reference is None or kind is None:
            return None
        index = np.clip(np.searchsorted(reference.t_s, t_s + 1e-9, side="right") - 1, 0, len(reference.t_s) - 1)
        return reference.y[index], kind.y[index] == ReferenceKind.JOINT

    def error(self, axis: str, true: bool) -> Series | None:
        """Attitude error ``reference - actual`` in rad, wrapped to half a turn.

        ``axis`` is ``pitch``, ``roll`` or ``heading``. Measured: against the ``/control`` estimate; true: ``/truth``.
        While the reference is a joint reference, the joint angle takes the place of the attitude.
        """
        prefix, topic = ("", "/truth") if true else ("estimate.", "/control")
        names = ("heading_rad", "azimuth_rad") if axis == "heading" else (f"platform_{axis}_rad", f"joint_{axis}_rad")
        space, joint = self.get(topic, prefix + names[0]), self.get(topic, prefix + names[1])
        if space is None:
            return None
        found = self._reference_on(space.t_s, axis)
        if found is None:
            return None
        reference, is_joint = found
        actual = space.y if joint is None else np.where(is_joint, joint.y, space.y)
        return Series(space.t_s, np.remainder(reference - actual + np.pi, 2.0 * np.pi) - np.pi)

    def base(self, axis: str) -> Series | None:
        """Attitude of the swing table in rad: true if recorded, else its encoders if they ever answered."""
        series = self.get("/truth", f"base_{axis}_rad")
        if series is not None:
            return series
        sequence = self.column("/measurement", "base.seq")
        if not len(sequence) or sequence.max() < 0:
            return None
        return self.get("/measurement", f"base.{axis}_rad")

    def platform(self, axis: str) -> Series | None:
        """Attitude of the platform in rad: true if recorded, else the estimate."""
        name = f"platform_{axis}_rad"
        return self.get("/truth", name) or self.get("/control", f"estimate.{name}")

    def rod_speed(self, axis: str) -> Series | None:
        """Rod speed in m/s: travel over a centred window of 10 ms."""
        rod = self.get("/control", f"estimate.rod_{axis}_m")
        if rod is None or len(rod.y) < 3:
            return None
        step_s = float(np.median(np.diff(rod.t_s)))
        half = max(1, round(SPEED_WINDOW_S / 2.0 / step_s)) if step_s > 0.0 else 1
        if len(rod.y) <= 2 * half:
            return None
        span_s = rod.t_s[2 * half :] - rod.t_s[: -2 * half]
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = (rod.y[2 * half :] - rod.y[: -2 * half]) / np.where(span_s > 0.0, span_s, np.nan)
        return Series(rod.t_s[half:-half], speed)

    def mode_changes(self) -> list[tuple[float, str]]:
        """Start and each change of the supervisor's mode: time in s and text."""
        mode = self.get("/control", "mode")
        if mode is None:
            return []
        values = mode.y.astype(np.int64)
        at = np.flatnonzero(np.diff(values)) + 1
        rows = [(float(mode.t_s[0]), f"starts in {mode_name(values[0])}")]
        rows += [(float(mode.t_s[k]), f"{mode_name(values[k - 1])} → {mode_name(values[k])}") for k in at]
        return rows

    def task(self, settle_s: float) -> str:
        """What the reference asked for after ``settle_s``: ``level``, ``attitude`` (in space) or ``joint``."""
        kind = self.get("/control", "reference.kind")
        if kind is not None and np.any(kind.after(settle_s) == ReferenceKind.JOINT):
            return "joint"
        for axis in ("pitch", "roll"):
            reference = self.get("/control", f"reference.{axis}_rad")
            if reference is not None and np.any(np.abs(reference.after(settle_s)) > LEVEL_RAD):
                return "attitude"
        return "level"

    def operator_requests(self) -> list[tuple[float, str]]:
        """Requests on the operator channel: time in s and text."""
        t_s = self._time("/operator")
        if t_s is None:
            return []
        array = self._topics["/operator"]
        rows = []
        for k in range(len(t_s)):
            verb, source = str(array["verb"][k]), str(array["source"][k])
            angle = f" {float(array['value'][k]) * DEG_PER_RAD:.1f}°" if verb == "heading" else ""
            rows.append((float(t_s[k]), f"{verb}{angle}, from {source}"))
        return rows

    def fault_times(self) -> list[tuple[float, int]]:
        """Times at which a fault number appeared."""
        fault = self.get("/control", "fault")
        if fault is None:
            return []
        values = fault.y.astype(np.int64)
        before = np.concatenate(([0], values[:-1]))
        return [(float(fault.t_s[k]), int(values[k])) for k in np.flatnonzero((values != before) & (values != 0))]


def mode_name(value: int) -> str:
    """Name of a mode number, or the number itself when this version does not know it."""
    try:
        return Mode(int(value)).name
    except ValueError:
        return f"mode {int(value)}"
