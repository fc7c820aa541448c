"""Errors along the motion of section 3.2 and at the poses of Eq (12)."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from spsp_ctrl.config.error_sources import PAPER
from spsp_ctrl.mechanism.error_analysis import (
    TABLE_3_M,
    Case,
    corners,
    paper_motion,
    respond,
    separate_and_together,
    sine_motion,
    static_tables,
)
from spsp_ctrl.mechanism.error_model import error_sources

LENGTHS = (0.2655, 0.1, 0.1)
ARCMIN = 60.0 * 180.0 / np.pi
KNOWN = error_sources(LENGTHS)
MOTION = paper_motion()
TABLE_2 = tuple((KNOWN[n], v) for n, v in zip(PAPER, (2e-5, 2e-5, 1e-5, 1e-5), strict=True))


def ranges(name: str, value: float) -> list[float]:
    found = respond(Case(name, ((KNOWN[name], value),)), MOTION.pitch_rad, MOTION.roll_rad, LENGTHS)
    assert found.nonlinearity * ARCMIN < 2.4e-4
    return [float(v) * ARCMIN for axis in (0, 1) for v in (found.linear[axis].min(), found.linear[axis].max())]


def test_figures_5_and_6() -> None:
    assert ranges("dl1", 2e-5) == pytest.approx([-0.715, -0.688, -0.059, 0.059], abs=5e-4)
    assert ranges("dl2", 2e-5) == pytest.approx([0.0, 0.0, -0.749, -0.688], abs=5e-4)
    assert ranges("dr", 1e-5) == pytest.approx([-0.092, 0.092, -0.126, 0.125], abs=5e-4)
    assert ranges("dh", 1e-5) == pytest.approx([0.344, 0.357, 0.342, 0.404], abs=5e-4)
    assert ranges("upper_radius", 1e-5)[2:] == pytest.approx([-0.135, 0.117], abs=5e-4)
    assert ranges("lower_radius", 1e-5)[2:] == pytest.approx([0.0, 0.010], abs=5e-4)


def test_figure_7() -> None:
    *alone, together = separate_and_together(TABLE_2)
    assert [case.name for case in alone] == list(PAPER)
    found = respond(together, MOTION.pitch_rad, MOTION.roll_rad, LENGTHS)
    assert np.abs(found.linear).max(axis=1) * ARCMIN == pytest.approx([0.450, 0.519], abs=5e-4)
    assert len(separate_and_together(TABLE_2[:1])) == 1


# arcmin per mm: pitch of dl1, dl2, dr, dh, then roll
POINTS = {
    "A": (-36.95, 0.0, -12.57, 36.93, -5.73, -40.13, -14.53, 45.79),
    "B": (-36.33, 0.0, 12.47, 36.32, -4.20, -38.13, 13.90, 42.29),
    "C": (-36.95, 0.0, -12.57, 36.93, 4.27, -38.13, 13.92, 33.82),
    "D": (-36.33, 0.0, 12.47, 36.32, 5.63, -40.13, -14.51, 34.43),
    "level": (-34.38, 0.0, 0.0, 34.38, 0.0, -34.38, 0.0, 34.38),
}


def test_static_points() -> None:
    points = [*corners(radians(20.0), radians(20.0)), ("level", 0.0, 0.0)]
    tables = static_tables([p for _, p, _ in points], [r for _, _, r in points], LENGTHS, [KNOWN[n] for n in PAPER])
    for k, (name, _, _) in enumerate(points):
        found = [table.per_unit[axis, k] * 1e-3 * ARCMIN for axis in (0, 1) for table in tables]
        assert found == pytest.approx(POINTS[name], abs=5.1e-3)
    assert max(t.nonlinearity for t in tables) * ARCMIN == pytest.approx(0.123, abs=5e-4)
    for table in tables:
        assert table.linear.shape == table.exact.shape == (2, 5, len(TABLE_3_M))


def test_motion_lasts_until_it_repeats() -> None:
    motion = sine_motion([(0.1, 3.0, 0.5)], [(0.2, 2.0, 0.0)])
    assert motion.t_s[-1] == 6.0
    np.testing.assert_allclose((motion.pitch_rad[0], motion.roll_rad[0]), (motion.pitch_rad[-1], motion.roll_rad[-1]), atol=1e-12)
    assert sine_motion([], []).t_s[-1] == 1.0
