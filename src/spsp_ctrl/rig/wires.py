"""A rig on real transports: hardware, or the plant server in another process. A bus that cannot carry its traffic is refused before it is opened."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from spsp_ctrl.config.devices import HARMLESS, BusDriver
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices.transport.base import CanTransport, SerialTransport, TransportError
from spsp_ctrl.devices.transport.opening import open_can, open_serial
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.bus import BusRig
from spsp_ctrl.rig.traffic import refusals

CanFilter = Callable[[str, CanTransport], CanTransport]
LineFilter = Callable[[str, SerialTransport], SerialTransport]


def is_terminal(port: str) -> bool:
    """A pseudo-terminal: its other end is a program, never a device. Also the name of one that is not there yet (the plant server makes a link)."""
    real = os.path.realpath(port)
    return re.fullmatch(r"/dev/pts/\d+", real) is not None or (not real.startswith("/dev/") and not os.path.exists(real))


def is_virtual_can(channel: str, net: Path = Path("/sys/class/net")) -> bool:
    """A SocketCAN interface without a controller (vcan)."""
    try:
        return os.path.realpath(net / channel).startswith("/sys/devices/virtual/") or "virtual" in Path(os.path.realpath(net / channel)).parts
    except OSError:
        return False


def hardware(driver: BusDriver) -> Iterator[str]:
    """Everything in the rig file that may reach hardware."""
    for name, bus in driver.can.items():
        port = bus.channel.partition("@")[0]
        simulated = (
            bus.interface in HARMLESS
            or (bus.interface == "slcan" and is_terminal(port))
            or (bus.interface == "socketcan" and is_virtual_can(bus.channel))
        )
        if not simulated:
            yield f"rig.can.{name}: {bus.interface} {bus.channel}"
    for name, line in driver.serial.items():
        if not is_terminal(line.port):
            yield f"rig.serial.{name}: {line.port}"


def open_lines(config: RigConfig, driver: BusDriver) -> tuple[dict[str, CanTransport], dict[str, SerialTransport]]:
    """Every bus and line of the rig file. Raises ``RigError`` with all that cannot be opened, and leaves none of them open then."""
    if driver.world == "in_process":
        raise RigError("`world: in_process` opens no bus and no port")
    if driver.world == "served" and (found := list(hardware(driver))):
        text = "`world: served` talks to a plant server and opens no hardware"
        raise RigError("\n".join(f"{place} may be hardware; {text} (pseudo-terminals, {', '.join(HARMLESS[:-1])}, vcan)" for place in found))
    full = refusals(config)
    if full:
        raise RigError("\n".join(full))
    problems: list[str] = []
    can: dict[str, CanTransport] = {}
    serial: dict[str, SerialTransport] = {}
    for name, bus in driver.can.items():
        try:
            can[name] = open_can(bus.interface, bus.channel, bus.bitrate, bus.options)
        except TransportError as error:
            problems.append(f"rig.can.{name}: {error}")
    for name, line in driver.serial.items():
        try:
            serial[name] = open_serial(line.port, line.baud)
        except TransportError as error:
            problems.append(f"rig.serial.{name}: {error}")
    if problems:
        for bus_opened in can.values():
            bus_opened.close()
        for line_opened in serial.values():
            line_opened.close()
        if driver.world == "served":
            problems.append("is the plant server running? start it in another terminal: spsp-ctrl plant serve --config FILE")
        raise RigError("\n".join(problems))
    return can, serial


def open_wires(
    config: RigConfig,
    driver: BusDriver,
    around: CanFilter = lambda name, bus: bus,
    around_line: LineFilter = lambda name, line: line,
) -> BusRig:
    """The rig behind the buses and lines of the rig file. ``around`` and ``around_line`` may put something between the rig and a bus or line."""
    can, serial = open_lines(config, driver)
    return BusRig(config, {name: around(name, bus) for name, bus in can.items()}, {name: around_line(name, line) for name, line in serial.items()})
