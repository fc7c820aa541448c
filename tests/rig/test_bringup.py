"""Before power: what keeps it off, what is limited, what the computer must have."""

from __future__ import annotations

import os
import tty
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.rig.lockstep_devices import Wired, rig_config

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.devices import odrive_host
from spsp_ctrl.devices.canopen_host import write
from spsp_ctrl.devices.cia402_device import Drive
from spsp_ctrl.devices.cia402_host import Walker, torque_command, velocity_command
from spsp_ctrl.messages import Command
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.bus import BusRig
from spsp_ctrl.rig.power_guard import NoPower, no_power
from spsp_ctrl.rig.preflight import FAIL, OK, WARN, Host, preflight
from spsp_ctrl.rig.staging import NeverEnabled, limited
from spsp_ctrl.rig.wires import hardware, is_terminal, open_lines


def test_no_frame_through_the_guard_can_switch_a_drive_on() -> None:
    """A drive walked as usual, and one fired at with controlwords, by PDO and SDO: it never takes current."""
    config = rig_config()
    wired = Wired(config)
    assert isinstance(config.rig, BusDriver)
    bus = no_power(config.rig, "can0", wired.can["can0"], 10)
    drive: Drive = wired.devices.drives[0].drive  # type: ignore[attr-defined]
    bus.send([(0, b"\x01\x01")])
    walker, seen = Walker(), set()
    for word in [*range(256), *[-1] * 20]:
        sent = walker.step(drive.node.objects[0x6041, 0].value, True) if word < 0 else word
        bus.send([torque_command(1, sent, 300.0), velocity_command(1, sent, 1e4), write(1, 0x6040, 0, sent, 2), (0x80, b"")])
        seen.add(drive.state.name)
        assert not drive.command.enabled
    assert "ready to switch on" in seen
    assert bus.held_back
    assert not seen & {"switched on", "operation enabled"}


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
@settings(max_examples=300)
def test_what_does_not_concern_power_goes_through(identifier: int, data: bytes) -> None:
    config = rig_config()
    assert isinstance(config.rig, BusDriver)
    medium = Wired(config)
    guard = no_power(config.rig, "can0", medium.can["can0"], 1)
    guard.send([(identifier, data)])
    concerns = identifier in (0x201, 0x202, 0x601, 0x602)
    assert concerns or guard.seen == [((identifier, data), False)]


def test_odrive_closed_loop_is_held_back_and_an_unknown_family_is_refused() -> None:
    config = rig_config(drive_pitch={"bus": "can0", "node": 1, "family": "odrive"})
    assert isinstance(config.rig, BusDriver)
    wired = Wired(config)
    guard = no_power(config.rig, "can0", wired.can["can0"], 10)
    guard.send([odrive_host.set_state(1, 8), odrive_host.set_state(1, 1)])
    assert guard.seen == [(odrive_host.set_state(1, 8), True), (odrive_host.set_state(1, 1), False)]
    unknown = rig_config(drive_roll={"bus": "can0", "node": 2, "family": "other"})
    assert isinstance(unknown.rig, BusDriver)
    with pytest.raises(RigError, match="cannot be kept off"):
        no_power(unknown.rig, "can0", wired.can["can0"])


def test_a_rig_that_is_never_enabled_reads_and_says_what_it_sent() -> None:
    config = rig_config()
    wired = Wired(config)
    can = {name: NoPower(bus, ()) for name, bus in wired.can.items()}
    rig = NeverEnabled(BusRig(config, can, wired.serial))
    rig.open()
    drive: Drive = wired.devices.drives[0].drive  # type: ignore[attr-defined]
    for k in range(20):
        now_ns = k * 1_000_000
        measurement = rig.read(now_ns)
        sent = rig.write(Command(now_ns, k, True, 1.0, 2.0, 3.0, 4.0, 5.0), now_ns)
        assert sent == Command(now_ns, k, False, 0.0, 0.0, 0.0, 0.0, 0.0)
        assert not drive.command.enabled
    assert measurement.drive_pitch.seq >= 0
    rig.stop()
    rig.close()


def test_a_limit_scales_what_moves_and_nothing_else() -> None:
    config = rig_config()
    tenth = limited(config, 0.1)
    assert tenth.limits.current_a == pytest.approx(0.1 * config.limits.current_a)
    assert tenth.limits.rod_speed_mm_s == pytest.approx(0.1 * config.limits.rod_speed_mm_s)
    assert tenth.limits.travel_margin_mm == config.limits.travel_margin_mm
    assert tenth.model_copy(update={"limits": config.limits}) == config


def on_wires(world: str = "hardware", interface: str = "socketcan", channel: str = "can0", port: str = "/dev/ttyUSB7", **more: Any) -> Any:
    config = rig_config()
    assert isinstance(config.rig, BusDriver)
    data = config.rig.model_dump() | {
        "world": world,
        "can": {"can0": {"interface": interface, "channel": channel, **more}},
        "serial": {"imu": {"port": port}, "stepper": {"port": port + "x"}},
    }
    azimuth = config.azimuth.model_copy(update={"rate_hz": 50.0})
    return config.model_copy(update={"rig": BusDriver.model_validate(data), "rate_hz": 500, "azimuth": azimuth})


def machine(tmp_path: Path, modules: tuple[str, ...] = ("can", "can_raw"), **interfaces: str) -> Host:
    """System files of another computer."""
    for module in modules:
        (tmp_path / "sys" / "module" / module).mkdir(parents=True, exist_ok=True)
    for name, flags in interfaces.items():
        folder = tmp_path / "sys" / "class" / "net" / name
        folder.mkdir(parents=True)
        (folder / "flags").write_text(flags)
        (folder / "tx_queue_len").write_text("10" if flags == "0x40081" else "100")
    return Host(tmp_path / "sys", tmp_path / "proc", tmp_path / "by-id", lambda channel: "")


@pytest.mark.parametrize(
    ("modules", "interfaces", "state", "text"),
    [
        ((), {}, FAIL, "modprobe can can_raw"),
        (("can", "can_raw"), {"vcan1": "0x1"}, FAIL, "there are vcan1"),
        (("can", "can_raw"), {"can0": "0x40080"}, FAIL, "ip link set can0 up type can bitrate 1000000"),
        (("can", "can_raw"), {"can0": "0x40081"}, WARN, "txqueuelen"),
        (("can", "can_raw"), {"can0": "0x1"}, OK, "socketcan can0, up"),
    ],
)
def test_socketcan_is_looked_at(tmp_path: Path, modules: tuple[str, ...], interfaces: dict[str, str], state: str, text: str) -> None:
    rows = preflight(on_wires(), tmp_path, machine(tmp_path, modules, **interfaces))
    row = next(r for r in rows if r.what == "bus can0")
    assert row.state == state
    assert text in f"{row.found} {row.advice}"


LINK = """[{"ifname": "can0", "operstate": "UP", "linkinfo": {"info_kind": "can", "info_data": {"state": "%s", "restart_ms": %d,
    "berr_counter": {"tx": 128, "rx": 3}, "bittiming": {"bitrate": %d, "sample_point": "0.875"}}}}]"""
"""As iproute2 6.1 prints it for a CAN controller."""


@pytest.mark.parametrize(
    ("state", "restart_ms", "bitrate", "rows"),
    [
        ("ERROR-ACTIVE", 100, 1_000_000, [(OK, "socketcan can0, up")]),
        ("ERROR-ACTIVE", 0, 1_000_000, [(WARN, "does not come back"), (OK, "socketcan can0, up")]),
        ("ERROR-ACTIVE", 100, 500_000, [(FAIL, "runs at 500000 bit/s, the rig file says 1000000")]),
        ("ERROR-PASSIVE", 100, 1_000_000, [(FAIL, "is ERROR-PASSIVE (errors: 128 sent, 3 received)")]),
        ("BUS-OFF", 100, 1_000_000, [(FAIL, "is BUS-OFF")]),
    ],
)
def test_the_state_of_the_controller_is_looked_at(tmp_path: Path, state: str, restart_ms: int, bitrate: int, rows: list[tuple[str, str]]) -> None:
    host = machine(tmp_path, can0="0x1")._replace(link=lambda channel: LINK % (state, restart_ms, bitrate))
    found = [row for row in preflight(on_wires(), tmp_path, host) if row.what == "bus can0"]
    assert [row.state for row in found] == [s for s, _ in rows]
    assert all(text in row.found for row, (_, text) in zip(found, rows, strict=True))
    for nothing in ("", "[]", "no json", '[{"ifname": "vcan0", "linkinfo": {"info_kind": "vcan"}}]'):
        plain = host._replace(link=lambda channel, text=nothing: text)
        assert [row.state for row in preflight(on_wires(), tmp_path, plain) if row.what == "bus can0"] == [OK]


def test_ports_loads_and_worlds_are_looked_at(tmp_path: Path) -> None:
    host = machine(tmp_path)
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-imu").touch()
    rows = preflight(on_wires(), tmp_path, host)
    lines = [r for r in rows if r.what.startswith("line")]
    assert all(r.state == FAIL and "no such port" in r.found and "usb-imu" in r.advice for r in lines)
    assert next(r for r in rows if r.what == "load of can0").state == OK
    full = preflight(on_wires(bitrate=125_000), tmp_path, host)
    assert next(r for r in full if r.what == "load of can0").state == FAIL
    assert any("bitrate" in r.found for r in full if r.what == "traffic")
    served = preflight(on_wires("served"), tmp_path, host)
    assert sum(r.what == "world" and r.state == FAIL for r in served) == 3
    assert any(r.what == "plant server" and "plant serve" in r.advice for r in served)
    assert not any(r.what == "plant server" for r in rows)
    file = preflight(on_wires(port=str(tmp_path / "file")), tmp_path, host)
    assert {r.state for r in file if r.what.startswith("line")} == {FAIL}


def test_a_simulated_session_opens_no_hardware(tmp_path: Path) -> None:
    """Ports that may be real are refused before any of them is opened."""
    master, slave = os.openpty()
    tty.setraw(slave)
    assert is_terminal(os.ttyname(slave))
    config = on_wires("served")
    with pytest.raises(RigError) as refused:
        open_lines(config, config.rig)
    assert [line.split(" may be")[0] for line in str(refused.value).splitlines()] == [
        "rig.can.can0: socketcan can0",
        "rig.serial.imu: /dev/ttyUSB7",
        "rig.serial.stepper: /dev/ttyUSB7x",
    ]
    inside = rig_config()
    assert isinstance(inside.rig, BusDriver)
    with pytest.raises(RigError, match="opens no bus"):
        open_lines(inside, inside.rig)
    assert list(hardware(on_wires("served", "udp_multicast", "239.74.163.2", os.ttyname(slave)).rig)) == [
        f"rig.serial.stepper: {os.ttyname(slave)}x"
    ]
    os.close(master)
    os.close(slave)


def test_everything_that_cannot_be_opened_is_said_at_once() -> None:
    config = on_wires("hardware", "slcan", "/dev/tty-none")
    with pytest.raises(RigError) as refused:
        open_lines(config, config.rig)
    assert [line.split(":")[0] for line in str(refused.value).splitlines()] == ["rig.can.can0", "rig.serial.imu", "rig.serial.stepper"]
