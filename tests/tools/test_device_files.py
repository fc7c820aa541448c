"""EDS and DBC: independent readers load them and find what the code packs and reads."""

from __future__ import annotations

from pathlib import Path

import canopen
import cantools
import pytest

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.devices import cia402_host, cia406_host
from spsp_ctrl.devices.cia402_device import Drive, MotorReading
from spsp_ctrl.devices.cia406_device import Encoder
from tools.make_device_files import files, for_hardware, main

ROOT = Path(__file__).parents[2]
DRIVER = {
    "driver": "bus",
    "world": "served",
    "can": {"can0": {"interface": "udp_multicast", "channel": "239.74.163.2"}},
    "serial": {"imu": {"port": "/dev/pts/1"}, "stepper": {"port": "/dev/pts/2"}},
    "devices": {
        "drive_pitch": {"bus": "can0", "node": 1},
        "drive_roll": {"bus": "can0", "node": 2},
        "imu": {"serial": "imu"},
        "azimuth": {"serial": "stepper"},
        "resolver_pitch": {"bus": "can0", "node": 5},
    },
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    config = load_rig(ROOT / "config" / "rig.yaml").model
    velocity = config.roll_actuator.model_copy(update={"mode": "velocity"})
    config = config.model_copy(update={"rig": BusDriver.model_validate(DRIVER), "roll_actuator": velocity})
    folder = tmp_path_factory.mktemp("devices")
    for name, text in files(config).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.mark.peers
def test_canopen_loads_the_eds_for_any_node_number(made: Path) -> None:
    for name, device in (("cia402-drive", Drive(9, rated_current_ma=2500)), ("cia406-encoder", Encoder(9))):
        node = canopen.RemoteNode(9, str(made / f"{name}.eds"))
        known = {(v.index, v.subindex) for o in node.object_dictionary.values() for v in (o.values() if hasattr(o, "values") else [o])}
        assert known == set(device.node.objects)
        for (index, sub), ours in device.node.objects.items():
            entry = node.object_dictionary[index]
            variable = entry[sub] if hasattr(entry, "values") else entry
            if ours.bits:
                assert len(variable) == ours.bits
                assert variable.default == (ours.value if not ours.signed else variable.default)
        assert node.tpdo[1] is not None
        assert node.object_dictionary[0x1800][1].default == 0x180 + 9


@pytest.mark.peers
def test_cantools_reads_what_the_devices_send_and_packs_what_we_send(made: Path) -> None:
    base = cantools.database.load_file(made / "can0.dbc")
    drive = Drive(1, rated_current_ma=2500)
    drive.receive((0, b"\x01\x01"))
    drive.motor = MotorReading(-123456, 250, 0, 24.1)
    sent = [frame for _ in range(10) for frame in drive.receive((0x80, b""))]
    status = base.decode_message(0x181, sent[-2][1])
    assert (status["position"], status["torque"]) == (-123456, pytest.approx(25.0))
    slow = base.decode_message(0x281, next(d for i, d in sent if i == 0x281))
    assert slow["bus_voltage"] == pytest.approx(24.1)

    identifier, data = cia402_host.torque_command(1, 0x000F, -125.0)
    command = base.get_message_by_name("drive_pitch_command")
    assert command.frame_id == identifier
    assert data == command.encode({"controlword": 0x0F, "target_torque": -12.5}, strict=False)
    identifier, data = cia402_host.velocity_command(2, 0x000F, -70000.0, 31.0)
    roll = base.get_message_by_name("drive_roll_command")
    assert roll.frame_id == identifier
    assert data == roll.encode({"controlword": 0x0F, "target_velocity": -70000, "torque_offset": 3.1}, strict=False)

    encoder = Encoder(5)
    encoder.receive((0, b"\x01\x05"))
    encoder.counts, encoder.faults = 40_000, 4
    frame = encoder.receive((0x80, b""))[0]
    angle = base.decode_message(*frame)
    reading = cia406_host.read_angle(frame, 5)
    assert reading is not None
    assert (angle["angle"], angle["converter_status"]) == (reading.position, 4) == (40_000, 4)
    assert {m.name for m in base.messages} >= {"sync", "drive_pitch_heartbeat", "resolver_pitch_emergency"}
    assert base.decode_message(0x701, b"\x05") == {"state": "operational"}


def test_the_shipped_files_are_those_of_the_tool(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["make_device_files", "--check"])
    assert main() == 0, capsys.readouterr().out


def test_the_hardware_file_is_the_hil_file_with_other_devices() -> None:
    """Going from the virtual rig to a real one changes the `rig:` section, the name, and who arms; nothing else."""
    hil, real = (load_rig(ROOT / "hil" / f"rig-{name}.yaml").model for name in ("hil", "hardware"))
    assert isinstance(real.rig, BusDriver)
    assert real.rig.world == "hardware"
    assert not real.supervisor.auto_arm
    same = {"rig": hil.rig, "name": hil.name, "supervisor": real.supervisor.model_copy(update={"auto_arm": hil.supervisor.auto_arm})}
    assert real.model_copy(update=same) == hil
    with pytest.raises(ValueError, match="one `rig:`"):
        for_hardware("name: x\n")


@pytest.mark.peers
def test_others_load_the_shipped_files() -> None:
    base = cantools.database.load_file(ROOT / "hil" / "devices" / "can0.dbc")
    assert {m.name for m in base.messages} >= {"drive_pitch_command", "drive_roll_status"}
    assert canopen.RemoteNode(2, str(ROOT / "hil" / "devices" / "cia402-drive.eds")).object_dictionary[0x6064].name == "Position actual value"
