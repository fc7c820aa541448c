"""What a rig puts on its buses: by hand for one rig, and refused where it is too much."""

from __future__ import annotations

from pathlib import Path

import pytest

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices.transport.bus_load import load, worst_bits
from spsp_ctrl.rig.traffic import can_traffic, refusals

CONFIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model


def rig(rate_hz: int = 500, bitrate: int = 1_000_000, baud: int = 921_600, **changes: object) -> RigConfig:
    devices: dict[str, object] = {
        "drive_pitch": {"bus": "can0", "node": 1},
        "drive_roll": {"bus": "can0", "node": 2},
        "imu": {"serial": "imu"},
        "azimuth": {"serial": "stepper"},
    }
    driver = {
        "driver": "bus",
        "world": "hardware",
        "can": {"can0": {"interface": "socketcan", "channel": "can0", "bitrate": bitrate}},
        "serial": {"imu": {"port": "/dev/ttyUSB0", "baud": baud}, "stepper": {"port": "/dev/ttyUSB1", "baud": 115_200}},
        "devices": devices | changes,
    }
    azimuth = CONFIG.azimuth.model_copy(update={"rate_hz": 50.0})
    return CONFIG.model_copy(update={"rig": BusDriver.model_validate(driver), "rate_hz": rate_hz, "azimuth": azimuth})


def test_two_drives_by_hand() -> None:
    per_cycle = worst_bits(0) + 2 * (worst_bits(4) + worst_bits(8) + worst_bits(7) / 10)
    per_s = 2 * 50 * worst_bits(1) + 50 * worst_bits(1) + 2 * 40 * worst_bits(8)
    assert load(can_traffic(rig(), "can0"), 1_000_000) == pytest.approx((500 * per_cycle + per_s) / 1e6)
    assert refusals(rig()) == []


def test_a_full_bus_and_a_full_line_are_refused_with_a_way_out() -> None:
    resolvers = {name: {"bus": "can0", "node": n} for n, name in enumerate(("resolver_pitch", "resolver_roll", "base_pitch", "base_roll"), 11)}
    (text,) = refusals(rig(rate_hz=1000, **resolvers))
    assert "rig.can.can0" in text
    assert "rate_hz" in text
    assert refusals(rig(rate_hz=500, **resolvers)) == []
    fast = rig(baud=115_200).model_copy(update={"imu": CONFIG.imu.model_copy(update={"rate_hz": 500.0})})
    (text,) = refusals(fast)
    assert text.startswith("rig.serial.imu: imu needs 208 % of 115200 baud")
    assert "460800 baud" in text


def test_a_stepper_on_the_bus_is_counted() -> None:
    there = can_traffic(rig(azimuth={"bus": "can0"}), "can0")
    assert load(there, 1_000_000) - load(can_traffic(rig(), "can0"), 1_000_000) == pytest.approx(12 * 50 * worst_bits(8) / 1e6)
