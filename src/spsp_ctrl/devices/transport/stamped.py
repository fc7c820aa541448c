"""A serial line read by a thread that only waits: bytes are stamped when they arrive, not when the loop looks (up to a cycle later)."""

from __future__ import annotations

import select
import threading
import time

from spsp_ctrl.devices.transport.base import Bytes, Fault, SerialTransport

_LOOK_S = 0.2


class StampedLine:
    """Around an open line that tells its ``fileno``; any other is passed through."""

    immediate = False

    def __init__(self, line: SerialTransport) -> None:
        self._line = line
        self._fd: int = getattr(line, "fileno", lambda: -1)()
        self._lock = threading.Lock()
        self._heard: list[Bytes] = []
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        if self._fd >= 0:
            self._thread = threading.Thread(target=self._listen, name="serial line", daemon=True)
            self._thread.start()

    @property
    def fault(self) -> Fault:
        """See ``SerialTransport``."""
        return self._line.fault

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                select.select((self._fd,), (), (), _LOOK_S)
            except (OSError, ValueError):
                return
            found = self._line.poll(time.monotonic_ns())
            if found:
                with self._lock:
                    self._heard += found
            elif self._line.fault.id:
                self._ended.wait(_LOOK_S)

    def poll(self, now_ns: int) -> list[Bytes]:
        """See ``SerialTransport``."""
        if self._thread is None:
            return self._line.poll(now_ns)
        if not self._heard:
            return []
        with self._lock:
            heard, self._heard = self._heard, []
        return heard

    def send(self, data: bytes) -> bool:
        """See ``SerialTransport``."""
        return self._line.send(data)

    def close(self) -> None:
        """See ``SerialTransport``."""
        self._ended.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(2 * _LOOK_S)
        self._line.close()
