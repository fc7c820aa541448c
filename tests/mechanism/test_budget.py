"""Transmission budget: each row by hand, and the sums."""

from __future__ import annotations

from math import cos, radians
from pathlib import Path

import numpy as np
import pytest

from spsp_ctrl.config.loader import load_transmission
from spsp_ctrl.mechanism.budget import circumferential_backlash, largest_travel, rod_effect, transmission_budget

LENGTHS = (0.2655, 0.1, 0.1)
LIMIT = radians(20.0)
ARCMIN = 60.0 * 180.0 / np.pi
FILE = Path(__file__).parents[2] / "config/tolerances/transmission.yaml"


def test_rows() -> None:
    found = transmission_budget(load_transmission(FILE).model, LIMIT, LIMIT, LENGTHS)
    rods = {row.name: row.rod_m * 1e6 for row in found.rows}
    along = 50.0 / cos(radians(20.0))  # um on a radius of 24 mm, 4 mm of rod per turn
    assert rods == pytest.approx(
        {
            "backlash, pair on the screw": along / 24e3 / (2.0 * np.pi) * 4e3,
            "screw clearance": 8.0,
            "lead error": 0.35 * 34.263,
            "periodic lead error": 2.0,
            "resolver": 10.0 / 60.0 / 360.0 / 3.0 * 4e3,
            "thermal deformation": 265.5e3 * 11.5e-6 * 5.0,
        },
        abs=2e-3,
    )
    assert found.worst_m * 1e6 == pytest.approx(sum(rods.values()))
    assert found.rss_m * 1e6 == pytest.approx(np.sqrt(sum(v * v for v in rods.values())))
    assert found.play_m * 1e6 == pytest.approx(rods["backlash, pair on the screw"] + 8.0)
    assert found.rod_limit_m == pytest.approx(70e-6)


def test_backlash_along_the_pitch_circle() -> None:
    assert circumferential_backlash(1.0, radians(20.0)) == pytest.approx(1.0642, abs=5e-5)
    assert circumferential_backlash(1.0, 0.0) == 1.0


def test_attitude_per_rod() -> None:
    effect = rod_effect(LIMIT, LIMIT, LENGTHS)
    found = [v * 1e-5 * ARCMIN for v in (effect.pitch_by_pitch_rod, effect.roll_by_pitch_rod, effect.roll_by_roll_rod)]
    assert found == pytest.approx([0.3695, 0.0573, 0.4013], abs=1e-4)
    assert effect.greatest == effect.roll_by_roll_rod
    assert largest_travel(LIMIT, LIMIT, LENGTHS) == pytest.approx(34.263e-3, abs=5e-7)
