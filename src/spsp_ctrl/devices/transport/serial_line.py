"""A serial line by the path of its port or pseudo-terminal: reads what is there in one call, never waits, never raises once it is open."""

from __future__ import annotations

import errno
import fcntl
import os
import select
import struct
import time
from contextlib import suppress

import serial

from spsp_ctrl.devices.transport.base import ALL_WELL, Bytes, TransportError
from spsp_ctrl.devices.transport.trouble import Ledger

_TIOCGICOUNT = 0x545D
_COUNTS = struct.Struct("20i")
_READ_BYTES = 65_536
_HELD_BYTES = 4_096
"""Bytes that may wait for the port before the queue counts as full: 0.35 s at 115200 baud."""
_LOOK_NS = 200_000_000
_QUIET_NS = 2_000_000_000
"""A line without a new framing error for as long is well again."""


def _why(port: str, error: Exception) -> str:
    code = getattr(error, "errno", None)
    if code == errno.ENOENT:
        return f"{port}: no such port; is the adapter plugged in? `ls -l /dev/serial/by-id` shows the ports"
    if code in (errno.EACCES, errno.EPERM):
        return f"{port}: no permission; put yourself into the group of the port (usually `sudo usermod -aG dialout $USER`, then log in again)"
    if code in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error).lower():
        return f"{port}: in use by another program"
    return f"{port}: cannot be opened: {error}"


class SerialLine:
    """See ``transport.base.SerialTransport``."""

    immediate = False

    def __init__(self, port: str, baud: int = 115_200) -> None:
        """Opens the port for this program alone. Raises ``TransportError``."""
        self.fault = ALL_WELL
        try:
            self._port = serial.Serial(port, baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise TransportError(_why(port, error)) from None
        with suppress(OSError, ValueError, AttributeError, NotImplementedError):
            self._port.set_low_latency_mode(True)  # FTDI adapters hold bytes back for 16 ms otherwise
        self._name = port
        self._fd: int = self._port.fileno()
        os.set_blocking(self._fd, False)
        self._poller = select.poll()
        self._poller.register(self._fd, select.POLLIN)
        self._held = b""
        self._ledger = Ledger()
        self._errors: int | None = self._line_errors()
        self._looked_ns = self._erred_ns = 0
        self.received_bytes = 0
        self.sent_bytes = 0
        with suppress(OSError, serial.SerialException):
            self._port.reset_input_buffer()

    def poll(self, now_ns: int) -> list[Bytes]:
        """All bytes that have arrived, as one piece; empty once the port is gone."""
        if self._fd < 0:
            return []
        data = b""
        try:
            seen = self._poller.poll(0)
            if seen:
                what = seen[0][1]
                if what & select.POLLIN:
                    data = os.read(self._fd, _READ_BYTES)
                    if not data:
                        self._set("unplugged", f"{self._name} reports data but has none")
                if what & (select.POLLHUP | select.POLLERR | select.POLLNVAL) and not data:
                    self._set("unplugged", f"{self._name} has hung up")
        except BlockingIOError:
            pass
        except OSError as error:
            self._set("unplugged", f"{self._name}: {error.strerror}")
        now = time.monotonic_ns()
        if self._held:
            self._push(b"")
        if now - self._looked_ns > _LOOK_NS:
            self._looked_ns = now
            self._look(now)
        if not data:
            return []
        self.received_bytes += len(data)
        return [(now, data)]

    def send(self, data: bytes) -> bool:
        """Hand over bytes; what the port does not take now goes first the next time. Nothing is ever sent in part and then dropped."""
        if self._fd < 0 or self._ledger.has("unplugged"):
            return False
        if len(self._held) + len(data) > _HELD_BYTES:
            self._push(b"")
            if len(self._held) + len(data) > _HELD_BYTES:
                self._set("queue-full", f"{self._name}: {len(self._held)} bytes wait")
                return False
        return self._push(data)

    def fileno(self) -> int:
        """What to wait on for bytes; -1 once it is closed."""
        return int(self._fd)

    def close(self) -> None:
        """Let go of the port."""
        self._fd = -1
        with suppress(OSError, serial.SerialException):
            self._port.close()

    def _push(self, data: bytes) -> bool:
        held = self._held + data
        try:
            taken = os.write(self._fd, held) if held else 0
        except BlockingIOError:
            taken = 0
        except OSError as error:
            self._set("unplugged", f"{self._name}: {error.strerror}")
            return False
        self.sent_bytes += taken
        self._held = held[taken:]
        if not self._held and self._ledger.has("queue-full"):
            self._ledger.clear("queue-full")
            self.fault = self._ledger.worst
        return True

    def _set(self, name: str, detail: str) -> None:
        self._ledger.set(name, detail)
        self.fault = self._ledger.worst

    def _line_errors(self) -> int | None:
        """Framing, overrun and parity errors counted by the driver of the port; None where it does not count (pseudo-terminals, some adapters)."""
        try:
            found = _COUNTS.unpack(fcntl.ioctl(self._fd, _TIOCGICOUNT, bytes(_COUNTS.size)))
        except OSError:
            return None
        return int(found[6] + found[7] + found[8] + found[10])

    def _look(self, now: int) -> None:
        if self._errors is None:
            return
        count = self._line_errors()
        if count is None:
            return
        if count > self._errors:
            self._erred_ns = now
            self._set("framing", f"{self._name}: {count - self._errors} errors")
        elif self._ledger.has("framing") and now - self._erred_ns > _QUIET_NS:
            self._ledger.clear("framing")
            self.fault = self._ledger.worst
        self._errors = count
