"""Decimation and axes of the plots."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.report.svg import (
    HEIGHT,
    WIDTH,
    Level,
    Panel,
    TimeAxis,
    Trace,
    auto_range,
    decimate_minmax,
    nice_ticks,
    path_of,
    render_panel,
    tick_labels,
)
from spsp_ctrl.report.text import MINUS, grouped, number


def decode(path: str) -> list[tuple[int, int]]:
    """Points of a trace, as the script in the page reads them."""
    points = []
    for run in path.split("M")[1:]:
        start, steps = run.split("l")
        x, y = map(int, start.split())
        numbers = list(map(int, steps.split()))
        for dx, dy in zip(numbers[::2], numbers[1::2], strict=True):
            x, y = x + dx, y + dy
            points.append((x, y))
    return points


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(1, 9000),
    columns=st.integers(1, 700),
    spikes=st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-1e6, 1e6)), max_size=5),
)
def test_decimation_keeps_the_extremes_of_every_column(
    seed: int, count: int, columns: int, spikes: list[tuple[float, float]]
) -> None:
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, 50.0, count))
    y = rng.standard_normal(count)
    for place, height in spikes:
        y[int(place * (count - 1))] = height
    y[rng.random(count) < 0.01] = np.nan
    index = decimate_minmax(t, y, columns)
    finite = np.flatnonzero(np.isfinite(y))
    assert np.all(np.diff(index) > 0)
    assert np.all(np.isfinite(y[index]))
    assert len(index) <= max(2 * columns + 2, 0)
    if not len(finite):
        assert not len(index)
        return
    assert {index[0], index[-1]} == {finite[0], finite[-1]}
    edges = np.linspace(t[finite[0]], t[finite[-1]], columns + 1)
    slot = np.searchsorted(edges[1:-1], t, side="right")
    for column in np.unique(slot[finite]):
        # One sample at a slot's edge may fall to either side by rounding: compare with the slot and its neighbours.
        inside = finite[slot[finite] == column]
        near = index[np.abs(slot[index] - column) <= 1]
        assert y[near].max() >= y[inside].max()
        assert y[near].min() <= y[inside].min()


@pytest.mark.parametrize("spike_at", [0, 1, 1234, 59_998, 59_999])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_single_spike_survives_into_the_path(spike_at: int, sign: float) -> None:
    t = np.arange(60_000) / 1000.0
    y = 0.1 * np.sin(t)
    y[spike_at] = 7.0 * sign
    axis = TimeAxis(60.0)
    y_range = auto_range(Panel("p", "", [Trace("y", t, y, "pitch")]))
    points = decode(path_of(Trace("y", t, y, "pitch"), axis, y_range))
    low, high = y_range
    values = np.array([high - py / HEIGHT * (high - low) for _, py in points])
    assert np.max(np.abs(values)) == pytest.approx(7.0, abs=(high - low) / HEIGHT)
    x = points[int(np.argmax(np.abs(values)))][0]
    assert x / WIDTH * 60.0 == pytest.approx(t[spike_at], abs=60.0 / WIDTH)


def test_a_gap_breaks_the_line_and_nothing_non_finite_is_written() -> None:
    t = np.arange(100.0)
    y = np.sin(t)
    y[40:50] = np.nan
    y[70] = np.inf
    path = path_of(Trace("y", t, y, "pitch"), TimeAxis(99.0), (-1.1, 1.1))
    assert path.count("M") == 3
    assert not re.search(r"nan|inf", path)


def test_a_flat_line_costs_two_points() -> None:
    t = np.arange(5000.0)
    assert len(decode(path_of(Trace("y", t, np.ones(5000), "pitch"), TimeAxis(5000.0), (0.0, 2.0)))) == 2


@given(low=st.floats(-1e5, 1e5), span=st.floats(1e-4, 1e5), target=st.integers(2, 12))
def test_ticks_are_few_inside_and_even(low: float, span: float, target: int) -> None:
    ticks = nice_ticks(low, low + span, target)
    assert len(ticks) <= target + 2
    tolerance = 1e-6 * span + 1e-9 * abs(low)
    assert all(low - tolerance <= tick <= low + span + tolerance for tick in ticks)
    if len(ticks) > 2:
        steps = np.diff(ticks)
        assert np.ptp(steps) <= 1e-6 * steps[0] + 1e-9 * abs(low)


def test_tick_labels_share_their_precision_and_use_a_minus_sign() -> None:
    assert tick_labels([-0.5, 0.0, 0.5]) == [f"{MINUS}0.5", "0.0", "0.5"]
    assert tick_labels([0.0, 5.0]) == ["0", "5"]
    assert number(-0.0001, 2) == "0.00"
    assert number(float("nan")) == number(float("inf"), 1) == "\u2013"
    assert grouped(1234567.0) == "1\u202f234\u202f567"


@pytest.mark.parametrize(
    "y", [np.empty(0), np.full(10, np.nan), np.zeros(10), np.full(10, 1e300), np.array([np.inf, -np.inf, 0.0, 1.0])]
)
def test_any_data_makes_a_well_formed_panel(y: np.ndarray) -> None:
    trace = Trace("a <b> & c", np.arange(float(len(y))), y, "pitch", area=True)
    html = render_panel(Panel("t", "u", [trace], [Level(3.0, "3")]), TimeAxis(10.0, 2.0, (5.0,)))
    svg = html[html.index("<svg") : html.rindex("</svg>") + 6]
    ET.fromstring(svg)
    assert not re.search(r'"[^"]*\b(nan|inf)\b[^"]*"', svg)
    assert "a &lt;b&gt; &amp; c" in html


def test_a_far_level_does_not_flatten_the_data() -> None:
    t = np.arange(10.0)
    trace = Trace("y", t, np.sin(t), "pitch")
    assert auto_range(Panel("p", "", [trace], [Level(1.5, "near")]))[1] > 1.5
    assert auto_range(Panel("p", "", [trace], [Level(100.0, "far")]))[1] < 1.5
