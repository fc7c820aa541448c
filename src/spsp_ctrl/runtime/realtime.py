"""Real-time settings of the process: asked for, and what was granted."""

from __future__ import annotations

import ctypes
import gc
import os
import struct
from types import TracebackType

MCL_CURRENT, MCL_FUTURE = 1, 2


class RealTime:
    """Within the ``with`` block: FIFO priority, locked memory, no deep CPU sleep, collector frozen. Nothing here can fail a run."""

    def __init__(self, enabled: bool, priority: int) -> None:
        self._enabled = enabled
        self._priority = priority
        self._latency_fd: int | None = None
        self.granted: dict[str, str | bool] = {"requested": enabled}

    def __enter__(self) -> RealTime:
        gc.collect()
        gc.freeze()
        gc.disable()
        self.granted["collector_frozen"] = True
        if self._enabled:
            self.granted["fifo"] = self._fifo()
            self.granted["memory_locked"] = self._lock()
            self.granted["cpu_dma_latency"] = self._latency()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None) -> None:
        gc.enable()
        gc.unfreeze()
        if self._latency_fd is not None:
            os.close(self._latency_fd)
            self._latency_fd = None
        if self.granted.get("fifo") is True:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        if self.granted.get("memory_locked") is True:
            ctypes.CDLL(None).munlockall()

    def _fifo(self) -> bool | str:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority))
        except (OSError, AttributeError) as error:
            return f"refused: {error}"
        return True

    def _lock(self) -> bool | str:
        try:
            libc = ctypes.CDLL(None, use_errno=True)
            if libc.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
                return f"refused: {os.strerror(ctypes.get_errno())}"
        except (OSError, AttributeError) as error:
            return f"refused: {error}"
        return True

    def _latency(self) -> bool | str:
        try:
            self._latency_fd = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
            os.write(self._latency_fd, struct.pack("i", 0))
        except OSError as error:
            return f"refused: {error.strerror}"
        return True
