"""A rig that does exactly what it is told, in a few lines: for walks through the controller that would take the plant days."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from random import Random

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.config.scenario import ReferencePlan
from spsp_ctrl.mechanism.kinematics import attitude_from_rods
from spsp_ctrl.messages import (
    AzimuthSample,
    BaseSample,
    Command,
    Control,
    DriveSample,
    ImuSample,
    Measurement,
    Mode,
    OperatorRequest,
    ResolverSample,
    TemperatureSample,
)
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.cycle import CycleState

CONFIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
CONTROLLER = cycle.controller(CONFIG)
P = CONTROLLER.laws[0][0]
DT, PERIOD_NS = 1e-3, 1_000_000
IDLE = Command(0, -1, False, 0.0, 0.0, 0.0, 0.0, 0.0)
COUNT = 2.0 * pi / 2**14


@dataclass
class Toy:
    """Motors turn at the speed asked for as soon as they are powered; the base stands still and level."""

    random: Random = field(default_factory=lambda: Random(1))
    k: int = 0
    pitch: float = 0.0
    """Motor angles in rad, azimuth in rad."""
    roll: float = 0.0
    azimuth: float = 0.0
    last: Command = IDLE
    before: Command = IDLE
    attitude: tuple[float, float, float] = (0.0, 0.0, 0.0)
    imu: tuple[ImuSample, ...] = ()
    stepper: AzimuthSample | None = None

    def copy(self, seed: int) -> Toy:
        """The same moment, with other noise."""
        return Toy(Random(seed), self.k, self.pitch, self.roll, self.azimuth, self.last, self.before, self.attitude, self.imu, self.stepper)

    def joints(self) -> tuple[float, float]:
        """Joint angles of pitch and roll."""
        travel = P.pitch.travel_per_rad_m
        return attitude_from_rods(P.level_m + self.pitch * travel, P.level_m + self.roll * travel, P.height_m, P.radius_m, P.static_radius_m)

    def read(self) -> Measurement:
        """The next SYNC."""
        now, noise = self.k * PERIOD_NS, self.random.gauss
        if self.before.enable:
            self.pitch += self.before.pitch_speed_rad_s * DT
            self.roll += self.before.roll_speed_rad_s * DT
            self.azimuth += self.before.azimuth_rate_rad_s * DT
        if self.k % 5 == 0:
            pitch, roll = self.joints()
            old = self.attitude
            self.attitude = (pitch, roll, self.azimuth)
            rates = [(a - b) / 5e-3 + noise(0.0, 4e-4) for a, b in zip(self.attitude, old, strict=True)]
            frame = ImuSample(
                now, now + 5_000_000, self.k // 5, True, -roll, pitch + noise(0.0, 1e-5), self.azimuth, -rates[1], rates[0], rates[2]
            )
            self.imu = (*self.imu[-1:], frame)
        if self.k % 10 == 0 or self.stepper is None:
            step = P.rad_per_microstep
            rate = self.before.azimuth_rate_rad_s / step
            self.stepper = AzimuthSample(
                now, self.k // 10, self.last.enable, round(self.azimuth / step), rate, False, False, abs(self.azimuth) < 0.0087
            )
        on, current = self.last.enable, self.before
        m = Measurement(
            now,
            self.k,
            self.imu[0],
            ResolverSample(now, self.k, round(self.pitch / COUNT + noise(0.0, 0.6)), 0),
            ResolverSample(now, self.k, round(self.roll / COUNT + noise(0.0, 0.6)), 0),
            DriveSample(now, self.k, on, 0, (current.pitch_current_a if on else 0.0) + noise(0.0, 5e-3), 24.0),
            DriveSample(now, self.k, on, 0, (current.roll_current_a if on else 0.0) + noise(0.0, 5e-3), 24.0),
            self.stepper,
            TemperatureSample(now - now % 100_000_000, self.k // 100, 20.0, 20.0, 20.0, 20.0),
            BaseSample(now, self.k, 0.0, 0.0, 0.0),
        )
        self.k += 1
        return m

    def write(self, command: Command) -> None:
        """Take a command."""
        self.before, self.last = self.last, command


def moments() -> dict[Mode, tuple[Toy, CycleState]]:
    """A rig and its controller in the middle of every mode that an operator can bring it to."""
    toy = Toy(pitch=20.0, roll=-15.0, azimuth=0.05)
    state = cycle.start(CONFIG, ReferencePlan())
    found: dict[Mode, tuple[Toy, CycleState]] = {}
    stop_at = None
    for _ in range(6000):
        m = toy.read()
        verbs: tuple[OperatorRequest, ...] = ()
        if stop_at is not None and toy.k >= stop_at:
            verbs, stop_at = (OperatorRequest(m.stamp_ns, "stop", 0.0, "toy"),), None
        control, state = cycle.step(state, CONTROLLER, m, verbs, m.stamp_ns, DT)
        toy.write(control.command)
        mode = Mode(control.mode)
        if state.supervisor.in_mode_s > 0.02 and mode not in found:
            found[mode] = (toy.copy(1), state)
            if mode == Mode.ACTIVE:
                # stopped out of a slew, so that braking takes its time
                heading = (OperatorRequest(toy.k * PERIOD_NS, "heading", 0.5, "toy"),)
                m = toy.read()
                control, state = cycle.step(state, CONTROLLER, m, heading, m.stamp_ns, DT)
                toy.write(control.command)
                stop_at = toy.k + 400
        if Mode.READY in found:
            break
    return found


def run(toy: Toy, state: CycleState, cycles: int) -> tuple[Control, CycleState]:
    """Undisturbed."""
    for _ in range(cycles):
        m = toy.read()
        control, state = cycle.step(state, CONTROLLER, m, (), m.stamp_ns, DT)
        toy.write(control.command)
    return control, state
