"""A CAN bus and a serial line inside this process, deterministic: what is sent has arrived, and has been answered, when ``send`` returns.

Time is that of the last ``poll``. Bytes of a line can arrive later than they were sent (transport delay of a unit).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from spsp_ctrl.devices.transport.base import ALL_WELL, Arrived, Bytes

Frame = tuple[int, bytes]


class Medium:
    """The wire of one CAN bus: a frame reaches everybody but its sender, in the order in which they joined."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.on_time: Callable[[int], None] = lambda now_ns: None
        """Called when time goes on."""
        self._listeners: list[Callable[[int, bytes], None]] = []

    def pass_time(self, now_ns: int) -> None:
        """Time goes on."""
        if now_ns != self.now_ns:
            self.now_ns = now_ns
            self.on_time(now_ns)

    def join(self, listener: Callable[[int, bytes], None]) -> None:
        """Hear every frame."""
        self._listeners.append(listener)

    def leave(self, listener: Callable[[int, bytes], None]) -> None:
        """Hear no more."""
        if listener in self._listeners:
            self._listeners.remove(listener)

    def transmit(self, sender: Callable[[int, bytes], None], identifier: int, data: bytes) -> None:
        """One frame. Answers of listeners follow it at once."""
        for listener in self._listeners:
            if listener != sender:
                listener(identifier, data)

    def serve(self, receive: Callable[[int, bytes], Iterable[Frame]]) -> Callable[[Iterable[Frame]], None]:
        """Join with a device side that answers; returns what sends frames that nobody asked for."""

        def listener(identifier: int, data: bytes) -> None:
            send(receive(identifier, data))

        def send(frames: Iterable[Frame]) -> None:
            for frame in frames:
                self.transmit(listener, *frame)

        self.join(listener)
        return send


_MEDIA: dict[str, Medium] = {}


def medium(channel: str) -> Medium:
    """The wire of that name in this process."""
    return _MEDIA.setdefault(channel, Medium())


class LockstepCan:
    """A host on a wire."""

    immediate = True

    def __init__(self, wire: Medium) -> None:
        self.fault = ALL_WELL
        self._wire = wire
        self._heard: list[Arrived] = []
        wire.join(self._hear)

    def _hear(self, identifier: int, data: bytes) -> None:
        self._heard.append((self._wire.now_ns, identifier, data))

    def poll(self, now_ns: int) -> list[Arrived]:
        """See ``CanTransport``."""
        self._wire.pass_time(now_ns)
        heard, self._heard = self._heard, []
        return heard

    def send(self, frames: Iterable[Frame]) -> bool:
        """See ``CanTransport``."""
        for identifier, data in frames:
            self._wire.transmit(self._hear, identifier, data)
        return True

    def close(self) -> None:
        """See ``CanTransport``."""
        self._wire.leave(self._hear)


class LockstepSerial:
    """The host's end of a line; ``receive`` is the device at the other."""

    immediate = True

    def __init__(self, receive: Callable[[bytes], bytes] = lambda data: b"") -> None:
        self.fault = ALL_WELL
        self.receive = receive
        self._now_ns = 0
        self._coming: deque[Bytes] = deque()

    def deliver(self, data: bytes, at_ns: int) -> None:
        """The device sends bytes that arrive at ``at_ns``, not before what it has sent earlier."""
        if data:
            self._coming.append((max(at_ns, self._coming[-1][0]) if self._coming else at_ns, data))

    def poll(self, now_ns: int) -> list[Bytes]:
        """See ``SerialTransport``."""
        self._now_ns = now_ns
        found = []
        while self._coming and self._coming[0][0] <= now_ns:
            found.append(self._coming.popleft())
        return found

    def send(self, data: bytes) -> bool:
        """See ``SerialTransport``."""
        self.deliver(self.receive(data), self._now_ns)
        return True

    def close(self) -> None:
        """See ``SerialTransport``."""
        self._coming.clear()
