"""The azimuth axis in its play: where it stands, and that what the base asks of it is followed without the rattle."""

from __future__ import annotations

from math import cos, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.control.backlash import play
from spsp_ctrl.control.law import _track

ANGLE = st.floats(-1.0, 1.0)


@given(ANGLE, ANGLE, st.floats(0.0, 0.1))
def test_driven_side_stays_within_the_play_and_moves_no_more_than_it_must(before: float, driving: float, half: float) -> None:
    after = play(before, driving, half)
    assert abs(after - driving) <= half + 1e-12
    if abs(before - driving) <= half:
        assert abs(after - before) <= 1e-15


def test_reversal_crosses_the_whole_play_before_anything_moves() -> None:
    place, seen = 0.0, []
    for driving in (0.001, 0.002, 0.0015, 0.0014, 0.001):
        place = play(place, driving, 3e-4)
        seen.append(place)
    assert seen == pytest.approx([0.0007, 0.0017, 0.0017, 0.0017, 0.0013])


def test_without_play_the_platform_is_where_the_stepper_is() -> None:
    assert play(0.3, 0.1, 0.0) == 0.1


@pytest.mark.parametrize(("f_hz", "least", "most"), [(0.25, 0.98, 1.03), (10.0, 0.0, 0.45)], ids=["swing", "rattle"])
def test_tracking_filter_passes_the_swing_and_not_the_rattle(f_hz: float, least: float, most: float) -> None:
    value = slope = 0.0
    c = s = 0.0
    for k in range(20_000):
        x = 2.0 * pi * f_hz * k * 1e-3
        value, slope = _track(value, slope, sin(x), 2.0 * pi * 2.0, 1e-3)
        if k >= 12_000:
            c, s = c + value * cos(x), s + value * sin(x)
    assert least <= (c * c + s * s) ** 0.5 / 4000.0 <= most


def test_tracking_filter_does_not_lag_behind_a_ramp() -> None:
    value = slope = 0.0
    for k in range(5000):
        value, slope = _track(value, slope, 0.5e-3 * k, 2.0 * pi * 2.0, 1e-3)
    assert value == pytest.approx(0.5e-3 * 4999, abs=1e-4)
    assert slope == pytest.approx(0.5, rel=1e-3)
