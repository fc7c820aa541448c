"""The serial line on a pseudo-terminal: batches, a full queue, an unplugged port. Nothing raises once it is open."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator
from contextlib import suppress

import pytest

from spsp_ctrl.devices.transport.base import TransportError
from spsp_ctrl.devices.transport.opening import open_serial
from spsp_ctrl.devices.transport.serial_line import SerialLine


@pytest.fixture
def ends() -> Iterator[tuple[int, str]]:
    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for fd in (master, slave):
        with suppress(OSError):
            os.close(fd)


def test_all_that_is_there_comes_in_one_piece(ends: tuple[int, str]) -> None:
    line = open_serial(ends[1], 921_600)
    assert line.poll(0) == []
    os.write(ends[0], b"one")
    os.write(ends[0], b"two")
    (stamp, data), *rest = line.poll(0)
    assert (data, rest) == (b"onetwo", [])
    assert stamp > 0
    assert line.send(b"three")
    assert os.read(ends[0], 100) == b"three"
    assert line.fault.id == ""
    line.close()
    line.close()
    assert line.poll(0) == []
    assert not line.send(b"x")


def test_a_full_queue_is_named_loses_no_half_message_and_recovers(ends: tuple[int, str]) -> None:
    line = SerialLine(ends[1])
    message = bytes(range(200))
    taken = 0
    while line.send(message):
        taken += 1
        assert taken < 10_000
    assert line.fault.id == "queue-full"
    os.set_blocking(ends[0], False)
    got = b""
    for _ in range(10_000):
        try:
            got += os.read(ends[0], 65_536)
        except BlockingIOError:
            if len(got) == taken * len(message):
                break
        line.poll(0)
    assert got == message * taken
    assert line.fault.id == ""
    assert line.send(message)
    line.close()


def test_an_unplugged_port_is_named_in_the_next_poll(ends: tuple[int, str]) -> None:
    line = SerialLine(ends[1])
    os.close(ends[0])
    assert line.poll(0) == []
    assert line.fault.id == "unplugged"
    assert ends[1] in line.fault.text
    assert not line.send(b"x")
    assert line.poll(0) == []
    assert line.fault.id == "unplugged"
    line.close()


def test_what_cannot_be_opened_says_why(ends: tuple[int, str], tmp_path: os.PathLike[str]) -> None:
    with pytest.raises(TransportError, match="no such port"):
        open_serial("/dev/tty-not-there", 115_200)
    first = SerialLine(ends[1])
    with pytest.raises(TransportError, match="in use by another program"):
        open_serial(ends[1], 115_200)
    first.close()
    with pytest.raises(TransportError, match="cannot be opened"):
        open_serial(str(tmp_path), 115_200)
