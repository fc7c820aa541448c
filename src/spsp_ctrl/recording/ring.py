"""A ring of frames in shared memory between the loop and the process that writes the log: one writes, one reads, nobody waits for a lock.

The frames are those of ``recording.frames``. A frame never wraps round the end: where it does not fit any more a byte :data:`SKIP` sends the reader
back to the beginning. The producer moves ``head`` only when a frame is complete, the consumer moves ``tail`` only when it is done with what it has
read, so that a producer that is killed in the middle of a frame leaves nothing half written. Both are counts of bytes since the beginning, each in an
aligned machine word of its own cache line: a store of one word is never seen in halves. The frame must be seen before the counter that covers it:
x86 keeps the order of stores and of loads, elsewhere a lock is taken and given back between the two, which is a barrier (and costs 0.1 us).
"""

from __future__ import annotations

import mmap
import os
import platform
import threading
from collections.abc import Callable
from typing import Any

from spsp_ctrl.recording.frames import FRAME

HEAD, TAIL, TAKEN = 0, 8, 16
"""Places of the counters in the first page, in words of 8 bytes; each is alone in its cache line."""
PAGE = 4096
IN_ORDER = platform.machine().lower() in ("x86_64", "amd64", "i686", "i386")
"""Stores are seen by other processors in the order in which they were made."""
_barrier = threading.Lock()
SKIP = 255
"""Kind of a frame that is none: the rest of the ring up to its end is not used."""


class Ring:
    """Both ends map the same memory file; ``capacity`` is what it holds in bytes."""

    def __init__(self, fd: int) -> None:
        """``fd`` is a memory file made by :func:`create`."""
        size = os.fstat(fd).st_size
        if size <= PAGE:
            raise ValueError("the memory file of the log ring is empty")
        self.capacity = size - PAGE
        self._map = mmap.mmap(fd, size)
        self._words = memoryview(self._map)[:PAGE].cast("Q")
        self.data = memoryview(self._map)[PAGE:]
        self._head = self._words[HEAD]
        self._tail = self._words[TAIL]

    def place(self, size: int) -> int:
        """Where in ``data`` a frame of ``size`` bytes may be written, -1 when there is no room now. Nothing is published before ``publish``."""
        head, capacity = self._head, self.capacity
        at = head % capacity
        if at + size > capacity:
            # the frame goes to the beginning; what is left at the end counts as used
            rest = capacity - at
            if not self._room(rest):
                return -1
            self.data[at] = SKIP
            self.publish(rest)
            return 0 if self._room(size) else -1
        if head + size - self._tail > capacity and not self._room(size):
            return -1
        return at

    def _room(self, size: int) -> bool:
        """Is there room for ``size`` bytes, now that the consumer is asked again?"""
        self._tail = self._words[TAIL]
        return self._head + size - self._tail <= self.capacity

    def publish(self, size: int) -> None:
        """The frame at the place given last is complete."""
        self._head += size
        if not IN_ORDER:
            _fence()
        self._words[HEAD] = self._head

    def put(self, frame: bytes) -> bool:
        """A whole frame; False when there is no room."""
        size = len(frame)
        at = self.place(size)
        if at < 0:
            return False
        self.data[at : at + size] = frame
        self.publish(size)
        return True

    def backlog(self) -> int:
        """Bytes that the consumer has not taken yet."""
        return self._head - self._words[TAIL]

    def taken(self) -> int:
        """Messages that the consumer has taken so far, by its own count."""
        return self._words[TAKEN]

    def touch(self) -> None:
        """Every page once, so that none is missing later: the first touch of a page costs more than a cycle can spare."""
        for at in range(0, self.capacity, PAGE):
            self.data[at] = 0

    def drain(self, take: Callable[[int, int, int, int, bytes], int]) -> int:
        """Consumer: ``take(kind, number, log_time, sequence, payload)`` for every complete frame, returns messages taken. Gives the bytes freed."""
        head, tail, capacity, data = self._words[HEAD], self._words[TAIL], self.capacity, self.data
        begin, fixed, unpack = tail, FRAME.size, FRAME.unpack_from
        if not IN_ORDER:
            _fence()
        while tail < head:
            at = tail % capacity
            if data[at] == SKIP:
                tail += capacity - at
                self._words[TAIL] = tail
                continue
            kind, number, log_time, sequence, length = unpack(data, at)
            end = at + fixed + length
            if end > capacity or tail + fixed + length > head:
                raise ValueError("the log ring is damaged: a frame is longer than what was published")
            self._words[TAKEN] += take(kind, number, log_time, sequence, bytes(data[at + fixed : end]))
            tail += fixed + length
            if not IN_ORDER:
                _fence()
            self._words[TAIL] = tail
        return tail - begin

    def close(self) -> None:
        """Let go of the memory."""
        self.data.release()
        self._words.release()
        self._map.close()


def _fence() -> None:
    # giving a lock back orders what was before, taking one what comes after; twice, so that one follows the other
    for _ in range(2):
        _barrier.acquire()
        _barrier.release()


def create(capacity: int) -> int:
    """A memory file for a ring: its descriptor, which the other process inherits. It has no name, so nothing is left of it after a crash."""
    system: Any = os
    if hasattr(os, "memfd_create"):
        fd: int = system.memfd_create("spsp-ctrl-log")
    else:
        import tempfile

        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, PAGE + capacity)
    return fd
