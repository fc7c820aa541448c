"""Who is there: questions that read and change nothing. No I/O; time is an argument, nothing waits. Each probe ends with ``done``."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

from spsp_ctrl.devices import canopen_host as canopen
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import mip_host, odrive_host, tmcl_host
from spsp_ctrl.devices import mip_table as M
from spsp_ctrl.devices import odrive_table as O
from spsp_ctrl.devices import tmcl_table as S

Frame = tuple[int, bytes]
PROFILES = {402: "CiA 402 drive", 406: "CiA 406 encoder", 401: "CiA 401 inputs/outputs", 418: "CiA 418 battery"}


class Who(NamedTuple):
    """One device that answers."""

    address: int
    """Node number or module address; 0 on a line of its own."""
    kind: str
    vendor: str
    product: str
    serial: str
    firmware: str
    name: str
    answers: int
    """Answers to one question: more than one is two devices with one number."""


class CanopenProbe:
    """Every node on a CANopen bus: device type, identity, and the name if it fits into a short answer."""

    WAIT_NS = 30_000_000
    BATCH = 16
    _ASKED = ((C.DEVICE_TYPE, 0), (C.IDENTITY, 1), (C.IDENTITY, 2), (C.IDENTITY, 3), (C.IDENTITY, 4))

    def __init__(self, nodes: Iterable[int] = range(1, C.MAX_NODE + 1)) -> None:
        self._left = list(nodes)
        self._asked: list[tuple[int, int, int]] = []
        self._sent_ns = 0
        self._types: dict[int, int] = {}
        self._values: dict[tuple[int, int, int], int] = {}
        self._answers: dict[int, int] = {}
        self._details: list[tuple[int, int, int]] = []
        self._begun = False
        self.talking: set[int] = set()
        """Nodes that were heard (heartbeat, boot-up, emergency), whether they answer or not."""
        self.done = False

    def step(self, now_ns: int, frames: Iterable[Frame]) -> list[Frame]:
        """Take what has arrived; the questions to send now."""
        for frame in frames:
            self._take(frame)
        if self.done or (self._asked and now_ns - self._sent_ns < self.WAIT_NS):
            return []
        self._asked = []
        if self._left:
            batch, self._left = self._left[: self.BATCH], self._left[self.BATCH :]
            self._asked = [(node, C.DEVICE_TYPE, 0) for node in batch]
        elif not self._begun:
            self._begun = True
            self._details = [(node, *key) for node in sorted(self._types) for key in self._ASKED[1:]]
        if not self._asked and self._details:
            self._asked, self._details = self._details[: self.BATCH], self._details[self.BATCH :]
        self.done = not self._asked
        self._sent_ns = now_ns
        return [canopen.read(*question) for question in self._asked]

    def _take(self, frame: Frame) -> None:
        identifier, data = frame
        base, node = identifier & 0x780, identifier & 0x7F
        if node and ((base == C.HEARTBEAT and len(data) == 1) or (base == C.EMCY and len(data) == 8)):
            self.talking.add(node)
        answer = canopen.answer(frame, node) if base == C.SDO_REPLY and node else None
        if answer is None:
            return
        self.talking.add(node)
        key = (node, answer.number, answer.subindex)
        if key not in self._asked:
            return
        if answer.number == C.DEVICE_TYPE:
            self._answers[node] = self._answers.get(node, 0) + 1
            self._types[node] = int.from_bytes(answer.data, "little")
        elif not answer.abort:
            self._values[key] = int.from_bytes(answer.data, "little")

    @property
    def found(self) -> list[Who]:
        """Everybody who answered."""
        out = []
        for node, kind in sorted(self._types.items()):
            vendor, product, revision, serial = (
                f"0x{self._values[key]:08X}" if (key := (node, C.IDENTITY, sub)) in self._values else "" for sub in (1, 2, 3, 4)
            )
            profile = PROFILES.get(kind & 0xFFFF, f"CANopen device, profile {kind & 0xFFFF}")
            out.append(Who(node, profile, vendor, product, serial, revision, "", self._answers[node]))
        return out


class TmclProbe:
    """A Trinamic module on a serial line or on CAN, at one address."""

    WAIT_NS = 100_000_000
    TRIES = 2

    def __init__(self, address: int = S.MODULE, host: int = S.HOST, *, on_can: bool = False) -> None:
        self._address, self._host, self._on_can = address, host, on_can
        self._replies = tmcl_host.SerialReplies(host, address)
        self._request = tmcl_host.Request(S.VERSION, S.VERSION_BINARY, 0, 0)
        self._tries = self._sent_ns = 0
        self.found: list[Who] = []
        self.done = False

    def step(self, now_ns: int, frames: Iterable[Frame], data: bytes = b"") -> tuple[list[Frame], bytes]:
        """Take what has arrived; what to send now."""
        heard = [tmcl_host.from_can(i, d, self._host, self._address) for i, d in frames] if self._on_can else self._replies.feed(data)
        for reply in heard:
            if reply is not None and self._tries and reply.instruction == S.VERSION and reply.status == S.OK:
                number = reply.value & 0xFFFFFFFF
                if self.found:
                    self.found = [self.found[0]._replace(answers=self.found[0].answers + 1)]
                else:
                    firmware = f"{number >> 8 & 0xFF}.{number & 0xFF:02d}"
                    self.found.append(Who(self._address, "TMCL module", "Trinamic", f"TMCM-{number >> 16}", "", firmware, "", 1))
        if self.done or (self._tries and now_ns - self._sent_ns < self.WAIT_NS):
            return [], b""
        if self.found or self._tries == self.TRIES:
            self.done = True
            return [], b""
        self._tries += 1
        self._sent_ns = now_ns
        if self._on_can:
            return [tmcl_host.to_can(self._request, self._address)], b""
        return [], tmcl_host.to_serial(self._request, self._address)


class MipProbe:
    """A MicroStrain unit on a serial line. Its streams go on."""

    WAIT_NS = 200_000_000
    TRIES = 3

    def __init__(self) -> None:
        self._parser = mip_host.PacketParser()
        self._tries = self._sent_ns = 0
        self.heard_bytes = self.packets = 0
        self.found: list[Who] = []
        self.done = False

    def step(self, now_ns: int, data: bytes) -> bytes:
        """Take what has arrived; what to send now."""
        self.heard_bytes += len(data)
        for packet in self._parser.feed(data):
            self.packets += 1
            info = mip_host.read_info(packet)
            if info is not None and not self.found:
                model = f"{info.model_name} {info.model_number}".strip()
                self.found.append(Who(0, "MIP inertial unit", "MicroStrain", info.model_name, info.serial_number, info.firmware, model, 1))
        if self.done or (not self.found and self._tries and now_ns - self._sent_ns < self.WAIT_NS):
            return b""
        if self.found or self._tries == self.TRIES:
            self.done = True
            return b""
        self._tries += 1
        self._sent_ns = now_ns
        return mip_host.command(M.BASE, M.DEVICE_INFO)


class OdriveProbe:
    """Axes that speak CANSimple, by their heartbeats; their version is asked for when ``ask`` names them. Their identifiers overlap CANopen's."""

    LISTEN_NS = 300_000_000

    def __init__(self, ask: Iterable[int], remote_flag: int) -> None:
        self._ask, self._flag = tuple(ask), remote_flag
        self._begin_ns: int | None = None
        self._found: dict[int, Who] = {}
        self.done = False

    def step(self, now_ns: int, frames: Iterable[Frame]) -> list[Frame]:
        """Take what has arrived; what to send now."""
        for frame in frames:
            node, command = frame[0] >> O.COMMAND_BITS, frame[0] & (1 << O.COMMAND_BITS) - 1
            if node not in self._ask:
                continue
            if odrive_host.read_heartbeat(frame, node) is not None:
                self._found.setdefault(node, Who(node, "ODrive axis", "ODrive", "", "", "", "", 1))
            elif command == O.VERSION and len(frame[1]) == 8:
                _, line, version, variant, major, minor, revision, _ = struct.unpack(O.VERSION_LAYOUT, frame[1])
                product, firmware = f"{line}.{version}-{variant}", f"{major}.{minor}.{revision}"
                self._found[node] = Who(node, "ODrive axis", "ODrive", product, "", firmware, "", 1)
        if self._begin_ns is None:
            self._begin_ns = now_ns
            return [(number | self._flag, data) for number, data in (odrive_host.query(node, O.VERSION) for node in self._ask)]
        self.done = now_ns - self._begin_ns >= self.LISTEN_NS
        return []

    @property
    def found(self) -> list[Who]:
        """Everybody heard."""
        return [self._found[node] for node in sorted(self._found)]
