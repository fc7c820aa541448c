"""Who is on the buses and lines of a rig file, against what the rig file expects. Nothing is changed on any device."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

from spsp_ctrl.config.devices import BusDriver, Expected
from spsp_ctrl.devices.probe_host import CanopenProbe, MipProbe, OdriveProbe, TmclProbe, Who
from spsp_ctrl.devices.transport.base import REMOTE, CanTransport, SerialTransport

_PROFILE = {"cia402": "CiA 402 drive", "cia406": "CiA 406 encoder"}
_WORDS = ("vendor", "product", "serial")


class Found(NamedTuple):
    """One device that answered, or should have."""

    place: str
    """Bus or line."""
    who: Who | None
    """None: nobody answers."""
    expected_as: str
    """Name in the rig file; empty for a device that is not in it."""
    problem: str
    """Why it is refused; empty when all is well."""

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        who = self.who._asdict() if self.who else None
        return {"place": self.place, "who": who, "expected_as": self.expected_as, "problem": self.problem}


def _run(step: Callable[[int], bool], limit_s: float = 10.0) -> None:
    """Turns of half a millisecond until the probe is done."""
    end = time.monotonic() + limit_s
    while not step(time.monotonic_ns()) and time.monotonic() < end:
        time.sleep(0.0005)


def sweep_canopen(bus: CanTransport, nodes: range = range(1, 128)) -> tuple[list[Who], set[int]]:
    """All CANopen nodes, and those that were heard without an answer."""
    probe = CanopenProbe(nodes)

    def step(now_ns: int) -> bool:
        bus.send(probe.step(now_ns, [(i, d) for _, i, d in bus.poll(now_ns)]))
        return probe.done or bus.fault.id == "unplugged"

    _run(step)
    found = probe.found
    return found, probe.talking - {who.address for who in found}


def ask_tmcl(line: SerialTransport | None, bus: CanTransport | None, address: int, host: int) -> list[Who]:
    """A Trinamic module on a line or a bus."""
    probe = TmclProbe(address, host, on_can=bus is not None)

    def step(now_ns: int) -> bool:
        if bus is not None:
            bus.send(probe.step(now_ns, [(i, d) for _, i, d in bus.poll(now_ns)])[0])
        elif line is not None:
            out = probe.step(now_ns, [], b"".join(d for _, d in line.poll(now_ns)))[1]
            if out:
                line.send(out)
        return probe.done

    _run(step)
    return probe.found


def ask_mip(line: SerialTransport) -> MipProbe:
    """A MicroStrain unit on a line."""
    probe = MipProbe()

    def step(now_ns: int) -> bool:
        out = probe.step(now_ns, b"".join(d for _, d in line.poll(now_ns)))
        if out:
            line.send(out)
        return probe.done

    _run(step)
    return probe


def ask_odrive(bus: CanTransport, nodes: list[int]) -> list[Who]:
    """ODrive axes of these numbers."""
    probe = OdriveProbe(nodes, REMOTE)

    def step(now_ns: int) -> bool:
        bus.send(probe.step(now_ns, [(i & ~REMOTE, d) for _, i, d in bus.poll(now_ns) if not i & REMOTE]))
        return probe.done

    _run(step)
    return probe.found


def strangers(expect: Expected, who: Who) -> str:
    """What is not as the rig file expects; empty when all is."""
    wrong = [
        f"{word} {getattr(who, word)!r}, the rig file expects {wanted!r}"
        for word in _WORDS
        if (wanted := getattr(expect, word)) is not None and wanted != getattr(who, word)
    ]
    return "; ".join(wrong)


def scan(driver: BusDriver, can: Mapping[str, CanTransport], serial: Mapping[str, SerialTransport]) -> list[Found]:
    """Everything on the buses and lines of a rig file."""
    out: list[Found] = []
    for name, bus in can.items():
        out += _scan_bus(driver, name, bus)
    devices = driver.devices
    if devices.imu.family == "mip":
        line = devices.imu.serial
        probe = ask_mip(serial[line])
        who = probe.found[0] if probe.found else None
        problem = strangers(devices.imu.expect, who) if who else _silent(probe, driver.serial[line].baud)
        out.append(Found(line, who, "imu", problem))
    stepper = devices.azimuth
    if stepper.family == "tmcl":
        place = stepper.serial or stepper.bus or ""
        found = ask_tmcl(serial.get(stepper.serial or ""), can.get(stepper.bus or ""), stepper.address, stepper.host)
        who = found[0] if found else None
        problem = _one(stepper.expect, who) if who else f"no TMCL module answers at address {stepper.address}: address, baud rate, cable, supply"
        out.append(Found(place, who, "azimuth", problem))
    return out


def _silent(probe: MipProbe, baud: int) -> str:
    if probe.packets:
        return "packets arrive, but the unit does not answer: is our transmit wire connected?"
    if probe.heard_bytes:
        return f"{probe.heard_bytes} bytes arrive and not one packet at {baud} baud: another baud rate, or another device"
    return "nothing arrives: port, cable, supply"


def _one(expect: Expected, who: Who) -> str:
    if who.answers > 1:
        return f"{who.answers} devices answer with the number {who.address}: unplug one and give it another number"
    return strangers(expect, who)


def _scan_bus(driver: BusDriver, name: str, bus: CanTransport) -> list[Found]:
    out: list[Found] = []
    wanted = {node.node: (place, node) for place, node in driver.devices.nodes() if node.bus == name}
    families = {number: getattr(node, "family", "") for number, (_, node) in wanted.items()}
    odrives = [number for number, family in families.items() if family == "odrive"]
    for who in ask_odrive(bus, odrives) if odrives else []:
        place, node = wanted.pop(who.address)
        out.append(Found(name, who, place, strangers(node.expect, who)))
    if not wanted and odrives:
        return out  # their identifiers are those of other nodes in CANopen: nobody else can be asked
    found, silent = sweep_canopen(bus)
    for who in found:
        if who.address not in wanted:
            twice = f"{who.answers} devices answer with this number; " if who.answers > 1 else ""
            out.append(Found(name, who, "", f"{twice}not in the rig file" if twice else ""))
            continue
        place, node = wanted.pop(who.address)
        profile = _PROFILE.get(families[who.address], who.kind)
        problem = f"is a {who.kind}, the rig file wants a {profile}" if profile != who.kind else _one(node.expect, who)
        out.append(Found(name, who, place, problem))
    for number, (place, _) in sorted(wanted.items()):
        talks = "it sends heartbeats or emergencies but answers no question"
        heard = talks if number in silent else "nobody answers: number, bit rate, cable, supply"
        out.append(Found(name, None, place, f"node {number}: {heard}"))
    return out
