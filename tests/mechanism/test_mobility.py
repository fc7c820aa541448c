"""Mobility by screws: the rank figures of the reproduction, and that a rank is what the motion says it is."""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
import pytest

from spsp_ctrl.mechanism import frames, mobility

PAPER = (0.2655, 0.1, 0.1)
LARGE = (0.62, 0.24, 0.30)
RNG = np.random.default_rng(7)
PITCH, ROLL = np.radians(RNG.uniform(-20.0, 20.0, (2, 10_000)))


@pytest.mark.parametrize("lengths", [PAPER, LARGE])
def test_r_parallel_y_has_rank_4_everywhere(lengths: tuple[float, float, float]) -> None:
    found = mobility.mobility(PITCH, ROLL, *lengths)
    assert [np.unique(b.wrench_dimension).tolist() for b in found.branches] == [[4], [1], [0]]
    assert [np.unique(b.twist_rank).tolist() for b in found.branches] == [[2], [5], [6]]
    assert np.all(found.wrench_rank == 4)
    assert np.all(found.mobility == 2)
    assert np.all(found.redundant_constraints == 1)
    assert np.all(found.locked_rank == 6)
    rps = found.branches[1]
    assert np.all(rps.redundant == 1)
    assert rps.residual.max() < 1e-13


def test_one_pose_is_the_same_as_in_an_array() -> None:
    for r_axis in ("y", "x"):
        many = mobility.mobility(PITCH[:20], ROLL[:20], *PAPER, r_axis=r_axis)  # type: ignore[arg-type]
        for k in range(20):
            one = mobility.mobility(float(PITCH[k]), float(ROLL[k]), *PAPER, r_axis=r_axis)  # type: ignore[arg-type]
            assert one.wrench_rank.shape == ()
            assert int(one.wrench_rank) == many.wrench_rank[k]
            assert float(one.locked_condition) == pytest.approx(many.locked_condition[k], rel=1e-9)


def test_r_parallel_x_as_printed_loses_a_freedom() -> None:
    home = mobility.mobility(0.0, 0.0, *PAPER, r_axis="x")
    assert (int(home.wrench_rank), int(home.mobility), int(home.redundant_constraints)) == (4, 2, 1)
    off = mobility.mobility(PITCH, ROLL, *PAPER, r_axis="x")
    assert np.all(off.wrench_rank == 5)
    assert np.all(off.mobility == 1)
    # it is pitch that is lost: with roll alone the leg stays upright and the rank stays 4
    assert int(mobility.mobility(0.0, radians(15.0), *PAPER, r_axis="x").wrench_rank) == 4
    assert int(mobility.mobility(radians(1e-3), 0.0, *PAPER, r_axis="x").wrench_rank) == 5


def test_u_joint_with_x_on_the_column_loses_a_freedom_too() -> None:
    assert int(mobility.mobility(0.0, 0.0, *PAPER, u_axis="x").wrench_rank) == 4
    assert np.all(mobility.mobility(PITCH, ROLL, *PAPER, u_axis="x").wrench_rank == 5)


def test_the_redundant_wrench_is_the_leg_force_along_y() -> None:
    for pitch, roll in ((0.0, 0.0), (0.3, -0.2), (-0.34, 0.34)):
        wrench, distance = mobility.redundant_wrench(pitch, roll, *PAPER)
        np.testing.assert_allclose(wrench[3:], [0.0, 1.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(wrench[:3], [sin(pitch), 0.0, cos(pitch)], atol=1e-12)
        assert distance < 1e-13
    assert mobility.redundant_wrench(0.3, 0.2, *PAPER, r_axis="x")[1] > 0.1


def test_branch_twists_are_velocities_of_the_real_linkage() -> None:
    """The platform's own motions (pitch and roll rates) lie in the twist span of every branch, by finite difference of the attitude."""
    for pitch, roll in ((0.0, 0.0), (0.25, -0.3), (-0.34, 0.2)):
        for rates in ((1.0, 0.0), (0.0, 1.0)):
            platform = frames.joint_rates_to_body(pitch, roll, *rates, 0.0)
            omega = frames.apply(frames.joint_rotation(pitch, roll), platform)
            twist = np.array([*omega, 0.0, 0.0, 0.0])
            for branch in mobility.branches(pitch, roll, *PAPER):
                projector, _ = mobility.wrench_projector(branch.twists)
                assert np.linalg.norm(projector @ twist) < 1e-13, branch.name
            if rates[0]:
                rps = mobility.branches(pitch, roll, *PAPER, r_axis="x")[1]
                assert pitch == 0.0 or np.linalg.norm(mobility.wrench_projector(rps.twists)[0] @ twist) > 0.05


def test_wrenches_do_no_work_on_the_twists() -> None:
    for branch in mobility.branches(PITCH[:50], ROLL[:50], *LARGE):
        projector, rank = mobility.wrench_projector(branch.twists)
        assert np.abs(projector @ np.swapaxes(branch.twists, -1, -2)).max() < 1e-14
        np.testing.assert_allclose(np.trace(projector, axis1=-2, axis2=-1), 6 - rank, atol=1e-12)


def test_locked_platform_is_held_until_a_rod_is_singular() -> None:
    assert mobility.mobility(PITCH, ROLL, *PAPER).locked_condition.max() < 5.0
    at = np.arctan2(PAPER[0], PAPER[2])
    stuck = mobility.mobility(at, 0.0, *PAPER)
    assert int(stuck.locked_rank) == 5
    assert np.isinf(stuck.locked_condition)


def test_kutzbach_counts_one() -> None:
    assert mobility.Kutzbach().mobility == 1
