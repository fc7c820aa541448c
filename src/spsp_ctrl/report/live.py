"""From the messages of the loop to the status of the live screen. Plain arithmetic: it may be called in every cycle."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import degrees, pi
from typing import TYPE_CHECKING

from spsp_ctrl.messages import Control, Measurement, Mode, ReferenceKind, Timing, Truth
from spsp_ctrl.report.status import Status
from spsp_ctrl.safety.faults import BY_NUMBER

if TYPE_CHECKING:
    from spsp_ctrl.config.rig import RigConfig
    from spsp_ctrl.config.scenario import Scenario

_ARCMIN_PER_RAD = 60.0 * 180.0 / pi
_WINDOW = 200
"""Cycles over which the median is taken."""


class LiveStatus:
    """Collects what happens between two statuses.

    Call :meth:`note` in every cycle, so that spikes and the worst lateness are not missed, and
    :meth:`status` a few times a second. ``counts`` tells records written and lost, if there is a recorder.
    """

    def __init__(
        self,
        rig: RigConfig,
        scenario: Scenario,
        clock: str,
        duration_s: float,
        virtual: bool = True,
        counts: Callable[[], tuple[int, int]] | None = None,
    ) -> None:
        self._counts = counts
        self._settle_ns = round(scenario.settle_s * 1e9)
        self._peak_pitch = self._peak_roll = self._worst_pitch = self._worst_roll = 0.0
        self._settled = False
        self._late: deque[int] = deque(maxlen=_WINDOW)
        self._compute: deque[int] = deque(maxlen=_WINDOW)
        self._late_max = self._compute_max = self._skipped = 0
        self._mode = -1
        self._event, self._event_s = "", 0.0
        self._degraded = ""
        self._fixed: Status = {
            "rig": rig.name,
            "scenario": scenario.title or scenario.name,
            "virtual": virtual,
            "clock": clock,
            "duration_s": duration_s,
            "settle_s": scenario.settle_s,
            "stroke_min_mm": rig.mechanism.stroke_min_mm,
            "stroke_max_mm": rig.mechanism.stroke_max_mm,
            "azimuth_limit_deg": rig.mechanism.azimuth_limit_deg,
            "rate_hz": rig.rate_hz,
        }

    def degraded(self, names: str) -> None:
        """What of the real-time settings was not granted."""
        self._degraded = names

    def recording(self, counts: Callable[[], tuple[int, int]]) -> None:
        """Show the records handed over and lost that ``counts`` tells."""
        self._counts = counts

    def event(self, text: str, t_s: float) -> None:
        """Show ``text`` as the last event."""
        self._event, self._event_s = text, t_s

    def note(self, control: Control, timing: Timing) -> None:
        """One cycle."""
        pitch, roll = _errors_rad(control)
        pitch, roll = abs(pitch), abs(roll)
        if pitch > self._worst_pitch:
            self._worst_pitch = pitch
        if roll > self._worst_roll:
            self._worst_roll = roll
        if control.stamp_ns >= self._settle_ns:
            self._settled = True
            if pitch > self._peak_pitch:
                self._peak_pitch = pitch
            if roll > self._peak_roll:
                self._peak_roll = roll
        self._late.append(timing.lateness_ns)
        self._compute.append(timing.compute_ns)
        if timing.lateness_ns > self._late_max:
            self._late_max = timing.lateness_ns
        if timing.compute_ns > self._compute_max:
            self._compute_max = timing.compute_ns
        self._skipped += timing.skipped
        if control.mode != self._mode:
            before, self._mode = self._mode, control.mode
            name = Mode(control.mode).name
            self.event(name if before < 0 else f"{Mode(before).name} → {name}", control.stamp_ns * 1e-9)

    def status(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> Status:
        """Status as of this cycle; the errors in it start again from here.

        The table is shown from its encoders (or the true state), the platform and the errors as the IMU sees them.
        """
        if not self._late:  # note() was never called: this cycle is all there is
            self.note(control, timing)
        estimate, reference = control.estimate, control.reference
        records, lost = self._counts() if self._counts is not None else (None, None)
        base = measurement.base
        known = truth is not None or base.seq >= 0
        base_pitch, base_roll = (
            (truth.base_pitch_rad, truth.base_roll_rad) if truth is not None else (base.pitch_rad, base.roll_rad)
        )
        fault = BY_NUMBER.get(control.fault)
        status: Status = {
            **self._fixed,
            "mode": Mode(control.mode).name,
            "fault": f"{fault.text}. Check: {fault.check}" if fault is not None else "",
            "elapsed_s": control.stamp_ns * 1e-9,
            "base_pitch_deg": degrees(base_pitch) if known else None,
            "base_roll_deg": degrees(base_roll) if known else None,
            "platform_pitch_deg": degrees(estimate.platform_pitch_rad),
            "platform_roll_deg": degrees(estimate.platform_roll_rad),
            "error_pitch_arcmin": self._worst_pitch * _ARCMIN_PER_RAD,
            "error_roll_arcmin": self._worst_roll * _ARCMIN_PER_RAD,
            "error_pitch_max_arcmin": self._peak_pitch * _ARCMIN_PER_RAD if self._settled else None,
            "error_roll_max_arcmin": self._peak_roll * _ARCMIN_PER_RAD if self._settled else None,
            "rod_pitch_mm": estimate.rod_pitch_m * 1e3,
            "rod_roll_mm": estimate.rod_roll_m * 1e3,
            "azimuth_deg": degrees(estimate.azimuth_rad),
            "heading_deg": degrees(estimate.heading_rad),
            "heading_target_deg": degrees(reference.heading_rad),
            "lateness_p50_us": sorted(self._late)[len(self._late) // 2] * 1e-3,
            "lateness_max_us": self._late_max * 1e-3,
            "compute_p50_us": sorted(self._compute)[len(self._compute) // 2] * 1e-3,
            "compute_max_us": self._compute_max * 1e-3,
            "skipped": self._skipped,
            "degraded": self._degraded,
            "log_records": records,
            "log_lost": lost,
            "event": self._event,
            "event_t_s": self._event_s,
        }
        self._worst_pitch = self._worst_roll = 0.0
        return status


def _errors_rad(control: Control) -> tuple[float, float]:
    estimate, reference = control.estimate, control.reference
    if reference.kind == ReferenceKind.JOINT:
        return reference.pitch_rad - estimate.joint_pitch_rad, reference.roll_rad - estimate.joint_roll_rad
    return reference.pitch_rad - estimate.platform_pitch_rad, reference.roll_rad - estimate.platform_roll_rad
