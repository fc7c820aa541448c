"""What is wrong with a device or a line, from the way it speaks: each watch names one trouble within its declared time. Time is an argument.

A transport names what its driver knows (unplugged, bus-off, ``transport.trouble``), the judge of the safety stage what the numbers tell (a
resolver that stands although its motor turns). These watches see what only bytes and frames tell: bytes that are no packets, two nodes that
speak with one number, a device whose clock stands.
"""

from __future__ import annotations

from spsp_ctrl.devices import canopen_table as C

GARBAGE_NS = 100_000_000
"""Declared time of ``StreamWatch``: so long after the last good packet."""
TWINS_SYNCS = 3
"""Declared time of ``TwinWatch`` in SYNCs (one more to judge the last); ``_CREDIT`` more after lost statuses."""
_CREDIT = 5
REPEATS, MOVING_COUNTS = 3, 8
"""``RepeatWatch``: named with the third repeat of a status; speeds below this can end within one SYNC."""
FROZEN_STAMP_NS = 50_000_000
"""Declared time of ``StampWatch``."""


class StreamWatch:
    """Bytes arrive but no packets: ``garbage``, or ``wrong-baud`` when nothing was ever understood. Silence: ``silent``."""

    def __init__(self, name: str, baud: int, patience_ns: int = GARBAGE_NS) -> None:
        self._name, self._baud, self._patience_ns = name, baud, patience_ns
        self._good_ns: int | None = None
        self._heard_ns: int | None = None
        self._begin_ns: int | None = None
        self._bytes = 0
        self._ever = False

    def step(self, now_ns: int, heard_bytes: int, packets: int) -> tuple[str, str]:
        """What has arrived since the last call; identifier and text, empty while all is well."""
        if self._begin_ns is None:
            self._begin_ns = now_ns
        if heard_bytes:
            self._heard_ns = now_ns
            self._bytes += heard_bytes
        if packets:
            self._good_ns, self._bytes, self._ever = now_ns, 0, True
        since = self._good_ns if self._good_ns is not None else self._begin_ns
        if now_ns - since < self._patience_ns:
            return "", ""
        ms = (now_ns - since) // 1_000_000
        if self._heard_ns is None or now_ns - self._heard_ns >= self._patience_ns:
            return "silent", f"{self._name}: nothing arrives for {ms} ms; check supply, cable, and that the device streams"
        if not self._ever:
            text = f"{self._name}: {self._bytes} bytes in {ms} ms and not one packet at {self._baud} baud"
            return "wrong-baud", f"{text}; the baud rate is probably another one, or another device is on this port"
        return "garbage", f"{self._name}: {self._bytes} bytes in {ms} ms since the last packet; check the ground, the shield and the plug of the line"


class TwinWatch:
    """Two nodes with one number: more statuses than SYNCs.

    A status that comes after the next SYNC is missed once and counted twice, which is even; a lost one gives a credit, up to ``_CREDIT``.
    """

    def __init__(self, name: str, node: int) -> None:
        self._name, self._node = name, node
        self._surplus = 0
        self._in_this = 1

    def sync(self, now_ns: int) -> tuple[str, str]:
        """A SYNC goes out: judge the one before. Identifier and text."""
        self._surplus = min(max(self._surplus + self._in_this - 1, -_CREDIT), 2 * TWINS_SYNCS)
        self._in_this = 0
        if self._surplus < TWINS_SYNCS:
            return "", ""
        return "node-twice", (
            f"{self._name}: node {self._node} answers a SYNC more than once; two devices have the number {self._node}: "
            "unplug one and give it another number"
        )

    def status(self) -> None:
        """A cyclic status of the node has arrived."""
        self._in_this += 1


class RepeatWatch:
    """A drive whose status repeats itself while its motor must turn: from at least ``MOVING_COUNTS`` a SYNC to the very same bytes, without a way.

    A motor that is braked passes the speeds between; one that is stopped by a hard blow looks the same for once, and deserves the words too.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._payload = b""
        self._counts = 0
        self._speed = 0
        self._repeats = 0

    def status(self, data: bytes) -> tuple[str, str]:
        """A cyclic status (statusword, position, torque) has arrived. Identifier and text."""
        payload = data[2:]
        if payload == self._payload:
            self._repeats += 1
        else:
            counts = int.from_bytes(payload[:4], "little", signed=True)
            self._speed, self._repeats = abs(counts - self._counts), 0
            self._payload, self._counts = payload, counts
        if self._repeats < REPEATS or self._speed < MOVING_COUNTS:
            return "", ""
        return "frozen-status", (
            f"{self._name}: turned at {self._speed} counts a SYNC and then sent the same position and torque {self._repeats + 1} times; "
            "the drive repeats an old status, or the shaft was stopped at once, or its resolver has come loose"
        )


class AnswerWatch:
    """Two nodes with one number, at start-up: they answer the same question twice. Objects that are read are read once."""

    def __init__(self) -> None:
        self._heard: dict[tuple[int, int], int] = {}

    def frame(self, identifier: int, data: bytes) -> None:
        """A frame of the bus."""
        if C.SDO_REPLY < identifier <= C.SDO_REPLY + C.MAX_NODE and len(data) == 8 and data[0] & 0xF3 == C.SDO_READ_SIZED:
            key = (identifier - C.SDO_REPLY, int.from_bytes(data[1:4], "little"))
            self._heard[key] = self._heard.get(key, 0) + 1

    @property
    def twins(self) -> list[int]:
        """Node numbers that two devices have."""
        doubled = [node for (node, _), count in self._heard.items() if count > 1]
        return sorted({node for node in doubled if doubled.count(node) >= TWINS_SYNCS})


class StampWatch:
    """A device that goes on sending while its own clock stands."""

    def __init__(self, name: str, patience_ns: int = FROZEN_STAMP_NS) -> None:
        self._name, self._patience_ns = name, patience_ns
        self._stamp: int | None = None
        self._since_ns = 0
        self._count = 0

    def step(self, now_ns: int, device_ns: int) -> tuple[str, str]:
        """A frame has arrived. Identifier and text; its data must not be used while there is one."""
        if device_ns != self._stamp:
            self._stamp, self._since_ns, self._count = device_ns, now_ns, 0
            return "", ""
        self._count += 1
        if self._count < 3 or now_ns - self._since_ns < self._patience_ns:
            return "", ""
        return "frozen-stamp", (
            f"{self._name}: {self._count + 1} frames carry the same time stamp; its filter has stopped: switch it off and on, check its firmware"
        )
