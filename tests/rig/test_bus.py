"""The rig on buses with every byte encoded and decoded, in lock-step: the contract of every rig, and the same numbers as without a bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.rig_contract import Factory, contract

from spsp_ctrl.config.devices import BusDriver, SimulatedDriver, Wire
from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import Control, Measurement, Mode, Timing, Truth
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.rig.base import Rig
from spsp_ctrl.rig.bus import BusRig
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.rig.world import LockstepWorld
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.clock import LockStepClock
from spsp_ctrl.runtime.loop import NullRecorder, run_loop

CONFIG = Path(__file__).parents[2] / "config"
RIG = load_rig(CONFIG / "rig.yaml").model
SCENARIO = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
MODEL = load_model(CONFIG / "model.yaml")
DRIVER = {
    "driver": "bus",
    "world": "in_process",
    "can": {"can0": {"interface": "spsp-lockstep", "channel": "rig"}},
    "serial": {"imu": {"port": "spsp-lockstep"}, "stepper": {"port": "spsp-lockstep"}},
    "devices": {
        "drive_pitch": {"bus": "can0", "node": 1, "temperature_object": 0x2002},
        "drive_roll": {"bus": "can0", "node": 2, "temperature_object": 0x2002},
        "imu": {"serial": "imu"},
        "azimuth": {"serial": "stepper"},
        "base_pitch": {"bus": "can0", "node": 11},
        "base_roll": {"bus": "can0", "node": 12},
        "base_yaw": {"bus": "can0", "node": 13},
    },
}


def driver(**changes: object) -> BusDriver:
    """The devices above, some of them changed."""
    return BusDriver.model_validate(DRIVER | {"devices": DRIVER["devices"] | changes})


CHANGED = {
    "drive_pitch": {"bus": "can0", "node": 1, "temperature_object": 0x2002, "reversed": True},
    "resolver_roll": {"bus": "can0", "node": 21, "reversed": True, "offset_counts": 1234},
    "azimuth": {"bus": "can0", "address": 3, "reversed": True},
}
"""Another wiring of the same rig: one motor and the stepper turned round, a resolver node of its own, the stepper on CAN."""


def make(seed: int = 7, config: RigConfig = RIG, **changes: object) -> BusRig:
    bus = driver(**changes)
    world = LockstepWorld(config, bus, MODEL, SCENARIO, seed)
    can = {name: world.can(name) for name in bus.can}
    return BusRig(config.model_copy(update={"rig": bus}), can, {name: world.line(name) for name in bus.serial}, world.truth, world.warm_up)


@contract
def test_contract(check: Callable[[Factory], None]) -> None:
    check(make)


class _Kept(NullRecorder):
    """What the loop records, kept."""

    def __init__(self) -> None:
        self.rows: list[tuple[Measurement, Control, Truth | None]] = []

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        self.rows.append((measurement, control, truth))


def _swing(rig: Rig, config: RigConfig, seconds: float) -> list[tuple[Measurement, Control, Truth | None]]:
    kept = _Kept()
    rig.open()
    period_ns = round(1e9 / config.rate_hz)
    start = cycle.start(config, SCENARIO.reference)
    run_loop(rig, LockStepClock(period_ns), cycle.controller(config), start, round(seconds * 1e9), kept, rate_hz=config.rate_hz)
    rig.close()
    return kept.rows


CASES = [(1000, "torque", {}), (500, "torque", {}), (1000, "velocity", {}), (1000, "torque", CHANGED)]


@pytest.mark.parametrize(("rate_hz", "mode", "changes"), CASES)
def test_swing_is_the_same_to_the_last_bit(rate_hz: int, mode: str, changes: dict[str, object]) -> None:
    """Plant called directly with the steps of the wire, and every byte encoded and decoded: one run."""
    sides = {name: getattr(RIG, name).model_copy(update={"mode": mode}) for name in ("pitch_actuator", "roll_actuator")}
    imu = RIG.imu.model_copy(update={"rate_hz": 250.0 if rate_hz == 500 else 200.0})  # what fits whole cycles
    config = RIG.model_copy(update={"rate_hz": rate_hz, "imu": imu, **sides})
    wired = config.model_copy(update={"rig": SimulatedDriver(driver="simulated", wire=Wire(rated_current_a=2.5))})
    direct = _swing(SimulatedRig(wired, MODEL, SCENARIO, seed=7), wired, 4.0)
    bus = _swing(make(config=config, **changes), config, 4.0)
    assert any(control.mode == Mode.ACTIVE for _, control, _ in bus)
    assert len(direct) == len(bus)
    for k, (a, b) in enumerate(zip(direct, bus, strict=True)):
        for name in Measurement._fields:
            assert getattr(a[0], name) == getattr(b[0], name), f"cycle {k}, {name}"
        assert a[1] == b[1], f"cycle {k}, control"
        assert a[2] == b[2], f"cycle {k}, truth"
