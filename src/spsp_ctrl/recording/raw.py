"""Frames and bytes as they went over buses and lines, in a log: ``/raw/NAME/rx`` and ``/raw/NAME/tx``.

CAN frames are ``can_msgs/msg/Frame``, which other tools know; bytes of a serial line are ``spsp_ctrl/msg/RawBytes``. CDR, little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

FRAME_NAME, BYTES_NAME = "can_msgs/msg/Frame", "spsp_ctrl/msg/RawBytes"
_HEADER = """std_msgs/Header header
{fields}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
FRAME_SCHEMA = _HEADER.format(fields="uint32 id\nbool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\nuint8[8] data")
BYTES_SCHEMA = _HEADER.format(fields="uint8[] data")
EXTENDED, REMOTE = 1 << 31, 1 << 30
"""Flags of an identifier, as SocketCAN has them."""
_CDR = b"\x00\x01\x00\x00"


class RawEntry(NamedTuple):
    """One frame, or one piece of a byte stream (``identifier`` is -1)."""

    stamp_ns: int
    name: str
    """Bus or line."""
    sent: bool
    identifier: int
    data: bytes


PACK = struct.Struct("<qIB?iHH")
"""An entry on its way to the writer: stamp, poll, length of the name, sent, identifier, length of the data, 1 for a frame."""


def pack(entries: Iterable[Any]) -> bytes:
    """Entries (``rig.raw``) as one block for the writer process."""
    out = []
    for stamp, name, sent, identifier, data, poll in entries:
        text = name.encode("ascii", "replace")
        number = identifier - (1 << 32) if identifier >= 1 << 31 else identifier
        out += [PACK.pack(stamp, poll, len(text), sent, number, len(data), 1 if identifier >= 0 else 0), text, data]
    return b"".join(out)


def unpack(block: bytes) -> Iterator[tuple[RawEntry, int]]:
    """Entries of a block, each with its poll."""
    at = 0
    while at < len(block):
        stamp, poll, size, sent, number, length, frame = PACK.unpack_from(block, at)
        at += PACK.size
        name = block[at : at + size].decode("ascii")
        data = block[at + size : at + size + length]
        at += size + length
        yield RawEntry(stamp, name, sent, number & 0xFFFFFFFF if frame else -1, data), poll


def topic(name: str, sent: bool) -> str:
    """Where it lies in a log."""
    return f"/raw/{name}/{'tx' if sent else 'rx'}"


def place(topic_name: str) -> tuple[str, bool] | None:
    """Bus or line and direction of a topic; None for any other topic."""
    parts = topic_name.split("/")
    if len(parts) != 4 or parts[:2] != ["", "raw"] or parts[3] not in ("rx", "tx"):
        return None
    return parts[2], parts[3] == "tx"


def _head(stamp_ns: int, name: str) -> bytes:
    text = name.encode("ascii", "replace") + b"\0"
    head = struct.pack("<iII", stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000, len(text)) + text
    return head + bytes(-len(head) % 4)


def encode(entry: RawEntry) -> bytes:
    """Payload of its message."""
    head = _CDR + _head(entry.stamp_ns, entry.name)
    if entry.identifier < 0:
        return head + struct.pack("<I", len(entry.data)) + entry.data
    number, remote = entry.identifier & 0x1FFFFFFF, bool(entry.identifier & REMOTE)
    flags = struct.pack("<I3?B", number, remote, bool(entry.identifier & EXTENDED), False, len(entry.data))
    return head + flags + entry.data.ljust(8, b"\0")


def decode(name: str, sent: bool, frame: bool, payload: bytes) -> RawEntry:
    """The entry of a payload. Raises ``ValueError`` when it is none."""
    try:
        second, nano, size = struct.unpack_from("<iII", payload, 4)
        at = 16 + size + -(12 + size) % 4
        stamp = second * 1_000_000_000 + nano
        if not frame:
            (count,) = struct.unpack_from("<I", payload, at)
            data = payload[at + 4 : at + 4 + count]
            if len(data) != count:
                raise ValueError("cut short")
            return RawEntry(stamp, name, sent, -1, data)
        number, remote, extended, _, length = struct.unpack_from("<I3?B", payload, at)
        data = payload[at + 8 : at + 8 + length]
        if length > 8 or len(payload) < at + 16 or payload[:4] != _CDR:
            raise ValueError("no frame")
    except struct.error as error:
        raise ValueError(str(error)) from None
    return RawEntry(stamp, name, sent, number | (EXTENDED if extended else 0) | (REMOTE if remote else 0), data)
