"""Slow temperatures: held when they are silent or impossible, derating, and the stop when a screw is too hot."""

from __future__ import annotations

from itertools import pairwise
from math import nan
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.messages import NO_TEMPERATURE, TemperatureSample
from spsp_ctrl.safety import temperature
from spsp_ctrl.safety.temperature import SHARES, TemperatureState, temperature_limits

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
P = temperature_limits(RIG)
MS = 1_000_000


def sample(n: int, pitch: float = 20.0, roll: float = 20.0, column: float = 20.0, frame: float = 20.0) -> TemperatureSample:
    return TemperatureSample(n * 100 * MS, n, pitch, roll, column, frame)


def play(samples: list[TemperatureSample], s: TemperatureState = temperature.START) -> tuple[str, TemperatureState]:
    name = ""
    for t in samples:
        fault, s = temperature.step(s, P, t, t.stamp_ns)
        name = fault.id if fault else ""
    return name, s


def test_constants() -> None:
    assert (P.derating_from_c, P.max_c, P.hot_ns) == (75.0, 90.0, 200 * MS)
    assert SHARES[0] == 1.0
    assert all(a > b > 0.0 for a, b in pairwise(SHARES))


def test_silence() -> None:
    for at_ns in (0, 10_000 * MS):  # never there: not fitted
        assert temperature.step(temperature.START, P, NO_TEMPERATURE, at_ns) == (None, temperature.START)
    name, s = play([sample(0), sample(1)])
    assert name == ""
    last = sample(1)
    assert temperature.step(s, P, last, 1600 * MS)[0] is None
    stale, s = temperature.step(s, P, last, 1600 * MS + 1)
    assert stale is not None
    assert stale.id == "temperature-stale"
    assert s.good == last
    assert temperature.step(s, P, sample(17), 1700 * MS)[0] is None
    # a sample from the future is not taken yet
    _, early = temperature.step(s, P, sample(30), 1700 * MS)
    assert early.good == last
    assert temperature.step(s, P, sample(18), 1800 * MS)[1].good == sample(18)


@pytest.mark.parametrize("field", ["screw_pitch_c", "screw_roll_c", "column_c", "frame_c"])
@pytest.mark.parametrize(("value", "held"), [(23.0, False), (17.0, False), (23.1, True), (16.9, True), (nan, True)])
def test_jumps_are_held(field: str, value: float, held: bool) -> None:
    name = "temperature-jump" if held else ""
    _, s = play([sample(0), sample(1)])
    hurt = sample(2)._replace(**{field: value})
    got, after = play([hurt], s)
    assert got == name
    assert (after.good == hurt) == (name == "")
    # the verdict holds until the next sample, which may be good again
    again, _ = temperature.step(after, P, hurt, 250 * MS)
    assert (again.id if again else "") == name
    assert play([sample(3)], after)[0] == ""


@pytest.mark.parametrize(("value", "name"), [(-40.0, ""), (-40.1, "temperature-jump"), (120.1, "temperature-jump")])
def test_impossible_temperatures_are_not_even_a_start(value: float, name: str) -> None:
    got, s = play([sample(0, column=value)])
    assert got == name or (name and got == "temperature-jump")
    assert (s.good.seq == 0) == (name == "")
    got, _ = play([sample(0, pitch=119.0, roll=119.0)])
    assert got == "derating"
    assert play([sample(0, frame=120.0)])[0] == ""


def test_a_value_that_stays_away_becomes_the_new_start() -> None:
    _, s = play([sample(0)])
    names = []
    for n in range(1, 24):
        name, s = play([sample(n, pitch=40.0)], s)
        names.append(name)
    assert names == ["temperature-jump"] * 20 + [""] * 3


@pytest.mark.parametrize("screw", ["pitch", "roll"])
def test_derating_in_steps_and_then_a_stop(screw: str) -> None:
    s = temperature.START
    seen = []
    for n, value in enumerate((74.0, 75.0, 75.5, 77.0, 79.9, 80.1, 82.0, 84.9, 85.1, 87.0, 89.0, 90.0)):
        name, s = play([sample(n, **{screw: value})], s)
        seen.append((name, s.share))
    assert seen == [("", 0), ("", 0), *[("derating", 1)] * 3, *[("derating", 2)] * 3, *[("derating", 3)] * 4]
    names = []
    for n in range(12, 17):
        name, s = play([sample(n, **{screw: 90.5})], s)
        names.append(name)
        assert s.share == 3
    assert names == ["derating", "derating", "overtemperature", "overtemperature", "overtemperature"]
    name, s = play([sample(17, **{screw: 89.0})], s)
    assert (name, s.hot_since) == ("derating", 0)
    s = temperature.START._replace(good=sample(0, pitch=89.0), seq=0)
    assert temperature.step(temperature.START, P, sample(0, pitch=91.0), 0)[1].hot_since == 1
    assert temperature.step(s, P, sample(1, pitch=91.0), 100 * MS)[1].hot_since == 100 * MS
