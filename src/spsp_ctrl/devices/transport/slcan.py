"""A CAN bus behind a serial adapter (slcan): one read and one write of the port for all frames of a cycle.

python-can's own interface of that name reads byte by byte (its issue 2027): 108 to 225 us a frame against 2 us here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from spsp_ctrl.devices.transport.base import Arrived, TransportError
from spsp_ctrl.devices.transport.serial_line import SerialLine
from spsp_ctrl.devices.transport.slcan_codec import BITRATES, Lines, flags, to_text
from spsp_ctrl.devices.transport.trouble import Ledger

_STATUS_NS = 200_000_000
_OPEN_S = 0.5
_FROM_ADAPTER = ("overrun", "queue-full", "error-frames", "error-passive")


class SlcanBus:
    """See ``transport.base.CanTransport``."""

    immediate = False

    def __init__(self, port: str, bitrate: int = 1_000_000, baud: int = 115_200, *, answers: bool = True) -> None:
        """Opens the adapter and its bus. ``answers`` is false for one that acknowledges nothing. Raises ``TransportError``."""
        if bitrate not in BITRATES:
            raise TransportError(f"{port}: an slcan adapter has no bit rate {bitrate}; choose one of {', '.join(map(str, BITRATES))}")
        self._line = SerialLine(port, baud)
        self._name = port
        self._lines = Lines()
        self._ledger = Ledger()
        self._frames: list[Arrived] = []
        self._asked_ns = 0
        self._asks = False
        self.fault = self._line.fault
        self.sent = self.received = 0
        self._line.send(b"\r\rC\rV\r")  # ends a half line and a bus that was left open; a bell for what was not open is no refusal
        self._wait(lambda: bool(self._lines.version))
        version = self._lines.version
        self._lines, self._frames = Lines(), []
        self._lines.version = version
        self._line.send(f"S{BITRATES[bitrate]}\rO\r".encode("ascii"))
        self._wait(lambda: not answers or self._lines.answers >= 2)
        if answers and not self._lines.answers and not version:
            self._line.close()
            raise TransportError(
                f"{port}: no slcan adapter answers; check the port and options.baud ({baud}), or say options.answers: false for one that never does"
            )
        if answers and self._lines.refused:
            self.close()
            raise TransportError(f"{port}: the slcan adapter refuses the bit rate {bitrate} or to open the bus")
        self._asks = answers

    @property
    def version(self) -> str:
        """What the adapter says of itself; empty when it says nothing."""
        return self._lines.version

    def poll(self, now_ns: int) -> list[Arrived]:
        """Every frame that has arrived since the last call. An adapter never sends our own back."""
        self._read()
        found, self._frames = self._frames, []
        self.received += len(found)
        now = time.monotonic_ns()
        if self._asks and now - self._asked_ns > _STATUS_NS:
            self._asked_ns = now
            self._line.send(b"F\r")
        self._judge()
        return found

    def send(self, frames: Iterable[tuple[int, bytes]]) -> bool:
        """Hand over frames in order, all in one write."""
        batch = list(frames)
        try:
            text = to_text(batch)
        except ValueError:
            return False
        done = self._line.send(text)
        self.sent += len(batch) if done else 0
        self._judge()
        return done

    def close(self) -> None:
        """Close the bus, let go of the port."""
        self._line.send(b"C\r")
        self._line.close()

    def _wait(self, ready: Callable[[], bool]) -> None:
        end = time.monotonic() + _OPEN_S
        while not ready() and time.monotonic() < end:
            time.sleep(0.002)
            self._read()

    def _read(self) -> None:
        for stamp_ns, data in self._line.poll(0):
            self._frames += [(stamp_ns, identifier, payload) for identifier, payload in self._lines.feed(data)]

    def _judge(self) -> None:
        """Worst of the line's faults and those of the adapter."""
        lines = self._lines
        if lines.status is not None:
            names = flags(lines.status)
            for name in names:
                self._ledger.set(name, f"{self._name}: status flags 0x{lines.status:02X}")
            self._ledger.clear(*(n for n in _FROM_ADAPTER if n not in names))
            lines.status = None
        elif self._asks and lines.refused > 2:
            self._asks = False  # it does not know the question
        self.fault = self._line.fault if self._line.fault.id else self._ledger.worst
