"""Rod demand of a motion: the table of travel, speed and acceleration, and that each is the derivative of the one before."""

from __future__ import annotations

from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spsp_ctrl.config.loader import load_scenario
from spsp_ctrl.config.scenario import BaseMotion, ReferencePlan, Sine
from spsp_ctrl.experiments.motion import RATE_HZ, common_period_s, motion_demand
from spsp_ctrl.mechanism.workspace import Travel

LIMIT = radians(20.0)
PAPER = Travel(0.2655, 0.1, 0.1, LIMIT, LIMIT, -0.0341, 0.0343)
CONFIG = Path(__file__).parents[2] / "config"


def sine(amplitude_deg: float, period_s: float, phase_deg: float = 0.0) -> tuple[Sine, ...]:
    return (Sine(amplitude_deg=amplitude_deg, period_s=period_s, phase_deg=phase_deg),)


STILL, LEVEL = BaseMotion(), ReferencePlan()
BOTH = {"pitch": sine(6, 4), "roll": sine(15, 8)}
# (low, high, speed, acceleration) in mm and s of the pitch and of the roll rod; None where nothing moves
DESIGN = ReferencePlan(kind="joint", pitch=sine(15, 4), roll=sine(20, 8))
ROWS: dict[str, tuple[BaseMotion, ReferencePlan, bool, Any, Any]] = {
    "section 3.2": (STILL, DESIGN, False, (-25.9, 25.9, 41.1, 62.6), (-34.1, 34.3, 27.4, 26.7)),
    "open loop 8 deg": (STILL, ReferencePlan(kind="joint", roll=sine(8, 8)), False, None, (-13.9, 13.9, 11.0, 8.5)),
    "roll 5": (BaseMotion(roll=sine(5, 8)), LEVEL, False, None, (-8.7, 8.7, 6.9, 5.4)),
    "roll 10": (BaseMotion(roll=sine(10, 8)), LEVEL, False, None, (-17.4, 17.4, 13.7, 10.6)),
    "roll 15": (BaseMotion(roll=sine(15, 8)), LEVEL, False, None, (-25.9, 25.9, 20.6, 15.6)),
    "pitch 6": (BaseMotion(pitch=sine(6, 4)), LEVEL, False, (-10.45, 10.45, 16.45, 25.7), None),
    "both, Rx Ry": (BaseMotion(**BOTH), LEVEL, False, (-10.45, 10.45, 16.45, 25.7), (-25.9, 25.9, 20.6, 16.3)),
    "both, Ry Rx, heading free": (BaseMotion(axis_order="pitch_roll", **BOTH), LEVEL, True, (-10.63, 10.63, 17.0, 26.2), (-25.9, 25.9, 20.6, 17.1)),
}  # fmt: skip


@pytest.mark.parametrize("name", ROWS)
def test_travel_speed_and_acceleration(name: str) -> None:
    base, reference, locked, *expected = ROWS[name]
    found = motion_demand(PAPER, base, reference, azimuth_locked=locked)
    for rod, row in zip((found.pitch_rod, found.roll_rod), expected, strict=True):
        values = [1e3 * v for v in (rod.low, rod.high, rod.speed, rod.accel)]
        assert values == pytest.approx(row or [0.0] * 4, abs=0.0501)


def test_azimuth_that_holds_the_heading_swings() -> None:
    """Base Ry Rx: azimuth has to turn by 1.2 degrees with 2.4 deg/s, and the pitch joint then moves less than with a free heading."""
    base = BaseMotion(axis_order="pitch_roll", **BOTH)
    found = motion_demand(PAPER, base, LEVEL)
    assert np.degrees(found.azimuth.high) == pytest.approx(1.204, abs=1e-3)
    assert np.degrees(found.azimuth.speed) == pytest.approx(2.439, abs=1e-3)
    assert np.degrees(found.pitch.high) == pytest.approx(5.898, abs=1e-3)
    free = motion_demand(PAPER, base, LEVEL, azimuth_locked=True)
    assert np.degrees(free.pitch.high) == pytest.approx(6.104, abs=1e-3)
    assert np.all(np.asarray(free.joints.azimuth_rad) == 0.0)


@pytest.mark.parametrize("locked", [False, True])
def test_each_is_the_derivative_of_the_one_before(locked: bool) -> None:
    base = BaseMotion(axis_order="pitch_roll", pitch=sine(6, 4, 30), roll=sine(15, 8), yaw=sine(20, 10))
    found = motion_demand(PAPER, base, LEVEL, azimuth_locked=locked)
    s1, s2, v1, v2, a1, a2 = found.rods
    joints = [np.asarray(x) for x in found.joints]
    pairs = [(s1, v1), (s2, v2), (v1, a1), (v2, a2), *zip(joints[:6], joints[3:], strict=True)]
    for value, rate in pairs:
        centred = (value[2:] - value[:-2]) * 0.5 * RATE_HZ
        assert np.abs(centred - rate[1:-1]).max() < 2e-5 * max(1e-3, float(np.abs(rate).max()))


def test_the_scenario_of_the_rig_keeps_within_its_travel() -> None:
    plan = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
    found = motion_demand(PAPER, plan.base, plan.reference)
    assert found.roll_rod.low > PAPER.stroke_min_m
    # roughness is in it: a little more acceleration than the two sines alone
    assert 1e3 * found.roll_rod.accel > 17.0


def test_common_period() -> None:
    assert common_period_s([]) == 1.0
    assert common_period_s([*sine(1, 4), *sine(1, 8)]) == 8.0
    assert common_period_s([*sine(1, 1.5), *sine(1, 2.5)]) == 7.5
    assert common_period_s([*sine(1, 7.919), *sine(1, 7.907)]) == 600.0


def test_locked_azimuth_cannot_hold_a_tilt() -> None:
    with pytest.raises(ValueError, match="held level"):
        motion_demand(PAPER, BaseMotion(roll=sine(5, 8)), ReferencePlan(pitch_deg=3.0), azimuth_locked=True)
