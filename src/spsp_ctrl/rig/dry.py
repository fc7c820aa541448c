"""A rehearsal: every device identified and configured, the frames of start-up and of one cycle kept, power held off on the bus itself."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices.transport.base import Bytes, CanTransport, Fault, SerialTransport
from spsp_ctrl.messages import Command
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.power_guard import NoPower, no_power
from spsp_ctrl.rig.wires import open_wires

CYCLES = 4
KEEP = 100_000
_NMT = {C.NMT_START: "start", C.NMT_STOP: "stop", C.NMT_PRE_OPERATIONAL: "pre-operational"} | dict.fromkeys(
    (C.NMT_RESET_NODE, C.NMT_RESET_COMMUNICATION), "reset"
)


class Kept:
    """A serial line whose outgoing bytes are kept."""

    def __init__(self, line: SerialTransport) -> None:
        self._line = line
        self.immediate = line.immediate
        self.sent: list[bytes] = []

    @property
    def fault(self) -> Fault:
        """That of the line."""
        return self._line.fault

    def poll(self, now_ns: int) -> list[Bytes]:
        """See ``SerialTransport``."""
        return self._line.poll(now_ns)

    def send(self, data: bytes) -> bool:
        """See ``SerialTransport``."""
        if data and len(self.sent) < KEEP:
            self.sent.append(data)
        return self._line.send(data)

    def close(self) -> None:
        """See ``SerialTransport``."""
        self._line.close()


@dataclass(slots=True)
class Rehearsal:
    """What was found and what was sent."""

    devices: dict[str, tuple[str, str, str, str]] = field(default_factory=dict)
    """Vendor, product, serial, firmware by name in the rig file."""
    start_up: dict[str, list[str]] = field(default_factory=dict)
    """Frames and bytes by bus and line, with their meaning."""
    cycle: dict[str, list[str]] = field(default_factory=dict)
    """Those of one cycle of a powered run."""

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        devices = {name: dict(zip(("vendor", "product", "serial", "firmware"), words, strict=True)) for name, words in self.devices.items()}
        return {"devices": devices, "start_up": self.start_up, "cycle": self.cycle, "power": "never enabled"}

    def lines(self) -> list[str]:
        """For a person."""
        out = ["devices:"]
        out += [f"  {name:15} {' '.join(word or '-' for word in words)}" for name, words in self.devices.items()]
        for title, parts in (("start-up", self.start_up), ("one cycle", self.cycle)):
            for place, found in parts.items():
                out.append(f"{title}, {place}: {len(found)}")
                out += [f"  {text}" for text in found]
        out.append("power was never enabled")
        return out


def meaning(frame: tuple[int, bytes], names: Mapping[int, str]) -> str:
    """A frame that we send, in words; ``names`` are those of the nodes."""
    identifier, data = frame
    base, node = identifier & 0x780, identifier & 0x7F
    name = names.get(node, f"node {node}")
    if identifier == C.SYNC:
        return "SYNC"
    if identifier == C.NMT and len(data) == 2:
        return f"{names.get(data[1], f'node {data[1]}')}: {_NMT.get(data[0], 'NMT')}"
    if base == C.SDO_REQUEST and len(data) == 8:
        place = f"0x{int.from_bytes(data[1:3], 'little'):04X}:{data[3]}"
        if data[0] == C.SDO_READ:
            return f"{name}: read {place}"
        size = 4 - (data[0] >> 2 & 3)
        return f"{name}: write {place} = 0x{int.from_bytes(data[4 : 4 + size], 'little'):0{2 * size}X}"
    if base == C.RPDO1:
        return f"{name}: command"
    if base == C.HEARTBEAT:
        return "our heartbeat"
    return ""


def written(frame: tuple[int, bytes], names: Mapping[int, str], held: bool = False) -> str:
    """As candump writes it, and what it means."""
    text = f"{frame[0]:03X}#{frame[1].hex().upper()}"
    words = ", ".join(word for word in (meaning(frame, names), "HELD BACK: it switches power on" if held else "") if word)
    return f"{text:24} {words}".rstrip()


def rehearse(config: RigConfig) -> Rehearsal:
    """Do it. Raises ``RigError`` when a device does not answer or is not the expected one."""
    driver = config.rig
    assert isinstance(driver, BusDriver)
    guards: dict[str, NoPower] = {}
    kept: dict[str, Kept] = {}
    names = {bus: {node.node: name for name, node in driver.devices.nodes() if node.bus == bus} for bus in driver.can}

    def around(name: str, bus: CanTransport) -> CanTransport:
        guards[name] = no_power(driver, name, bus, KEEP)
        return guards[name]

    def around_line(name: str, line: SerialTransport) -> SerialTransport:
        kept[name] = Kept(line)
        return kept[name]

    def since(marks: Mapping[str, int]) -> dict[str, list[str]]:
        frames = {name: [written(f, names[name], held) for f, held in guard.seen[marks[name] :]] for name, guard in guards.items()}
        return frames | {name: [piece.hex(" ") for piece in line.sent[marks[name] :]] for name, line in kept.items()}

    def now_at() -> dict[str, int]:
        return {name: len(guard.seen) for name, guard in guards.items()} | {name: len(line.sent) for name, line in kept.items()}

    rig = open_wires(config, driver, around, around_line)
    found = Rehearsal()
    try:
        rig.open()
        found.devices = {name: (d.vendor, d.product, d.serial, d.firmware) for name, d in ((n, x.identity) for n, x in rig.devices.items())}
        found.start_up = since(dict.fromkeys((*guards, *kept), 0))
        period_ns = round(1e9 / config.rate_hz)
        begin = time.monotonic_ns()
        marks: dict[str, int] = {}
        for cycle in range(CYCLES):
            now_ns = cycle * period_ns
            while time.monotonic_ns() - begin < now_ns:
                time.sleep(1e-4)
            marks = now_at()
            measurement = rig.read(now_ns)
            if measurement.drive_pitch.enabled or measurement.drive_roll.enabled:
                raise RigError("a drive says that its power stage is on, though nothing has asked for it: switch it off at its supply")
            # the last cycle asks for power at zero current, as a run would: the guard holds those frames back
            rig.write(Command(now_ns, cycle, cycle == CYCLES - 1, 0.0, 0.0, 0.0, 0.0, 0.0), now_ns)
        found.cycle = since(marks)
        if min(measurement.drive_pitch.seq, measurement.drive_roll.seq) < 0:
            raise RigError("the drives answer questions but send no cyclic status after SYNC: is their mapping taken?")
    finally:
        rig.stop()
        rig.close()
    return found
