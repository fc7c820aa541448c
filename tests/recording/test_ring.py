"""The ring between loop and writer: what goes in comes out, whole and in order, whatever the sizes; what is not published is not seen."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.recording import ring as ring_module
from spsp_ctrl.recording.frames import FRAME, MESSAGE
from spsp_ctrl.recording.ring import HEAD, Ring, create

CAPACITY = 400


@contextmanager
def both_ends(capacity: int = CAPACITY) -> Iterator[tuple[Ring, Ring]]:
    fd = create(capacity)
    ends = Ring(fd), Ring(fd)
    os.close(fd)
    try:
        yield ends
    finally:
        for end in ends:
            end.close()


def frame(k: int, size: int) -> bytes:
    return FRAME.pack(MESSAGE, k % 7, k, k, size) + bytes([k % 251]) * size


@pytest.mark.parametrize("in_order", [True, False])
@given(steps=st.lists(st.one_of(st.integers(0, CAPACITY - FRAME.size), st.none()), max_size=80))
def test_what_goes_in_comes_out(in_order: bool, steps: list[int | None]) -> None:
    """A number puts a payload of that size, None empties the ring."""
    with patch.object(ring_module, "IN_ORDER", in_order), both_ends() as (ring, other):
        expected: deque[tuple[int, int, int, int, bytes]] = deque()
        used = taken = 0

        def take(kind: int, number: int, log_time: int, sequence: int, payload: bytes) -> int:
            nonlocal taken
            assert expected.popleft() == (kind, number, log_time, sequence, payload)
            taken += 1
            return 1

        for k, size in enumerate(steps):
            if size is None:
                assert (other.drain(take) > 0) == (used > 0)
                assert not expected
                assert ring.backlog() == 0
                used = 0
            elif ring.put(frame(k, size)):
                expected.append((MESSAGE, k % 7, k, k, bytes([k % 251]) * size))
                used += FRAME.size + size
            else:
                # refused only with something else in the ring: what is larger than the rest of an empty one goes to the beginning
                assert ring.backlog() > 0
                used += 1
        other.drain(take)
        assert not expected
        assert ring.taken() == taken


def test_a_frame_as_large_as_the_ring_fits_wherever_the_last_one_ended() -> None:
    for before in range(0, CAPACITY - FRAME.size, 7):
        with both_ends() as (ring, other):
            assert ring.put(frame(0, before))
            other.drain(lambda *_: 1)
            whole = frame(1, CAPACITY - FRAME.size)
            if not ring.put(whole):
                # the rest of the ring is given up first
                assert other.drain(lambda *_: 1) > 0
                assert ring.put(whole)
            assert other.drain(lambda *_: 1) >= CAPACITY


def test_a_frame_that_is_not_published_is_not_seen() -> None:
    with both_ends() as (ring, other):
        at = ring.place(50)
        ring.data[at : at + 50] = frame(1, 50 - FRAME.size)
        assert other.drain(lambda *_: 1) == 0
        ring.publish(50)
        assert other.drain(lambda *_: 1) == 50


def test_a_damaged_ring_is_noticed() -> None:
    with both_ends() as (ring, other):
        ring.data[:19] = FRAME.pack(MESSAGE, 0, 0, 0, 10_000)
        ring._words[HEAD] = 50
        with pytest.raises(ValueError, match="damaged"):
            other.drain(lambda *_: 1)


def test_a_ring_needs_its_memory() -> None:
    fd = os.memfd_create("empty")
    with pytest.raises(ValueError, match="empty"):
        Ring(fd)
    os.close(fd)
