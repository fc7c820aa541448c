"""Bus load: frame lengths by construction of the frame, the figures of the tables, and the refusal."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.devices.transport.bus_load import Traffic, load, refusal, worst_bits


def stuffed(bits: str) -> int:
    """Length after bit stuffing: after five equal bits comes the opposite one."""
    length, run, last = 0, 0, ""
    for bit in bits:
        run = run + 1 if bit == last else 1
        length, last = length + 1, bit
        if run == 5:
            length, last, run = length + 1, "1" if bit == "0" else "0", 1
    return length


@given(st.integers(0, 8), st.data())
def test_no_frame_is_longer_than_the_worst_one(size: int, data: st.DataObject) -> None:
    """Start, 11 bits, RTR, IDE, r0, 4 bits of length, data and 15 bits of checksum are stuffed; 10 bits of end and 3 of pause are not."""
    free = data.draw(st.text("01", min_size=34 + 8 * size - 1, max_size=34 + 8 * size - 1))
    assert stuffed("0" + free) + 13 <= worst_bits(size)


def test_the_worst_frame_exists_and_the_known_lengths_hold() -> None:
    for size in range(9):
        bits = 34 + 8 * size
        worst = ("00000" + "11110000" * 16)[:bits]
        assert stuffed(worst) + 13 == worst_bits(size)
    assert [worst_bits(n) for n in (0, 7, 8)] == [55, 125, 135]
    assert worst_bits(8, extended=True) == 160


def cyclic(rate_hz: float, resolvers: bool = False) -> list[Traffic]:
    """Two drives with eight-byte PDOs, SYNC, and two resolver nodes, as in the published arithmetic."""
    found = [Traffic("sync", 0, rate_hz, cyclic=True)]
    found += [Traffic(f"{name}: PDO", 8, rate_hz, cyclic=True) for name in ("rpdo 1", "rpdo 2", "tpdo 1", "tpdo 2")]
    return found + [Traffic(f"resolver {n}: PDO", 8, rate_hz, cyclic=True) for n in (1, 2)] * resolvers


def test_figures_of_the_table() -> None:
    assert load(cyclic(500), 1_000_000) == pytest.approx(0.2975)
    assert load(cyclic(1000), 1_000_000) == pytest.approx(0.595)
    assert load(cyclic(1000, True), 1_000_000) == pytest.approx(0.865)


def test_a_bus_that_is_too_full_is_refused_and_each_way_out_works() -> None:
    assert refusal("drives", cyclic(500, True), 1_000_000, 500) == ""
    text = refusal("drives", cyclic(1000, True), 1_000_000, 1000)
    assert text.startswith("rig.can.drives: 86 % of 1000000 bit/s")
    rate = int(re.search(r"rate_hz (\d+)", text)[1])  # type: ignore[index]
    assert refusal("drives", cyclic(rate, True), 1_000_000, rate) == ""
    assert refusal("drives", cyclic(rate + 1, True), 1_000_000, rate + 1)
    text = refusal("drives", cyclic(500, True), 500_000, 500)
    faster = int(re.search(r"bitrate (\d+)", text)[1])  # type: ignore[index]
    assert refusal("drives", cyclic(500, True), faster, 500) == ""
