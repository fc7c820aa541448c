"""The text protocol of serial CAN adapters (Lawicel, "slcan"): frames to text and back, many at a time. No I/O."""

from __future__ import annotations

from collections.abc import Iterable

from spsp_ctrl.devices.transport.base import EXTENDED, REMOTE

Frame = tuple[int, bytes]
BITRATES = {10_000: 0, 20_000: 1, 50_000: 2, 100_000: 3, 125_000: 4, 250_000: 5, 500_000: 6, 800_000: 7, 1_000_000: 8}
OK, BELL = b"\r", b"\a"
_DATA_BYTES = {ord("t"): (3, 0), ord("T"): (8, EXTENDED), ord("r"): (3, REMOTE), ord("R"): (8, EXTENDED | REMOTE)}
_FLAGS = {0x01: "overrun", 0x02: "queue-full", 0x04: "error-frames", 0x08: "overrun", 0x20: "error-passive", 0x80: "error-frames"}
"""Bits of the answer to ``F``, and the fault that each means."""


def to_text(frames: Iterable[Frame]) -> bytes:
    """Frames as the adapter wants them. Longer data than eight bytes raises ``ValueError``."""
    out = []
    for identifier, data in frames:
        if len(data) > 8:
            raise ValueError(f"a CAN frame holds at most 8 bytes, not {len(data)}")
        remote = identifier & REMOTE
        extended = identifier & EXTENDED
        letter = ("R" if remote else "T") if extended else ("r" if remote else "t")
        number = f"{identifier & 0x1FFFFFFF:08X}" if extended else f"{identifier & 0x7FF:03X}"
        out.append(f"{letter}{number}{len(data)}{'' if remote else data.hex().upper()}\r")
    return "".join(out).encode("ascii")


def flags(word: int) -> set[str]:
    """Faults that the status flags of an adapter name."""
    return {name for bit, name in _FLAGS.items() if word & bit}


class Lines:
    """Frames out of the text of an adapter. A damaged line costs itself only."""

    _LONGEST = 64

    def __init__(self) -> None:
        self._held = b""
        self.answers = 0
        """Lines that were no frame: the adapter is alive."""
        self.refused = 0
        """Bells: a command or a frame was not taken."""
        self.damaged = 0
        self.status: int | None = None
        """Newest status flags."""
        self.version = ""

    def feed(self, data: bytes) -> list[Frame]:
        """Every frame that is complete now."""
        *lines, self._held = (self._held + data).replace(BELL, b"\a\r").split(OK)
        if len(self._held) > self._LONGEST:
            self.damaged += 1
            self._held = b""
        found = []
        for line in lines:
            if line[-1:] == BELL:
                self.refused += 1
                self.answers += 1
                continue
            frame = self._frame(line)
            if frame is not None:
                found.append(frame)
        return found

    def _frame(self, line: bytes) -> Frame | None:
        kind = _DATA_BYTES.get(line[0]) if line else None
        if kind is None:
            self._answer(line)
            return None
        digits, flag = kind
        at = 2 + digits
        try:
            number = int(line[1 : 1 + digits], 16)
            size = int(line[1 + digits : at])
            end = at if flag & REMOTE else at + 2 * size
            data = bytes.fromhex(line[at:end].decode("ascii"))
        except ValueError:
            self.damaged += 1
            return None
        # a time stamp of four digits may follow
        whole = size <= 8 and len(data) * 2 == end - at and len(line) in (end, end + 4) and line[1 : len(line)].isalnum()
        if not whole or number > (0x1FFFFFFF if flag & EXTENDED else 0x7FF):
            self.damaged += 1
            return None
        return number | flag, data

    def _answer(self, line: bytes) -> None:
        if not line or line in (b"z", b"Z"):
            self.answers += 1
        elif line[:1] == b"F" and len(line) == 3:
            try:
                self.status = int(line[1:], 16)
                self.answers += 1
            except ValueError:
                self.damaged += 1
        elif line[:1] in b"VvN" and len(line) >= 5 and line.isascii():
            self.version = line.decode("ascii") if line[:1] == b"V" else self.version
            self.answers += 1
        else:
            self.damaged += 1
