"""CANopen, the node's side: object dictionary, SDO server, NMT, PDOs at SYNC, heartbeats. A drive or an encoder fills the dictionary."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from spsp_ctrl.devices import canopen_table as T

Frame = tuple[int, bytes]


@dataclass(slots=True)
class Object:
    """One entry of the dictionary. ``bits`` 0 is text."""

    name: str
    bits: int
    value: int = 0
    signed: bool = False
    writable: bool = False
    readable: bool = True
    mappable: bool = False
    text: str = ""
    low: int | None = None
    high: int | None = None
    written: Callable[[int], int] | None = field(default=None, repr=False)
    """Called before a new value is taken; returns an abort code, 0 to take it."""

    def encode(self) -> bytes:
        """Value as it travels."""
        if not self.bits:
            return self.text.encode("ascii", "replace")
        return (self.value & (1 << self.bits) - 1).to_bytes(self.bits // 8, "little")

    def set(self, data: bytes) -> int:
        """Take a value from the bus; returns an abort code, 0 when it is taken."""
        if len(data) * 8 != self.bits:
            return T.WRONG_LENGTH
        value = int.from_bytes(data, "little", signed=self.signed)
        if (self.low is not None and value < self.low) or (self.high is not None and value > self.high):
            return T.OUT_OF_RANGE
        abort = self.written(value) if self.written else 0
        if not abort:
            self.value = value
        return abort


Key = tuple[int, int]


class _Pdo(NamedTuple):
    """A PDO that is on. It acts at every ``kind``-th SYNC; a received one at the next."""

    number: int
    identifier: int
    kind: int
    size: int
    objects: list[Object]


class Node:
    """A CANopen node without a bus: ``receive`` a frame, ``tick`` with the time; both return the frames to send."""

    def __init__(self, number: int, objects: dict[Key, Object]) -> None:
        self.number = number
        self.objects = objects
        self.state = T.PRE_OPERATIONAL
        self.error_register = 0
        self._syncs = 0
        self._segments: tuple[bytes, int] | None = None
        self._latched: dict[int, bytes] = {}
        self._heartbeat_ns: int | None = None
        self._watched_ns: int | None = None
        self._layout: tuple[list[_Pdo], list[_Pdo]] | None = None
        self.on_sync: Callable[[], None] = lambda: None
        """After the commands of this SYNC were taken, before its status is sent: the plant is latched here."""
        self.on_loss: Callable[[], list[Frame]] = list
        """The master's heartbeat has failed."""

    def boot(self) -> list[Frame]:
        """The message that a node sends once when it starts."""
        return [(T.HEARTBEAT + self.number, bytes((T.BOOT_UP,)))]

    def receive(self, frame: Frame, now_ns: int = 0) -> list[Frame]:
        """React to one frame."""
        identifier, data = frame
        if identifier == T.SYNC and len(data) <= 1:
            return self._sync()
        if identifier == T.NMT and len(data) == 2 and data[1] in (0, self.number):
            return self._nmt(data[0])
        if identifier == T.SDO_REQUEST + self.number and len(data) == 8 and self.state != T.STOPPED:
            return [(T.SDO_REPLY + self.number, self._sdo(data))]
        watched = self.objects.get((T.CONSUMER_HEARTBEAT, 1))
        if watched is not None and watched.value >> 16 & 0x7F and identifier == T.HEARTBEAT + (watched.value >> 16 & 0x7F) and len(data) == 1:
            self._watched_ns = now_ns
        elif self.state == T.OPERATIONAL:
            self._rpdo(identifier, data)
        return []

    def tick(self, now_ns: int) -> list[Frame]:
        """Heartbeats that are due, and the watch over the master's."""
        out: list[Frame] = []
        producer = self.objects.get((T.PRODUCER_HEARTBEAT, 0))
        period = producer.value * 1_000_000 if producer else 0
        if period and (self._heartbeat_ns is None or now_ns - self._heartbeat_ns >= period):
            self._heartbeat_ns = now_ns
            out.append((T.HEARTBEAT + self.number, bytes((self.state,))))
        watched = self.objects.get((T.CONSUMER_HEARTBEAT, 1))
        limit = (watched.value & 0xFFFF) * 1_000_000 if watched else 0
        if limit and self._watched_ns is not None and now_ns - self._watched_ns > limit:
            self._watched_ns = None
            out += self.on_loss()
        return out

    def emergency(self, code: int, register: int, extra: bytes = b"") -> Frame:
        """An emergency message; code 0 says that all is well again."""
        self.error_register = register
        if (T.ERROR_REGISTER, 0) in self.objects:
            self.objects[T.ERROR_REGISTER, 0].value = register
        return T.EMCY + self.number, code.to_bytes(2, "little") + bytes((register,)) + extra[:5].ljust(5, b"\0")

    def _nmt(self, command: int) -> list[Frame]:
        target = {T.NMT_START: T.OPERATIONAL, T.NMT_STOP: T.STOPPED, T.NMT_PRE_OPERATIONAL: T.PRE_OPERATIONAL}.get(command)
        if target is not None:
            self.state = target
            self._latched.clear()
            return []
        if command in (T.NMT_RESET_NODE, T.NMT_RESET_COMMUNICATION):
            self.state = T.PRE_OPERATIONAL
            self._latched.clear()
            self._watched_ns = None
            return self.boot()
        return []

    def _pdos(self) -> tuple[list[_Pdo], list[_Pdo]]:
        """The PDOs that are on, received and sent, as the dictionary lays them out now."""
        if self._layout is None:
            received = [self._pdo(number, T.RPDO_SETTINGS, T.RPDO_MAPPING) for number in range(4)]
            sent = [self._pdo(number, T.TPDO_SETTINGS, T.TPDO_MAPPING) for number in range(4)]
            self._layout = [pdo for pdo in received if pdo], [pdo for pdo in sent if pdo]
        return self._layout

    def _pdo(self, number: int, settings: int, mapping: int) -> _Pdo | None:
        identifier = self.objects.get((settings + number, 1))
        if identifier is None or identifier.value & T.PDO_OFF:
            return None
        entries = [self.objects[mapping + number, place].value for place in range(1, self.objects[mapping + number, 0].value + 1)]
        objects = [self.objects[entry >> 16, entry >> 8 & 0xFF] for entry in entries]
        kind = self.objects[settings + number, 2].value
        return _Pdo(number, identifier.value & 0x7FF, kind, sum(o.bits for o in objects) // 8, objects)

    def _rpdo(self, identifier: int, data: bytes) -> None:
        for pdo in self._pdos()[0]:
            if pdo.identifier == identifier and len(data) >= pdo.size:  # too short: not processed (CiA 301)
                self._latched[pdo.number] = data

    @staticmethod
    def _take(objects: list[Object], data: bytes) -> None:
        at = 0
        for target in objects:
            size = target.bits // 8
            target.set(data[at : at + size])
            at += size

    def _sync(self) -> list[Frame]:
        """Commands that arrived before this SYNC act now; the status is that of this instant."""
        if self.state != T.OPERATIONAL:
            return []
        received, sent = self._pdos()
        for pdo in received:
            data = self._latched.pop(pdo.number, b"")
            if data and len(data) >= pdo.size:
                self._take(pdo.objects, data)
        self._latched.clear()
        self.on_sync()
        self._syncs += 1
        return [
            (pdo.identifier, b"".join([o.encode() for o in pdo.objects])) for pdo in sent if pdo.kind and self._syncs % pdo.kind == 0
        ]

    def _sdo(self, data: bytes) -> bytes:
        command = data[0]
        if command & 0xEF == T.SDO_READ_SEGMENT and self._segments is not None:
            return self._segment(command)
        key = (data[1] | data[2] << 8, data[3])
        target = self.objects.get(key)
        if command == T.SDO_ABORT:
            self._segments = None
        if command != T.SDO_READ and command & 0xF3 not in (T.SDO_WRITE_SIZED, T.SDO_WRITE_SIZED - 1):
            return _abort(data, T.COMMAND_UNKNOWN)
        if target is None:
            return _abort(data, T.NO_SUBINDEX if any(index == key[0] for index, _ in self.objects) else T.NO_OBJECT)
        if command == T.SDO_READ:
            if not target.readable:
                return _abort(data, T.WRITE_ONLY)
            value = target.encode()
            if len(value) <= 4 and target.bits:
                return bytes((T.SDO_READ_SIZED | (4 - len(value)) << 2,)) + data[1:4] + value.ljust(4, b"\0")
            self._segments = (value, 0)
            return bytes((T.SDO_READ_LONG,)) + data[1:4] + len(value).to_bytes(4, "little")
        if not target.writable:
            return _abort(data, T.READ_ONLY)
        size = 4 - (command >> 2 & 3) if command & 1 else target.bits // 8
        abort = target.set(data[4 : 4 + size])
        if T.RPDO_SETTINGS <= key[0] < T.TPDO_MAPPING + 4:
            self._layout = None
        return _abort(data, abort) if abort else bytes((T.SDO_WRITTEN,)) + data[1:4] + bytes(4)

    def _segment(self, command: int) -> bytes:
        assert self._segments is not None
        value, sent = self._segments
        if command >> 4 & 1 != sent // 7 % 2:
            self._segments = None
            return _abort(bytes(8), T.TOGGLE_WRONG)
        part = value[sent : sent + 7]
        last = sent + 7 >= len(value)
        self._segments = None if last else (value, sent + 7)
        return bytes(((command & 0x10) | (7 - len(part)) << 1 | int(last),)) + part.ljust(7, b"\0")


def _abort(request: bytes, code: int) -> bytes:
    return bytes((T.SDO_ABORT,)) + request[1:4] + code.to_bytes(4, "little")


def communication_objects(
    number: int, name: str, kind: int, identity: tuple[int, int, int, int], pdos: dict[str, tuple[tuple[int, int, int], ...]]
) -> dict[Key, Object]:
    """Objects that every node has. ``pdos`` holds the default mappings: ``rpdo1``, ``tpdo1``, ``tpdo2``."""
    objects = {
        (T.DEVICE_TYPE, 0): Object("Device type", 32, kind),
        (T.ERROR_REGISTER, 0): Object("Error register", 8),
        (T.DEVICE_NAME, 0): Object("Manufacturer device name", 0, text=name),
        (T.CONSUMER_HEARTBEAT, 0): Object("Consumer heartbeat time count", 8, 1),
        (T.CONSUMER_HEARTBEAT, 1): Object("Consumer heartbeat time", 32, writable=True),
        (T.PRODUCER_HEARTBEAT, 0): Object("Producer heartbeat time", 16, writable=True),
        (T.IDENTITY, 0): Object("Identity count", 8, 4),
    }
    for place, (word, value) in enumerate(zip(("Vendor", "Product", "Revision", "Serial number"), identity, strict=True), 1):
        objects[T.IDENTITY, place] = Object(word, 32, value)
    for key, (settings, mapping, base) in {
        "rpdo1": (T.RPDO_SETTINGS, T.RPDO_MAPPING, T.RPDO1),
        "tpdo1": (T.TPDO_SETTINGS, T.TPDO_MAPPING, T.TPDO1),
        "tpdo2": (T.TPDO_SETTINGS + 1, T.TPDO_MAPPING + 1, T.TPDO2),
    }.items():
        if key in pdos:
            objects |= _pdo_objects(key, settings, mapping, base + number, pdos[key], objects)
    return objects


def _pdo_objects(
    name: str, settings: int, mapping: int, identifier: int, entries: tuple[tuple[int, int, int], ...], objects: dict[Key, Object]
) -> dict[Key, Object]:
    every = T.SLOW_EVERY if name == "tpdo2" else 1
    found = {
        (settings, 0): Object(f"{name} settings count", 8, 2),
        (settings, 1): Object(f"{name} identifier", 32, identifier, writable=True),
        (settings, 2): Object(f"{name} transmission type", 8, every, writable=True, high=240),
        (mapping, 0): Object(f"{name} mapping count", 8, len(entries), writable=True, high=8),
    }
    for place in range(1, 9):
        value = entries[place - 1] if place <= len(entries) else None
        found[mapping, place] = Object(f"{name} mapping {place}", 32, value[0] << 16 | value[1] << 8 | value[2] if value else 0, writable=True)
    return found


_RESERVED = ((0x000, 0x07F), (0x101, 0x180), (0x581, 0x5FF), (0x601, 0x67F), (0x6E0, 0x7FF))
"""Identifiers that no PDO may take (CiA 301, restricted CAN-IDs): a PDO on 0 would be a network command to every node."""


def _pdo_identifier(value: int) -> int:
    number = value & 0x1FFFFFFF
    free = number <= 0x7FF and not any(low <= number <= high for low, high in _RESERVED) and not value >> 29 & 1
    return 0 if free else T.OUT_OF_RANGE


def guard_mappings(objects: dict[Key, Object]) -> None:
    """Mappings can be written only while empty, only to mappable objects, and hold at most 64 bits; identifiers only those free for PDOs."""

    def entry(mapping: int) -> Callable[[int], int]:
        def check(value: int) -> int:
            if objects[mapping, 0].value:
                return T.WRONG_STATE
            target = objects.get((value >> 16, value >> 8 & 0xFF))
            fits = target is not None and target.mappable and target.bits == value & 0xFF and (target.writable or mapping >= T.TPDO_MAPPING)
            return 0 if value == 0 or fits else T.NOT_MAPPABLE

        return check

    def total(mapping: int) -> Callable[[int], int]:
        def check(value: int) -> int:
            entries = [objects[mapping, place].value for place in range(1, value + 1)]
            if any(not e for e in entries):
                return T.NOT_MAPPABLE
            return T.PDO_TOO_LONG if sum(e & 0xFF for e in entries) > 64 else 0

        return check

    for (index, subindex), target in objects.items():
        if subindex == 1 and (T.RPDO_SETTINGS <= index < T.RPDO_SETTINGS + 4 or T.TPDO_SETTINGS <= index < T.TPDO_SETTINGS + 4):
            target.written = _pdo_identifier
        if T.RPDO_MAPPING <= index < T.RPDO_MAPPING + 4 or T.TPDO_MAPPING <= index < T.TPDO_MAPPING + 4:
            target.written = total(index) if subindex == 0 else entry(index)
