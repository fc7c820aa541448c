"""Each trouble on a line is named within its declared time, and nothing is said of a line that is well."""

from __future__ import annotations

import struct
from random import Random

import pytest

from spsp_ctrl.devices import mip_table as M
from spsp_ctrl.devices.mip_device import ImuState, MipImu
from spsp_ctrl.devices.mip_host import PacketParser, message_format, resume, stream
from spsp_ctrl.devices.watch_host import FROZEN_STAMP_NS, GARBAGE_NS, StampWatch, StreamWatch, TwinWatch

CYCLE_NS = 2_000_000


def imu() -> MipImu:
    unit = MipImu()
    unit.receive(message_format(M.FILTER, ((M.REFERENCE_TIME, 1), (M.EULER, 1), (M.ANGULAR_RATE, 1))) + stream(M.FILTER, True) + resume())
    return unit


def wrong_speed(rng: Random, data: bytes, ratio: float) -> bytes:
    """What a receiver at ``ratio`` of the sender's speed samples: start bit, eight bits, stop bit, at its own pace."""
    line = "".join("0" + "".join(str(byte >> bit & 1) for bit in range(8)) + "1" for byte in data)
    found, at = bytearray(), 0.0
    while (at := line.find("0", int(at))) >= 0 and at + 9.5 / ratio < len(line):
        found.append(sum(int(line[int(at + (1.5 + bit) / ratio)]) << bit for bit in range(8)))
        at += 9.6 / ratio
    return bytes(found)


@pytest.mark.parametrize(("kind", "name"), [("good", ""), ("silent", "silent"), ("noise", "garbage"), ("slow", "wrong-baud"), ("fast", "wrong-baud")])
def test_a_stream_is_judged_by_its_packets(kind: str, name: str) -> None:
    rng, unit, parser, watch = Random(1), imu(), PacketParser(), StreamWatch("imu", 115_200)
    begin = 500 if kind in ("silent", "noise") else 0  # these begin on a line that was well
    said: list[tuple[int, str]] = []
    for cycle in range(1000):
        good = unit.sample(cycle * CYCLE_NS, ImuState(0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
        data = {"noise": rng.randbytes(48), "silent": b"", "slow": wrong_speed(rng, good, 0.5), "fast": wrong_speed(rng, good, 4.0)}.get(kind, good)
        data = data if cycle >= begin else good
        found, text = watch.step(cycle * CYCLE_NS, len(data), len(parser.feed(data)))
        if found:
            said.append((cycle, found))
            assert "imu" in text
    assert {n for _, n in said} == ({name} if name else set())
    if name:
        assert (said[0][0] - begin) * CYCLE_NS <= GARBAGE_NS + CYCLE_NS


def test_two_nodes_with_one_number_are_named_within_three_syncs() -> None:
    watch = TwinWatch("drive_pitch", 1)
    for cycle in range(20):
        assert watch.sync(cycle * CYCLE_NS) == ("", "")
        watch.status()
    names = []
    for cycle in range(20, 25):
        names.append(watch.sync(cycle * CYCLE_NS)[0])
        watch.status()
        watch.status()
    assert names == ["", "", "", "node-twice", "node-twice"]
    assert "number 1" in watch.sync(0)[1]


def test_one_late_status_is_no_second_node() -> None:
    """On wires a status may come just after the next SYNC: then one cycle has none and the other two."""
    watch = TwinWatch("drive_pitch", 1)
    for cycle in range(0, 4000):
        assert watch.sync(cycle * CYCLE_NS) == ("", "")
        for _ in range({0: 0, 1: 2}.get(cycle % 500, 1)):
            watch.status()


@pytest.mark.parametrize("rate_hz", [100, 200, 500, 1000])
def test_a_frozen_stamp_is_named_in_time_and_a_running_one_never(rate_hz: int) -> None:
    watch, period = StampWatch("imu"), 1_000_000_000 // rate_hz
    for n in range(100):
        assert watch.step(n * period, struct.unpack(">Q", (n * period).to_bytes(8, "big"))[0]) == ("", "")
    frozen_ns = 99 * period
    n = 100
    while not (found := watch.step(n * period, frozen_ns))[0]:
        n += 1
        assert n * period - frozen_ns <= FROZEN_STAMP_NS + period
    assert found[0] == "frozen-stamp"
    assert watch.step((n + 1) * period, (n + 1) * period) == ("", "")
