"""Targets on the host's side. A shot draws a mutant, feeds it, and judges what came out by another rule than the decoder's own."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Any

from spsp_ctrl.config.devices import AngleNode, DriveNode, ImuUnit
from spsp_ctrl.devices import (
    canopen_host,
    canopen_table,
    cia402_host,
    cia406_host,
    mip_device,
    mip_host,
    mip_table,
    odrive_host,
    tmcl_host,
    tmcl_table,
)
from spsp_ctrl.devices.families.base import DriveSetup, ImuSetup
from spsp_ctrl.devices.families.cia402 import Cia402Drive
from spsp_ctrl.devices.families.cia406 import Cia406Angle
from spsp_ctrl.devices.families.mip import MipUnit
from spsp_ctrl.devices.families.odrive import OdriveDrive
from spsp_ctrl.devices.transport.base import EXTENDED, REMOTE
from spsp_ctrl.devices.transport.slcan_codec import Lines
from spsp_ctrl.devices.transport.slcan_device import SlcanAdapter
from tools.fuzz.mutate import Frame, damaged, frame

NODE = 5


class Target:
    """One decoder or device under fire."""

    name = ""
    kind = "frames"

    def __init__(self) -> None:
        self.count: Counter[str] = Counter()
        """``samples``: mutants that gave something; ``wrong``: what must not be; ``lost``: good messages swallowed after a mutant."""

    def shot(self, rng: Random) -> None:
        """One mutant."""
        raise NotImplementedError

    def wrong(self, text: str) -> None:
        """A broken promise; the first ones are kept in words."""
        self.count["wrong"] += 1
        if self.count["wrong"] <= 3:
            self.count[f"wrong: {text}"] += 1


class FrameDecoder(Target):
    """A function of one frame. ``sure``: with the right identifier and length there is always a sample."""

    def __init__(self, name: str, read: Callable[[Frame], Any], identifier: int, sizes: tuple[int, ...], sure: bool) -> None:
        super().__init__()
        self.name, self._read, self._identifier, self._sizes, self._sure = name, read, identifier, sizes, sure

    def shot(self, rng: Random) -> None:
        mutant = frame(rng, self._identifier, rng.choice(self._sizes))
        right = mutant[0] == self._identifier and len(mutant[1]) in self._sizes
        found = self._read(mutant) is not None
        self.count["samples"] += found
        if (found and not right) or (self._sure and right and not found):
            self.wrong(f"{mutant[0]:03X}#{mutant[1].hex()} gave {'a' if found else 'no'} sample")


def frame_decoders() -> list[Target]:
    """Every decoder of single frames."""
    estimates = odrive_host.identifier(3, 0x09)
    return [
        FrameDecoder("cia402 status", lambda f: cia402_host.read_status(f, NODE), 0x180 + NODE, (8,), True),
        FrameDecoder("cia402 slow status", lambda f: cia402_host.read_slow(f, NODE), 0x280 + NODE, (7,), True),
        FrameDecoder("cia406 angle", lambda f: cia406_host.read_angle(f, NODE), 0x180 + NODE, (8,), True),
        FrameDecoder("canopen heartbeat", lambda f: canopen_host.read_heartbeat(f, NODE), 0x700 + NODE, (1,), True),
        FrameDecoder("canopen emergency", lambda f: canopen_host.read_emergency(f, NODE), 0x080 + NODE, (8,), True),
        FrameDecoder("canopen sdo answer", lambda f: canopen_host.answer(f, NODE), 0x580 + NODE, (8,), False),
        FrameDecoder("odrive heartbeat", lambda f: odrive_host.read_heartbeat(f, 3), 3 << 5 | 1, (8,), True),
        FrameDecoder("odrive estimates", lambda f: odrive_host.read_pair(f, 3, 0x09), estimates, (8,), False),
        FrameDecoder("tmcl answer on can", lambda f: tmcl_host.from_can(*f), tmcl_table.HOST, (7, 8), False),
    ]


class SdoClient(Target):
    """The start-up dialogue of a drive among mutated answers."""

    name = "canopen start-up dialogue"

    def __init__(self) -> None:
        super().__init__()
        self._now_ns = 0
        self._dialogue = self._new()

    def _new(self) -> canopen_host.SdoDialogue:
        return canopen_host.SdoDialogue(NODE, cia402_host.start_up(NODE, canopen_table.CST, 2, 127, 20))

    def shot(self, rng: Random) -> None:
        self._now_ns += 5_000_000
        asked = self._dialogue.step(self._now_ns, [frame(rng, 0x580 + NODE, 8)])
        for identifier, data in asked:
            answer = bytes((rng.choice((0x43, 0x4B, 0x4F, 0x60, 0x80)),)) + data[1:4] + rng.randbytes(4)
            self._dialogue.step(self._now_ns, [(0x580 + NODE, answer if rng.random() < 0.7 else damaged(rng, answer))])
            if identifier != 0x600 + NODE or len(data) != 8:
                self.wrong("a question of another form")
        if self._dialogue.done or self._dialogue.problem:
            self.count["ended"] += 1
            self._dialogue = self._new()


class MipHost(Target):
    """The IMU's stream: a mutant between good packets."""

    name = "mip stream"
    kind = "streams"

    def __init__(self) -> None:
        super().__init__()
        self._parser, self._decoder, self._set_up = mip_host.PacketParser(), mip_host.ImuDecoder(), mip_host.SetUp(500)
        self._n = 0

    def shot(self, rng: Random) -> None:
        good = [self._packet(rng) for _ in range(2)]
        mutant = damaged(rng, self._packet(rng)) if rng.random() < 0.9 else rng.randbytes(rng.randrange(60))
        text = mutant + good[0] + good[1]
        packets = self._parser.feed(text)
        packets += self._parser.feed(bytes(mip_table.MAX_PACKET_BYTES))  # silence: whoever waits for a long packet sees that it is none
        self._decoder.decode(packets)
        self._set_up.step(self._n, packets)
        if self._set_up.problem or self._set_up.done:
            self._set_up = mip_host.SetUp(500)
        rebuilt = [mip_device.packet(p.descriptor_set, *p.fields) for p in packets]
        self.count["samples"] += sum(r not in good for r in rebuilt)
        self.count["lost"] += sum(g not in rebuilt for g in good)
        self.count["both lost"] += all(g not in rebuilt for g in good)
        if any(r not in text + bytes(mip_table.MAX_PACKET_BYTES) for r in rebuilt):
            self.wrong(f"a packet that never came, from {text.hex()}")

    def _packet(self, rng: Random) -> bytes:
        self._n += 1
        angles = struct.pack(">3fH", rng.random(), rng.random(), rng.random(), 1)
        fields = [(mip_table.REFERENCE_TIME, self._n.to_bytes(8, "big")), (mip_table.EULER, angles), (mip_table.ANGULAR_RATE, angles)]
        return mip_device.packet(mip_table.FILTER, *fields[: rng.randint(1, 3)])


class TmclHost(Target):
    """The stepper's answers: a mutant between good ones, and the questions that follow."""

    name = "tmcl stream"
    kind = "streams"

    def __init__(self) -> None:
        super().__init__()
        self._replies, self._stepper, self._now_ns = tmcl_host.SerialReplies(), tmcl_host.Stepper(), 0

    def shot(self, rng: Random) -> None:
        good = [self._answer(rng) for _ in range(2)]
        mutant = damaged(rng, self._answer(rng)) if rng.random() < 0.9 else rng.randbytes(rng.randrange(20))
        text = mutant + good[0] + good[1] + bytes(tmcl_table.SERIAL_BYTES)
        replies = self._replies.feed(text)
        rebuilt = [self._bytes(r.status, r.instruction, r.value) for r in replies]
        self.count["samples"] += sum(r not in good for r in rebuilt)
        self.count["lost"] += sum(g not in rebuilt for g in good)
        self.count["both lost"] += all(g not in rebuilt for g in good)
        if any(r not in text for r in rebuilt):
            self.wrong(f"an answer that never came, from {text.hex()}")
        self._now_ns += 10_000_000
        self._stepper.step(self._now_ns, replies)

    def _answer(self, rng: Random) -> bytes:
        return self._bytes(100, tmcl_table.GET_PARAMETER, rng.randint(-(1 << 31), (1 << 31) - 1))

    @staticmethod
    def _bytes(status: int, instruction: int, value: int) -> bytes:
        body = struct.pack(">BBBBi", tmcl_table.HOST, tmcl_table.MODULE, status, instruction, value)
        return body + bytes((sum(body) % 256,))


class SlcanHost(Target):
    """The adapter's text: a mutant between good lines. The text has no checksum, so a changed digit is another frame (and only one)."""

    name = "slcan text"
    kind = "streams"

    def __init__(self) -> None:
        super().__init__()
        self._lines, self._adapter = Lines(), SlcanAdapter()
        self._adapter.receive(b"S8\rO\r")

    def shot(self, rng: Random) -> None:
        frames = [(rng.randrange(0x800), rng.randbytes(rng.randrange(9))) for _ in range(3)]
        text = [self._adapter.deliver([f]) for f in frames]
        found = self._lines.feed(damaged(rng, text[0]) + b"\r" + text[1] + text[2])
        self.count["samples"] += len(found) - 2
        self.count["lost"] += found[-2:] != frames[1:]
        for identifier, data in found:
            plain = identifier & ~(EXTENDED | REMOTE)
            if plain > (0x1FFFFFFF if identifier & EXTENDED else 0x7FF) or len(data) > 8:
                self.wrong(f"no frame: {identifier:X}#{data.hex()}")


class RigFamilies(Target):
    """The families as a rig uses them, all on one bus and one line: whatever arrives, samples stay numbers and nothing is read of a foreign frame."""

    name = "rig families"

    def __init__(self) -> None:
        super().__init__()
        drive = DriveNode(bus="can0", node=NODE, temperature_object=0x2002)
        self._drive = Cia402Drive(drive, DriveSetup(False, 16384, 0.05, 500))
        self._drive.restore({"rated_a": 2.5, "bus_v": 24.0, "identity": ["a", "b", "c", "d"]})
        self._odrive = OdriveDrive(DriveNode(bus="can0", node=3, family="odrive"), DriveSetup(True, 16384, 0.05, 500))
        self._angle = Cia406Angle(AngleNode(bus="can0", node=NODE + 1))
        self._angle.restore({"units_per_turn": 36000, "span": 36000 * 4096, "identity": ["a", "b", "c", "d"]})
        self._imu = MipUnit(ImuUnit(serial="imu"), ImuSetup(250.0, 5_000_000))
        self._imu.restore({"rate_hz": 250.0, "identity": ["a", "b", "c", "d"]})
        self._n = 0

    def shot(self, rng: Random) -> None:
        self._n += 1
        stamp = self._n * 2_000_000
        identifier, size = rng.choice(
            ((0x180 + NODE, 8), (0x280 + NODE, 7), (0x080 + NODE, 8), (0x580 + NODE, 8), (0x181 + NODE, 8), (3 << 5 | 1, 8), (3 << 5 | 9, 8))
        )
        mutant = frame(rng, identifier, size)
        before = self._drive.drive, self._drive.shaft, self._angle.shaft, self._odrive.shaft
        for device in (self._drive, self._odrive, self._angle):
            device.receive(mutant, stamp, self._n)
        samples = self._drive.drive, self._drive.shaft, self._angle.shaft, self._odrive.shaft
        changed = [new is not old for new, old in zip(samples, before, strict=True)]
        self.count["samples"] += any(changed)
        known = {0x180 + NODE: 8, 0x181 + NODE: 8, 3 << 5 | 9: 8}
        if any(changed) and known.get(mutant[0]) != len(mutant[1]):
            self.wrong(f"{mutant[0]:03X}#{mutant[1].hex()} gave a sample")
        if self._n % 8 == 0:
            angles = struct.pack(">3fH", *(rng.uniform(-4, 4) for _ in range(3)), 1)
            fields = ((mip_table.REFERENCE_TIME, stamp.to_bytes(8, "big")), (mip_table.EULER, angles), (mip_table.ANGULAR_RATE, angles))
            self._imu.receive(damaged(rng, mip_device.packet(mip_table.FILTER, *fields)), stamp)
        numbers = (*self._drive.drive[4:], *self._odrive.drive[4:], *(self._imu.imu[4:] if self._imu.imu.valid else ()))
        if any(x - x != 0.0 for x in numbers):
            self.wrong(f"a sample that is no number after {mutant[0]:03X}#{mutant[1].hex()}")
        self._drive.command(rng.random() < 0.5, rng.uniform(-9, 9), 0.0, stamp)
        self._odrive.command(rng.random() < 0.5, rng.uniform(-9, 9), rng.uniform(-900, 900), stamp)


def accepted(kind: str, shots: int, seed: int) -> int:
    """Of ``shots`` messages whose content was replaced by chance under the old checksum, how many pass it."""
    rng = Random(seed)
    if kind == "mip":
        body = mip_device.packet(mip_table.FILTER, (mip_table.EULER, bytes(range(14))), (mip_table.ANGULAR_RATE, bytes(range(14))))
        head, field, tail = body[:6], body[20:22], body[-2:]
        parser = mip_host.PacketParser()
        passed = 0
        for _ in range(shots):
            found = parser.feed(head + rng.randbytes(14) + field + rng.randbytes(14) + tail + bytes(8))
            passed += any(len(p.fields) == 2 for p in found)
            parser._held = b""
        return passed
    replies = tmcl_host.SerialReplies()
    passed = 0
    for _ in range(shots):
        passed += len(replies.feed(b"\x02\x01\x64\x06" + rng.randbytes(4) + b"\x37"))
        replies._held = b""
    return passed


EXPECTED = {"mip": 2.0**-16, "tmcl": 2.0**-8}
"""Theory: Fletcher-16 and a sum of one byte."""


def host_targets() -> list[Target]:
    """All of them."""
    return [*frame_decoders(), SdoClient(), MipHost(), TmclHost(), SlcanHost(), RigFamilies()]
