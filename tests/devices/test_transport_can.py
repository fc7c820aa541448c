"""Buses of python-can: own frames, bounded polls, faults with names. SocketCAN's error frames and refusals come from a driver that acts them."""

from __future__ import annotations

import errno
import itertools
import threading
from collections.abc import Callable

import can
import pytest

from spsp_ctrl.devices.transport import python_can
from spsp_ctrl.devices.transport.base import EXTENDED, REMOTE, TransportError
from spsp_ctrl.devices.transport.opening import open_can
from spsp_ctrl.devices.transport.python_can import MOST_FRAMES, PythonCanBus
from spsp_ctrl.devices.transport.trouble import FAULTS, Ledger, named

_port = itertools.count(43_200)


def gathered(bus: PythonCanBus, count: int) -> list[tuple[int, int, bytes]]:
    got: list[tuple[int, int, bytes]] = []
    pause = threading.Event()
    for _ in range(400):
        got += bus.poll(0)
        if len(got) >= count:
            break
        pause.wait(0.005)
    return got


@pytest.mark.parametrize("interface", ["virtual", "udp_multicast", "socketcan"])
def test_two_ends_hear_each_other_and_never_themselves(interface: str) -> None:
    options = {"port": next(_port)} if interface == "udp_multicast" else {}
    channel = {"virtual": "spsp-test", "udp_multicast": "239.74.163.9", "socketcan": "vcan0"}[interface]
    try:
        one, two = (PythonCanBus(interface, channel, 1_000_000, options) for _ in range(2))
    except TransportError as error:  # a container without a network
        pytest.skip(str(error))  # no vcan0 in this kernel: modprobe vcan; ip link add vcan0 type vcan; ip link set vcan0 up
    frames = [(0x80, b""), (0x201, b"\x01\x02"), (0x1234567 | EXTENDED, bytes(8)), (0x45 | REMOTE, b"")]
    assert one.send(frames)
    assert [(i, d) for _, i, d in gathered(two, len(frames))] == frames
    assert two.send([(0x181, b"abc")])
    assert [(i, d) for _, i, d in gathered(one, 1)] == [(0x181, b"abc")]
    assert one.poll(0) == two.poll(0) == []
    assert (one.own, two.own) == ((4, 1) if interface == "udp_multicast" else (0, 0))
    assert one.fault.id == two.fault.id == ""
    one.close()
    two.close()
    one.close()
    assert not one.send(frames)
    assert one.poll(0) == []


def test_a_group_on_the_same_port_is_another_bus() -> None:
    """Two sessions on one computer do not hear each other."""
    port = next(_port)
    try:
        one, other, third = (PythonCanBus("udp_multicast", f"239.74.163.{n}", 1_000_000, {"port": port}) for n in (31, 32, 31))
    except TransportError as error:
        pytest.skip(str(error))
    assert one.send([(0x181, b"one")])
    assert other.send([(0x182, b"other")])
    assert [(i, d) for _, i, d in gathered(third, 1)] == [(0x181, b"one")]
    for bus in (one, other, third):
        assert bus.poll(0) == []
        bus.close()


class Acted(can.BusABC):
    """A driver that does what its script says: messages to receive, exceptions to raise."""

    def __init__(self) -> None:
        super().__init__("acted")
        self.script: list[can.Message | Exception] = []
        self.refusal: Exception | None = None
        self.went_out: list[can.Message] = []

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self.script:
            return None, True
        following = self.script.pop(0)
        if isinstance(following, Exception):
            raise following
        return following, True

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.refusal:
            raise self.refusal
        self.went_out.append(msg)


@pytest.fixture
def acted(monkeypatch: pytest.MonkeyPatch) -> tuple[PythonCanBus, Acted]:
    driver = Acted()
    monkeypatch.setattr(python_can.can, "Bus", lambda **words: driver)
    return PythonCanBus("socketcan", "can0"), driver


def error_frame(kind: int, detail: int = 0, sent: int = 0, received: int = 0) -> can.Message:
    """As SocketCAN delivers it."""
    data = bytes((0, detail, 0, 0, 0, 0, sent, received))
    return can.Message(arbitration_id=kind, data=data, is_error_frame=True, is_extended_id=False)


def test_error_frames_are_named_and_taken_back(acted: tuple[PythonCanBus, Acted]) -> None:
    bus, driver = acted
    for frame, name in (
        (error_frame(0x08), "error-frames"),
        (error_frame(0x04, 0x20, 130, 12), "error-passive"),
        (error_frame(0x40), "bus-off"),
        (error_frame(0x100), "error-frames"),  # restarted: the older complaint about errors still stands
        (error_frame(0x04, 0x40), ""),
        (error_frame(0x04, 0x01), "overrun"),
    ):
        driver.script.append(frame)
        assert bus.poll(0) == []
        assert bus.fault.id == name
    assert bus.error_frames == 6
    driver.script.append(error_frame(0x04, 0x20, 130, 12))
    bus.poll(0)
    assert "counters 130 sent, 12 received" in bus.fault.text


@pytest.mark.parametrize(
    ("refusal", "name"),
    [
        (can.CanOperationError("Failed to transmit", error_code=errno.ENOBUFS), "queue-full"),
        (can.CanOperationError("Transmit buffer full"), "queue-full"),
        (can.CanTimeoutError("timeout"), "queue-full"),
        (can.CanOperationError("Failed to transmit", error_code=errno.ENETDOWN), "down"),
        (can.CanOperationError("Failed to transmit", error_code=errno.ENODEV), "unplugged"),
        (can.CanOperationError("the bus is in bus-off state"), "bus-off"),
        (RuntimeError("libusb died"), "unplugged"),
    ],
)
def test_refused_frames_are_named_and_stop_the_batch(acted: tuple[PythonCanBus, Acted], refusal: Exception, name: str) -> None:
    bus, driver = acted
    driver.refusal = refusal
    assert not bus.send([(0x201, b"x"), (0x80, b"")])
    assert bus.fault.id == name
    assert "socketcan can0" in bus.fault.text
    assert not driver.went_out
    driver.refusal = None
    well = bus.send([(0x80, b"")])
    assert well == (name != "unplugged")
    assert bus.fault.id == ("" if name in ("queue-full", "down") else name)


def test_a_driver_that_fails_while_reading_is_a_fault(acted: tuple[PythonCanBus, Acted]) -> None:
    bus, driver = acted
    driver.script += [can.Message(arbitration_id=0x181, is_extended_id=False, data=b"a"), can.CanOperationError("read", error_code=errno.ENETDOWN)]
    assert [(i, d) for _, i, d in bus.poll(0)] == [(0x181, b"a")]
    assert bus.fault.id == "down"
    driver.script.append(OSError(errno.ENODEV, "No such device"))
    assert bus.poll(0) == []
    assert bus.fault.id == "unplugged"


def test_one_call_takes_a_bounded_number_of_frames(acted: tuple[PythonCanBus, Acted]) -> None:
    bus, driver = acted
    driver.script += [can.Message(arbitration_id=n % 0x800, is_extended_id=False) for n in range(2 * MOST_FRAMES - 1)]
    assert len(bus.poll(0)) == MOST_FRAMES
    assert bus.fault.id == "flooded"
    assert len(bus.poll(0)) == MOST_FRAMES - 1
    assert bus.fault.id == ""


def test_own_and_foreign_kinds_of_frames_are_left_out(acted: tuple[PythonCanBus, Acted]) -> None:
    bus, driver = acted
    driver.script += [
        can.Message(arbitration_id=1, is_extended_id=False, is_rx=False),
        can.Message(arbitration_id=2, is_extended_id=False, is_fd=True, data=bytes(12)),
        can.CanOperationError("could not unpack received message"),
        can.Message(arbitration_id=3, is_extended_id=False),
    ]
    assert [i for _, i, _ in bus.poll(0)] == [3]
    assert (bus.own, bus.malformed, bus.fault.id) == (1, 2, "")


@pytest.mark.parametrize("frame", [(0x201, bytes(9)), (0x801, b"")])
def test_a_frame_that_is_none_is_not_sent_and_blames_nobody(acted: tuple[PythonCanBus, Acted], frame: tuple[int, bytes]) -> None:
    bus, driver = acted
    assert not bus.send([frame])
    assert not driver.went_out
    assert bus.fault.id == ""


def test_what_cannot_be_opened_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TransportError, match="cannot use this interface"):
        open_can("no-such-interface", "x", 1_000_000)

    def refuse(text: Exception) -> Callable[..., None]:
        def bus(**words: object) -> None:
            raise text

        return bus

    for error, text in (
        (can.CanInterfaceNotImplementedError("msgpack not installed"), "pip install msgpack"),
        (OSError(errno.ENODEV, "No such device"), "ip link set can0 up"),
        (OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol"), "modprobe"),
    ):
        monkeypatch.setattr(python_can.can, "Bus", refuse(error))
        with pytest.raises(TransportError, match=text):
            open_can("socketcan", "can0", 1_000_000)


def test_the_worst_fault_is_shown_and_unplugged_stays() -> None:
    ledger = Ledger()
    names = list(FAULTS)
    for name in names:
        ledger.set(name)
        assert ledger.worst.id == name
    ledger.clear(*names)
    assert ledger.worst.id == "unplugged"
    assert named(can.CanOperationError("x", error_code=errno.EAGAIN)) == "queue-full"
