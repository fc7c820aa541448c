"""The slcan text: both sides against each other, against python-can's own interface on a pseudo-terminal, and against damage."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Iterator
from contextlib import suppress

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.devices.transport.base import EXTENDED, REMOTE, TransportError
from spsp_ctrl.devices.transport.opening import open_can
from spsp_ctrl.devices.transport.slcan import SlcanBus
from spsp_ctrl.devices.transport.slcan_codec import Lines, to_text
from spsp_ctrl.devices.transport.slcan_device import SlcanAdapter

Frame = tuple[int, bytes]
_standard = st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8))
_extended = st.tuples(st.integers(0, 0x1FFFFFFF).map(lambda i: i | EXTENDED), st.binary(max_size=8))
_remote = st.tuples(st.integers(0, 0x7FF).map(lambda i: i | REMOTE), st.just(b""))
FRAMES = st.lists(st.one_of(_standard, _extended, _remote), max_size=20)


def opened() -> SlcanAdapter:
    adapter = SlcanAdapter()
    assert adapter.receive(b"S8\rO\r") == ([], b"\r\r")
    return adapter


@given(FRAMES)
@settings(max_examples=100)
def test_what_we_write_the_adapter_reads_and_the_other_way_round(frames: list[Frame]) -> None:
    adapter = opened()
    assert adapter.receive(to_text(frames))[0] == frames
    assert Lines().feed(adapter.deliver(frames)) == frames


@given(FRAMES, st.data())
@settings(max_examples=60)
def test_it_does_not_matter_where_the_text_is_cut(frames: list[Frame], data: st.DataObject) -> None:
    text, lines, found = opened().deliver(frames), Lines(), []
    while text:
        cut = data.draw(st.integers(1, len(text)))
        found += lines.feed(text[:cut])
        text = text[cut:]
    assert found == frames
    assert not lines.damaged


def test_printed_examples_of_the_manual() -> None:
    """CAN232 manual, section 6: t10021133 is identifier 0x100 with bytes 11 33; T0000010021133 the same with 29 bits; r1002 asks for it."""
    assert Lines().feed(b"t10021133\rT0000010021133\rr1002\rt10021133ABCD\r") == [
        (0x100, b"\x11\x33"),
        (0x100 | EXTENDED, b"\x11\x33"),
        (0x100 | REMOTE, b""),
        (0x100, b"\x11\x33"),  # with a time stamp
    ]
    assert to_text([(0x100, b"\x11\x33")]) == b"t10021133\r"


@pytest.mark.parametrize(
    "line", [b"t1002113\r", b"t100911\r", b"t10G211\r", b"tFFF0\r", b"T200000000\r", b"t100211 3\r", b"x\r", b"t\r", b"t10021133ABC\r"]
)
def test_a_damaged_line_is_no_frame_and_costs_itself_only(line: bytes) -> None:
    lines = Lines()
    assert lines.feed(line + b"t1230\r") == [(0x123, b"")]
    assert lines.damaged == 1


class Served:
    """The simulated adapter on a pseudo-terminal, with a list of what it heard from the computer."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        self._slave = slave
        self.adapter = SlcanAdapter()
        self.heard: list[Frame] = []
        self.ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self.ended.is_set():
            try:
                frames, answer = self.adapter.receive(os.read(self.master, 4096))
                self.heard += frames
                os.write(self.master, answer + self.adapter.deliver([(i + 1, d) for i, d in frames]))
            except OSError:
                return

    def unplug(self) -> None:
        """Both ends of the pseudo-terminal are let go."""
        self.ended.set()
        for fd in (self.master, self._slave):
            with suppress(OSError):
                os.close(fd)


@pytest.fixture
def served() -> Iterator[Served]:
    found = Served()
    yield found
    found.unplug()


def wait_for(bus: SlcanBus, count: int) -> list[tuple[int, int, bytes]]:
    got: list[tuple[int, int, bytes]] = []
    pause = threading.Event()
    for _ in range(1000):
        got += bus.poll(0)
        if len(got) >= count:
            return got
        pause.wait(0.005)
    raise AssertionError(f"{len(got)} of {count} frames came")


def test_a_whole_bus_over_a_pseudo_terminal(served: Served) -> None:
    bus = SlcanBus(served.port)
    assert bus.version == "V1013"
    frames = [(0x200 + n, bytes(range(n))) for n in range(9)] + [(0x80, b"")]
    assert bus.send(frames)
    got = wait_for(bus, len(frames))
    assert [(i, d) for _, i, d in got] == [(i + 1, d) for i, d in frames]
    assert served.heard == frames
    assert bus.fault.id == ""
    stamps = [t for t, _, _ in got]
    assert stamps == sorted(stamps)
    bus.close()


def test_status_flags_become_named_faults_and_go_away(served: Served) -> None:
    bus = SlcanBus(served.port)
    served.adapter.flags = 0x20
    pause = threading.Event()
    seen = set()
    for _ in range(400):
        bus.poll(0)
        seen.add(bus.fault.id)
        if seen == {"", "error-passive"} and not bus.fault.id:
            break
        pause.wait(0.005)
    assert seen == {"", "error-passive"}
    assert bus.fault.id == ""
    bus.close()


def test_an_adapter_that_is_pulled_out_is_a_fault_and_no_exception(served: Served) -> None:
    bus = SlcanBus(served.port)
    served.unplug()
    pause = threading.Event()
    for _ in range(200):
        bus.poll(0)
        if bus.fault.id:
            break
        pause.wait(0.005)
    assert bus.fault.id == "unplugged"
    assert "plug" in bus.fault.text
    assert not bus.send([(0x80, b"")])
    assert bus.poll(0) == []
    bus.close()
    bus.close()


def test_what_cannot_be_opened_says_why(served: Served) -> None:
    with pytest.raises(TransportError, match="no such port"):
        open_can("slcan", "/dev/tty-not-there", 1_000_000)
    with pytest.raises(TransportError, match="no bit rate 123456"):
        open_can("slcan", served.port, 123456)
    with pytest.raises(TransportError, match="unknown option 'bad'"):
        open_can("slcan", served.port, 1_000_000, {"bad": 1})
    master, slave = os.openpty()
    with pytest.raises(TransportError, match="no slcan adapter answers"):
        SlcanBus(os.ttyname(slave))
    os.close(master)
    os.close(slave)


@pytest.mark.peers
def test_python_can_speaks_to_our_adapter(served: Served) -> None:
    with can.Bus(interface="slcan", channel=served.port, bitrate=500_000, sleep_after_open=0) as bus:
        sent = [can.Message(arbitration_id=0x321, data=b"\x01\x02", is_extended_id=False), can.Message(arbitration_id=0x12345, data=b"abcdefgh")]
        for message in sent:
            bus.send(message)
        got = []
        while len(got) < 2:
            message = bus.recv(2.0)
            assert message is not None
            got.append(message)
    assert [(m.arbitration_id, bytes(m.data), m.is_extended_id) for m in got] == [(0x322, b"\x01\x02", False), (0x12346, b"abcdefgh", True)]
    assert served.adapter.bit_rate_code == 6
