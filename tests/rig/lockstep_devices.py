"""The simulated devices of a rig file on wires inside the process, without a plant: for tests of what is on a bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices.transport.lockstep import LockstepCan, LockstepSerial, Medium
from spsp_ctrl.rig.virtual_devices import VirtualDevices

CONFIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
DEVICES: dict[str, Any] = {
    "drive_pitch": {"bus": "can0", "node": 1},
    "drive_roll": {"bus": "can0", "node": 2},
    "imu": {"serial": "imu"},
    "azimuth": {"serial": "stepper"},
    "base_pitch": {"bus": "can0", "node": 11},
}


def rig_config(**changes: Any) -> RigConfig:
    """A rig of the devices above, some changed; None leaves one out."""
    devices = {name: value for name, value in (DEVICES | changes).items() if value is not None}
    driver = {
        "driver": "bus",
        "world": "in_process",
        "can": {"can0": {"interface": "spsp-lockstep", "channel": "rig"}},
        "serial": {"imu": {"port": "spsp-lockstep"}, "stepper": {"port": "spsp-lockstep"}},
        "devices": devices,
    }
    return CONFIG.model_copy(update={"rig": BusDriver.model_validate(driver)})


class Wired:
    """Devices of one rig file, answering."""

    def __init__(self, config: RigConfig) -> None:
        driver = config.rig
        assert isinstance(driver, BusDriver)
        self.devices = VirtualDevices(config, driver, config.imu.rate_hz)
        self.media = {name: Medium() for name in driver.can}
        for name, medium in self.media.items():
            medium.serve(lambda identifier, data, name=name: self.devices.receive(name, (identifier, data), 0))  # type: ignore[misc]
        self.can = {name: LockstepCan(medium) for name, medium in self.media.items()}
        self.serial = {"imu": LockstepSerial(self.devices.imu.receive), "stepper": LockstepSerial(self.devices.stepper_bytes)}
