"""ODrive CANSimple: recorded frames, the two roles against each other, wrong frames, and the community client's message database."""

from __future__ import annotations

import struct
from math import inf, isfinite, nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.devices import odrive_host as H
from spsp_ctrl.devices import odrive_table as T
from spsp_ctrl.devices.odrive_device import Axis

NODE = 3
MS = 1_000_000


def beat(axis: Axis, now_ns: int) -> H.Heartbeat:
    (found,) = [h for f in axis.tick(now_ns) if (h := H.read_heartbeat(f, NODE))]
    return found


def closed(control: int = T.TORQUE_CONTROL, watchdog_ns: int = 0) -> Axis:
    axis, walker = Axis(NODE, watchdog_ns=watchdog_ns), H.Walker(NODE, control)
    for frame in walker.step(beat(axis, 0), True):
        axis.receive(frame, 0)
    assert axis.state == T.CLOSED_LOOP
    return axis


def test_recorded_frames() -> None:
    """Traces that users posted (node 63: heartbeat in closed loop, query and answer of the bus voltage), and a published speed command."""
    assert H.read_heartbeat((0x7E1, bytes.fromhex("00 00 00 00 08 00 00 00")), 63) == H.Heartbeat(0, T.CLOSED_LOOP, 0, False)
    assert H.read_heartbeat((0x001, bytes.fromhex("00 00 00 00 01 00 00 00")), 0) == H.Heartbeat(0, T.IDLE, 0, False)
    assert H.query(63, T.BUS)[0] == 0x7F7
    bus = H.read_pair((0x7F7, bytes.fromhex("33 F5 42 41 00 00 00 00")), 63, T.BUS)
    assert bus == pytest.approx((12.184863090515137, 0.0), rel=1e-12)
    assert H.velocity(1, -2.5, 0.25) == (0x02D, bytes.fromhex("00 00 20 C0 00 00 80 3E"))


def test_walk_command_and_readings() -> None:
    axis = closed()
    axis.receive(H.torque(NODE, 0.125))
    assert axis.command == (True, T.TORQUE_CONTROL, 0.125, 0.0)
    axis.turns, axis.speed_turns_s, axis.current_a = 1.5, -2.25, 0.75
    assert [p for f in axis.tick(10**9) if (p := H.read_pair(f, NODE, T.ESTIMATES))] == [(1.5, -2.25)]
    assert [H.read_pair(f, NODE, T.CURRENTS) for f in axis.receive(H.query(NODE, T.CURRENTS))] == [(0.0, 0.75)]
    walker = H.Walker(NODE, T.TORQUE_CONTROL)
    for frame in walker.step(beat(axis, 2 * 10**9), False):
        axis.receive(frame)
    assert axis.command == (False, T.TORQUE_CONTROL, 0.0, 0.0)


def test_velocity_mode() -> None:
    axis = closed(T.VELOCITY_CONTROL)
    axis.receive(H.velocity(NODE, 3.0, 0.5))
    assert axis.command == (True, T.VELOCITY_CONTROL, 0.5, 3.0)


def test_errors_are_left_only_by_a_reset() -> None:
    axis, walker = closed(), H.Walker(NODE, T.TORQUE_CONTROL)
    axis.receive(H.estop(NODE))
    heard = beat(axis, 10**9)
    assert (heard.text, axis.command.enabled) == ("emergency stop requested", False)
    assert walker.step(heard, True) == []
    axis.receive(H.set_state(NODE, T.CLOSED_LOOP))
    assert axis.state == T.IDLE
    walker.reset()
    for k in range(3):
        for frame in walker.step(beat(axis, (20 + k) * 10**8), True):
            axis.receive(frame)
    assert axis.state == T.CLOSED_LOOP


def test_watchdog_stops_an_axis_without_commands() -> None:
    axis = closed(watchdog_ns=20 * MS)
    axis.receive(H.torque(NODE, 1.0), 10 * MS)
    axis.tick(30 * MS)
    assert axis.command.enabled
    axis.tick(31 * MS)
    assert not axis.command.enabled
    assert axis.errors == T.WATCHDOG


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_numbers_that_are_none_move_nothing(value: float) -> None:
    assert isfinite(struct.unpack("<f", H.torque(NODE, value)[1])[0])
    axis = closed()
    axis.receive((H.identifier(NODE, T.INPUT_TORQUE), struct.pack("<f", value)))
    assert not axis.command.enabled
    assert H.read_pair((H.identifier(NODE, T.ESTIMATES), struct.pack("<ff", value, 0.0)), NODE, T.ESTIMATES) is None


@given(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 62))
def test_only_the_right_frame_is_a_sample(identifier: int, data: bytes, node: int) -> None:
    assert (H.read_heartbeat((identifier, data), node) is not None) == (identifier == node * 32 + 1 and len(data) == 8)
    if H.read_pair((identifier, data), node, T.ESTIMATES) is not None:
        assert identifier == node * 32 + 9
        assert len(data) == 8


@given(st.lists(st.tuples(st.integers(NODE * 32, NODE * 32 + 31), st.binary(max_size=8)), max_size=40))
@settings(max_examples=200)
def test_no_frames_raise(frames: list[H.Frame]) -> None:
    axis = Axis(NODE, watchdog_ns=MS)
    for k, frame in enumerate(frames):
        for number, data in axis.receive(frame, k * MS) + axis.tick(k * MS):
            assert number >> 5 == NODE
            assert len(data) == 8
        assert axis.command.enabled == (axis.state == T.CLOSED_LOOP)
        assert isfinite(axis.command.torque_nm)


@pytest.mark.peers
def test_the_communitys_message_database_agrees_in_both_directions() -> None:
    """``odrive-can`` ships the DBC of firmware 0.6.10: it reads what our axis sends, and our axis obeys what it writes."""
    odrive_can = pytest.importorskip("odrive_can", reason="odrive-can is not installed")
    database = odrive_can.get_dbc("odrive-cansimple-0.6.10")
    axis = Axis(0)
    axis.turns, axis.speed_turns_s, axis.bus_voltage_v = -0.5, 4.0, 23.5

    def send(name: str, **values: Any) -> None:
        message = database.get_message_by_name(f"Axis0_{name}")
        axis.receive((message.frame_id, bytes(message.encode(values))))

    def ask(frame: H.Frame) -> dict[str, Any]:
        (answer,) = axis.receive(frame)
        return dict(database.decode_message(*answer))

    heartbeat, estimates = (database.decode_message(*frame) for frame in axis.tick(0))
    assert (str(heartbeat["Axis_State"]), str(heartbeat["Axis_Error"])) == ("IDLE", "NONE")
    assert estimates == {"Pos_Estimate": -0.5, "Vel_Estimate": 4.0}
    send("Set_Controller_Mode", Control_Mode="VELOCITY_CONTROL", Input_Mode="PASSTHROUGH")
    send("Set_Axis_State", Axis_Requested_State="CLOSED_LOOP_CONTROL")
    send("Set_Input_Vel", Input_Vel=-1.5, Input_Torque_FF=0.25)
    assert axis.command == (True, T.VELOCITY_CONTROL, 0.25, -1.5)
    assert ask(H.query(0, T.BUS)) == {"Bus_Voltage": 23.5, "Bus_Current": 0.0}
    assert ask(H.query(0, T.VERSION))["Fw_Version_Minor"] == 6
    for command, values in {
        H.set_state(0, T.CLOSED_LOOP): {"Axis_Requested_State": "CLOSED_LOOP_CONTROL"},
        H.set_mode(0, T.TORQUE_CONTROL): {"Control_Mode": "TORQUE_CONTROL", "Input_Mode": "PASSTHROUGH"},
        H.velocity(0, 1.5, -2.0): {"Input_Vel": 1.5, "Input_Torque_FF": -2.0},
        H.torque(0, 0.5): {"Input_Torque": 0.5},
    }.items():
        read = database.decode_message(command[0], command[1].ljust(8, b"\0"))
        assert {key: (value if isinstance(value, float) else str(value)) for key, value in read.items()} == values
    send("Estop")
    (heartbeat,) = [database.decode_message(*f) for f in axis.tick(10**9) if f[0] == 1]
    assert str(heartbeat["Axis_Error"]) == "ESTOP_REQUESTED"
