"""Who is on the bus, against the rig file: missing, doubled, foreign and wrong devices are named; nothing is changed by asking."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from tests.rig.lockstep_devices import Wired, rig_config

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices.cia402_device import Drive
from spsp_ctrl.devices.cia406_device import Encoder
from spsp_ctrl.rig.finding import Found, scan


def scanned(asked: RigConfig, there: Wired) -> dict[str, Found]:
    assert isinstance(asked.rig, BusDriver)
    found = scan(asked.rig, there.can, there.serial)
    return {f.expected_as or f"stranger {f.who.address if f.who else ''}": f for f in found}


def test_everybody_is_there_and_as_expected() -> None:
    config = rig_config()
    found = scanned(config, Wired(config))
    assert set(found) == {"drive_pitch", "drive_roll", "base_pitch", "imu", "azimuth"}
    assert not any(f.problem for f in found.values())
    who = found["drive_roll"].who
    assert who is not None
    assert (who.address, who.kind, who.vendor, who.serial) == (2, "CiA 402 drive", "0x53505350", "0x00000002")
    imu, stepper = found["imu"].who, found["azimuth"].who
    assert imu is not None
    assert stepper is not None
    assert (imu.vendor, imu.product, imu.firmware) == ("MicroStrain", "3DM-CV7-AHRS", "1.1.05")
    assert (stepper.vendor, stepper.product) == ("Trinamic", "TMCM-1241")


def test_the_identity_is_the_one_that_the_rig_compares() -> None:
    """`expect` of the rig file takes what the scan prints."""
    from spsp_ctrl.rig.bus import BusRig

    config = rig_config()
    wired = Wired(config)
    rig = BusRig(config, wired.can, wired.serial)
    identities = rig.identify()
    for name, f in scanned(config, Wired(config)).items():
        assert f.who is not None
        assert (f.who.vendor, f.who.product, f.who.serial, f.who.firmware) == tuple(identities[name])


@pytest.mark.parametrize(
    ("there", "asked", "name", "text"),
    [
        ({}, {"drive_roll": {"bus": "can0", "node": 3}}, "drive_roll", "node 3: nobody answers"),
        ({}, {"drive_roll": {"bus": "can0", "node": 3}}, "stranger 2", "not in the rig file"),
        ({}, {"drive_pitch": {"bus": "can0", "node": 1, "expect": {"serial": "0x00000009"}}}, "drive_pitch", "'0x00000001', the rig file expects"),
        ({}, {"base_pitch": {"bus": "can0", "node": 2}, "drive_roll": {"bus": "can0", "node": 11}}, "base_pitch", "is a CiA 402 drive"),
        ({}, {"imu": {"serial": "imu", "expect": {"serial": "6286.7"}}}, "imu", "serial"),
        ({"azimuth": {"serial": "stepper", "address": 5}}, {}, "azimuth", "no TMCL module answers at address 1"),
    ],
)
def test_what_is_not_as_expected_is_named(there: dict[str, Any], asked: dict[str, Any], name: str, text: str) -> None:
    found = scanned(rig_config(**asked), Wired(rig_config(**there)))
    if name.startswith("stranger"):
        assert found[name].problem == ""
        assert found[name].expected_as == ""
    else:
        assert text in found[name].problem


def test_two_nodes_with_one_number_are_named() -> None:
    config = rig_config()
    wired = Wired(config)
    wired.media["can0"].serve(_answers(Drive(1, rated_current_ma=1000)))
    found = scanned(config, wired)
    assert "2 devices answer with the number 1" in found["drive_pitch"].problem
    assert found["drive_roll"].problem == ""


def test_asking_changes_no_device() -> None:
    config = rig_config()
    wired = Wired(config)
    drive = wired.devices.drives[0].drive  # type: ignore[attr-defined]
    before = {key: o.value for key, o in drive.node.objects.items()}
    scanned(config, wired)
    assert {key: o.value for key, o in drive.node.objects.items()} == before
    assert drive.node.state == 127  # still before the start


def test_an_imu_at_another_speed_is_told_from_a_dead_line() -> None:
    config = rig_config()
    wired = Wired(config)
    wired.serial["imu"].receive = lambda data: bytes(200)
    assert "not one packet at 115200 baud" in scanned(config, wired)["imu"].problem
    wired.serial["imu"].receive = lambda data: b""
    assert "nothing arrives" in scanned(config, wired)["imu"].problem


def test_a_foreign_encoder_is_listed() -> None:
    config = rig_config()
    wired = Wired(config)
    wired.media["can0"].serve(_answers(Encoder(77)))
    assert scanned(config, wired)["stranger 77"].who is not None


def _answers(device: Drive | Encoder) -> Callable[[int, bytes], list[tuple[int, bytes]]]:
    return lambda identifier, data: device.receive((identifier, data))
