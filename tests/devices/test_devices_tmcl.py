"""Trinamic TMCL: printed datagrams of the manuals, the two roles against each other, wrong bytes, and the vendor's own client."""

from __future__ import annotations

import os
import pty
import random
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from math import nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.devices import tmcl_host as H
from spsp_ctrl.devices import tmcl_table as T
from spsp_ctrl.devices.tmcl_device import Axis, Module
from spsp_ctrl.devices.tmcl_host import Reply, Request, SerialReplies, SpeedUnit, Stepper

MS = 1_000_000


def test_printed_requests() -> None:
    """TMCM-351 and TMCM-1640 (ROR 2, 350; ROR 0, 350), TMCM-6212 (CALC MUL, -5000)."""
    assert H.to_serial(H.rotate(2, 350))[:-1] == bytes.fromhex("01 01 00 02 00 00 01 5E")
    assert H.to_serial(H.rotate(0, 350))[:-1] == bytes.fromhex("01 01 00 00 00 00 01 5E")
    assert H.to_serial(Request(0x13, 0x02, 0, -5000)) == bytes.fromhex("01 13 02 00 FF FF EC 78 78")
    assert H.to_serial(Request(0x2C, 1, 0x1B, 0)) == bytes.fromhex("01 2C 01 1B 00 00 00 00 49")
    assert H.to_can(H.rotate(0, 350)) == (1, bytes.fromhex("01 00 00 00 00 01 5E"))


def test_printed_answers() -> None:
    assert SerialReplies().feed(bytes.fromhex("02 01 64 13 FF FF EC 78 DC")) == [Reply(100, 0x13, -5000)]
    assert SerialReplies().feed(bytes.fromhex("02 01 64 2C 00 00 00 00 93")) == [Reply(100, 0x2C, 0)]


def test_the_module_answers_byte_for_byte() -> None:
    module = Module()
    assert module.serial(H.to_serial(H.rotate(0, 350))) == bytes.fromhex("02 01 64 01 00 00 01 5E C7")
    assert module.serial(H.to_serial(Request(0x2C, 1, 0, 0))) == bytes.fromhex("02 01 02 2C 00 00 00 00 31")
    assert module.can(1, H.to_can(H.get(0, 99))[1]) == [(2, bytes.fromhex("01 03 06 00 00 00 00"))]


def test_speed_of_a_tmc429_module_is_an_internal_number() -> None:
    """TMCM-1140 manual: 2047 with divisor 5 is 15.6 kpps at 16 MHz."""
    unit = SpeedUnit(pulse_divisor=5)
    assert unit.from_module(2047) == pytest.approx(15617.4, abs=0.1)
    assert unit.to_module(15617.4) == 2047
    assert SpeedUnit().to_module(-123.4) == -123


class Line:
    """Stepper and module on a serial line, one cycle a millisecond; answers may be lost, and come ``delay`` cycles late."""

    def __init__(self, stepper: Stepper, module: Module, delay: int = 1) -> None:
        self.stepper, self.module = stepper, module
        self._replies, self._on_the_way, self._cycle = SerialReplies(), [b""] * delay, 0

    def run(self, cycles: int, lose: Callable[[], bool] = lambda: False) -> None:
        """Let time pass."""
        for _ in range(cycles):
            self._cycle += 1
            request = self.stepper.step(self._cycle * MS, self._replies.feed(self._on_the_way.pop(0)))
            answer = self.module.serial(H.to_serial(request)) if request is not None else b""
            self._on_the_way.append(b"" if lose() else answer)
            self.module.advance(1e-3)


def test_stepper_follows_and_reads_back() -> None:
    stepper, module = Stepper(), Module()
    line = Line(stepper, module)
    stepper.command(-2000.0)
    line.run(400)
    assert stepper.reading.seq > 20
    assert stepper.reading.speed_microsteps_s == -2000.0
    assert -800 < stepper.reading.position_microsteps < -600
    assert (stepper.lost, stepper.refused) == (0, 0)
    module.axes[0].left_switch = True
    line.run(60)
    assert stepper.reading.left_switch
    assert stepper.reading.speed_microsteps_s == 0.0
    stepper.halt()
    line.run(30)
    assert module.axes[0].parameters[T.TARGET_SPEED] == 0


@given(st.integers(0, 2**32), st.integers(1, 70), st.floats(0.0, 0.3))
@settings(max_examples=60, deadline=None)
def test_a_late_answer_is_never_taken_for_another(seed: int, delay: int, loss: float) -> None:
    """Any delay (beyond the time-out too) and loss: position, speed and switches are never mixed up."""
    draw = random.Random(seed)
    stepper, module = Stepper(), Module()
    axis = module.axes[0]
    axis.position, axis.home_switch = 7_000_000.0, True
    Line(stepper, module, delay).run(600, lambda: draw.random() < loss)
    if stepper.reading.seq >= 0:
        assert stepper.reading[:5] == (7_000_000, 0.0, False, False, True)
    if delay < 40 and loss == 0.0:
        assert stepper.lost == 0


def test_a_refusal_is_said() -> None:
    stepper, module = Stepper(motor=3), Module()
    Line(stepper, module).run(10)
    assert stepper.problem == "instruction 6, type 1: invalid value (4)"


def test_positioning_ramps_and_arrives() -> None:
    axis = Axis()
    assert axis.write(T.MAX_SPEED, 20000) == T.OK
    assert axis.write(T.TARGET_POSITION, 10000) == T.OK
    speeds = []
    for _ in range(3000):
        axis.advance(1e-3)
        speeds.append(axis.speed)
    assert axis.read(T.POSITION) == 10000
    assert axis.read(T.POSITION_REACHED) == 1
    assert max(speeds) <= 20000
    assert max(abs(b - a) for a, b in pairwise(speeds)) <= 3.0 * 51200 * 1e-3  # the last step is a little longer


@pytest.mark.parametrize(
    ("mode", "closed"),
    [
        (T.SEARCH_LEFT, lambda x: {"left_switch": x < -3000}),
        (T.SEARCH_LEFT | T.SEARCH_OPPOSITE, lambda x: {"right_switch": x > 3000}),
        (T.SEARCH_HOME_NEGATIVE, lambda x: {"home_switch": -4000 < x < -3000}),
        (T.SEARCH_HOME_POSITIVE, lambda x: {"home_switch": 3000 < x < 4000, "right_switch": x > 2000}),
    ],
)
def test_reference_search_finds_the_switch(mode: int, closed: Callable[[float], dict[str, bool]]) -> None:
    module = Module()
    axis, true = module.axes[0], 0.0
    module.serial(H.to_serial(H.put(0, T.SEARCH_MODE, mode)))
    module.serial(H.to_serial(H.search(0, T.SEARCH_START)))
    for _ in range(20000):
        for name, state in closed(true).items():
            setattr(axis, name, state)
        axis.advance(1e-3)
        true += axis.speed * 1e-3
        if not axis.search_phase:
            break
    assert SerialReplies().feed(module.serial(H.to_serial(H.search(0, T.SEARCH_STATUS))))[0].value == 0
    assert axis.position == 0.0
    assert abs(abs(true) - 3000) < 5


REQUESTS = st.builds(lambda *r: H.to_serial(Request(*r)), *[st.integers(0, 255)] * 3, st.integers(-(2**31), 2**31 - 1))


@given(st.lists(st.one_of(st.binary(max_size=20), REQUESTS)))
@settings(max_examples=300, deadline=None)
def test_no_bytes_raise_on_either_side(pieces: list[bytes]) -> None:
    module, line, stepper = Module(), SerialReplies(), Stepper()
    for k, piece in enumerate(pieces):
        out = module.serial(piece)
        stepper.step(k * 100 * MS, line.feed(out + piece))
        for data in (piece[:7], piece[:8]):
            for identifier, answer in module.can(1, data):
                H.from_can(identifier, answer)
        module.advance(1e-3)


@given(st.integers(0, 8), st.integers(1, 255))
def test_a_wrong_byte_gives_no_answer(at: int, flip: int) -> None:
    datagram = bytearray(bytes.fromhex("02 01 64 06 00 12 34 56 09"))
    assert SerialReplies().feed(bytes(datagram)) == [Reply(100, 6, 0x123456)]
    datagram[at] ^= flip
    line = SerialReplies()
    assert line.feed(bytes(datagram)) == []
    assert line.feed(bytes.fromhex("02 01 64 06 00 00 00 07 74") * 2)[-1] == Reply(100, 6, 7)


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_only_the_right_can_frame_is_an_answer(identifier: int, data: bytes) -> None:
    found = H.from_can(identifier, data)
    if found is not None:
        assert identifier == 2
        assert data[0] == 1
        assert len(data) in (7, 8)


def test_nan_is_standing_still() -> None:
    assert H.rotate(0, nan) == Request(T.ROTATE_RIGHT, 0, 0, 0)


@contextmanager
def served(take: Callable[[Module], None]) -> Iterator[Module]:
    """The module in a thread, moving by the clock."""
    module, end = Module(), threading.Event()

    def serve() -> None:
        last = time.monotonic()
        while not end.is_set():
            take(module)
            now = time.monotonic()
            while last + 1e-3 <= now:
                module.advance(1e-3)
                last += 1e-3

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield module
    finally:
        end.set()
        thread.join()


def drive(client: Any, module: Module) -> None:
    """What the vendor's client does with our module, on any line."""
    from pytrinamic.modules import TMCM1241
    from pytrinamic.tmcl import TMCLReplyStatusError

    assert client.get_version_string() == "1241V110"
    board = TMCM1241(client)
    motor = board.motors[0]
    motor.set_axis_parameter(motor.AP.MaxVelocity, 40000)
    motor.set_axis_parameter(motor.AP.MaxAcceleration, 400000)
    assert motor.get_axis_parameter(motor.AP.MaxVelocity) == 40000
    with pytest.raises(TMCLReplyStatusError) as caught:
        motor.get_axis_parameter(250)
    assert caught.value.status_code == T.WRONG_TYPE
    motor.move_to(-3000)
    end = time.monotonic() + 10
    while not motor.get_position_reached() and time.monotonic() < end:
        time.sleep(0.01)
    assert motor.get_axis_parameter(motor.AP.ActualPosition, signed=True) == -3000
    motor.rotate(5000)
    end = time.monotonic() + 10
    while motor.get_axis_parameter(motor.AP.ActualVelocity, signed=True) != 5000 and time.monotonic() < end:
        time.sleep(0.01)
    assert motor.get_axis_parameter(motor.AP.ActualVelocity, signed=True) == 5000
    module.axes[0].right_switch = True
    while motor.get_axis_parameter(motor.AP.ActualVelocity, signed=True) and time.monotonic() < end:
        time.sleep(0.01)
    assert motor.get_axis_parameter(motor.AP.RightEndstop) == 1
    assert motor.get_axis_parameter(motor.AP.ActualVelocity, signed=True) == 0
    motor.stop()


@pytest.mark.peers
@given(st.sampled_from([1, 2, 3, 5, 6, 13]), st.integers(0, 255), st.integers(0, 5), st.integers(-(2**31), 2**31 - 1))
def test_the_vendors_classes_read_our_requests_and_we_their_answers(instruction: int, kind: int, motor: int, value: int) -> None:
    tmcl = pytest.importorskip("pytrinamic.tmcl", reason="pytrinamic (the vendor's client) is not installed")
    theirs = tmcl.TMCLRequest(1, instruction, kind, motor, value)
    assert bytes(theirs.to_buffer()) == H.to_serial(Request(instruction, kind, motor, value))
    answer = bytes(tmcl.TMCLReply(2, 1, 100, instruction, value).to_buffer())
    assert SerialReplies().feed(answer) == [Reply(100, instruction, value)]
    assert H.from_can(2, answer[1:]) == H.from_can(2, answer[1:8]) == Reply(100, instruction, value)


@pytest.mark.peers
def test_the_vendors_client_drives_our_module_over_a_serial_line() -> None:
    connections = pytest.importorskip("pytrinamic.connections", reason="pytrinamic (the vendor's client) is not installed")
    master, slave = pty.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    os.set_blocking(master, False)

    def take(module: Module) -> None:
        try:
            os.write(master, module.serial(os.read(master, 1024)))
        except BlockingIOError:
            time.sleep(2e-4)

    with served(take) as module:
        client = connections.SerialTmclInterface(os.ttyname(slave), timeout_s=5)
        drive(client, module)
        client.close()
    os.close(master)
    os.close(slave)


@pytest.mark.peers
def test_the_vendors_client_drives_our_module_over_can() -> None:
    interface = pytest.importorskip("pytrinamic.connections.can_tmcl_interface", reason="pytrinamic (the vendor's client) is not installed")
    can = pytest.importorskip("can")
    name = f"stepper-{time.monotonic_ns()}"
    bus = can.Bus(interface="virtual", channel=name)

    class Virtual(interface.CanTmclInterface):  # type: ignore[misc, name-defined]
        """The client's own CAN interface on python-can's virtual bus."""

        def __init__(self) -> None:
            super().__init__(name, 1_000_000, T.HOST, T.MODULE, 5)
            self._connection = can.Bus(interface="virtual", channel=name)

    def take(module: Module) -> None:
        message = bus.recv(2e-4)
        if message is not None:
            for identifier, data in module.can(message.arbitration_id, bytes(message.data)):
                bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    with served(take) as module:
        client = Virtual()
        drive(client, module)
        client.close()
    bus.shutdown()
