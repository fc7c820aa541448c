"""What went over buses and lines since it was last asked for: for the log, and for replay from the bytes."""

from __future__ import annotations

from typing import NamedTuple


class RawEntry(NamedTuple):
    """One CAN frame, or one piece of a byte stream (``identifier`` is -1)."""

    stamp_ns: int
    """Control time: of arrival; of the cycle for what is sent; of SYNC itself for a SYNC."""
    name: str
    """Bus or line."""
    sent: bool
    identifier: int
    data: bytes
    poll: int
    """How often the bus or line had been asked when it came: a replay hands it over in the same call."""


class Raw:
    """A buffer, filled once ``start`` was called. ``take`` empties it."""

    def __init__(self) -> None:
        self._entries: list[RawEntry] = []
        self._polls: dict[str, int] = {}
        self.recording = False

    def start(self) -> None:
        """Record from now on."""
        self.recording = True
        self._polls.clear()

    def asked(self, name: str) -> None:
        """A bus or line is asked for what has come."""
        if self.recording:
            self._polls[name] = self._polls.get(name, 0) + 1

    def arrived(self, name: str, stamp_ns: int, identifier: int, data: bytes) -> None:
        """A frame, or bytes with the identifier -1."""
        if self.recording:
            self._entries.append(RawEntry(stamp_ns, name, False, identifier, data, self._polls.get(name, 0)))

    def sent(self, name: str, stamp_ns: int, identifier: int, data: bytes) -> None:
        """The same in the other direction."""
        if self.recording:
            self._entries.append(RawEntry(stamp_ns, name, True, identifier, data, self._polls.get(name, 0)))

    def take(self) -> list[RawEntry]:
        """Everything since the last call."""
        found, self._entries = self._entries, []
        return found
