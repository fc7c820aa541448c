"""The loops measured on the running code: a seeded multi-sine added at the seam while the real cycle runs in lock-step on the smooth plant.

Knows only the seam, so it works for any law. What the injection adds and what the loop gives back are correlated over whole periods of the
multi-sine, after the transient; ``L = -returned / (returned + injected)`` line by line (Pintelon & Schoukens, System Identification, 2nd ed., ch. 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import TypeVar

import numpy as np
from pydantic import BaseModel

from spsp_ctrl.config.rig import RigConfig, SpeedLoop
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.control.law import STILL_SHARE
from spsp_ctrl.messages import NO_IMU, Command, Measurement, Mode, Truth
from spsp_ctrl.plant.layout import G
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.rig.base import Rig, RigIdentity
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.runtime import cycle
from spsp_ctrl.tuning.loops import Break, Complex, Kind, Margins, Real, margins
from spsp_ctrl.tuning.plant_model import LOAD_KG, SMOOTH_BITS, Axis, smooth

Part = TypeVar("Part", bound=BaseModel)
PERIOD_S = 4.0
"""Period of the multi-sine: lines are multiples of 0.25 Hz."""
START_S = 1.0
"""Arming and alignment at level are over by then (checked)."""
FADE_S = 1.0
"""The injection grows over this time: a jump would run into the limit of rod acceleration."""
SETTLE_PERIODS, JUDGED_PERIODS = 1, 1
RMS: dict[Break, float] = {"current": 5e-3, "imu": 5e-6, "resolver": 2e-3}
"""Size of the injection (A, rad, rad): small enough that no limit acts, large against the resolver's counts."""


class MeasurementError(Exception):
    """The loop did not stay closed and linear during the measurement; the text says what happened."""


@dataclass(frozen=True, slots=True)
class Response:
    """A measured loop: frequencies in Hz and the loop transfer function there."""

    at: Break
    axis: Axis
    f_hz: Real
    loop: Complex
    leak: float
    """Size (rms) of the signal after the injection at lines that were not injected, over that at those that were: distortion, drift, transient."""


def lines_hz(low_hz: float = 0.25, high_hz: float = 90.0, count: int = 48) -> Real:
    """Lines about evenly spread on a logarithmic scale: 4 n + 1 times the base frequency.

    Second harmonics and the images of the lines at multiples of a 200 Hz IMU then fall between the lines, never on one.
    """
    n = np.round((np.geomspace(low_hz, high_hz, count) * PERIOD_S - 1.0) / 4.0)
    return np.asarray((4.0 * np.unique(n[n >= 0.0]) + 1.0) / PERIOD_S, dtype=float)


def default_lines(at: Break) -> Real:
    """Up to 95 Hz at the IMU, over the structural mode elsewhere: every 2 Hz around it, where the loop changes fast."""
    if at == "imu":
        return lines_hz(high_hz=95.0)
    return np.unique(np.concatenate((lines_hz(high_hz=160.0, count=64), np.arange(90.25, 112.0, 2.0))))


class InjectingRig:
    """A rig whose current command, or sensed angle, of one axis carries a multi-sine. Everything else passes through."""

    def __init__(
        self, rig: Rig, at: Break, axis: Axis, f_hz: Real, seed: int, lags_s: tuple[float, float], rad_per_count: float
    ) -> None:
        """``lags_s``: of the IMU's attitude and gyro. ``rad_per_count``: of the resolver."""
        self._rig, self._at, self._axis = rig, at, axis
        self.omega = 2.0 * pi * f_hz
        amplitude = RMS[at] * np.sqrt(2.0 / len(f_hz))
        self.phasors = amplitude * np.exp(1j * np.random.default_rng(seed).uniform(0.0, 2.0 * pi, len(f_hz)))
        attitude, gyro = lags_s
        s = 1j * self.omega
        # a motion of the platform as the lags of the IMU let it through
        self._attitude = self.phasors / (1.0 + s * attitude)
        self._gyro = self.phasors * s / (1.0 + s * gyro)
        self._rad_per_count = rad_per_count
        self._imu = NO_IMU
        self.active_from_ns = 0
        self.stamps_ns: list[int] = []
        self.before: list[float] = []
        self.after: list[float] = []
        """The broken signal on its way to the injection, and after it."""

    def open(self) -> RigIdentity:
        """Pass."""
        return self._rig.open()

    def stop(self) -> None:
        """Pass."""
        self._rig.stop()

    def close(self) -> None:
        """Pass."""
        self._rig.close()

    def truth(self) -> Truth | None:
        """Pass."""
        return self._rig.truth()

    def _value(self, phasors: Complex, stamp_ns: int) -> float:
        if stamp_ns < self.active_from_ns:
            return 0.0
        fade = min(1.0, (stamp_ns - self.active_from_ns) * 1e-9 / FADE_S)
        return fade * float(np.sum((phasors * np.exp(1j * self.omega * (stamp_ns * 1e-9))).real))

    def _note(self, stamp_ns: int, before: float, after: float) -> None:
        self.stamps_ns.append(stamp_ns)
        self.before.append(before)
        self.after.append(after)

    def read(self, now_ns: int) -> Measurement:
        """Inject into what is sensed."""
        m = self._rig.read(now_ns)
        if self._at == "imu" and m.imu.valid:
            frame = m.imu
            if frame.seq != self._imu.seq:
                angle, rate = self._value(self._attitude, frame.stamp_ns), self._value(self._gyro, frame.stamp_ns)
                if self._axis == "roll":
                    # platform roll is minus the roll of the IMU
                    self._note(frame.stamp_ns, -frame.roll_rad, -frame.roll_rad + angle)
                    self._imu = frame._replace(roll_rad=frame.roll_rad - angle, gyro_x_rad_s=frame.gyro_x_rad_s - rate)
                else:
                    self._note(frame.stamp_ns, frame.pitch_rad, frame.pitch_rad + angle)
                    self._imu = frame._replace(pitch_rad=frame.pitch_rad + angle, gyro_y_rad_s=frame.gyro_y_rad_s + rate)
            m = m._replace(imu=self._imu)
        elif self._at == "resolver":
            name = f"resolver_{self._axis}"
            sample = getattr(m, name)
            counts = sample.counts + round(self._value(self.phasors, now_ns) / self._rad_per_count)
            self._note(now_ns, sample.counts * self._rad_per_count, counts * self._rad_per_count)
            m = m._replace(**{name: sample._replace(counts=counts)})
        return m

    def write(self, command: Command, now_ns: int) -> Command:
        """Inject into the current command. Returns what the law asked for, so that the law never learns of the injection."""
        if self._at == "current":
            name = f"{self._axis}_current_a"
            asked = getattr(command, name)
            given = asked + self._value(self.phasors, now_ns)
            self._note(now_ns, asked, given)
            self._rig.write(command._replace(**{name: given}), now_ns)
            return command
        return self._rig.write(command, now_ns)


def smooth_config(config: RigConfig, at_rest: bool = True) -> RigConfig:
    """The rig file for the smooth plant, with the law as it acts on a moving axis.

    What compensates an effect that is not there is off (backlash, friction, screw map), resolvers are as fine as the plant's. What makes the law
    nonlinear is off (learnt swing frequency, the watch that changes to a plainer law). The rig stands still during a measurement, where the law
    reduces the speed integral to ``STILL_SHARE``: the integral gains are raised by as much, so that the loop is that of the moving axis
    (``at_rest=False`` leaves them, for a run that moves).
    """

    def moving(loop: SpeedLoop) -> SpeedLoop:
        return loop.model_copy(update={"ki_a_rad": loop.ki_a_rad / STILL_SHARE}) if at_rest else loop

    def off(part: Part) -> Part:
        return part.model_copy(update={"enabled": False})

    control, compensation = config.control, config.compensation
    ours, plain = control.stabiliser, control.cascade
    performance = ours.performance.model_copy(update={"speed": moving(ours.performance.speed)})
    terms = ours.terms.model_copy(update={"screw_map": False})
    law = control.model_copy(
        update={
            "stabiliser": ours.model_copy(update={"speed": moving(ours.speed), "performance": performance, "terms": terms}),
            "cascade": plain.model_copy(update={"speed": moving(plain.speed)}),
            "base": control.base.model_copy(update={"adaptive": off(control.base.adaptive)}),
            "watch": off(control.watch),
        }
    )
    actuators = {
        name: getattr(config, name).model_copy(update={"resolver_bits": SMOOTH_BITS}) for name in ("pitch_actuator", "roll_actuator")
    }
    less = compensation.model_copy(update={"backlash": off(compensation.backlash), "friction": off(compensation.friction)})
    return config.model_copy(update={**actuators, "control": law, "compensation": less})


def still(kind: Kind, load_kg: float = LOAD_KG) -> Scenario:
    """A level rig on a base that does not move."""
    return Scenario.model_validate(
        {"schema": "spsp-ctrl/scenario/1", "name": "loop-measurement", "reference": {"kind": kind}, "load": {"mass_kg": load_kg}}
    )


def measure(
    config: RigConfig,
    model: PlantModel,
    at: Break,
    axis: Axis = "roll",
    kind: Kind = "inertial",
    f_hz: Sequence[float] | Real | None = None,
    seed: int = 1,
) -> Response:
    """Frequency response of one loop of the law in ``config`` on the smooth part of ``model``.

    Raises ``MeasurementError`` where the loop leaves ACTIVE or a limit acts during the judged periods, ``ValueError`` for a break point or a line
    that cannot be measured.
    """
    if at == "imu" and kind == "joint":
        raise ValueError("closed on the resolvers there is no loop through the IMU")
    config = smooth_config(config)
    f = default_lines(at) if f_hz is None else np.asarray(f_hz, dtype=float)
    if np.any(np.abs(f * PERIOD_S - np.round(f * PERIOD_S)) > 1e-9) or f.min() <= 0.0:
        raise ValueError(f"lines must be multiples of {1.0 / PERIOD_S:g} Hz")
    top = 0.5 * (config.imu.rate_hz if at == "imu" else config.rate_hz)
    if f.max() >= top:
        raise ValueError(f"lines must lie below half the rate at which {at} is sampled, {top:g} Hz")
    plant = smooth(model)
    parameters = plant.parameters()
    lags = float(parameters[G.imu_attitude_lag_s]), float(parameters[G.imu_gyro_lag_s])
    scenario = still(kind)
    rig = InjectingRig(SimulatedRig(config, plant, scenario, seed), at, axis, f, seed, lags, 2.0 * pi / 2**SMOOTH_BITS)
    rig.active_from_ns = round(START_S * 1e9)
    _run(rig, config, scenario)

    stamps = np.asarray(rig.stamps_ns, dtype=float) * 1e-9
    end = START_S + (SETTLE_PERIODS + JUDGED_PERIODS) * PERIOD_S
    keep = (stamps > end - JUDGED_PERIODS * PERIOD_S - 1e-9) & (stamps < end - 1e-9)
    t = stamps[keep]
    before, after = (np.asarray(x)[keep] for x in (rig.before, rig.after))

    def phasors(x: Real, lines: Real) -> Complex:
        return np.asarray((x - x.mean()) @ np.exp(-2j * pi * np.outer(t, lines)) * (2.0 / len(t)), dtype=complex)

    total, used = float(np.var(after)), 0.5 * float(np.sum(np.abs(phasors(after, f)) ** 2))
    return Response(at, axis, f, -phasors(before, f) / phasors(after, f), float(np.sqrt(max(total - used, 0.0) / used)))


def measured_margins(response: Response) -> Margins:
    """Margins of a measured loop, from the lines where the gain is below 30: above, the little that is left of the injection says nothing of L."""
    keep = np.abs(response.loop) < 30.0
    return margins(response.f_hz[keep], response.loop[keep])


def _run(rig: InjectingRig, config: RigConfig, scenario: Scenario) -> None:
    """The real cycle in lock-step, without a clock and a record."""
    controller = cycle.controller(config)
    state = cycle.start(config, scenario.reference)
    period_ns = round(1e9 / config.rate_hz)
    # one tenth of a second more: the last frames of the judged period are still on their way
    cycles = round((START_S + (SETTLE_PERIODS + JUDGED_PERIODS) * PERIOD_S + 0.1) * config.rate_hz)
    rig.open()
    try:
        for k in range(cycles):
            now_ns = k * period_ns
            measurement = rig.read(now_ns)
            control, state = cycle.step(state, controller, measurement, (), now_ns, period_ns * 1e-9)
            rig.write(control.command, now_ns)
            if now_ns >= rig.active_from_ns:
                _check(control.mode, control.fault, control.pitch.limited | control.roll.limited, now_ns)
    finally:
        rig.stop()
        rig.close()


def _check(mode: int, fault: int, limited: int, now_ns: int) -> None:
    if mode != Mode.ACTIVE or fault:
        raise MeasurementError(f"the loop was not closed at {now_ns * 1e-9:.3f} s: mode {Mode(mode).name}, fault {fault}")
    if limited:
        raise MeasurementError(f"a limit acted at {now_ns * 1e-9:.3f} s (bits {limited}): the response would not be linear")
