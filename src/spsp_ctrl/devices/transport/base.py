"""What a bus and a serial line are to a rig. Nothing here waits, and nothing raises once it is open: what goes wrong is a named fault.

Times are those of the transport's own clock: ``time.monotonic_ns`` on wires and between processes (``immediate`` is false), the time that
``poll`` is told inside this process in lock-step (``immediate`` is true: the answer to a frame is there when ``send`` returns).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, Protocol


class Fault(NamedTuple):
    """What is wrong with a bus or line. ``id`` is empty while all is well."""

    id: str
    """``queue-full``, ``bus-off``, ``error-passive``, ``unplugged`` … (``transport.trouble.FAULTS`` has them all)."""
    text: str
    """What happened, in words, with what to check."""


ALL_WELL = Fault("", "")
EXTENDED, REMOTE = 1 << 31, 1 << 30
"""Flags of an identifier, as SocketCAN has them: 29 bits; a remote frame, which has no data."""
Arrived = tuple[int, int, bytes]
"""Time in ns, identifier (with its flags), data."""
Bytes = tuple[int, bytes]
"""Time in ns, data."""


class TransportError(Exception):
    """A bus or line cannot be opened; the text says what to check."""


class CanTransport(Protocol):
    """A CAN bus."""

    immediate: bool

    @property
    def fault(self) -> Fault:
        """What is wrong now, the worst of it."""
        ...

    def poll(self, now_ns: int) -> list[Arrived]:
        """Every frame that has arrived since the last call, in order, without our own."""
        ...

    def send(self, frames: Iterable[tuple[int, bytes]]) -> bool:
        """Hand over frames in order. False when one of them could not be handed over; ``fault`` then says why."""
        ...

    def close(self) -> None:
        """Let go; may be called twice."""
        ...


class SerialTransport(Protocol):
    """A serial line."""

    immediate: bool

    @property
    def fault(self) -> Fault:
        """What is wrong now, the worst of it."""
        ...

    def poll(self, now_ns: int) -> list[Bytes]:
        """All bytes that have arrived since the last call, in pieces as they came."""
        ...

    def send(self, data: bytes) -> bool:
        """Hand over bytes. False when not all could be handed over."""
        ...

    def close(self) -> None:
        """Let go; may be called twice."""
        ...
