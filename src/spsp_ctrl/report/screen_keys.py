"""Keys of the live screen: bytes from the terminal to requests, and the terminal's mode."""

from __future__ import annotations

import contextlib
import os
import termios
import tty
from collections.abc import Iterator
from typing import Any

from spsp_ctrl.report.status import Status

HEADING_STEP_DEG = 5.0
HEADING_MEMORY_S = 10.0
"""Arrow keys within this time build on the last demand, since the reference only ramps towards it."""
QUIT = "quit"
_VERBS = {b"a": "arm", b"d": "disarm", b"s": "stop", b" ": "stop", b"r": "reset"}
_STOP = (b"s", b" ", b"q")
"""These count even behind a stray escape byte: a stop must never be lost."""
_ARROWS = {b"C": 1.0, b"D": -1.0}

Request = dict[str, Any]


class KeyDecoder:
    """Splits terminal input into key names: ``a d s r q ? left right``. Other keys and escape sequences are dropped.

    A sequence may arrive in pieces; an escape byte alone waits for the rest, and takes the next key along unless that
    key stops the platform.
    """

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> list[str]:
        """Key names in the order in which they were pressed."""
        keys: list[str] = []
        for code in data:
            byte = bytes([code])
            if byte == b"\x1b":
                self._pending = byte
            elif self._pending == b"\x1b" and byte in (b"[", b"O"):
                self._pending += byte
            elif len(self._pending) >= 2:
                # Parameters and intermediates go on until a final byte (ECMA-48, 5.4).
                if 0x40 <= code <= 0x7E:
                    if byte in _ARROWS and len(self._pending) == 2:
                        keys.append("right" if byte == b"C" else "left")
                    self._pending = b""
                else:
                    self._pending += byte
            elif self._pending and byte.lower() not in _STOP:
                self._pending = b""  # Alt and a key: no key of ours
            elif byte.lower() in _VERBS or byte.lower() in (b"q", b"?"):
                self._pending = b""
                keys.append("space" if byte == b" " else byte.lower().decode())
        return keys


class Operator:
    """Turns keys into requests. Heading steps add up although the status answers later."""

    def __init__(self) -> None:
        self._target_deg: float | None = None
        self._asked_at = float("-inf")

    def requests(self, key: str, status: Status, now_s: float) -> list[Request]:
        """Requests of one key. ``now_s`` is any monotonic time.

        ``q`` asks for a controlled stop and then for the end of the run (``quit``). A heading request carries
        the absolute target in degrees, within (-180, 180].
        """
        if key == "q":
            return [_request("stop"), _request(QUIT)]
        if key in ("left", "right"):
            if self._target_deg is None or now_s - self._asked_at > HEADING_MEMORY_S:
                self._target_deg = float(status.get("heading_target_deg") or 0.0)
            self._asked_at = now_s
            target = self._target_deg + (HEADING_STEP_DEG if key == "right" else -HEADING_STEP_DEG)
            self._target_deg = 180.0 - (180.0 - target) % 360.0
            return [_request("heading", self._target_deg)]
        verb = _VERBS.get(b" " if key == "space" else key.encode())
        return [_request(verb)] if verb else []


def _request(verb: str, value: float = 0.0) -> Request:
    return {"verb": verb, "value": value}


@contextlib.contextmanager
def single_keys(fd: int | None) -> Iterator[None]:
    """Keys of terminal ``fd`` come at once and unechoed; its former mode returns on every way out. None: no keys."""
    if fd is None:
        yield
        return
    try:
        former = termios.tcgetattr(fd)
    except termios.error:
        yield
        return
    try:
        tty.setcbreak(fd, termios.TCSANOW)
        yield
    finally:
        with contextlib.suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(fd, termios.TCSANOW, former)


def open_terminal() -> int | None:
    """A file descriptor to read keys from: standard input if it is a terminal, else the controlling one, else None."""
    if os.isatty(0):
        return 0
    try:
        return os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY)
    except OSError:
        return None
