"""CiA 402 over CANopen: printed frames of manuals, the two roles against each other, wrong frames, and ``canopen`` at the master's end."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.devices.bus import exchange, talk

from spsp_ctrl.devices import canopen_host as H
from spsp_ctrl.devices import canopen_table as T
from spsp_ctrl.devices import cia402_host as D
from spsp_ctrl.devices.canopen_eds import eds
from spsp_ctrl.devices.cia402_device import Drive, MotorReading

NODE = 5
IDENTITY = (0x1F5, 0x402, 3, 4711)


def drive(node: int = NODE) -> Drive:
    return Drive(node, rated_current_ma=4000, rated_torque_mnm=480, identity=IDENTITY)


def started(mode: int = T.CST) -> tuple[Drive, H.SdoDialogue]:
    """A drive that was set up by our own master and runs."""
    unit = drive()
    dialogue = H.SdoDialogue(NODE, D.start_up(NODE, mode, 2, 127, 100))
    talk(dialogue.step, unit.receive, lambda: dialogue.done or bool(dialogue.problem))
    assert dialogue.done, dialogue.problem
    assert unit.receive(H.nmt(T.NMT_START, NODE)) == []
    return unit, dialogue


def cycle(unit: Drive, walker: D.Walker, status: D.Status, wanted: bool, torque: float = 0.0) -> D.Status:
    """One cycle in torque mode: command, SYNC, status."""
    unit.receive(D.torque_command(NODE, walker.step(status.word, wanted), torque))
    found = [s for frame in unit.receive(H.SYNC_FRAME) if (s := D.read_status(frame, NODE))]
    assert len(found) == 1
    return found[0]


def enabled() -> tuple[Drive, D.Walker, D.Status]:
    unit, _ = started()
    walker, status = D.Walker(), D.Status(0, 0, 0)
    for _ in range(6):
        status = cycle(unit, walker, status, True)
    assert D.state_of(status.word) is T.OPERATION_ENABLED
    return unit, walker, status


# Festo CMMP-AS-M3 "CANopen access procedure" (node 1), Baumueller b maXX 1000 (node 4)
PRINTED_REQUESTS = [
    (H.read(1, 0x6061, 0), 0x601, "40 61 60 00"),
    (H.write(1, 0x1401, 2, 0xEF, 1), 0x601, "2F 01 14 02 EF"),
    (H.read(1, 0x6041, 0), 0x601, "40 41 60 00"),
    (H.write(1, 0x6040, 0, 0x03E8, 2), 0x601, "2B 40 60 00 E8 03"),
    (H.write(1, 0x6093, 1, 0x12345678, 4), 0x601, "23 93 60 01 78 56 34 12"),
    (H.write(4, 0x6060, 0, 5, 1), 0x604, "2F 60 60 00 05 00 00 00"),
]
PRINTED_ANSWERS = [
    ("4F 61 60 00 01", H.SdoAnswer(0x6061, 0, 0, b"\x01")),
    ("60 01 14 02", H.SdoAnswer(0x1401, 2, 0, b"")),
    ("4B 41 60 00 34 12", H.SdoAnswer(0x6041, 0, 0, b"\x34\x12")),
    ("43 93 60 01 78 56 34 12", H.SdoAnswer(0x6093, 1, 0, b"\x78\x56\x34\x12")),
]


@pytest.mark.parametrize(("frame", "identifier", "printed"), PRINTED_REQUESTS)
def test_sdo_requests_are_the_printed_ones(frame: H.Frame, identifier: int, printed: str) -> None:
    assert frame == (identifier, bytes.fromhex(printed).ljust(8, b"\0"))


@pytest.mark.parametrize(("printed", "meaning"), PRINTED_ANSWERS)
def test_printed_sdo_answers_are_read(printed: str, meaning: H.SdoAnswer) -> None:
    assert H.answer((0x581, bytes.fromhex(printed).ljust(8, b"\0")), 1) == meaning


def test_the_device_answers_as_printed() -> None:
    unit = drive(4)
    assert unit.receive(H.write(4, 0x6060, 0, T.CST, 1)) == [(0x584, bytes.fromhex("60 60 60 00 00 00 00 00"))]
    assert unit.receive(H.read(4, 0x6061, 0)) == [(0x584, bytes.fromhex("4F 61 60 00 0A 00 00 00"))]
    assert unit.receive(H.read(4, 0x7000, 0)) == [(0x584, bytes.fromhex("80 00 70 00 00 00 02 06"))]
    assert unit.node.boot() == [(0x704, b"\x00")]


def test_printed_emergency() -> None:
    """Faulhaber MC 5010: following error of node 1."""
    found = H.read_emergency((0x081, bytes.fromhex("11 86 20 02 00 00 00 00")), 1)
    assert found is not None
    assert (found.code, found.register, found.manufacturer) == (0x8611, 0x20, b"\x02\0\0\0\0")
    assert found.text == "0x8611 position controller (error register: of the profile)"
    assert H.read_emergency(H.SYNC_FRAME, 0) is None


def test_start_up_reads_who_it_is_and_lays_out_the_pdos() -> None:
    unit, dialogue = started(T.CSV)
    assert tuple(dialogue.values[T.IDENTITY, sub] for sub in (1, 2, 3, 4)) == IDENTITY
    assert dialogue.values[T.DEVICE_TYPE, 0] & 0xFFFF == 402
    assert dialogue.values[T.RATED_CURRENT, 0] == 4000
    assert D.supports(dialogue.values[T.SUPPORTED_MODES, 0], T.CSV)
    assert not D.supports(dialogue.values[T.SUPPORTED_MODES, 0], 8)
    unit.receive(D.velocity_command(NODE, T.SHUTDOWN, -7.0, 9.0))
    unit.receive(H.SYNC_FRAME)
    assert (unit.node.objects[T.TARGET_VELOCITY, 0].value, unit.node.objects[T.TORQUE_OFFSET, 0].value) == (-7, 9)


def test_walk_to_operation_enabled_and_what_the_command_does_when() -> None:
    unit, _ = started()
    walker, status, seen = D.Walker(), D.Status(0, 0, 0), []
    for _ in range(6):
        status = cycle(unit, walker, status, True, 250.0)
        seen.append(D.state_of(status.word).name)
    assert list(dict.fromkeys(seen)) == ["switch on disabled", "ready to switch on", "switched on", "operation enabled"]
    unit.motor = MotorReading(-12345, -77, bus_voltage_v=23.5)
    assert unit.command == (True, T.CST, 250, 0)
    unit.receive(D.torque_command(NODE, T.ENABLE, 400.0))
    assert unit.command.torque_permille == 250, "acts at SYNC only"
    (status,) = [s for f in unit.receive(H.SYNC_FRAME) if (s := D.read_status(f, NODE))]
    assert (status.counts, status.torque_permille, unit.command.torque_permille) == (-12345, -77, 400)
    slow = [s for _ in range(T.SLOW_EVERY) for f in unit.receive(H.SYNC_FRAME) if (s := D.read_slow(f, NODE))]
    assert slow == [D.SlowStatus(23.5, 0, T.CST)]
    status = cycle(unit, walker, status, False)
    assert D.state_of(status.word) is T.QUICK_STOP_ACTIVE
    assert unit.command == (False, T.CST, 0, 0)


def test_fault_emergency_and_reset_by_an_edge() -> None:
    unit, walker, status = enabled()
    (frame,) = unit.fail(T.EMCY_OVER_CURRENT)
    emergency = H.read_emergency(frame, NODE)
    assert emergency is not None
    assert emergency.text == "0x2310 current, output side (error register: generic, current)"
    assert not unit.command.enabled
    for _ in range(3):
        status = cycle(unit, walker, status, True, 100.0)
        assert D.state_of(status.word) is T.FAULT, "not left by itself"
    walker.reset()
    for _ in range(8):
        status = cycle(unit, walker, status, True, 100.0)
    assert D.state_of(status.word) is T.OPERATION_ENABLED
    assert unit.node.objects[T.ERROR_CODE, 0].value == 0


@pytest.mark.parametrize(("reaction", "state"), [(0, T.OPERATION_ENABLED), (1, T.FAULT), (2, T.SWITCH_ON_DISABLED), (3, T.QUICK_STOP_ACTIVE)])
def test_a_silent_master_stops_the_drive(reaction: int, state: T.State) -> None:
    unit, _, _ = enabled()
    unit.receive(H.write(NODE, T.COMM_LOSS_REACTION, 0, reaction, 2))
    ms = 1_000_000
    for k in range(20):
        unit.receive(H.heartbeat(127), k * 100 * ms)
        beats = [H.read_heartbeat(frame, NODE) for frame in unit.tick(k * 100 * ms)]
        assert beats == [T.OPERATIONAL]
    assert unit.tick(2190 * ms) == [(T.HEARTBEAT + NODE, b"\x05")]
    out = unit.tick(2250 * ms)
    assert [e.code for f in out if (e := H.read_emergency(f, NODE))] == [T.EMCY_HEARTBEAT]
    assert unit.state is state


def test_leaving_operational_takes_the_power_off() -> None:
    for command in (T.NMT_STOP, T.NMT_PRE_OPERATIONAL, T.NMT_RESET_NODE):
        unit, _, _ = enabled()
        unit.receive(H.nmt(command, 0))
        assert not unit.command.enabled
        unit.receive(H.nmt(T.NMT_START, 0))
        assert not unit.command.enabled
        assert unit.receive(H.nmt(T.NMT_STOP, NODE + 1)) == []


def test_dialogue_says_what_is_refused_and_who_is_silent() -> None:
    unit = drive()
    refused = H.SdoDialogue(NODE, [H.Setting(T.RATED_CURRENT, 0, 1, 4)])
    talk(refused.step, unit.receive, lambda: bool(refused.problem))
    assert refused.problem == "node 5, object 0x6075:0: read-only object written (0x06010002)"
    mapped = H.SdoDialogue(NODE, H.map_pdo(T.RPDO_SETTINGS, T.RPDO_MAPPING, T.RPDO1 + NODE, 1, ((T.STATUSWORD, 0, 16),)))
    talk(mapped.step, unit.receive, lambda: bool(mapped.problem))
    assert "cannot be mapped" in mapped.problem
    long = H.SdoDialogue(NODE, H.map_pdo(T.TPDO_SETTINGS, T.TPDO_MAPPING, T.TPDO1 + NODE, 1, ((T.POSITION, 0, 32),) * 3))
    talk(long.step, unit.receive, lambda: bool(long.problem))
    assert "PDO too long" in long.problem
    silent = H.SdoDialogue(9, [H.Setting(T.DEVICE_TYPE, 0, None, 4)])
    talk(silent.step, unit.receive, lambda: bool(silent.problem))
    assert silent.problem == "node 9 does not answer for object 0x1000:0"


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_any_command_is_a_frame(value: float) -> None:
    torque = int.from_bytes(D.torque_command(NODE, T.ENABLE, value)[1][2:], "little", signed=True)
    assert torque == (0 if value != value else round(min(max(value, -32768.0), 32767.0)))
    assert len(D.velocity_command(NODE, T.ENABLE, value, value)[1]) == 8


def test_nan_moves_nothing() -> None:
    assert D.torque_command(1, 15, nan)[1] == b"\x0f\0\0\0"
    assert D.torque_command(1, 15, inf)[1] == b"\x0f\0\xff\x7f"


@given(st.lists(st.integers(-(2**40), 2**40), min_size=1, max_size=20))
def test_counter_does_not_wrap(steps: list[int]) -> None:
    counter, true = H.Counter(), 0
    counter.step(0)
    for step in steps:
        true += max(-(2**31) + 1, min(2**31 - 1, step))
        wrapped = (true + 2**31) % 2**32 - 2**31
        assert counter.step(wrapped) == true


@given(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(1, 127))
@settings(max_examples=400)
def test_only_the_right_frame_is_a_sample(identifier: int, data: bytes, node: int) -> None:
    frame = (identifier, data)
    assert (D.read_status(frame, node) is not None) == (identifier == 0x180 + node and len(data) == 8)
    assert (D.read_slow(frame, node) is not None) == (identifier == 0x280 + node and len(data) == 7)
    assert (H.read_emergency(frame, node) is not None) == (identifier == 0x80 + node and len(data) == 8)
    assert (H.read_heartbeat(frame, node) is not None) == (identifier == 0x700 + node and len(data) == 1)
    if H.answer(frame, node) is not None:
        assert identifier == 0x580 + node
        assert len(data) == 8


IDENTIFIERS = st.one_of(st.sampled_from([0, 0x80, 0x200 + NODE, 0x600 + NODE, 0x77F, 0x580 + NODE, 0x180 + NODE]), st.integers(0, 0x7FF))
SDO = st.builds(
    lambda command, index, sub, rest: (0x600 + NODE, bytes((command, index & 0xFF, index >> 8, sub)) + rest),
    st.sampled_from([0x40, 0x22, 0x23, 0x2B, 0x2F, 0x60, 0x70, 0x80, 0xA0]),
    st.sampled_from(sorted({index for index, _ in drive().node.objects} | {0x2000})),
    st.integers(0, 9),
    st.binary(min_size=4, max_size=4),
)


@given(st.lists(st.one_of(SDO, st.tuples(IDENTIFIERS, st.binary(max_size=8)), st.just(H.SYNC_FRAME), st.just(H.nmt(T.NMT_START, 0))), max_size=60))
@settings(max_examples=300, deadline=None)
def test_no_frames_raise_on_either_side(frames: list[H.Frame]) -> None:
    unit = drive()
    dialogue = H.SdoDialogue(NODE, D.start_up(NODE, T.CST, 2, 127, 100))
    for k, frame in enumerate(frames):
        out = unit.receive(frame, k * 10**7) + unit.tick(k * 10**7)
        assert all(0 <= identifier <= 0x7FF and len(data) <= 8 for identifier, data in out)
        dialogue.step(k * 10**8, [frame, *out])
        if unit.command.enabled:
            assert unit.state is T.OPERATION_ENABLED


@given(st.lists(st.integers(0, 0xFFFF), max_size=40))
def test_power_only_after_the_whole_walk(words: list[int]) -> None:
    """No controlword skips a state, and the power stage is on in one state only."""
    unit, _ = started()
    before = unit.state
    for word in words:
        unit.receive(D.torque_command(NODE, word, 500.0))
        unit.receive(H.SYNC_FRAME)
        if unit.state is T.OPERATION_ENABLED and before is not T.OPERATION_ENABLED:
            assert before in (T.SWITCHED_ON, T.QUICK_STOP_ACTIVE)
            assert word & 0x0F == T.ENABLE
        assert unit.command.enabled == (unit.state is T.OPERATION_ENABLED)
        before = unit.state


@contextmanager
def on_bus(unit: Drive) -> Iterator[tuple[Any, list[H.Frame]]]:
    """The drive on python-can's virtual bus, with SYNC every 5 ms, and a ``canopen`` network at the other end."""
    can = pytest.importorskip("can")
    canopen = pytest.importorskip("canopen", reason="the independent CANopen master is not installed")
    name, outbox = f"drive-{time.monotonic_ns()}", list[H.Frame]()
    bus = can.Bus(interface="virtual", channel=name)
    end = threading.Event()

    def serve() -> None:
        next_sync = time.monotonic()
        while not end.is_set():
            message = bus.recv(0.001)
            out = unit.receive((message.arbitration_id, bytes(message.data)), time.monotonic_ns()) if message else []
            if time.monotonic() >= next_sync and unit.node.state == T.OPERATIONAL:
                next_sync += 0.005
                unit.motor = MotorReading(unit.motor.counts + unit.command.velocity_counts_s // 200, unit.command.torque_permille)
                out += unit.receive(H.SYNC_FRAME)
            while outbox:
                out.append(outbox.pop(0))
            for identifier, data in out + unit.tick(time.monotonic_ns()):
                bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    thread = threading.Thread(target=serve)
    network = canopen.Network()
    network.connect(interface="virtual", channel=name)
    thread.start()
    try:
        yield network, outbox
    finally:
        network.disconnect()
        end.set()
        thread.join()
        bus.shutdown()


@pytest.mark.peers
def test_canopen_walks_our_drive_and_drives_it() -> None:
    """``canopen.BaseNode402``: EDS, SDO (expedited and segmented), PDO set-up, state machine, modes, EMCY, heartbeat."""
    unit = drive()
    with on_bus(unit) as (network, outbox):
        import canopen

        source = io.StringIO(eds("drive", unit.node.objects))
        source.name = "drive.eds"
        node = canopen.BaseNode402(NODE, canopen.import_od(source, NODE))
        network.add_node(node)
        assert node.sdo[0x1008].raw == "Simulated CiA 402 drive"
        assert [node.sdo[0x1018][sub].raw for sub in (1, 2, 3, 4)] == list(IDENTITY)
        with pytest.raises(canopen.SdoAbortedError) as caught:
            node.sdo[0x6075].raw = 1
        assert caught.value.code == T.READ_ONLY
        node.tpdo.read()
        node.rpdo.read()
        pdo = node.rpdo[1]
        pdo.clear()
        for index in (T.CONTROLWORD, T.TARGET_VELOCITY, T.TORQUE_OFFSET):
            pdo.add_variable(index)
        pdo.trans_type, pdo.enabled = 1, True
        node.rpdo.save()
        node.sdo[T.PRODUCER_HEARTBEAT].raw = 50
        node.nmt.state = "OPERATIONAL"
        node.setup_402_state_machine()
        pdo.start(0.005)
        node.nmt.wait_for_heartbeat(2)
        assert node.nmt.state == "OPERATIONAL"
        node.op_mode = "CYCLIC SYNCHRONOUS VELOCITY"
        assert node.op_mode == "CYCLIC SYNCHRONOUS VELOCITY"
        node.state = "OPERATION ENABLED"
        assert node.state == "OPERATION ENABLED"
        pdo[1].raw = -20000
        before = node.tpdo[1][1].raw
        for _ in range(4):
            node.tpdo[1].wait_for_reception(1)
        assert node.tpdo[1][1].raw < before
        assert unit.command.velocity_counts_s == -20000
        node.state = "SWITCHED ON"
        assert not unit.command.enabled
        outbox += unit.fail(T.EMCY_OVER_TEMPERATURE)
        assert node.emcy.wait(T.EMCY_OVER_TEMPERATURE, 2) is not None
        assert (node.emcy.active[0].code, node.emcy.active[0].register) == (T.EMCY_OVER_TEMPERATURE, 9)
        node.tpdo[1].wait_for_reception(1)
        node.tpdo[1].wait_for_reception(1)
        assert node.state == "FAULT"
        node.reset_from_fault()
        assert node.state == "OPERATION ENABLED"
        pdo.stop()


@pytest.mark.peers
def test_our_master_sets_up_a_node_of_canopen() -> None:
    """``canopen.LocalNode`` as the SDO server: everything that our start-up writes and reads arrives there."""
    can = pytest.importorskip("can")
    canopen = pytest.importorskip("canopen", reason="the independent CANopen node is not installed")
    name = f"local-{time.monotonic_ns()}"
    source = io.StringIO(eds("drive", drive().node.objects))
    source.name = "drive.eds"
    network, bus = canopen.Network(), can.Bus(interface="virtual", channel=name)
    network.connect(interface="virtual", channel=name)
    try:
        node = canopen.LocalNode(NODE, canopen.import_od(source, NODE))
        network.add_node(node)
        dialogue, heard = H.SdoDialogue(NODE, D.start_up(NODE, T.CSV, 2, 127, 100)), list[H.Frame]()
        end = time.monotonic() + 20
        while not dialogue.done and not dialogue.problem and time.monotonic() < end:
            for identifier, data in dialogue.step(time.monotonic_ns(), heard):
                bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
            message = bus.recv(0.1)
            heard = [(message.arbitration_id, bytes(message.data))] if message else []
        assert dialogue.done, dialogue.problem
        assert tuple(dialogue.values[T.IDENTITY, sub] for sub in (1, 2, 3, 4)) == IDENTITY
        assert [node.sdo[0x1600][sub].raw for sub in range(4)] == [3, 0x60400010, 0x60FF0020, 0x60B20010]
        assert node.sdo[0x1400][1].raw == 0x205
        assert node.sdo[T.MODE].raw == T.CSV
        assert node.sdo[T.CONSUMER_HEARTBEAT][1].raw == 127 << 16 | 300
        assert node.sdo[T.INTERPOLATION_PERIOD][2].raw == -3
    finally:
        network.disconnect()
        bus.shutdown()


def test_eds_lists_every_object() -> None:
    text = eds("drive", drive().node.objects)
    for index, sub in drive().node.objects:
        assert f"[{index:04X}]" in text
        if sub:
            assert f"[{index:04X}sub{sub:X}]" in text


def test_exchange_keeps_the_order() -> None:
    assert exchange([(1, b"a"), (2, b"b")], lambda frame: [frame, frame]) == [(1, b"a"), (1, b"a"), (2, b"b"), (2, b"b")]
