"""CANopen, the master's side: NMT, SYNC, heartbeat, emergencies, and an SDO client. Frames are pairs of identifier and data."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from spsp_ctrl.devices import canopen_table as T

Frame = tuple[int, bytes]
SYNC_FRAME: Frame = (T.SYNC, b"")


def nmt(command: int, node: int) -> Frame:
    """Start, stop or reset a node; node 0 means all."""
    return T.NMT, bytes((command, node))


def heartbeat(node: int, state: int = T.OPERATIONAL) -> Frame:
    """Our own sign of life, for the drives that watch it."""
    return T.HEARTBEAT + node, bytes((state,))


def read_heartbeat(frame: Frame, node: int) -> int | None:
    """State of a node from its heartbeat, None for any other frame."""
    identifier, data = frame
    return data[0] & 0x7F if identifier == T.HEARTBEAT + node and len(data) == 1 else None


class Emergency(NamedTuple):
    """One emergency message."""

    code: int
    register: int
    manufacturer: bytes

    @property
    def text(self) -> str:
        """In words, from the class of the code and the bits of the error register."""
        kind = T.EMCY_CLASS.get(self.code >> 8) or T.EMCY_CLASS.get(self.code >> 8 & 0xF0) or "unknown"
        bits = ", ".join(word for bit, word in T.ERROR_BITS.items() if self.register & bit)
        return f"0x{self.code:04X} {kind}" + (f" (error register: {bits})" if bits else "")


def read_emergency(frame: Frame, node: int) -> Emergency | None:
    """An emergency of a node, None for any other frame."""
    identifier, data = frame
    if identifier != T.EMCY + node or not 1 <= node <= T.MAX_NODE or len(data) != 8:
        return None
    return Emergency(data[0] | data[1] << 8, data[2], data[3:])


class SdoAnswer(NamedTuple):
    """Answer of an SDO server."""

    number: int
    """Index of the object."""
    subindex: int
    abort: int
    """Abort code, 0 when it went well."""
    data: bytes
    """What was read; empty after a write."""


def write(node: int, index: int, subindex: int, value: int, size: int) -> Frame:
    """Expedited write of 1 to 4 bytes. A negative value is two's complement."""
    data = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
    return T.SDO_REQUEST + node, struct.pack("<BHB4s", T.SDO_WRITE_SIZED | (4 - size) << 2, index, subindex, data)


def read(node: int, index: int, subindex: int) -> Frame:
    """Ask for an object of at most four bytes."""
    return T.SDO_REQUEST + node, struct.pack("<BHB4x", T.SDO_READ, index, subindex)


def answer(frame: Frame, node: int) -> SdoAnswer | None:
    """An expedited answer of a node; None for any other frame, a segmented answer included."""
    identifier, data = frame
    if identifier != T.SDO_REPLY + node or len(data) != 8:
        return None
    command, index, subindex = struct.unpack_from("<BHB", data)
    if command == T.SDO_ABORT:
        return SdoAnswer(index, subindex, int.from_bytes(data[4:], "little") or 0x08000000, b"")
    if command == T.SDO_WRITTEN:
        return SdoAnswer(index, subindex, 0, b"")
    if command & 0xF3 == T.SDO_READ_SIZED:
        return SdoAnswer(index, subindex, 0, data[4 : 8 - (command >> 2 & 3)])
    return None


class Setting(NamedTuple):
    """One object to write, or with ``value`` None to read."""

    number: int
    """Index of the object."""
    subindex: int
    value: int | None
    size: int


def map_pdo(
    settings: int, mapping: int, identifier: int, kind: int, entries: Sequence[tuple[int, int, int]]
) -> Iterator[Setting]:
    """The writes that lay out one PDO: off, transmission type, mapping, on (CiA 301, procedure for re-mapping)."""
    yield Setting(settings, 1, identifier | T.PDO_OFF, 4)
    yield Setting(settings, 2, kind, 1)
    yield Setting(mapping, 0, 0, 1)
    for place, (index, subindex, bits) in enumerate(entries, 1):
        yield Setting(mapping, place, index << 16 | subindex << 8 | bits, 4)
    yield Setting(mapping, 0, len(entries), 1)
    yield Setting(settings, 1, identifier, 4)


class SdoDialogue:
    """A list of settings worked off one by one. Time is an argument; nothing waits. Ends with ``done`` or a text in ``problem``."""

    TIMEOUT_NS = 300_000_000
    TRIES = 3

    def __init__(self, node: int, settings: Iterable[Setting]) -> None:
        self._node = node
        self._left = list(settings)[::-1]
        self._sent_ns = 0
        self._tries = 0
        self.values: dict[tuple[int, int], int] = {}
        """What was read, as unsigned numbers."""
        self.done = False
        self.problem = ""

    def step(self, now_ns: int, frames: Iterable[Frame]) -> list[Frame]:
        """Go on with what has arrived; the frames to send now."""
        for frame in frames:
            found = answer(frame, self._node)
            if found is not None and self._left and not self.done and found[:2] == self._left[-1][:2]:
                self._take(found)
        if self.done or len(self.problem) > 0:
            return []
        if not self._left:
            self.done = True
            return []
        if self._tries and now_ns - self._sent_ns < self.TIMEOUT_NS:
            return []
        index, subindex, value, size = self._left[-1]
        if self._tries == self.TRIES:
            self.problem = f"node {self._node} does not answer for object 0x{index:04X}:{subindex}"
            return []
        self._tries += 1
        self._sent_ns = now_ns
        return [read(self._node, index, subindex) if value is None else write(self._node, index, subindex, value, size)]

    def _take(self, found: SdoAnswer) -> None:
        index, subindex, value, size = self._left[-1]
        if found.abort:
            text = T.ABORT_TEXT.get(found.abort, "refused")
            self.problem = f"node {self._node}, object 0x{index:04X}:{subindex}: {text} (0x{found.abort:08X})"
            return
        if value is None:
            if len(found.data) != size:
                self.problem = f"node {self._node}, object 0x{index:04X}:{subindex}: {len(found.data)} bytes, expected {size}"
                return
            self.values[index, subindex] = int.from_bytes(found.data, "little")
        self._left.pop()
        self._tries = 0


class Counter:
    """A position that wraps round after ``span`` counts, as a number that does not."""

    def __init__(self, span: int = 1 << 32) -> None:
        self._span = span
        self._last: int | None = None
        self.counts = 0

    def step(self, counts: int) -> int:
        """Position without wraps: the nearest one to the last."""
        half = self._span // 2
        self.counts = counts if self._last is None else self.counts + (counts - self._last + half) % self._span - half
        self._last = counts
        return self.counts
