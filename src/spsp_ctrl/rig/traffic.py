"""What the devices of a rig file put on its buses and lines, and whether these can carry it."""

from __future__ import annotations

from collections.abc import Iterator

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.rig import Actuator, RigConfig
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import mip_table as M
from spsp_ctrl.devices import tmcl_table as S
from spsp_ctrl.devices.transport.bus_load import Traffic, refusal

SERIAL_LIMIT = 0.9
"""A line has one sender a direction and repeats nothing; what is left is for the tolerance of its baud rate."""
_ASKED = 6
"""Questions and orders of one round of the stepper."""
_IMU_BYTES = M.HEADER_BYTES + 10 + 16 + 16 + M.CHECKSUM_BYTES
"""Reference time, Euler angles and rate in one packet."""


def _bytes(mapping: tuple[tuple[int, int, int], ...]) -> int:
    return sum(bits for _, _, bits in mapping) // 8


def _drive(name: str, family: str, velocity: bool, rate_hz: int, heartbeat_hz: float, estimates_hz: float) -> Iterator[Traffic]:
    if family == "odrive":
        yield Traffic(f"{name}: command", 8 if velocity else 4, rate_hz, cyclic=True)
        yield Traffic(f"{name}: estimates", 8, estimates_hz)
        yield Traffic(f"{name}: heartbeat", 8, 10.0)
        return
    yield Traffic(f"{name}: command", _bytes(C.VELOCITY_PDO if velocity else C.TORQUE_PDO), rate_hz, cyclic=True)
    yield Traffic(f"{name}: status", _bytes(C.STATUS_PDO), rate_hz, cyclic=True)
    yield Traffic(f"{name}: slow status", _bytes(C.SLOW_PDO), rate_hz / C.SLOW_EVERY, cyclic=True)
    yield Traffic(f"{name}: heartbeat", 1, heartbeat_hz)
    yield Traffic(f"{name}: temperatures", 8, 2 * 2 * 10.0)  # two objects asked and answered ten times a second


def can_traffic(config: RigConfig, bus: str) -> list[Traffic]:
    """Everything on one CAN bus in operation, with the worst case of each device."""
    driver = config.rig
    assert isinstance(driver, BusDriver)
    d, rate_hz = driver.devices, config.rate_hz
    found: list[Traffic] = []
    actuators: dict[str, Actuator] = {"drive_pitch": config.pitch_actuator, "drive_roll": config.roll_actuator}
    beats = [1e3 / node.heartbeat_ms for _, node in d.nodes() if node.bus == bus]
    for name, node in d.nodes():
        if node.bus != bus:
            continue
        if name in actuators:
            estimates_hz = 1e6 / float(node.settings.get("estimates_us", 1000))
            velocity = actuators[name].mode == "velocity"
            found += _drive(name, getattr(node, "family", ""), velocity, rate_hz, 1e3 / node.heartbeat_ms, estimates_hz)
        else:
            found += [Traffic(f"{name}: angle", 8, rate_hz, cyclic=True), Traffic(f"{name}: heartbeat", 1, 1e3 / node.heartbeat_ms)]
    if beats:
        found += [Traffic("sync", 0, rate_hz, cyclic=True), Traffic("our heartbeat", 1, max(beats))]
    if d.azimuth.bus == bus:
        found.append(Traffic("azimuth: questions and answers", 8, 2 * _ASKED * min(config.azimuth.rate_hz, rate_hz)))
    return found


def refusals(config: RigConfig) -> list[str]:
    """Every bus and line that cannot carry its traffic, with what to change; empty when all can."""
    driver = config.rig
    assert isinstance(driver, BusDriver)
    found = [text for name, bus in driver.can.items() if (text := refusal(name, can_traffic(config, name), bus.bitrate, config.rate_hz))]
    d = driver.devices
    lines = [(d.imu.serial, "imu", _IMU_BYTES * config.imu.rate_hz, "imu.rate_hz")] if d.imu.family == "mip" else []
    if d.azimuth.serial is not None and d.azimuth.family == "tmcl":
        # one request on the way at a time: question and answer take turns
        lines.append((d.azimuth.serial, "azimuth", 2 * _ASKED * S.SERIAL_BYTES * config.azimuth.rate_hz, "azimuth.rate_hz"))
    for name, device, bytes_s, key in lines:
        baud = driver.serial[name].baud
        share = 10.0 * bytes_s / baud
        if share > SERIAL_LIMIT:
            enough = next(b for b in (115_200, 230_400, 460_800, 921_600, 3_000_000, 10**9) if 10.0 * bytes_s <= SERIAL_LIMIT * b)
            text = f"rig.serial.{name}: {device} needs {100 * share:.0f} % of {baud} baud, allowed {100 * SERIAL_LIMIT:.0f} %"
            found.append(f"{text}; set it (and the device) to {enough} baud, or lower {key}")
    return found
