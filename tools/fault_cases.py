"""The cases of the fault matrix: every signal, every kind, in ALIGNING and ACTIVE. Each says when its fault can be seen at all.

A deviation is what arrives less what the rig sent. A fault counts as observable from the cycle on in which the deviation, seen through the same
memory as the judge's, passes the size that the fault table states. What stays below that size is not a fault but an error, and is shown harmless.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, radians
from typing import Any

from spsp_ctrl.messages import Command, Measurement
from spsp_ctrl.rig.signals import KINDS, SIGNALS, Signal

MODES = ("ALIGNING", "ACTIVE")


@dataclass(frozen=True)
class Case:
    """One row."""

    signal: Signal
    kind: str
    mode: str

    @property
    def id(self) -> str:
        """For tables and tests."""
        return f"{self.signal.name}-{self.kind}-{self.mode}"


def cases() -> list[Case]:
    """All of them."""
    return [Case(signal, kind, mode) for signal in SIGNALS for kind in KINDS for mode in MODES]


NAMES: dict[str, tuple[str, ...]] = {
    "imu": ("imu-",),
    "resolver": ("resolver-", "following-error", "rod-travel", "imu-resolver"),
    "drive": ("drive-", "overcurrent", "current-error", "supply", "not-finite"),
    "azimuth": ("azimuth-", "travel-switch", "switch-implausible", "home-switch", "steps-lost", "not-finite"),
    "temperature": ("temperature-", "overtemperature", "derating"),
    "command": ("current-error", "following-error", "drive-state", "azimuth-following", "attitude-lost", "steps-lost", "overcurrent"),
    "base": (),
}
"""A fault is named rightly when its id begins like this."""


def rightly_named(case: Case, fault: str) -> bool:
    """Whether ``fault`` points at the signal that was hurt."""
    group = case.signal.name.split(".")[0].split("_")[0]
    return fault.startswith(NAMES[group])


class Observability:
    """Tells from when on the fault of a case can be seen. Fed in every cycle with both measurements and commands."""

    def __init__(self, case: Case) -> None:
        self._case = case
        self._state = 0.0
        self._step = {
            "imu": self._imu, "resolver": self._resolver, "drive": self._drive, "azimuth": self._azimuth, "temperature": self._temperature,
            "base": self._never, "command": self._command,
        }[case.signal.name.split(".")[0].split("_")[0]]  # fmt: skip
        self.words = WORDS[self._key()]

    def _key(self) -> str:
        name, kind = self._case.signal.name, self._case.kind
        if self._case.signal.frame and kind in ("off", "slow", "delayed", "intermittent") and name != "base":
            return "frames"
        if name.endswith("_switch"):
            return "switch"
        return max((key for key in WORDS if name.replace("_pitch", "").replace("_roll", "").startswith(key)), key=len)

    def step(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        """Whether it can be seen now."""
        if self._case.signal.frame and self._case.kind in ("off", "slow", "delayed", "intermittent") and self._case.signal.name != "base":
            return True
        return self._step(good, seen, sent, arrived, dt)

    def _difference(self, good: Any, seen: Any) -> float:
        place = self._case.signal.values[0]
        a, b = float(good[place]), float(seen[place])
        return abs(b - a) if isfinite(a) and isfinite(b) else float("inf")

    def _leaky(self, value: float, memory_s: float, dt: float) -> float:
        self._state = self._state * exp(-dt / memory_s) + value if isfinite(value) else float("inf")
        return self._state

    def _imu(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        off = self._difference(good.imu, seen.imu)
        if "gyro" in self._case.signal.name:
            place = self._case.signal.values[0]
            signed = seen.imu[place] - good.imu[place]
            return abs(self._leaky(signed * dt, 0.5, dt)) > radians(20.0 / 60.0) or off > radians(180.0)
        return off > radians(20.0 / 60.0)

    def _resolver(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        place = self._case.signal.sample
        off = self._difference(good[place], seen[place])
        return off >= 1.0 if "status" in self._case.signal.name else off > 140.0

    def _drive(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        place = self._case.signal.sample
        off = self._difference(good[place], seen[place])
        if "current" in self._case.signal.name:
            share = 1.0 - exp(-dt / 0.02)
            self._state += share * (min(off, 1e6) - self._state)
            return self._state > 0.75 or off > 7.5
        if "supply" in self._case.signal.name:
            volts = seen[place].bus_voltage_v
            return not 18.0 <= volts <= 30.0
        return off >= 1.0

    def _azimuth(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        off = self._difference(good.azimuth, seen.azimuth)
        if "home_switch" in self._case.signal.name:
            return off >= 1.0 and abs(good.azimuth.microsteps) > 3.0 / 360.0 * 76800.0
        return off >= 1.0 if "switch" in self._case.signal.name else off * radians(360.0 / 76800.0) > radians(0.5)

    def _temperature(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        return self._difference(good.temperature, seen.temperature) > 3.0

    def _command(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        off = self._difference(sent, arrived)
        if "azimuth" in self._case.signal.name:
            place = self._case.signal.values[0]
            return abs(self._leaky((arrived[place] - sent[place]) * dt, 1.0, dt)) > radians(0.5)
        share = 1.0 - exp(-dt / 0.02)
        self._state += share * (min(off, 1e6) - self._state)
        return self._state > 0.75

    def _never(self, good: Measurement, seen: Measurement, sent: Command, arrived: Command, dt: float) -> bool:
        return False


WORDS: dict[str, str] = {
    "frames": "at once",
    "imu": "attitude off by 20 arcmin",
    "imu.pitch": "attitude off by 20 arcmin", "imu.roll": "attitude off by 20 arcmin", "imu.yaw": "attitude off by 20 arcmin",
    "imu.gyro": "rate error integrates to 20 arcmin within 0.5 s",
    "resolver.status": "at once", "resolver": "angle off by 140 counts (3 deg of the motor, 11 um of the rod)",
    "drive": "at once",
    "drive.current": "mean over 20 ms off by 0.75 A", "drive.supply": "outside 18 to 30 V", "drive.enabled": "status and command differ",
    "azimuth": "count off by 0.5 deg", "switch": "the switch shows another state (zero switch: 3 deg from zero)",
    "temperature": "off by 3 K", "base": "never: logged, not read by the law",
    "command": "mean over 20 ms off by 0.75 A", "command.azimuth": "travel off by 0.5 deg within 1 s",
}  # fmt: skip

UNSEEN: tuple[tuple[str, str, str, str], ...] = (
    ("IMU attitude off by less than 20 arcmin, or drifting slower than the leak of the comparison with the gyro (40 arcmin/s)",
     "the carrier's tilt is measured by nobody: a bias of the IMU looks like a tilted carrier",
     "the platform stands off by as much", "encoders of the swing table (on a vehicle: a second IMU on the carrier)"),
    ("gyro bias below 40 arcmin/s", "below the same leak", "costs the base observer up to 1 arcmin, no more (attitude corrects it)", "a second IMU"),
    ("a coupling that creeps: resolver off by less than 140 counts at a time", "looks like a slow tilt of the carrier in the base observer",
     "none in attitude (closed on the IMU); the stroke is off by as much", "a linear scale on the rod"),
    ("play or a loose hinge behind the rod", "behind the resolver, before the IMU: looks like motion of the carrier",
     "adds to the attitude error, seen by the IMU", "a linear scale on the rod"),
    ("lost azimuth steps that creep (below 0.2 deg within 0.1 s), between two passes of zero", "the stepper counts what it was told",
     "none in heading (closed on the IMU); travel limits are off by as much", "an encoder on the azimuth axis"),
    ("a travel switch that never closes", "azimuth does not get there: the law keeps to its travel by the count", "none while the count is right",
     "normally-closed contacts, or a second channel"),
    ("the zero switch dead while azimuth does not pass zero", "no edge is expected", "none", "a second vane, or an encoder"),
    ("a temperature that is stuck, or off by less than 3 K", "screws change by fractions of a kelvin per second at most",
     "2.9 um of rod per kelvin: 0.1 arcmin of attitude, and that only where it is closed on the resolvers", "a second sensor at each screw"),
    ("a supply reading that is stuck within its range", "it is constant in health too", "none: the law does not use it", "the supply's own monitor"),
    ("a current reading off by less than 0.75 A", "less than what supply and load may explain", "the motor observer explains it as a disturbance",
     "a second current sensor"),
    ("any fault of the base encoders", "logged for diagnosis, never read by the law", "none", "the IMU, offline: `spsp-ctrl diagnose`"),
)  # fmt: skip
"""Fault, why nobody sees it, what it does meanwhile, the sensor that would."""
