"""Stamps of a device on the control clock: drift, jitter of arrival, a device that was reset."""

from __future__ import annotations

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.devices.clock_host import DeviceClock

MS = 1_000_000


@given(st.integers(0, 2**32), st.floats(-100e-6, 100e-6), st.integers(-(10**15), 10**15), st.integers(0, 3 * MS))
@settings(max_examples=60, deadline=None)
def test_error_is_bounded_by_drift_and_the_shortest_delay(seed: int, drift: float, offset: int, delay: int) -> None:
    """200 Hz, arrival delayed by up to 3 ms on top of a known delay: the stamp is right within 0.4 ms once a window is full."""
    draw, clock, last = random.Random(seed), DeviceClock(delay), -(10**18)
    for k in range(600):
        true = 5 * MS * k + abs(offset) + 10**6
        device = round((5 * MS * k) * (1.0 + drift))
        received = true + delay + round(3 * MS * draw.random() ** 2)
        stamp = clock.stamp(device, received)
        assert last < stamp <= received
        last = stamp
        if k > 120:
            assert abs(stamp - true) < 0.4 * MS
    assert clock.restarts == 0


def test_a_reset_of_the_device_starts_anew() -> None:
    clock = DeviceClock()
    for k in range(100):
        clock.stamp(10**9 + k * 5 * MS, k * 5 * MS)
    assert clock.stamp(0, 500 * MS) == 500 * MS
    assert clock.restarts == 1
    assert clock.stamp(5 * MS, 506 * MS) == 505 * MS


def test_without_a_stamp_arrival_counts() -> None:
    assert DeviceClock().stamp(-1, 123) == 123


@given(st.lists(st.tuples(st.integers(-1, 2**64), st.integers(0, 2**62)), max_size=50))
def test_any_numbers_give_a_stamp_that_is_not_in_the_future(pairs: list[tuple[int, int]]) -> None:
    clock = DeviceClock()
    for device, received in pairs:
        assert clock.stamp(device, received) <= received
