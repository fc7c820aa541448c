"""Limits of a rate demand, bit by bit: which limit acts, by how much, and that braking always suffices."""

from __future__ import annotations

from math import sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.control.limits import ACCELERATION, SPEED, TRAVEL, limit_rate

LOW, HIGH, TOP, ACCEL, DT = -1.0, 2.0, 0.5, 4.0, 0.01


def limited(rate: float, before: float, position: float = 0.0, top: float = TOP) -> tuple[float, int]:
    return limit_rate(rate, before, position, LOW, HIGH, top, ACCEL, DT)


@pytest.mark.parametrize(
    ("rate", "before", "wanted", "bits"),
    [
        (0.3, 0.3, 0.3, 0),
        (0.5, 0.5, 0.5, 0),
        (-0.5, -0.5, -0.5, 0),
        (0.6, 0.5, 0.5, SPEED),
        (-0.6, -0.5, -0.5, SPEED),
        (0.3, 0.0, 0.04, ACCELERATION),
        (0.04, 0.0, 0.04, 0),
        (-0.3, 0.0, -0.04, ACCELERATION),
        (-0.04, 0.0, -0.04, 0),
        (0.0, 0.3, 0.26, ACCELERATION),
        (0.9, 0.0, 0.04, SPEED | ACCELERATION),
        (-0.9, 0.0, -0.04, SPEED | ACCELERATION),
        (0.0, 0.0, 0.0, 0),
    ],
)
def test_speed_and_acceleration(rate: float, before: float, wanted: float, bits: int) -> None:
    got, acted = limited(rate, before)
    assert got == pytest.approx(wanted, abs=1e-12)
    assert acted == bits


@pytest.mark.parametrize(("position", "sign"), [(HIGH - 0.02, 1.0), (LOW + 0.02, -1.0)])
def test_room_to_brake(position: float, sign: float) -> None:
    reaction = ACCEL * DT
    allowed = sqrt(reaction * reaction + 2.0 * ACCEL * (0.02 - 0.5 * DT)) - reaction
    got, acted = limited(sign * 0.5, sign * 0.5, position)
    assert got == pytest.approx(sign * allowed, rel=1e-9)
    assert acted == TRAVEL
    # the other way is free
    assert limited(-sign * 0.5, -sign * 0.5, position) == (-sign * 0.5, 0)
    # and so is what is slower than allowed
    assert limited(sign * 0.3, sign * 0.3, position) == (sign * 0.3, 0)


@pytest.mark.parametrize("beyond", [0.0, 1e-9, 0.5])
def test_at_and_beyond_an_end_only_the_way_back_is_open(beyond: float) -> None:
    assert limited(0.3, 0.3, HIGH + beyond) == (0.0, TRAVEL)
    assert limited(-0.3, -0.3, LOW - beyond) == (0.0, TRAVEL)
    assert limited(-0.3, -0.3, HIGH + beyond) == (-0.3, 0)
    assert limited(0.3, 0.3, LOW - beyond) == (0.3, 0)


@settings(max_examples=60, deadline=None)
@given(st.floats(LOW, HIGH), st.floats(0.05, 3.0), st.lists(st.floats(-5.0, 5.0), min_size=30, max_size=30))
def test_no_sequence_of_demands_leaves_the_travel(position: float, top: float, demands: list[float]) -> None:
    before, rate = 0.0, 0.0
    for demand in demands:
        for _ in range(10):
            rate, _ = limited(demand, before, position, top)
            assert abs(rate) <= top
            # one cycle of dead time, as in the loop
            position += before * DT
            before = rate
            assert LOW - 1e-6 <= position <= HIGH + 1e-6
