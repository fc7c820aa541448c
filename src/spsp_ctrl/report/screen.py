"""The live screen, a process of its own so that it never takes time from the loop.

``python -m spsp_ctrl.report.screen --status-fd N [--request-fd M] [--interrupt-pid P]`` reads :class:`Status` objects,
one JSON object per line, from descriptor N and draws the newest, at most five times a second. It writes what the
operator asks for to descriptor M, one JSON object per line: ``{"verb": "heading", "value": 35.0}``. Verbs are ``arm``,
``disarm``, ``stop``, ``reset`` and ``heading``. The key q asks for a stop and then interrupts process P like Ctrl-C;
without P it sends the verb ``quit``. The screen ends at the end of the status stream.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import selectors
import signal
import sys
import time
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn, cast

from rich.console import Console
from rich.live import Live

from spsp_ctrl.report.screen_keys import QUIT, KeyDecoder, Operator, Request, open_terminal, single_keys
from spsp_ctrl.report.screen_view import plain_line, render
from spsp_ctrl.report.status import History, Status
from spsp_ctrl.report.summary_table import print_summary

__all__ = ["History", "Status", "main", "print_summary", "render"]

DRAW_PERIOD_S = 0.2
PLAIN_PERIOD_S = 5.0
MAX_LINE = 65536


class StatusStream:
    """Splits the bytes of the status pipe into statuses. A line that is not a JSON object is dropped."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Status]:
        """Statuses completed by ``data``, oldest first."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > MAX_LINE:
            self._rest = b""
        found: list[Status] = []
        for line in lines:
            with contextlib.suppress(ValueError):
                value = json.loads(line)
                if isinstance(value, dict):
                    found.append(cast(Status, value))
        return found


class Screen:
    """State of the screen between two events; :meth:`run` is the process."""

    def __init__(self, console: Console, status_fd: int, request_fd: int | None, interrupt_pid: int | None) -> None:
        self._console, self._status_fd, self._request_fd = console, status_fd, request_fd
        self._stream, self._decoder, self._operator = StatusStream(), KeyDecoder(), Operator()
        self._status: Status = {}
        self._history = History()
        self._interrupt_pid = interrupt_pid
        self._help = False
        # Without cursor control (TERM missing, "dumb" or "unknown") a line now and then is all that is safe.
        name = os.environ.get("TERM", "").strip().lower()
        self._drawable = console.is_terminal and name not in ("", "dumb", "unknown")

    def run(self, terminal_fd: int | None) -> None:
        """Read, draw and listen until the status stream ends."""
        with contextlib.ExitStack() as stack:
            stack.enter_context(single_keys(terminal_fd))
            selector = stack.enter_context(selectors.DefaultSelector())
            selector.register(self._status_fd, selectors.EVENT_READ, "status")
            if terminal_fd is not None:
                selector.register(terminal_fd, selectors.EVENT_READ, "keys")
            live: Live | None = None
            if self._drawable:
                live = Live(
                    console=self._console,
                    auto_refresh=False,
                    transient=True,
                    redirect_stdout=False,
                    redirect_stderr=False,
                )
                stack.enter_context(live)
            period_s = DRAW_PERIOD_S if live is not None else PLAIN_PERIOD_S
            drawn_at, fresh = float("-inf"), False
            while True:
                wait_s = max(0.0, drawn_at + period_s - time.monotonic()) if fresh else None
                for key, _ in selector.select(wait_s):
                    if key.data == "status":
                        data = os.read(self._status_fd, MAX_LINE)
                        if not data:
                            return
                        fresh |= self._take(data)
                    elif not self._listen(cast(int, terminal_fd)):
                        selector.unregister(cast(int, terminal_fd))
                    else:
                        fresh = True
                if fresh and time.monotonic() >= drawn_at + period_s:
                    self._draw(live)
                    drawn_at, fresh = time.monotonic(), False

    def _take(self, data: bytes) -> bool:
        found = self._stream.feed(data)
        for status in found:
            self._history.add(status)
            self._status = status
        return bool(found)

    def _listen(self, terminal_fd: int) -> bool:
        """Read keys and pass requests on; False when the terminal is gone."""
        try:
            data = os.read(terminal_fd, 1024)
        except OSError:
            return False
        for key in self._decoder.feed(data):
            if key == "?":
                self._help = not self._help
            for request in self._operator.requests(key, self._status, time.monotonic()):
                self._ask(request)
        return bool(data)

    def _ask(self, request: Request) -> None:
        if request["verb"] == QUIT and self._interrupt_pid is not None:
            # Once only: a second interrupt would cut the controlled stop short. The run may be gone and its number
            # in other hands, so it must still be our parent.
            if os.getppid() == self._interrupt_pid:
                os.kill(self._interrupt_pid, signal.SIGINT)
            self._interrupt_pid = None
            return
        if self._request_fd is None:
            return
        # A full or closed pipe means that nobody reads: Ctrl-C still reaches the loop.
        with contextlib.suppress(OSError):
            os.write(self._request_fd, json.dumps(request).encode() + b"\n")

    def _draw(self, live: Live | None) -> None:
        if live is not None:
            live.update(render(self._status, self._history, self._help), refresh=True)
        else:
            self._console.print(plain_line(self._status), highlight=False, markup=False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of the process. Returns 0 at the end of the stream."""
    parser = argparse.ArgumentParser(prog="python -m spsp_ctrl.report.screen", description="Live screen of a run.")
    parser.add_argument("--status-fd", type=int, required=True, help="descriptor to read status lines from")
    parser.add_argument("--request-fd", type=int, default=None, help="descriptor to write operator requests to")
    parser.add_argument("--interrupt-pid", type=int, default=None, help="q interrupts this parent process, like Ctrl-C")
    options = parser.parse_args(arguments)
    for name, fd in (("--status-fd", options.status_fd), ("--request-fd", options.request_fd)):
        try:
            if fd is not None:
                os.fstat(fd)
        except OSError:
            parser.error(f"{name} {fd} is not an open descriptor; the screen is started by spsp-ctrl run")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C belongs to the run, which ends the stream when it is done
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)  # in the background: no keys, but no halt either
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _leave)
    if options.request_fd is not None:
        os.set_blocking(options.request_fd, False)
    screen = Screen(Console(), options.status_fd, options.request_fd, options.interrupt_pid)
    with contextlib.suppress(OSError):  # the terminal went away while we drew on it
        screen.run(open_terminal())
    return 0


def _leave(number: int, _frame: FrameType | None) -> NoReturn:
    """Unwind, so that the terminal gets its mode and cursor back."""
    raise SystemExit(128 + number)


if __name__ == "__main__":
    sys.exit(main())
