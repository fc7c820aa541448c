"""The run's end of the live screen: starts the process, hands it statuses, collects requests. Never waits."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from typing import Any

from spsp_ctrl.report.status import Status

_VERBS = frozenset({"arm", "disarm", "stop", "reset", "heading"})
_CLOSE_TIMEOUT_S = 2.0


class ScreenLink:
    """A live screen in its own process. When it dies or falls behind, the run goes on without it."""

    def __init__(self, process: subprocess.Popen[bytes], status_fd: int, request_fd: int) -> None:
        self._process, self._status_fd, self._request_fd = process, status_fd, request_fd
        self._unsent = b""
        self._unread = b""
        self._closed = False

    @classmethod
    def start(cls) -> ScreenLink | None:
        """Start the screen on this terminal; ``None`` when standard output is none, or the start fails."""
        if not sys.stdout.isatty():
            return None
        status_read, status_write = os.pipe()
        request_read, request_write = os.pipe()
        command = [sys.executable, "-m", "spsp_ctrl.report.screen"]
        command += ["--status-fd", str(status_read), "--request-fd", str(request_write)]
        command += ["--interrupt-pid", str(os.getpid())]
        try:
            process = subprocess.Popen(command, pass_fds=(status_read, request_write))
        except OSError:
            for fd in (status_read, status_write, request_read, request_write):
                os.close(fd)
            return None
        os.close(status_read)
        os.close(request_write)
        os.set_blocking(status_write, False)
        os.set_blocking(request_read, False)
        return cls(process, status_write, request_read)

    @property
    def request_fd(self) -> int:
        """Where the requests arrive, for a reader of its own instead of :meth:`requests`."""
        return self._request_fd

    def send(self, status: Status) -> None:
        """Hand over one status, if the pipe has room; a status that does not fit is dropped whole."""
        if self._closed:
            return
        if not self._unsent:
            self._unsent = json.dumps(status).encode() + b"\n"
        with contextlib.suppress(OSError):
            # The rest of a line cut short goes first: the stream stays a stream of whole lines.
            self._unsent = self._unsent[os.write(self._status_fd, self._unsent) :]

    def requests(self) -> list[dict[str, Any]]:
        """Requests since the last call: ``{"verb": str, "value": float}``; anything malformed is dropped."""
        if self._closed:
            return []
        with contextlib.suppress(OSError):
            while data := os.read(self._request_fd, 4096):
                self._unread += data
        *lines, self._unread = self._unread.split(b"\n")
        found: list[dict[str, Any]] = []
        for line in lines:
            with contextlib.suppress(ValueError, TypeError, KeyError):
                request = json.loads(line)
                if request["verb"] in _VERBS:
                    found.append({"verb": request["verb"], "value": float(request.get("value") or 0.0)})
        return found

    def close(self) -> None:
        """End the stream and wait briefly, so that the terminal is in order again before the run prints its table."""
        if self._closed:
            return
        self._closed = True
        os.close(self._status_fd)
        try:
            self._process.wait(_CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_CLOSE_TIMEOUT_S)
        os.close(self._request_fd)
