"""True states of a served plant, through a file in memory: the newest one, without waiting on either side."""

from __future__ import annotations

import mmap
import os
import struct
from pathlib import Path

from spsp_ctrl.messages import Truth

_N = len(Truth._fields) - 2
_ROW = struct.Struct(f"<Q{_N}dQ")
"""A counter before and after: when they differ, the row is being written."""


class TruthWriter:
    """The server's side. Raises ``OSError`` when the file cannot be made."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(bytes(_ROW.size))
        with path.open("r+b") as stream:
            self._map = mmap.mmap(stream.fileno(), _ROW.size)
        self._count = 0

    def put(self, values: list[float]) -> None:
        """The newest true state: the fields of ``Truth`` after stamp and cycle."""
        self._count += 1
        struct.pack_into("<Q", self._map, 0, self._count)
        struct.pack_into(f"<{_N}d", self._map, 8, *values)
        struct.pack_into("<Q", self._map, 8 + 8 * _N, self._count)

    def close(self) -> None:
        """Remove the file."""
        self._map.close()
        self._path.unlink(missing_ok=True)


class TruthReader:
    """The controller's side: for the log, never for the law."""

    def __init__(self, path: Path) -> None:
        fd = os.open(path, os.O_RDONLY)
        try:
            self._map = mmap.mmap(fd, _ROW.size, prot=mmap.PROT_READ)
        finally:
            os.close(fd)
        self._newest = (0.0,) * _N

    def get(self, stamp_ns: int, cycle: int) -> Truth:
        """The newest true state; the one before when it is just being written."""
        first, *values, last = _ROW.unpack(self._map)
        if first == last:
            self._newest = tuple(values)
        return Truth(stamp_ns, cycle, *self._newest)
