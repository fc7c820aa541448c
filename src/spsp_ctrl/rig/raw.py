"""What went over buses and lines since it was last asked for: for the log, and for replay from the bytes."""

from __future__ import annotations

from typing import NamedTuple

LIMIT = 20_000
"""Entries kept when nobody asks."""


class RawFrame(NamedTuple):
    """One CAN frame."""

    stamp_ns: int
    bus: str
    sent: bool
    identifier: int
    data: bytes


class RawBytes(NamedTuple):
    """One piece of a byte stream."""

    stamp_ns: int
    line: str
    sent: bool
    data: bytes


class Raw:
    """A buffer. ``take`` empties it."""

    def __init__(self) -> None:
        self._entries: list[RawFrame | RawBytes] = []
        self.recording = False

    def frame_in(self, bus: str, stamp_ns: int, identifier: int, data: bytes) -> None:
        """Arrived on a bus."""
        if self.recording:
            self._entries.append(RawFrame(stamp_ns, bus, False, identifier, data))

    def frames_out(self, bus: str, stamp_ns: int, frames: list[tuple[int, bytes]]) -> None:
        """Sent on a bus."""
        if self.recording:
            self._entries += [RawFrame(stamp_ns, bus, True, identifier, data) for identifier, data in frames]

    def bytes_in(self, line: str, stamp_ns: int, data: bytes) -> None:
        """Arrived on a line."""
        if self.recording:
            self._entries.append(RawBytes(stamp_ns, line, False, data))

    def bytes_out(self, line: str, stamp_ns: int, data: bytes) -> None:
        """Sent on a line."""
        if self.recording:
            self._entries.append(RawBytes(stamp_ns, line, True, data))

    def take(self) -> list[RawFrame | RawBytes]:
        """Everything since the last call."""
        found, self._entries = self._entries, []
        return found
