"""Requests from a person: judged at this boundary, stamped with the cycle that takes them."""

from __future__ import annotations

import json
import os
from math import isfinite, radians

from spsp_ctrl.messages import OperatorRequest

VERBS = ("arm", "disarm", "stop", "reset", "heading", "turn")
MAX_LINE = 4096


class PipeOperator:
    """Newline-delimited JSON requests ``{"verb": ..., "value": degrees}`` from a non-blocking file descriptor.

    ``heading`` goes to a heading in degrees; ``turn`` changes the present demand by so many degrees. What is not understood is counted and dropped.
    """

    def __init__(self, fd: int, source: str) -> None:
        os.set_blocking(fd, False)
        self._fd = fd
        self._source = source
        self._buffer = b""
        self._heading_rad = 0.0
        self.rejected = 0

    def poll(self, now_ns: int) -> tuple[OperatorRequest, ...]:
        """Requests since the last call."""
        try:
            data = os.read(self._fd, MAX_LINE)
        except (BlockingIOError, OSError):
            return ()
        if not data:
            return ()
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\n")
        if len(self._buffer) > MAX_LINE:
            self._buffer = b""
            self.rejected += 1
        found = []
        for line in lines:
            request = self._judge(line, now_ns)
            if request is None:
                self.rejected += 1
            else:
                found.append(request)
        return tuple(found)

    def _judge(self, line: bytes, now_ns: int) -> OperatorRequest | None:
        try:
            data = json.loads(line)
            verb, value = data["verb"], float(data.get("value") or 0.0)
        except (ValueError, KeyError, TypeError, AttributeError):
            return None
        if verb not in VERBS or not isfinite(value) or abs(value) > 360.0:
            return None
        if verb in ("heading", "turn"):
            self._heading_rad = radians(value) + (self._heading_rad if verb == "turn" else 0.0)
            return OperatorRequest(now_ns, "heading", self._heading_rad, self._source)
        return OperatorRequest(now_ns, verb, 0.0, self._source)
