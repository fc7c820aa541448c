"""What a rig is made of: the virtual rig in one piece, or devices on CAN buses and serial lines. A part of the rig file (``rig:``)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Annotated, Literal

from pydantic import Field

from spsp_ctrl.config.strict import Strict

LOCKSTEP = "spsp-lockstep"
"""Name of the deterministic bus inside this process, as a python-can interface and as a serial port."""
HARMLESS = ("udp_multicast", "virtual", LOCKSTEP)
"""Interfaces that never reach hardware by themselves."""
Option = str | int | float | bool
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,19}$")]


class Wire(Strict):
    """Steps in which values travel on the buses, so that a run without them has the same numbers."""

    rated_current_a: float = Field(gt=0.0, le=500.0)
    """Motor current is commanded and reported in thousandths of this."""


class SimulatedDriver(Strict):
    """The virtual rig: the plant in this process."""

    driver: Literal["simulated"]
    """The virtual rig."""
    model: str = "model.yaml"
    """Plant model file, relative to this file."""
    seed: int = Field(default=1, ge=0, le=2**31 - 1)
    """Seed of noise and base roughness."""
    wire: Wire | None = None
    """Round commands and readings as a bus would; absent: they are exact."""


class CanBus(Strict):
    """One CAN bus, in python-can's own words."""

    interface: str = Field(min_length=1, max_length=60)
    """Name of a python-can interface (`socketcan`, `slcan`, `udp_multicast`, `pcan` …), or `spsp-lockstep` inside this process."""
    channel: str = Field(min_length=1, max_length=200)
    """Its channel: `can0`, `/dev/ttyACM0`, `239.74.163.2` …"""
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    """Bit/s; the load of the bus is computed with it."""
    options: dict[str, Option] = Field(default_factory=dict)
    """Anything else that the interface wants."""


class SerialLine(Strict):
    """One serial line."""

    port: str = Field(min_length=1, max_length=200)
    """Path of the port or pseudo-terminal, or `spsp-lockstep` inside this process."""
    baud: int = Field(default=115_200, ge=1_200, le=6_000_000)
    """Bit/s."""


class Expected(Strict):
    """Who must answer; what is absent is not compared."""

    vendor: str | None = None
    """Vendor as `spsp-ctrl scan` prints it."""
    product: str | None = None
    """Product, likewise."""
    serial: str | None = None
    """Serial number, likewise."""


class CanNode(Strict):
    """A node on a CAN bus."""

    bus: Name
    """One of `can`."""
    node: int = Field(ge=1, le=127)
    """Its node number."""
    heartbeat_ms: int = Field(default=20, ge=5, le=1000)
    """Period of its heartbeat and of ours; a drive stops after three of ours are missing."""
    expect: Expected = Expected()
    """Who must answer."""
    settings: dict[str, Option] = Field(default_factory=dict)
    """What else the family wants to know."""


class DriveNode(CanNode):
    """The drive of an actuator. Its mode is that of the actuator."""

    family: str = Field(default="cia402", min_length=1, max_length=60)
    """Protocol: `cia402`, `odrive`, or the name of a plug-in (entry point `spsp_ctrl.drive`)."""
    counts_per_turn: int | None = Field(default=None, ge=16, le=2**24)
    """Unit of position and speed on the bus; that of the actuator's resolver when absent."""
    rated_current_a: float | None = Field(default=None, gt=0.0, le=500.0)
    """Torque travels in thousandths of it; asked from the drive when absent, compared with its answer when given."""
    reversed: bool = False
    """The motor turns the other way: position, speed and current change their sign."""
    temperature_object: int | None = Field(default=None, ge=0x2000, le=0x9FFF)
    """Object with the temperatures of two sensors (16 bit, 1/16 °C): 1 the screw, 2 the column (pitch drive) or the frame (roll drive)."""


class AngleNode(CanNode):
    """A resolver or encoder node."""

    family: str = Field(default="cia406", min_length=1, max_length=60)
    """Protocol: `cia406` or the name of a plug-in (entry point `spsp_ctrl.angle`)."""
    counts_per_turn: int | None = Field(default=None, ge=16, le=2**24)
    """Measuring units per turn; asked from the node when absent, compared with its answer when given."""
    reversed: bool = False
    """It counts the other way."""
    offset_counts: int = 0
    """Its reading at zero."""


class ImuUnit(Strict):
    """The inertial unit, mounted upright, x forward."""

    family: str = Field(default="mip", min_length=1, max_length=60)
    """Protocol: `mip` or the name of a plug-in (entry point `spsp_ctrl.imu`)."""
    serial: Name
    """One of `serial`."""
    expect: Expected = Expected()
    """Who must answer."""
    settings: dict[str, Option] = Field(default_factory=dict)
    """What else the family wants to know."""


class StepperModule(Strict):
    """The azimuth stepper."""

    family: str = Field(default="tmcl", min_length=1, max_length=60)
    """Protocol: `tmcl` or the name of a plug-in (entry point `spsp_ctrl.stepper`)."""
    serial: Name | None = None
    """One of `serial`, or"""
    bus: Name | None = None
    """one of `can`."""
    address: int = Field(default=1, ge=1, le=127)
    """Address of the module."""
    host: int = Field(default=2, ge=1, le=127)
    """Our address."""
    motor: int = Field(default=0, ge=0, le=5)
    """Axis of the module."""
    pulse_divisor: int | None = Field(default=None, ge=0, le=13)
    """Axis parameter 154 of a module on a TMC429, which counts speed in internal numbers; absent: pulses per second."""
    reversed: bool = False
    """It counts the other way; the travel switches change places."""
    expect: Expected = Expected()
    """Who must answer."""
    settings: dict[str, Option] = Field(default_factory=dict)
    """What else the family wants to know."""


class Devices(Strict):
    """What is on the buses and lines."""

    drive_pitch: DriveNode
    """Drive of the pitch leg."""
    drive_roll: DriveNode
    """Drive of the roll leg."""
    imu: ImuUnit
    azimuth: StepperModule
    resolver_pitch: AngleNode | None = None
    """Resolver node of the pitch leg; absent: the position that its drive reports."""
    resolver_roll: AngleNode | None = None
    """The same for the roll leg."""
    base_pitch: AngleNode | None = None
    """Encoder of the swing table: logged, never used by the law."""
    base_roll: AngleNode | None = None
    """The same about roll."""
    base_yaw: AngleNode | None = None
    """The same about yaw."""

    def nodes(self) -> Iterator[tuple[str, CanNode]]:
        """Everything with a node number, by name."""
        for name in type(self).model_fields:
            device = getattr(self, name)
            if isinstance(device, CanNode):
                yield name, device


class BusDriver(Strict):
    """A rig on buses: hardware, or the virtual rig with every byte encoded and decoded."""

    driver: Literal["bus"]
    """Devices on CAN buses and serial lines."""
    world: Literal["in_process", "served", "hardware"]
    """Who answers: simulated devices in this process (lock-step), `spsp-ctrl plant serve` in another process, or hardware."""
    model: str = "model.yaml"
    """Plant model file of a virtual rig, relative to this file."""
    seed: int = Field(default=1, ge=0, le=2**31 - 1)
    """Seed of a virtual rig."""
    truth: str | None = Field(default=None, max_length=200)
    """File in memory (`/dev/shm/…`) through which `spsp-ctrl plant serve` tells true states, for the log of a virtual rig only."""
    can: dict[Name, CanBus] = Field(default_factory=dict)
    """CAN buses by name."""
    serial: dict[Name, SerialLine] = Field(default_factory=dict)
    """Serial lines by name."""
    devices: Devices
    """What is on them."""

    def misfits(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """What no single key can know: place below ``rig`` and text."""
        yield from self._wrong_places()
        yield from self._doubles()
        yield from self._wrong_truth()
        yield from self._wrong_world()

    def _wrong_places(self) -> Iterator[tuple[tuple[str, ...], str]]:
        d = self.devices
        used: list[tuple[tuple[str, str], str, Collection[str], str]] = [((name, "bus"), node.bus, self.can, "can") for name, node in d.nodes()]
        used.append((("imu", "serial"), d.imu.serial, self.serial, "serial"))
        if (d.azimuth.serial is None) == (d.azimuth.bus is None):
            yield ("devices", "azimuth"), "rig.devices.azimuth: give either `serial` or `bus`"
        if d.azimuth.serial is not None:
            used.append((("azimuth", "serial"), d.azimuth.serial, self.serial, "serial"))
        if d.azimuth.bus is not None:
            used.append((("azimuth", "bus"), d.azimuth.bus, self.can, "can"))
        for place, name, known, section in used:
            if name not in known:
                text = f"rig.devices.{'.'.join(place)} = {name!r} is none of rig.{section}: {', '.join(known) or 'which is empty'}"
                yield ("devices", *place), text
        if d.azimuth.serial is not None and d.azimuth.serial == d.imu.serial:
            yield ("devices", "azimuth", "serial"), f"rig.devices: imu and azimuth are both on the line {d.azimuth.serial!r}; each needs its own"

    def _doubles(self) -> Iterator[tuple[tuple[str, ...], str]]:
        seen: dict[tuple[str, int], str] = {}
        for name, node in self.devices.nodes():
            other = seen.setdefault((node.bus, node.node), name)
            if other != name:
                yield ("devices", name, "node"), f"rig.devices.{name}.node = {node.node} is taken by {other} on the same bus {node.bus!r}"
        stepper = self.devices.azimuth
        if stepper.bus is not None and stepper.address == stepper.host:
            yield ("devices", "azimuth", "host"), f"rig.devices.azimuth.host = {stepper.host} is the address of the module; they must differ"
        channels: dict[tuple[str, str], str] = {}
        for name, bus in self.can.items():
            other = channels.setdefault((bus.interface, bus.channel), name)
            if other != name:
                yield ("can", name, "channel"), f"rig.can.{name}: {bus.interface} {bus.channel} is already the bus {other!r}"
        ports: dict[str, str] = {}
        for name, line in self.serial.items():
            other = ports.setdefault(line.port if line.port != LOCKSTEP else name, name)
            if other != name:
                yield ("serial", name, "port"), f"rig.serial.{name}: {line.port} is already the line {other!r}"

    def _wrong_truth(self) -> Iterator[tuple[tuple[str, ...], str]]:
        if self.truth is not None and self.world != "served":
            yield ("truth",), f"rig.truth: `world: {self.world}` has no plant in another process; delete it"

    def _wrong_world(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """A simulated session names no hardware, and hardware no simulation."""
        inside = self.world == "in_process"
        for name, bus in self.can.items():
            place = ("can", name, "interface")
            if inside != (bus.interface == LOCKSTEP):
                yield place, f"rig.can.{name}.interface = {bus.interface!r}: `world: {self.world}` {_needs(inside)}"
        for name, line in self.serial.items():
            place = ("serial", name, "port")
            if inside != (line.port == LOCKSTEP):
                yield place, f"rig.serial.{name}.port = {line.port!r}: `world: {self.world}` {_needs(inside)}"


def _needs(inside: bool) -> str:
    return f"needs {LOCKSTEP!r}" if inside else f"cannot have {LOCKSTEP!r}, which ends at this process"


Driver = Annotated[SimulatedDriver | BusDriver, Field(discriminator="driver")]
"""``rig:`` of a rig file."""
