"""EDS files of the simulated nodes, a DBC of everything that is mapped on the buses of a rig file, and that rig file for hardware.

``python -m tools.make_device_files`` writes ``hil/devices/*.eds``, ``hil/devices/BUS.dbc`` (of ``hil/rig-hil.yaml``), ``hil/rig-hardware.yaml``; with
``--check`` it writes nothing and exits 1 when a file is out of date. EDS and DBC come from the object dictionaries and PDO tables that the code works
with; the hardware file is the HIL file with another ``rig:`` section, since nothing else changes between the virtual rig and a real one.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import cia406_table as E
from spsp_ctrl.devices.canopen_device import Key, Object
from spsp_ctrl.devices.canopen_eds import eds
from spsp_ctrl.devices.cia402_device import Drive
from spsp_ctrl.devices.cia406_device import Encoder

ROOT = Path(__file__).parents[1]
FOLDER, RIG = "hil/devices", "hil/rig-hil.yaml"
MASTER = "Controller"
Mapping = tuple[tuple[int, int, int], ...]

SIGNALS: dict[tuple[int, int], tuple[str, float, str]] = {
    (C.STATUSWORD, 0): ("statusword", 1.0, ""),
    (C.CONTROLWORD, 0): ("controlword", 1.0, ""),
    (C.POSITION, 0): ("position", 1.0, "counts"),
    (C.TORQUE, 0): ("torque", 0.1, "% of rated"),
    (C.TARGET_TORQUE, 0): ("target_torque", 0.1, "% of rated"),
    (C.TORQUE_OFFSET, 0): ("torque_offset", 0.1, "% of rated"),
    (C.TARGET_VELOCITY, 0): ("target_velocity", 1.0, "counts/s"),
    (C.BUS_VOLTAGE, 0): ("bus_voltage", 0.001, "V"),
    (C.ERROR_CODE, 0): ("error_code", 1.0, ""),
    (C.MODE_DISPLAY, 0): ("mode", 1.0, ""),
    (E.POSITION, 0): ("angle", 1.0, "counts"),
    (E.SPEED, 1): ("speed", 1.0, ""),
    (E.CONVERTER_STATUS, 0): ("converter_status", 1.0, ""),
}
"""Name, unit step and unit of each object that is mapped."""
VALUES = {"mode": {C.CSV: "CSV", C.CST: "CST"}}
STATES = {C.BOOT_UP: "boot_up", C.STOPPED: "stopped", C.OPERATIONAL: "operational", C.PRE_OPERATIONAL: "pre_operational"}


class Message(NamedTuple):
    """One frame of the DBC."""

    identifier: int
    name: str
    sender: str
    signals: tuple[str, ...]
    size: int


def _pdo(name: str, identifier: int, sender: str, receiver: str, mapping: Mapping, objects: dict[Key, Object]) -> Message:
    at, lines = 0, []
    for index, sub, bits in mapping:
        word, step, unit = SIGNALS[index, sub]
        sign = "-" if objects[index, sub].signed else "+"
        lines.append(f' SG_ {word} : {at}|{bits}@1{sign} ({step:g},0) [0|0] "{unit}" {receiver}')
        at += bits
    return Message(identifier, name, sender, tuple(lines), at // 8)


def messages(config: RigConfig, bus: str) -> Iterator[Message]:
    """Everything that CANopen nodes map on a bus, with their heartbeats and emergencies."""
    driver = config.rig
    assert isinstance(driver, BusDriver)
    yield Message(C.SYNC, "sync", MASTER, (), 0)
    for name, node in driver.devices.nodes():
        if node.bus != bus or node.family not in ("cia402", "cia406"):
            continue
        number = node.node
        if node.family == "cia402":
            objects = Drive(number, rated_current_ma=1000).node.objects
            velocity = (config.pitch_actuator if name == "drive_pitch" else config.roll_actuator).mode == "velocity"
            command = C.VELOCITY_PDO if velocity else C.TORQUE_PDO
            yield _pdo(f"{name}_command", C.RPDO1 + number, MASTER, name, command, objects)
            yield _pdo(f"{name}_status", C.TPDO1 + number, name, MASTER, C.STATUS_PDO, objects)
            yield _pdo(f"{name}_slow", C.TPDO2 + number, name, MASTER, C.SLOW_PDO, objects)
        else:
            yield _pdo(f"{name}_angle", C.TPDO1 + number, name, MASTER, E.ANGLE_PDO, Encoder(number).node.objects)
        yield Message(C.HEARTBEAT + number, f"{name}_heartbeat", name, (f' SG_ state : 0|8@1+ (1,0) [0|0] "" {MASTER}',), 1)
        emergency = (f' SG_ code : 0|16@1+ (1,0) [0|0] "" {MASTER}', f' SG_ register : 16|8@1+ (1,0) [0|0] "" {MASTER}')
        yield Message(C.EMCY + number, f"{name}_emergency", name, emergency, 8)


def dbc(config: RigConfig, bus: str) -> str:
    """Text of the DBC of one bus."""
    found = list(messages(config, bus))
    nodes = list(dict.fromkeys(m.sender for m in found))
    lines = ['VERSION "spsp-ctrl"', "", "NS_ :", "", "BS_:", "", f"BU_: {' '.join(nodes)}", ""]
    for m in found:
        lines += [f"BO_ {m.identifier} {m.name}: {m.size} {m.sender}", *m.signals, ""]
    lines.append(f'CM_ "Mapped PDOs of the bus {bus} of {config.name}; made by tools/make_device_files.py";')
    for m in found:
        values = {signal.split()[1]: VALUES[signal.split()[1]] for signal in m.signals if signal.split()[1] in VALUES}
        if m.name.endswith("_heartbeat"):
            values["state"] = STATES
        for name, table in values.items():
            words = " ".join(f'{number} "{word}"' for number, word in table.items())
            lines.append(f"VAL_ {m.identifier} {name} {words} ;")
    return "\n".join(lines) + "\n"


HEAD = """# yaml-language-server: $schema=../config/schema/rig.schema.json
# A rig on hardware: two CiA 402 drives, a MIP inertial unit, a TMCL stepper. Made from rig-hil.yaml by tools/make_device_files.py: only `rig:`,
# the name and `auto_arm` differ. Copy it, put in your ports, node numbers and serial numbers (docs/hardware.md), and your own mechanism and gains.
"""
SECTION = """rig:
  driver: bus
  world: hardware                      # asks before each stage; nothing moves before `arm`
  model: model.yaml                    # the plant as designed: goes into the log, for `spsp-ctrl diagnose`
  can:
    can0: {interface: socketcan, channel: can0, bitrate: 1000000}   # any python-can interface: slcan, pcan, kvaser, ...
  serial:
    imu: {port: /dev/spsp-imu, baud: 921600}          # names by hil/system/99-spsp-ctrl.rules
    stepper: {port: /dev/spsp-stepper, baud: 115200}
  devices:                             # `expect: {serial: ...}` takes what `spsp-ctrl scan` prints: then no other device is accepted
    drive_pitch: {family: cia402, bus: can0, node: 1}
    drive_roll: {family: cia402, bus: can0, node: 2}
    imu: {family: mip, serial: imu}
    azimuth: {family: tmcl, serial: stepper}
"""


def for_hardware(text: str) -> str:
    """A rig file with `world: served` as one for hardware. Raises ``ValueError`` when a part is not where it is expected."""
    body = re.sub(r"\A(#[^\n]*\n)+", HEAD, text)
    body, rigs = re.subn(r"^rig:\n(?:[ #][^\n]*\n)+", SECTION, body, flags=re.M)
    body, names = re.subn(r"^name: [^\n]*$", "name: hardware-rig", body, flags=re.M)
    body, arms = re.subn(r"auto_arm: true[^\n]*", "auto_arm: false                      # an operator arms; a real rig never arms itself", body)
    if (rigs, names) != (1, 1):
        raise ValueError("the rig file has not one `rig:` and one `name:`")
    if not arms:
        body, arms = re.subn(r"^supervisor:\n", "supervisor:\n  auto_arm: false                      # an operator arms\n", body, flags=re.M)
    return body if arms else body + "\nsupervisor:\n  auto_arm: false                      # an operator arms; a real rig never arms itself\n"


def files(config: RigConfig) -> dict[str, str]:
    """Name and text of every file."""
    drive, encoder = Drive(1, rated_current_ma=2500), Encoder(1)
    found = {
        "cia402-drive.eds": eds("cia402-drive", drive.node.objects, 1),
        "cia406-encoder.eds": eds("cia406-encoder", encoder.node.objects, 1),
    }
    driver = config.rig
    assert isinstance(driver, BusDriver), "the rig file has no buses"
    return found | {f"{bus}.dbc": dbc(config, bus) for bus in driver.can if len(list(messages(config, bus))) > 1}


def main() -> int:
    """Write or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--config", type=Path, default=ROOT / RIG)
    parser.add_argument("--out", type=Path, default=ROOT / FOLDER)
    parser.add_argument("--check", action="store_true")
    given = parser.parse_args()
    stale = 0
    given.out.mkdir(parents=True, exist_ok=True)
    made = {given.out / name: text for name, text in files(load_rig(given.config).model).items()}
    made[given.out.parent / "rig-hardware.yaml"] = for_hardware(given.config.read_text(encoding="utf-8"))
    for path, text in made.items():
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            continue
        stale += 1
        if given.check:
            print(f"{path} is out of date: python -m tools.make_device_files")
        else:
            path.write_text(text, encoding="utf-8")
            print(path)
    return int(given.check and stale > 0)


if __name__ == "__main__":
    sys.exit(main())
