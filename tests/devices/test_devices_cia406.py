"""CiA 406 resolver node: printed mapping, the two roles against each other, converter faults, wrong frames, ``canopen`` as the master."""

from __future__ import annotations

import io
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.devices.bus import talk

from spsp_ctrl.devices import canopen_host as H
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import cia406_host as A
from spsp_ctrl.devices import cia406_table as T
from spsp_ctrl.devices.canopen_eds import eds
from spsp_ctrl.devices.cia406_device import Encoder
from spsp_ctrl.messages import ResolverStatus

NODE = 9


def started() -> tuple[Encoder, H.SdoDialogue]:
    unit = Encoder(NODE, identity=(1, 2, 3, 4))
    dialogue = H.SdoDialogue(NODE, A.start_up(NODE, 50))
    talk(dialogue.step, unit.receive, lambda: dialogue.done or bool(dialogue.problem))
    assert dialogue.done, dialogue.problem
    unit.receive(H.nmt(C.NMT_START, NODE))
    return unit, dialogue


def reading(unit: Encoder) -> A.AngleReading:
    (found,) = [r for f in unit.receive(H.SYNC_FRAME) if (r := A.read_angle(f, NODE))]
    return found


def test_printed_device_type_mapping_and_requests() -> None:
    """AXRES manual: type 0x00010196, PDO 0x60040020 0x60300110 0x20010010. BEI MHK5 manual: read of the preset of node 1."""
    unit = Encoder(1)
    assert unit.receive(H.read(1, 0x1000, 0)) == [(0x581, bytes.fromhex("43 00 10 00 96 01 01 00"))]
    mapping = [unit.receive(H.read(1, 0x1A00, sub))[0][1][4:] for sub in (1, 2, 3)]
    assert [int.from_bytes(m, "little") for m in mapping] == [0x60040020, 0x60300110, 0x20010010]
    assert H.read(1, 0x6003, 0) == (0x601, bytes.fromhex("40 03 60 00 00 00 00 00"))
    assert unit.receive(H.read(1, 0x6001, 0)) == [(0x581, bytes.fromhex("43 01 60 00 A0 8C 00 00"))]


def test_angle_speed_and_faults_arrive() -> None:
    unit, dialogue = started()
    assert A.is_encoder(dialogue.values[C.DEVICE_TYPE, 0])
    assert dialogue.values[T.UNITS_PER_TURN, 0] == 36_000
    counter = H.Counter(dialogue.values[T.TOTAL_RANGE, 0])
    unit.counts, unit.speed = 123_456, -40_000
    assert reading(unit) == (123_456, -32_768, ResolverStatus.OK)
    counter.step(123_456)
    unit.counts = -7
    assert reading(unit).position == 36_000 * 4096 - 7
    assert counter.step(reading(unit).position) == -7
    unit.faults = T.LOSS_OF_SIGNAL | T.LOSS_OF_TRACKING
    assert reading(unit).status == ResolverStatus.LOSS_OF_SIGNAL | ResolverStatus.LOSS_OF_TRACKING
    heard = [e for f in unit.tick(0) if (e := H.read_emergency(f, NODE))]
    assert [(e.code, e.register, e.manufacturer[0]) for e in heard] == [(C.EMCY_RESOLVER, 129, 5)]
    assert heard[0].text == "0x7300 sensor (error register: generic, of the manufacturer)"
    assert not [f for f in unit.tick(1) if H.read_emergency(f, NODE)], "said once"
    unit.faults = 0
    gone = [H.read_emergency(f, NODE) for f in unit.tick(2)]
    assert [e.code for e in gone if e is not None] == [0]


def test_preset_moves_the_zero() -> None:
    unit, _ = started()
    unit.counts = 5000
    (frame,) = unit.receive(H.write(NODE, T.PRESET, 0, 100, 4))
    assert H.answer(frame, NODE) == H.SdoAnswer(T.PRESET, 0, 0, b"")
    assert reading(unit).position == 100
    (frame,) = unit.receive(H.write(NODE, T.PRESET, 0, 1 << 31, 4))
    answer = H.answer(frame, NODE)
    assert answer is not None
    assert answer.abort == C.OUT_OF_RANGE


def test_a_range_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="32 bits"):
        Encoder(1, units_per_turn=1 << 20, turns=1 << 12)


@given(st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(1, 127))
def test_only_the_right_frame_is_a_reading(identifier: int, data: bytes, node: int) -> None:
    found = A.read_angle((identifier, data), node)
    assert (found is not None) == (identifier == 0x180 + node and len(data) == 8)
    if found is not None:
        assert 0 <= found.status <= 7


FRAMES = st.one_of(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), st.tuples(st.just(0x600 + NODE), st.binary(min_size=8, max_size=8)))


@given(st.lists(FRAMES))
@settings(max_examples=200, deadline=None)
def test_no_frames_raise(frames: list[H.Frame]) -> None:
    unit = Encoder(NODE)
    for k, frame in enumerate(frames):
        unit.faults = k & 15
        for identifier, data in unit.receive(frame, k) + unit.receive(H.SYNC_FRAME) + unit.tick(k * 10**7):
            assert 0 <= identifier <= 0x7FF
            assert len(data) <= 8


@pytest.mark.peers
def test_canopen_reads_our_node() -> None:
    can = pytest.importorskip("can")
    canopen = pytest.importorskip("canopen", reason="the independent CANopen master is not installed")
    unit, end, name = Encoder(NODE, identity=(1, 2, 3, 4)), threading.Event(), f"angle-{time.monotonic_ns()}"
    bus = can.Bus(interface="virtual", channel=name)

    def serve() -> None:
        while not end.is_set():
            message = bus.recv(0.002)
            out = unit.receive((message.arbitration_id, bytes(message.data))) if message else []
            for identifier, data in out + unit.tick(time.monotonic_ns()):
                bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    thread = threading.Thread(target=serve)
    network = canopen.Network()
    network.connect(interface="virtual", channel=name)
    thread.start()
    try:
        source = io.StringIO(eds("resolver", unit.node.objects))
        source.name = "resolver.eds"
        node = network.add_node(NODE, canopen.import_od(source, NODE))
        assert node.sdo["Manufacturer device name"].raw == "Simulated CiA 406 resolver"
        assert node.sdo[0x1000].raw == 0x00010196
        node.tpdo.read()
        node.nmt.state = "OPERATIONAL"
        unit.counts, unit.speed, unit.faults = 4711, -12, T.DEGRADATION
        assert node.emcy.wait(C.EMCY_RESOLVER, 2).data[0] == T.DEGRADATION
        network.sync.transmit()
        assert node.tpdo[1].wait_for_reception(2) is not None
        assert [v.raw for v in node.tpdo[1]] == [4711, -12, T.DEGRADATION]
        node.sdo[T.PRESET].raw = 0
        network.sync.transmit()
        assert node.tpdo[1].wait_for_reception(2) is not None
        assert node.tpdo[1][0].raw == 0
    finally:
        network.disconnect()
        end.set()
        thread.join()
        bus.shutdown()
