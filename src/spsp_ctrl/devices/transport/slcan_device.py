"""The adapter's side of the slcan text protocol (Lawicel CAN232 manual): for a simulated adapter on a pseudo-terminal. No I/O.

Written apart from ``slcan_codec``; python-can's own ``slcan`` interface is its other judge.
"""

from __future__ import annotations

from collections.abc import Iterable

from spsp_ctrl.devices.transport.base import EXTENDED, REMOTE

Frame = tuple[int, bytes]


class SlcanAdapter:
    """``receive`` what the computer writes: frames for the bus and the answer. ``deliver`` frames of the bus: bytes for the computer."""

    def __init__(self) -> None:
        self._held = b""
        self.bit_rate_code: int | None = None
        self.is_open = False
        self.flags = 0
        """Status flags that ``F`` answers; cleared by it."""

    def receive(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Frames that go out on the bus, and the answer of the adapter."""
        self._held += data
        frames: list[Frame] = []
        answer = b""
        while (end := self._held.find(b"\r")) >= 0:
            line, self._held = self._held[:end].lstrip(b"\n"), self._held[end + 1 :]
            answer += self._line(line, frames)
        self._held = self._held[-64:]
        return frames, answer

    def deliver(self, frames: Iterable[Frame]) -> bytes:
        """Frames heard on the bus; nothing while it is closed."""
        if not self.is_open:
            return b""
        out = bytearray()
        for identifier, data in frames:
            letter = {0: b"t", EXTENDED: b"T", REMOTE: b"r", EXTENDED | REMOTE: b"R"}[identifier & (EXTENDED | REMOTE)]
            digits = 8 if identifier & EXTENDED else 3
            out += letter + b"%0*X" % (digits, identifier & 0x1FFFFFFF) + b"%d" % len(data)
            if not identifier & REMOTE:
                for value in data:
                    out += b"%02X" % value
            out += b"\r"
        return bytes(out)

    def _line(self, line: bytes, frames: list[Frame]) -> bytes:
        if not line:
            return b"\r"
        letter = line[:1]
        if letter in b"tTrR":
            frame = _parse(line)
            if frame is None or not self.is_open:
                return b"\a"
            frames.append(frame)
            return b"z\r" if letter in b"tr" else b"Z\r"
        if letter == b"S" and len(line) == 2 and line[1:] in b"012345678" and not self.is_open:
            self.bit_rate_code = int(line[1:])
            return b"\r"
        if letter in b"OL" and len(line) == 1 and not self.is_open and self.bit_rate_code is not None:
            self.is_open = True
            return b"\r"
        if letter == b"C" and len(line) == 1 and self.is_open:
            self.is_open = False
            return b"\r"
        if line == b"F" and self.is_open:
            flags, self.flags = self.flags, 0
            return b"F%02X\r" % flags
        return {b"V": b"V1013\r", b"N": b"NSIM1\r", b"Z0": b"\r"}.get(line, b"\a")


def _parse(line: bytes) -> Frame | None:
    extended, remote = line[:1] in b"TR", line[:1] in b"rR"
    head = 9 if extended else 4
    text = line.decode("latin-1")
    if len(text) <= head or any(c not in "0123456789abcdefABCDEF" for c in text[1:]):
        return None
    number, size = int(text[1:head], 16), int(text[head], 16)
    body = text[head + 1 :]
    if size > 8 or number > (0x1FFFFFFF if extended else 0x7FF) or len(body) != (0 if remote else 2 * size):
        return None
    flags = (EXTENDED if extended else 0) | (REMOTE if remote else 0)
    return number | flags, bytes(int(body[at : at + 2], 16) for at in range(0, len(body), 2))
