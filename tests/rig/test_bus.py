"""The rig on buses with every byte encoded and decoded, in lock-step: the contract of every rig, and the same numbers as without a bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.rig_contract import Factory, contract

from spsp_ctrl.config.devices import BusDriver, SimulatedDriver, Wire
from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.rig.bus import BusRig
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.rig.world import LockstepWorld

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


def make(seed: int = 7, **changes: object) -> BusRig:
    bus = driver(**changes)
    world = LockstepWorld(RIG, bus, MODEL, SCENARIO, seed)
    can = {name: world.can(name) for name in bus.can}
    return BusRig(RIG.model_copy(update={"rig": bus}), can, {name: world.line(name) for name in bus.serial}, world.truth, world.warm_up)


@contract
def test_contract(check: Callable[[Factory], None]) -> None:
    check(make)
