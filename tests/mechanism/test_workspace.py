"""Workspace: limits, strokes, conditioning, hinge swing."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, radians

import numpy as np
import pytest

from spsp_ctrl.mechanism import frames, kinematics
from spsp_ctrl.mechanism.workspace import Travel, UnreachablePose, check_pose, conditioning_map, workspace

LIMIT = radians(20.0)
PAPER = Travel(0.2655, 0.1, 0.1, LIMIT, LIMIT, -0.03413, 0.0343)


def test_the_paper_reaches_all_of_its_square() -> None:
    found = workspace(PAPER)
    assert found.reachable == 1.0
    assert degrees(found.any_direction_rad) == pytest.approx(20.0, abs=1e-6)
    for rod in found.rods:
        assert 1e3 * rod.shortest_m == pytest.approx(-34.123, abs=5e-4)
        assert 1e3 * rod.longest_m == pytest.approx(34.263, abs=5e-4)
    assert found.conditioning_min > 0.8
    # 1 um of rod at level is 0.0344 arcmin; at the worst corner a fifth more
    assert 1e-6 / found.weakest_m * degrees(60.0) == pytest.approx(0.0419, abs=1e-4)


def test_a_short_stroke_cuts_the_corner_off() -> None:
    short = replace(PAPER, stroke_min_m=-0.030)
    found = workspace(short)
    assert 0.8 < found.reachable < 1.0
    pitch_end = found.pitch_by_stroke_rad[1]
    assert kinematics.rod_lengths(pitch_end, 0.0, *short.lengths_m)[0] == pytest.approx(short.level_m - 0.030, abs=1e-12)
    assert found.any_direction_rad == pytest.approx(min(pitch_end, found.roll_by_stroke_rad[1]), abs=1e-6)
    check_pose(short, pitch_end - 1e-9, 0.0)
    with pytest.raises(UnreachablePose, match="stroke_min_mm") as caught:
        check_pose(short, pitch_end + 1e-6, 0.0)
    assert caught.value.field == "stroke_min_mm"


def test_a_stroke_longer_than_the_rod_can_go_has_no_end() -> None:
    found = workspace(replace(PAPER, stroke_max_m=0.5))
    assert np.isnan(found.pitch_by_stroke_rad[0])
    assert found.reachable == 1.0


@pytest.mark.parametrize(
    ("pitch", "roll", "field"),
    [(20.1, 0.0, "pitch_limit_deg"), (0.0, -21.0, "roll_limit_deg"), (float("nan"), 0.0, "pitch_limit_deg")],
)
def test_a_pose_beyond_a_limit_names_the_key(pitch: float, roll: float, field: str) -> None:
    with pytest.raises(UnreachablePose, match=field) as caught:
        check_pose(PAPER, radians(pitch), radians(roll))
    assert caught.value.field == field


def test_stroke_end_that_extends() -> None:
    with pytest.raises(UnreachablePose, match="roll rod by") as caught:
        check_pose(replace(PAPER, stroke_max_m=0.030), 0.0, -LIMIT)
    assert caught.value.field == "stroke_max_mm"


def test_map_agrees_with_the_scalar_functions() -> None:
    grid = conditioning_map(PAPER, np.radians([-30.0, 0.0, 12.0]), np.radians([-8.0, 5.0]))
    assert grid.within.tolist() == [[False, False], [True, True], [True, True]]
    lengths = kinematics.rod_lengths(radians(12.0), radians(-8.0), *PAPER.lengths_m)
    largest, weakest = kinematics.jacobian_gains(*kinematics.jacobian(radians(12.0), radians(-8.0), *lengths, *PAPER.lengths_m))
    assert grid.conditioning[2, 0] == pytest.approx(weakest / largest, rel=1e-13)
    assert grid.travel2_m[2, 0] == pytest.approx(lengths[1] - PAPER.level_m, abs=1e-15)


def test_hinge_swing_is_an_angle_between_rods() -> None:
    """Largest lower swing by a coarse search with plain vectors."""
    found = workspace(PAPER, points=41)
    largest = [0.0, 0.0]
    for pitch in np.linspace(-LIMIT, LIMIT, 41):
        for roll in np.linspace(-LIMIT, LIMIT, 41):
            rotation = np.array(frames.joint_rotation(pitch, roll)).reshape(3, 3)
            for k in (0, 1):
                foot = np.array([0.0, 0.0, -0.2655])
                foot[k] = 0.1
                rod = 0.1 * rotation[:, k] - foot
                largest[k] = max(largest[k], float(np.arccos(rod[2] / np.linalg.norm(rod))))
    assert found.lower_swing_rad == pytest.approx(largest, abs=1e-9)
