"""Troubles of buses, lines and nodes of a rig, told once when they begin and once when they are over. The faults that stop a run are the judge's;
this says what is behind them, in words that name the bus, the line or the node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices.transport.base import CanTransport, SerialTransport
from spsp_ctrl.devices.watch_host import RepeatWatch, StampWatch, StreamWatch, TwinWatch

_STATUS_BYTES = sum(bits for _, _, bits in C.STATUS_PDO) // 8


class Note(NamedTuple):
    """One thing that began or ended."""

    level: str
    """``error`` when it began, ``info`` when it is over."""
    id: str
    text: str


class LineWatch:
    """Told of everything that arrives; ``notes`` gives what is new."""

    def __init__(self, driver: BusDriver, can: Mapping[str, CanTransport], serial: Mapping[str, SerialTransport]) -> None:
        self._transports: dict[str, CanTransport | SerialTransport] = {**can, **serial}
        devices = driver.devices
        self._of_drives = [can[name] for name in dict.fromkeys((devices.drive_pitch.bus, devices.drive_roll.bus))]
        self._twins = {
            (node.bus, C.TPDO1 + node.node): TwinWatch(name, node.node)
            for name, node in devices.nodes()
            if getattr(node, "family", "") in ("cia402", "cia406")
        }
        self._repeats = {
            (node.bus, C.TPDO1 + node.node): RepeatWatch(name)
            for name, node in (("drive_pitch", devices.drive_pitch), ("drive_roll", devices.drive_roll))
            if node.family == "cia402"
        }
        line = devices.imu.serial
        self._stream = StreamWatch(f"imu on {line} ({driver.serial[line].port})", driver.serial[line].baud)
        self._stamp = StampWatch("imu")
        self._holding: dict[str, Note] = {}
        self._new: list[Note] = []

    def sync(self, now_ns: int) -> None:
        """A SYNC goes out."""
        for twin in self._twins.values():
            self._say(f"twin {id(twin)}", *twin.sync(now_ns))

    def frame(self, bus: str, identifier: int, data: bytes) -> None:
        """A frame has arrived."""
        place = (bus, identifier)
        twin = self._twins.get(place)
        if twin is not None:
            twin.status()
        repeat = self._repeats.get(place)
        if repeat is not None and len(data) == _STATUS_BYTES:
            self._say(f"repeat {identifier}", *repeat.status(data))

    def imu(self, now_ns: int, heard_bytes: int, device_ns: int | None) -> None:
        """What this cycle has heard of the IMU: bytes, and the device's own time of the newest frame (None: no frame)."""
        if device_ns is not None and device_ns >= 0:
            self._say("stamp", *self._stamp.step(now_ns, device_ns))
        self._say("stream", *self._stream.step(now_ns, heard_bytes, device_ns is not None))

    def step(self) -> None:
        """Once a cycle: the faults of buses and lines."""
        for name, transport in self._transports.items():
            fault = transport.fault
            if fault.id or f"line {name}" in self._holding:
                self._say(f"line {name}", fault.id, f"{name}: {fault.text}")

    def notes(self) -> list[Note]:
        """What began or ended since the last call."""
        if not self._new:
            return self._new
        found, self._new = self._new, []
        return found

    def trouble(self) -> str:
        """Fault of a bus of the drives: they may not hear us any more, whatever they say. Empty while there is none.

        A line that is gone shows as a signal that grows old; the judge of the loop knows what each one is worth.
        """
        for bus in self._of_drives:
            if bus.fault.id:
                return bus.fault.id
        return ""

    @property
    def holding(self) -> list[Note]:
        """Troubles that hold now."""
        return list(self._holding.values())

    def _say(self, place: str, name: str, text: str) -> None:
        held = self._holding.get(place)
        if held is not None and held.id != name:
            del self._holding[place]
            if not name:
                self._new.append(Note("info", held.id, f"over: {held.text}"))
        if name and (held is None or held.id != name):
            self._holding[place] = note = Note("error", name, text)
            self._new.append(note)
