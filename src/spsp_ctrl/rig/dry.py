"""A rehearsal: every device identified and configured, the frames of start-up and of two cycles sent and kept, power held off on the bus itself."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices.transport.base import CanTransport
from spsp_ctrl.messages import Command
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.power_guard import NoPower, no_power
from spsp_ctrl.rig.wires import open_wires

CYCLES = 3
KEEP = 100_000


@dataclass(slots=True)
class Rehearsal:
    """What was found and what was sent."""

    devices: dict[str, tuple[str, str, str, str]] = field(default_factory=dict)
    """Vendor, product, serial, firmware by name in the rig file."""
    start_up: dict[str, list[str]] = field(default_factory=dict)
    """Frames by bus, in candump's way to write them."""
    cycle: dict[str, list[str]] = field(default_factory=dict)
    """Frames of one cycle in operation."""
    would: dict[str, list[str]] = field(default_factory=dict)
    """Frames that a powered run would send at this point, held back."""

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        devices = {name: dict(zip(("vendor", "product", "serial", "firmware"), words, strict=True)) for name, words in self.devices.items()}
        return {"devices": devices, "start_up": self.start_up, "cycle": self.cycle, "held_back": self.would, "power": "never enabled"}

    def lines(self) -> list[str]:
        """For a person."""
        out = ["devices:"]
        out += [f"  {name:15} {' '.join(word or '-' for word in words)}" for name, words in self.devices.items()]
        for title, frames in (("start-up", self.start_up), ("one cycle", self.cycle), ("held back (they switch power on)", self.would)):
            for bus, found in frames.items():
                out.append(f"{title}, {bus}: {len(found)} frames")
                out += [f"  {frame}" for frame in found]
        out.append("power was never enabled")
        return out


def written(frame: tuple[int, bytes]) -> str:
    """As candump writes it."""
    return f"{frame[0]:03X}#{frame[1].hex().upper()}"


def rehearse(config: RigConfig) -> Rehearsal:
    """Do it. Raises ``RigError`` when a device does not answer or is not the expected one."""
    driver = config.rig
    assert isinstance(driver, BusDriver)
    guards: dict[str, NoPower] = {}

    def around(name: str, bus: CanTransport) -> CanTransport:
        guards[name] = no_power(driver, name, bus, KEEP)
        return guards[name]

    rig = open_wires(config, driver, around)
    found = Rehearsal()
    try:
        rig.open()
        found.devices = {name: tuple(device.identity) for name, device in rig.devices.items()}
        found.start_up = {name: [written(f) for f in guard.sent] for name, guard in guards.items()}
        period_ns = round(1e9 / config.rate_hz)
        begin = time.monotonic_ns()
        statuses = 0
        marks: dict[str, int] = {}
        for cycle in range(CYCLES):
            now_ns = cycle * period_ns
            while time.monotonic_ns() - begin < now_ns:
                time.sleep(1e-4)
            marks = {name: len(guard.sent) for name, guard in guards.items()}
            for guard in guards.values():
                guard.held_back.clear()
            measurement = rig.read(now_ns)
            statuses += measurement.drive_pitch.seq >= 0 and measurement.drive_roll.seq >= 0
            if measurement.drive_pitch.enabled or measurement.drive_roll.enabled:
                raise RigError("a drive says that its power stage is on, though nothing has asked for it: switch it off at its supply")
            # what a powered run would send now, with zero current: the guard keeps the frames that switch power on
            rig.write(Command(now_ns, cycle, cycle == CYCLES - 1, 0.0, 0.0, 0.0, 0.0, 0.0), now_ns)
        found.cycle = {name: [written(f) for f in guard.sent[marks[name] :]] for name, guard in guards.items()}
        found.would = {name: [written(f) for f in guard.held_back] for name, guard in guards.items()}
        if not statuses:
            raise RigError("the drives answer questions but send no cyclic status after SYNC: is their mapping taken?")
    finally:
        rig.stop()
        rig.close()
    return found
