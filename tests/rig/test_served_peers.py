"""Clients of other people on the devices of a served plant, over real transports."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests import served

from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import mip_table as M
from spsp_ctrl.devices import tmcl_table as T
from spsp_ctrl.devices.canopen_eds import eds
from spsp_ctrl.devices.cia402_device import Drive

pytestmark = [pytest.mark.peers, pytest.mark.realtime]
pytest.importorskip("msgpack", reason="python-can's udp_multicast needs it")


def _value(own: list[str], key: str) -> str:
    return next(text.partition("=")[2] for text in own if text.startswith(key + "="))


def test_pymscl_receives_five_seconds_at_500_hz(tmp_path: Path) -> None:
    """The vendor's client on the served IMU: no packet invalid, none missing, the values those of the swing."""
    mscl = pytest.importorskip("mscl", reason="pymscl (the vendor's client) has no wheel here")
    model = tmp_path / "model.yaml"
    text = (served.HIL / "model.yaml").read_text(encoding="utf-8")
    model.write_text(text.replace("imu_rate: {value: 250.0", "imu_rate: {value: 500.0"), encoding="utf-8")
    own = [*served.settings(tmp_path), f"rig.model={model}"]
    with served.plant(own, "--at-once"):
        node = mscl.InertialNode(mscl.Connection.Serial(_value(own, "rig.serial.imu.port"), 921600))
        node.timeout(3000)
        assert node.ping()
        assert node.modelName() == "3DM-CV7-AHRS"
        kinds = mscl.MipTypes
        node.setToIdle()
        assert node.getDataRateBase(kinds.CLASS_ESTFILTER) == 500
        channels = mscl.MipChannels()
        for field in (M.FILTER << 8 | M.REFERENCE_TIME, kinds.CH_FIELD_ESTFILTER_ESTIMATED_ORIENT_EULER):
            channels.append(mscl.MipChannel(field, mscl.SampleRate.Hertz(500)))
        node.setActiveChannelFields(kinds.CLASS_ESTFILTER, channels)
        node.enableDataStream(kinds.CLASS_ESTFILTER)
        node.resume()
        stamps: list[int] = []
        pitches: list[float] = []
        end = time.monotonic() + 30.0
        while len(stamps) < 2510 and time.monotonic() < end:
            for packet in node.getDataPackets(200):
                points = {p.channelName(): p for p in packet.data()}
                assert all(p.valid() for p in points.values())
                (stamp,) = (p for name, p in points.items() if "referenceTime" in name)
                stamps.append(stamp.as_uint64())
                pitches.append(points["estPitch"].as_float())
    assert len(stamps) >= 2510, "5 s at 500 Hz"
    steps = {b - a for a, b in itertools.pairwise(stamps)}
    assert steps <= {2_000_000, 1_999_999, 2_000_001}, "packets are missing"
    # nobody holds the platform: it moves with the table, 15 deg and 6 deg over a parked 1 deg
    assert 0.03 < max(pitches) - min(pitches) < 0.6


@contextmanager
def _canopen(own: list[str]) -> Iterator[tuple[Any, Any]]:
    canopen = pytest.importorskip("canopen", reason="the independent CANopen master is not installed")
    network = canopen.Network()
    network.connect(interface="udp_multicast", channel=_value(own, "rig.can.can0.channel"), fd=False, hop_limit=0)
    try:
        yield canopen, network
    finally:
        network.disconnect()


def test_canopen_enables_and_turns_a_drive_of_the_plant(tmp_path: Path) -> None:
    """``canopen.BaseNode402`` over multicast with our EDS: SDO, operation enabled in both modes, the motor turns as it is told."""
    own = served.settings(tmp_path)
    with served.plant(own, "--at-once"), _canopen(own) as (canopen, network):
        path = tmp_path / "drive.eds"
        path.write_text(eds("drive", Drive(1, rated_current_ma=2500).node.objects), encoding="utf-8")
        node = canopen.BaseNode402(1, canopen.import_od(str(path), 1))
        network.add_node(node)
        node.sdo.RESPONSE_TIMEOUT = 2.0
        assert node.sdo[0x1008].raw == "Simulated CiA 402 drive"
        assert node.sdo[C.RATED_CURRENT].raw == 2500
        assert node.sdo[C.TEMPERATURES][1].raw == pytest.approx(20.0 * 16, abs=16)
        node.tpdo.read()
        node.rpdo.read()
        pdo = node.rpdo[1]
        for mode, index, value in (("CYCLIC SYNCHRONOUS TORQUE", C.TARGET_TORQUE, 300), ("CYCLIC SYNCHRONOUS VELOCITY", C.TARGET_VELOCITY, -20000)):
            node.nmt.state = "PRE-OPERATIONAL"
            pdo.clear()
            pdo.add_variable(C.CONTROLWORD)
            pdo.add_variable(index)
            pdo.trans_type, pdo.enabled = 1, True
            pdo.save()
            node.nmt.state = "OPERATIONAL"
            node.setup_402_state_machine()
            network.sync.start(0.005)
            pdo.start(0.005)
            node.op_mode = mode
            node.state = "OPERATION ENABLED"
            assert node.state == "OPERATION ENABLED"
            before = node.sdo[C.POSITION].raw
            pdo[1].raw = value
            time.sleep(0.15)
            moved = node.sdo[C.POSITION].raw - before
            pdo[1].raw = 0
            assert moved * value > 0
            assert abs(moved) > 500
            node.state = "SWITCHED ON"
            pdo.stop()
            network.sync.stop()


def _turn(client: Any) -> None:
    """Version, speed, position, home switch, reference search: with the vendor's classes."""
    from pytrinamic.modules import TMCM1241

    assert client.get_version_string() == "1241V110"
    motor = TMCM1241(client).motors[0]

    def until(ready: Any, seconds: float = 15.0) -> None:
        end = time.monotonic() + seconds
        while not ready():
            assert time.monotonic() < end
            time.sleep(0.02)

    position = motor.AP.ActualPosition
    assert motor.get_axis_parameter(motor.AP.HomeSwitch) == 1
    motor.move_to(600)
    until(motor.get_position_reached)
    assert motor.get_axis_parameter(position, signed=True) == 600
    assert motor.get_axis_parameter(motor.AP.HomeSwitch) == 0
    motor.rotate(2000)
    until(lambda: motor.get_axis_parameter(motor.AP.ActualVelocity, signed=True) == 2000)
    motor.stop()
    until(lambda: motor.get_axis_parameter(motor.AP.ActualVelocity, signed=True) == 0)
    for number, value in ((T.SEARCH_MODE, T.SEARCH_HOME_NEGATIVE), (T.SEARCH_SPEED, 2000), (T.SWITCH_SPEED, 400)):
        motor.set_axis_parameter(number, value)
    client.reference_search(T.SEARCH_START, 0)
    until(lambda: client.reference_search(T.SEARCH_STATUS, 0) == 0)
    assert abs(motor.get_axis_parameter(position, signed=True)) < 200


@pytest.mark.parametrize("line", ["pty", "udp_multicast", "slcan"])
def test_pytrinamic_turns_and_homes_the_azimuth(tmp_path: Path, line: str) -> None:
    pytest.importorskip("pytrinamic", reason="pytrinamic (the vendor's client) is not installed")
    import can
    from pytrinamic.connections import SerialTmclInterface
    from pytrinamic.connections.can_tmcl_interface import CanTmclInterface

    own = served.settings(tmp_path, interface="slcan" if line == "slcan" else "udp_multicast")
    more = [] if line == "pty" else ["rig.devices.azimuth={bus: can0}"]
    still = tmp_path / "still.yaml"
    text = (served.HIL / "swing-2dof.yaml").read_text(encoding="utf-8")
    begin, end = text.index("  pitch: [{"), text.index("  roughness")
    still.write_text(text[:begin] + text[end:], encoding="utf-8")
    channel = _value(own, "rig.can.can0.channel")
    words = {"interface": "udp_multicast", "channel": channel, "fd": False, "hop_limit": 0}
    if line == "slcan":
        words = {"interface": "slcan", "channel": channel, "bitrate": 1_000_000, "sleep_after_open": 0.0}

    class OnBus(CanTmclInterface):  # type: ignore[misc]
        """The client's own CAN interface on any bus of python-can."""

        def __init__(self) -> None:
            super().__init__(channel, 1_000_000, T.HOST, T.MODULE, 5)
            self._connection = can.Bus(**words, can_filters=[{"can_id": T.HOST, "can_mask": 0x7FF}])

    with served.plant([*own, *more], "--at-once", "--scenario", str(still)):
        client = SerialTmclInterface(_value(own, "rig.serial.stepper.port"), timeout_s=5) if line == "pty" else OnBus()
        _turn(client)
        client.close()
