"""Targets on the device's side: simulated devices that must answer in form, ignore what is not for them, and go on working."""

from __future__ import annotations

from random import Random

from spsp_ctrl.devices import (
    canopen_device,
    canopen_table,
    cia402_device,
    cia406_device,
    mip_device,
    mip_host,
    odrive_device,
    tmcl_device,
    tmcl_table,
)
from spsp_ctrl.devices.transport.slcan_device import SlcanAdapter
from tools.fuzz.hosts import NODE, Target
from tools.fuzz.mutate import Frame, damaged, frame

ALIVE_EVERY = 50


class CanopenDevice(Target):
    """A node among mutated SYNC, NMT, SDO and PDO frames."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name
        self._device = self._new()
        self._keys = list(self._device.node.objects)
        self._now_ns = self._n = 0

    def _new(self) -> cia402_device.Drive | cia406_device.Encoder:
        if self.name == "cia402 drive":
            return cia402_device.Drive(NODE, rated_current_ma=4000)
        return cia406_device.Encoder(NODE)

    def _mutant(self, rng: Random) -> Frame:
        kind = rng.random()
        if kind < 0.5:  # a question about an object that exists, mostly
            index, sub = rng.choice(self._keys) if rng.random() < 0.8 else (rng.randrange(0x10000), rng.randrange(256))
            command = rng.choice((0x23, 0x27, 0x2B, 0x2F, 0x40, 0x60, 0x70, 0x80, 0x22, rng.randrange(256)))
            value = rng.choice(self._mappings()) if rng.random() < 0.3 else rng.randrange(1 << rng.choice((1, 4, 8, 16, 32)))
            return 0x600 + NODE, bytes((command,)) + index.to_bytes(2, "little") + bytes((sub,)) + value.to_bytes(4, "little")
        identifier, size = rng.choice(((0x000, 2), (0x080, 0), (0x200 + NODE, 4), (0x600 + NODE, 8), (0x77F, 1), (0x300 + NODE, 8)))
        if identifier == 0 and rng.random() < 0.7:
            return 0, bytes((rng.choice((1, 2, 128, 129, 130)), rng.choice((0, NODE))))
        return frame(rng, identifier, size)

    def _mappings(self) -> list[int]:
        return [index << 16 | sub << 8 | o.bits for (index, sub), o in self._device.node.objects.items()]

    def shot(self, rng: Random) -> None:
        device, mutant = self._device, self._mutant(rng)
        self._now_ns += rng.randrange(3_000_000)
        self._n += 1
        before = device.node.state
        out = device.receive(mutant, self._now_ns)
        mine = mutant[0] in (0x000, 0x080, 0x600 + NODE) or mutant[0] in self._received()
        if not mine and (out or device.node.state != before):
            self.wrong(f"{mutant[0]:03X}#{mutant[1].hex()} was not for it")
        out = out + device.tick(self._now_ns)
        self.count["samples"] += len(out)
        for identifier, data in out:
            if not 0 < identifier < 0x800 or len(data) > 8:
                self.wrong(f"sends {identifier:X}#{data.hex()}")
        if isinstance(device, cia402_device.Drive):
            command = device.command
            if command.enabled != (device.state is canopen_table.OPERATION_ENABLED and device.node.state == 5 and command.mode in (9, 10)):
                self.wrong("current without operation enabled")
        if self._n % ALIVE_EVERY == 0:
            self._alive()

    def _received(self) -> set[int]:
        objects = self._device.node.objects
        rpdo = objects[0x1400, 1].value & 0x7FF if (0x1400, 1) in objects else 0
        return {rpdo, 0x700 + (objects[0x1016, 1].value >> 16 & 0x7F)}

    def _alive(self) -> None:
        """Reset, a read, and a session as usual."""
        device = self._device
        device.receive((0, bytes((129, NODE))), self._now_ns)
        asked = device.receive((0x600 + NODE, b"\x40\x00\x10\x00\0\0\0\0"), self._now_ns)
        if asked != [(0x580 + NODE, b"\x43\x00\x10\x00" + device.node.objects[0x1000, 0].encode())]:
            self.wrong(f"does not answer after a reset: {asked}")
        if self._n % (20 * ALIVE_EVERY) == 0:
            self._device = self._new()
            assert isinstance(self._device.node, canopen_device.Node)


class MipDevice(Target):
    """The simulated IMU among mutated commands."""

    name, kind = "mip imu", "streams"

    def __init__(self) -> None:
        super().__init__()
        self._imu, self._n = mip_device.MipImu(), 0
        self._state = mip_device.ImuState(0.1, 0.2, 0.3, 0.0, 0.0, 0.0)

    def shot(self, rng: Random) -> None:
        self._n += 1
        data = rng.randbytes(rng.choice((0, 1, 2, 3, 5, 8)))
        number = rng.choice((0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x0A, 0x0E, 0x0F, 0x11, 0x40, rng.randrange(256)))
        sent = mip_host.command(rng.choice((0x01, 0x0C, 0x0D, 0x7F, rng.randrange(256))), number, data)
        out = self._imu.receive(damaged(rng, sent) if rng.random() < 0.6 else sent)
        out += self._imu.sample(self._n * 2_000_000, self._state)
        parser = mip_host.PacketParser()
        self.count["samples"] += len(parser.feed(out))
        if parser.skipped_bytes or parser.bad_packets or parser._held:
            self.wrong(f"answers no packet to {sent.hex()}: {out.hex()}")
        if self._n % ALIVE_EVERY == 0:
            answers = mip_host.PacketParser().feed(self._imu.receive(bytes(300) + mip_host.ping() + mip_host.ping()))
            if (0x01, 0x00) not in [mip_host.acknowledged(p) for p in answers]:
                self.wrong("does not answer a ping afterwards")


class TmclDevice(Target):
    """The simulated stepper module among mutated requests, on both lines."""

    name, kind = "tmcl module", "streams"

    def __init__(self) -> None:
        super().__init__()
        self._module, self._n = tmcl_device.Module(), 0

    def shot(self, rng: Random) -> None:
        self._n += 1
        instruction, kind = rng.choice((1, 2, 3, 4, 5, 6, 9, 10, 13, 15, 136, rng.randrange(256))), rng.randrange(256)
        body = bytes((1, instruction, kind, rng.choice((0, 0, 0, rng.randrange(256))))) + rng.randbytes(4)
        sent = body + bytes((sum(body) % 256,))
        out = self._module.serial(damaged(rng, sent) if rng.random() < 0.6 else sent)
        if len(out) % tmcl_table.SERIAL_BYTES:
            self.wrong(f"answers {len(out)} bytes to {sent.hex()}")
        self.count["samples"] += len(out) // tmcl_table.SERIAL_BYTES
        mutant = frame(rng, 1, 7)
        for identifier, data in self._module.can(*mutant):
            if identifier != 2 or len(data) not in (7, 8) or mutant[0] != 1 or len(mutant[1]) not in (7, 8):
                self.wrong(f"answers {identifier:X}#{data.hex()} to {mutant[0]:X}#{mutant[1].hex()}")
        self._module.advance(0.002)
        if self._n % ALIVE_EVERY == 0:
            asked = b"\x01\x06\x01\x00\x00\x00\x00\x00\x08"
            answers = self._module.serial(bytes(tmcl_table.SERIAL_BYTES) + asked + asked)
            if b"\x02\x01\x64\x06" not in answers:
                self.wrong("does not answer a question afterwards")


class OdriveDevice(Target):
    """The simulated ODrive axis among mutated frames."""

    name = "odrive axis"

    def __init__(self) -> None:
        super().__init__()
        self._axis, self._now_ns = odrive_device.Axis(3, watchdog_ns=100_000_000), 0

    def shot(self, rng: Random) -> None:
        self._now_ns += rng.randrange(2_000_000)
        mutant = frame(rng, 3 << 5 | rng.randrange(32), rng.choice((0, 1, 4, 8)))
        out = self._axis.receive(mutant, self._now_ns)
        if out and mutant[0] >> 5 != 3:
            self.wrong(f"{mutant[0]:03X} was not for it")
        out = out + self._axis.tick(self._now_ns)
        self.count["samples"] += len(out)
        if any(identifier >> 5 != 3 or len(data) != 8 for identifier, data in out):
            self.wrong(f"sends {out}")
        command = self._axis.command
        if command.torque_nm - command.torque_nm != 0.0 or command.turns_s - command.turns_s != 0.0:
            self.wrong("a command that is no number")


class SlcanDevice(Target):
    """The simulated adapter among mutated lines."""

    name, kind = "slcan adapter", "streams"

    def __init__(self) -> None:
        super().__init__()
        self._adapter = SlcanAdapter()

    def shot(self, rng: Random) -> None:
        line = rng.choice((b"O", b"C", b"S8", b"V", b"F", b"N", b"t10021133", b"T0000010021133", b"r1002", b"R000001000"))
        frames, answer = self._adapter.receive(damaged(rng, line) + b"\r")
        self.count["samples"] += len(frames)
        if not answer or answer[-1:] not in b"\r\a":
            self.wrong(f"answers {answer!r}")
        if any(len(data) > 8 for _, data in frames):
            self.wrong("no frame")


def device_targets() -> list[Target]:
    """All of them."""
    return [CanopenDevice("cia402 drive"), CanopenDevice("cia406 encoder"), MipDevice(), TmclDevice(), OdriveDevice(), SlcanDevice()]
