"""Each trouble of a bus, a line or a node is named within its declared time, in words that say where: through the whole rig, to the event log."""

from __future__ import annotations

import os
import struct
import tty
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import pytest
from tests.rig.lockstep_devices import Wired, rig_config

from spsp_ctrl.devices import mip_table as M
from spsp_ctrl.devices.cia402_device import Drive, MotorReading
from spsp_ctrl.devices.mip_device import ImuState
from spsp_ctrl.devices.transport.base import ALL_WELL
from spsp_ctrl.devices.transport.serial_line import SerialLine
from spsp_ctrl.devices.transport.trouble import fault
from spsp_ctrl.devices.watch_host import FROZEN_STAMP_NS, GARBAGE_NS, REPEATS, TWINS_SYNCS
from spsp_ctrl.messages import Command
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.bus import BusRig
from spsp_ctrl.rig.line_watch import Note

PERIOD_NS = 1_000_000
BEGIN = 300
"""Cycle in which the trouble begins."""


class Session:
    """A rig on simulated devices without a plant, cycle by cycle."""

    def __init__(self) -> None:
        self.config = rig_config()
        self.wired = Wired(self.config)
        self.rig = BusRig(self.config, self.wired.can, self.wired.serial)
        self.every = round(1e9 / self.config.imu.rate_hz / PERIOD_NS)
        self.imu: Callable[[int, bytes], bytes] = lambda cycle, data: data
        """What becomes of the bytes of an IMU frame."""
        self.device_ns: Callable[[int], int] = lambda now_ns: now_ns
        self.before: Callable[[int], None] = lambda cycle: None
        self.notes: list[tuple[int, Note]] = []
        self.measured: list[Any] = []

    def run(self, cycles: int) -> None:
        self.rig.open()
        for cycle in range(cycles):
            now_ns = cycle * PERIOD_NS
            self.before(cycle)
            if cycle % self.every == 0:
                data = self.wired.devices.imu.sample(self.device_ns(now_ns), ImuState(0.1, 0.2, 0.3, 0.01 * (cycle % 7), 0.0, 0.0))
                self.wired.serial["imu"].deliver(self.imu(cycle, data), now_ns)
            self.measured.append(self.rig.read(now_ns))
            self.rig.write(Command(now_ns, cycle, True, 0.1, 1.0, 0.1, 1.0, 0.0), now_ns)
            self.notes += [(cycle, note) for note in self.rig.notes()]

    def first(self, name: str) -> int:
        """Cycles from the begin of the trouble until it was named."""
        found = [cycle - BEGIN for cycle, note in self.notes if note.id == name and note.level == "error"]
        assert found, f"{name} is not among {self.notes}"
        return found[0]


@pytest.fixture
def session() -> Session:
    return Session()


def test_a_rig_that_is_well_says_nothing(session: Session) -> None:
    session.run(1000)
    assert session.notes == []
    assert session.measured[-1].imu.seq > 190


def test_garbage_on_the_line(session: Session) -> None:
    rng = Random(1)
    session.imu = lambda cycle, data: rng.randbytes(48) if BEGIN <= cycle < 700 else data
    session.run(1000)
    assert 0 <= session.first("garbage") * PERIOD_NS <= GARBAGE_NS + session.every * PERIOD_NS
    (_, begin), (cycle, end) = session.notes
    assert "imu" in begin.text
    assert (end.level, end.id) == ("info", "garbage")
    assert end.text.startswith("over: ")
    assert 700 <= cycle < 720


def test_a_line_that_falls_silent(session: Session) -> None:
    session.imu = lambda cycle, data: data if cycle < BEGIN else b""
    session.run(600)
    assert session.first("silent") * PERIOD_NS <= GARBAGE_NS + session.every * PERIOD_NS


def test_a_frozen_time_stamp(session: Session) -> None:
    session.device_ns = lambda now_ns: min(now_ns, BEGIN * PERIOD_NS)
    session.run(600)
    assert 0 < session.first("frozen-stamp") * PERIOD_NS <= FROZEN_STAMP_NS + session.every * PERIOD_NS
    assert {note.id for _, note in session.notes} == {"frozen-stamp"}
    # the judge of the loop sees an IMU that grows old, though frames keep coming
    old = session.measured[-1]
    assert old.stamp_ns - old.imu.stamp_ns > 200_000_000


def test_two_nodes_with_one_number_in_operation(session: Session) -> None:
    """A second drive that was in pre-operational and is started: it maps the same status."""
    twin = Drive(1, rated_current_ma=2500)

    def before(cycle: int) -> None:
        if cycle == BEGIN:
            twin.receive((0, b"\x01\x01"))
            session.wired.media["can0"].serve(lambda identifier, data: twin.receive((identifier, data)))

    session.before = before
    session.run(400)
    assert session.first("node-twice") <= TWINS_SYNCS + 1
    assert "drive_pitch: node 1" in session.notes[0][1].text


def test_two_nodes_with_one_number_at_start_up(session: Session) -> None:
    twin = Drive(2, rated_current_ma=2500)
    session.wired.media["can0"].serve(lambda identifier, data: twin.receive((identifier, data)))
    with pytest.raises(RigError, match="two devices answer with the number 2"):
        session.rig.open()


@pytest.mark.parametrize(("answer", "text"), [(bytes(30), "bytes have arrived that are no answer; is it at 115200 baud"), (b"", "not one byte")])
def test_a_wrong_baud_rate_and_a_dead_line_at_start_up(session: Session, answer: bytes, text: str) -> None:
    session.wired.serial["imu"].receive = lambda data: answer
    with pytest.raises(RigError, match=text):
        session.rig.open()


def test_a_motor_that_is_braked_repeats_nothing(session: Session) -> None:
    """From 40 counts a cycle to rest within eight cycles, then at rest for long."""
    drive = session.wired.devices.drives[0].drive  # type: ignore[attr-defined]
    place = 0

    def before(cycle: int) -> None:
        nonlocal place
        place += 40 if cycle < BEGIN else max(0, 40 - 5 * (cycle - BEGIN))
        drive.motor = MotorReading(place, 300)

    session.before = before
    session.run(500)
    assert session.notes == []


def test_a_frozen_status_while_moving_is_named_and_comes_through_as_new_samples_of_one_position(session: Session) -> None:
    """What the judge needs to act: sequence and stamp go on, the count stands though the command turns the motor."""
    drive = session.wired.devices.drives[0].drive  # type: ignore[attr-defined]

    def before(cycle: int) -> None:
        drive.motor = MotorReading(min(cycle, BEGIN) * 40, 300)

    session.before = before
    session.run(400)
    frozen = [m.resolver_pitch for m in session.measured[BEGIN + 2 :]]
    assert len({s.counts for s in frozen}) == 1
    assert len({s.seq for s in frozen}) == len({s.stamp_ns for s in frozen}) == len(frozen)
    moving = [m.resolver_pitch.counts for m in session.measured[10:BEGIN]]
    assert len(set(moving)) == len(moving)
    assert session.first("frozen-status") <= REPEATS + 1
    assert "drive_pitch: turned at 40 counts" in session.notes[0][1].text


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for fd in (master, slave):
        try:
            os.close(fd)
        except OSError:
            continue


def test_an_unplugged_serial_port_is_named_within_a_cycle(session: Session, terminal: tuple[int, str]) -> None:
    """The IMU behind a real port, which goes away."""
    master, port = terminal
    line = SerialLine(port)
    unit = session.wired.devices.imu
    rig = BusRig(session.config, session.wired.can, {**session.wired.serial, "imu": _Answered(line, master, unit.receive)})
    rig.identify()
    named_at = -1
    for cycle in range(BEGIN + 50):
        if cycle == BEGIN:
            os.close(master)
        elif cycle < BEGIN and cycle % session.every == 0:
            os.write(master, unit.sample(cycle * PERIOD_NS, ImuState(0.1, 0.2, 0.3, 0.0, 0.0, 0.0)))
        rig.read(cycle * PERIOD_NS)
        rig.write(Command(cycle * PERIOD_NS, cycle, False, 0.0, 0.0, 0.0, 0.0, 0.0), cycle * PERIOD_NS)
        for note in rig.notes():
            assert (note.level, note.id) == ("error", "unplugged")
            assert port in note.text
            named_at = cycle
    assert BEGIN <= named_at <= BEGIN + 1
    rig.stop()
    rig.close()


class _Answered:
    """A real port; what is sent to it is answered at its other end at once, by one process."""

    immediate = False

    def __init__(self, line: SerialLine, master: int, receive: Callable[[bytes], bytes]) -> None:
        self._line, self._master, self._receive = line, master, receive

    @property
    def fault(self) -> Any:
        return self._line.fault

    def poll(self, now_ns: int) -> list[tuple[int, bytes]]:
        return self._line.poll(now_ns)

    def send(self, data: bytes) -> bool:
        done = self._line.send(data)
        if data:
            os.write(self._master, self._receive(os.read(self._master, 4096)))
        return done

    def close(self) -> None:
        self._line.close()


def test_a_bus_of_the_drives_that_fails_is_told_to_the_loop(session: Session) -> None:
    """Bus-off of the adapter: an event, and the name that the session maps to a fault of its table."""
    bus = session.wired.can["can0"]

    def before(cycle: int) -> None:
        if cycle == BEGIN:
            bus.fault = fault("bus-off", "can0")
        if cycle == BEGIN + 20:
            bus.fault = ALL_WELL

    session.before = before
    session.run(BEGIN + 10)
    assert session.first("bus-off") == 0
    assert session.rig.trouble() == "bus-off"
    session.run(BEGIN + 30)
    assert session.rig.trouble() == ""
    assert [note.level for _, note in session.notes if note.id == "bus-off"] == ["error", "info"]


def test_a_device_clock_of_the_unit_is_what_is_watched() -> None:
    """The stamp is the one in the bytes: reference time of the filter set, nanoseconds since power-up."""
    session = Session()
    session.run(20)
    field = struct.pack(">Q", 15 * PERIOD_NS)
    assert len(field) == struct.calcsize(M.TIME_NS)
    assert session.rig.devices["imu"].device_ns == 15 * PERIOD_NS
