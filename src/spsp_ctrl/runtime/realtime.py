"""Real-time settings of the process: each is asked for, and what was granted is reported. Nothing here can fail a run."""

from __future__ import annotations

import ctypes
import gc
import os
import struct
from types import TracebackType
from typing import Any, NamedTuple

MCL_CURRENT, MCL_FUTURE = 1, 2
PR_SET_TIMERSLACK = 29
M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4
TRIM_DEFAULT, MMAP_DEFAULT = 128 << 10, 65536
TOUCHED_BYTES = 16 << 20
SMALL_OBJECTS = 60_000
_PAGE = 4096

Granted = bool | str | float | list[str]
"""True, or why not, in words."""


class Wishes(NamedTuple):
    """What a session asks of the operating system. ``cpu`` is the core to stay on, None for any."""

    priority: int = 50
    cpu: int | None = None
    lock_memory: bool = True
    cpu_dma_latency: bool = True
    freeze_collector: bool = True


class RealTime:
    """Within the ``with`` block: FIFO priority, one core, locked and touched memory, no deep sleep of the processor, collector frozen.

    ``wishes`` None asks for nothing but the frozen collector (lock-step). ``granted`` says what became of each wish; ``granted["degraded"]`` names
    the wishes that were refused.
    """

    def __init__(self, wishes: Wishes | None) -> None:
        self._wishes = wishes
        self._latency_fd: int | None = None
        self._cores: set[int] | None = None
        self._reserve: list[float] = []
        self._frozen = False
        self.granted: dict[str, Granted] = {"requested": wishes is not None}

    def __enter__(self) -> RealTime:
        wishes, granted = self._wishes, self.granted
        if wishes is None or wishes.freeze_collector:
            gc.collect()
            gc.freeze()
            gc.disable()
            self._frozen = granted["collector_frozen"] = True
        if wishes is not None:
            if wishes.lock_memory:
                granted["memory_locked"] = _tried(_lock_memory)
                granted["memory_touched"] = _tried(self._touch)
            if wishes.cpu is not None:
                granted["cpu"] = _tried(self._stay, wishes.cpu)
            if wishes.cpu_dma_latency:
                granted["cpu_dma_latency"] = _tried(self._stay_awake)
            granted["timer_slack"] = _tried(_prctl, PR_SET_TIMERSLACK, 1)
            granted["fifo"] = _tried(_fifo, wishes.priority)
            granted["degraded"] = [name for name, value in granted.items() if isinstance(value, str)]
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None) -> None:
        if self._frozen:
            gc.enable()
            gc.unfreeze()
        if self.granted.get("fifo") is True:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        if self._latency_fd is not None:
            os.close(self._latency_fd)
            self._latency_fd = None
        if self._cores is not None:
            os.sched_setaffinity(0, self._cores)
        if self.granted.get("memory_locked") is True:
            ctypes.CDLL(None).munlockall()
        if self.granted.get("timer_slack") is True:
            _tried(_prctl, PR_SET_TIMERSLACK, 0)  # 0: back to the default
        if self.granted.get("memory_touched") is True:
            _libc().mallopt(M_TRIM_THRESHOLD, TRIM_DEFAULT)
            _libc().mallopt(M_MMAP_MAX, MMAP_DEFAULT)
        self._reserve = []

    def _stay(self, cpu: int) -> None:
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {cpu})
        self._cores = before

    def _stay_awake(self) -> None:
        fd = os.open("/dev/cpu_dma_latency", os.O_WRONLY)
        try:
            os.write(fd, struct.pack("i", 0))
        except OSError:
            os.close(fd)
            raise
        self._latency_fd = fd  # the wish holds as long as the file is open

    def _touch(self) -> None:
        """Memory that the cycle may need is in place before the first cycle: the allocator keeps what it once had, and has it already."""
        libc = _libc()
        libc.mallopt(M_TRIM_THRESHOLD, -1)
        libc.mallopt(M_MMAP_MAX, 0)
        block = bytearray(TOUCHED_BYTES)
        for at in range(0, len(block), _PAGE):
            block[at] = 1
        # arenas of small objects stay as long as one object lives in them
        many = [k * 0.5 for k in range(SMALL_OBJECTS)]
        self._reserve = many[::100]


def degraded(granted: object) -> list[tuple[str, str]]:
    """Wishes that were refused, with the reason, from ``granted`` as it stands in ``summary.json``."""
    if not isinstance(granted, dict):
        return []
    names = granted.get("degraded")
    return [(str(name), str(granted.get(name))) for name in names] if isinstance(names, list) else []


def _tried(ask: Any, *arguments: Any) -> bool | str:
    try:
        ask(*arguments)
    except OSError as error:
        return f"refused: {error.strerror}"
    except AttributeError as error:
        return f"not here: {error}"
    return True


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _checked(code: int) -> None:
    if code != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _fifo(priority: int) -> None:
    # processes started from here on are not to inherit it
    os.sched_setscheduler(0, os.SCHED_FIFO | getattr(os, "SCHED_RESET_ON_FORK", 0), os.sched_param(priority))


def _lock_memory() -> None:
    _checked(_libc().mlockall(MCL_CURRENT | MCL_FUTURE))


def _prctl(option: int, value: int) -> None:
    _checked(_libc().prctl(option, value, 0, 0, 0))
