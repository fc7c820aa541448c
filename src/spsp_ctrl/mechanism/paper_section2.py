"""Claims of section 2 (mobility, stroke) and of section 3.1 with Appendix A (the equations of the error model)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from spsp_ctrl.mechanism.error_model import STEP
from spsp_ctrl.mechanism.mobility import TOLERANCE, mobility
from spsp_ctrl.mechanism.paper_claims import HEIGHT_M, LENGTHS_M, LIMIT_RAD, RADIUS_M, Answer, Claim, residual, rounds_to, verdict
from spsp_ctrl.mechanism.vectorised import Array, joint_rotation, matrix, rod_lengths, rotation_from_euler
from spsp_ctrl.mechanism.workspace import Travel, workspace

POSES = 200


def _random_poses() -> tuple[Array, Array]:
    rng = np.random.default_rng(1)
    pitch, roll = rng.uniform(-LIMIT_RAD, LIMIT_RAD, (2, POSES))
    return pitch, roll


def _rank(rows: Any) -> int:
    return int(np.linalg.matrix_rank(np.asarray(rows, dtype=np.float64), tol=TOLERANCE))


def printed_rps(alpha: float, beta: float, axis: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> Array:
    """The five screws of Eq (1), (direction; moment) about B1; ``axis`` is that of S11."""
    return np.array(
        [
            (*axis, 0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0, alpha, 0.0, beta),
            (alpha, 0.0, beta, 0.0, 0.0, 0.0),
            (0.0, 1.0, 0.0, -beta, 0.0, alpha),
            (beta, 0.0, -alpha, 0.0, 1.0, 0.0),
        ]
    )


def printed_ups(alpha: float, beta: float) -> Array:
    """The six screws of Eq (3)."""
    first, *others = printed_rps(alpha, beta)
    return np.array([first, (0.0, 1.0, 0.0, 0.0, 0.0, 0.0), *others])


def _work(twists: Array, wrench: tuple[float, ...]) -> float:
    """Largest work of a wrench (force; moment) on twists (angular; linear): 0 for a constraint wrench."""
    force, moment = np.array(wrench[:3]), np.array(wrench[3:])
    return float(np.abs(twists[:, 3:] @ force + twists[:, :3] @ moment).max())


PRINTED_6 = np.array(
    [(1, 0, 0, 0, 1, 0), (0, 0, 1, 0, 0, 0), (0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)], dtype=np.float64
)
"""Eq (6) as printed."""


def section_2() -> list[Claim]:
    """Mobility and Table 1."""
    poses = _random_poses()
    right, home = mobility(*poses, *LENGTHS_M), mobility(0.0, 0.0, *LENGTHS_M)
    wrong, wrong_home = mobility(*poses, *LENGTHS_M, r_axis="x"), mobility(0.0, 0.0, *LENGTHS_M, r_axis="x")
    two = bool(np.all(right.mobility == 2)) and int(home.mobility) == 2
    at_right, at_wrong = int(right.mobility.min()), int(wrong.mobility.max())
    alpha, beta = float(np.sin(0.3)), float(np.cos(0.3))
    screw_2 = (beta, 0.0, -alpha, 0.0, 1.0, 0.0)
    as_printed = _work(printed_rps(alpha, beta), screw_2)
    in_truth = _work(printed_rps(alpha, beta, (0.0, 1.0, 0.0)), screw_2)
    true_wrench = _work(printed_rps(alpha, beta, (0.0, 1.0, 0.0)), (0.0, 1.0, 0.0, -beta, 0.0, alpha))
    rank_00, rank_01 = _rank(printed_rps(0.0, 0.0)), _rank(printed_rps(0.0, 1.0))
    rank_6 = _rank(PRINTED_6)
    ups_rank = _rank(printed_ups(alpha, beta))
    wrenches = [int(b.wrench_dimension.min()) for b in right.branches]
    return [
        Claim(
            "2.2-mobility",
            "2.2, Eq (7)",
            "the platform has two rotational freedoms",
            Answer(
                f"mobility {int(home.mobility)} at level, {at_right} at {POSES} random poses, {int(right.redundant_constraints.min())} "
                "redundant constraint",
                {"level": float(home.mobility), "off_level": float(at_right), "redundant": float(right.redundant_constraints.min())},
            ),
            verdict(two),
            "with the R axis of the pitch leg parallel to y; over-constrained by one at every pose",
            {"mobility": 2.0},
        ),
        Claim(
            "2.2-eq1-axis",
            "2.2, Eq (1)",
            "S11, the R axis of the RPS leg, is (1 0 0)",
            Answer(
                f"with R along x: mobility {int(wrong_home.mobility)} at level, {at_wrong} at the random poses",
                {"level": float(wrong_home.mobility), "off_level": float(at_wrong)},
            ),
            verdict(bool(np.all(wrong.mobility == 2))),
            "the leg moves in the xz plane, so its R axis must be (0 1 0); as printed a freedom is lost away from level",
        ),
        Claim(
            "2.2-eq1-home",
            "2.2, below Eq (2)",
            "at the initial position α = 0, β = 0",
            Answer(f"twist rank {rank_00} with (0, 0), {rank_01} with (0, 1)", {"rank_00": rank_00, "rank_01": rank_01}),
            verdict(rank_00 == rank_01),
            "α² + β² = 1 is stated two lines before: level is α = 0, β = 1",
        ),
        Claim(
            "2.2-rps-wrench",
            "2.2, Eq (2)",
            "the RPS leg has the one constraint wrench (β 0 −α; 0 1 0)",
            Answer(
                f"{wrenches[1]} wrench; work on the leg's joints {in_truth:.2f} for the printed one, {residual(true_wrench)} for (0 1 0; −β 0 α)",
                {"wrenches": wrenches[1], "work_printed": in_truth, "work_true": true_wrench},
            ),
            verdict(in_truth < TOLERANCE),
            f"one wrench is right; the printed one fits only the misprinted S11 (work {residual(as_printed)} there)",
            {"wrenches": 1.0},
        ),
        Claim(
            "2.2-ups",
            "2.2, Eq (3)",
            "the UPS leg has rank 6 and no constraint",
            Answer(f"twist rank {int(right.branches[2].twist_rank.min())}, {wrenches[2]} wrenches", {"wrenches": wrenches[2]}),
            verdict(wrenches[2] == 0 and ups_rank == 6),
            f"the printed screws are those of a leg in the xz plane, not of the roll leg; their rank is {ups_rank} all the same",
            {"rank": 6.0},
        ),
        Claim(
            "2.2-u",
            "2.2, Eqs (4), (5)",
            "the U joint gives four constraint wrenches",
            Answer(f"{wrenches[0]} wrenches at every pose", {"wrenches": wrenches[0]}),
            verdict(wrenches[0] == 4),
            "Eq (5) is written (moment; force), Eq (2) before it (force; moment); the couple is along z at level only",
            {"wrenches": 4.0},
        ),
        Claim(
            "2.2-eq6",
            "2.2, Eq (6) to (7)",
            "the five wrenches of Eq (6) leave two rotations",
            Answer(
                f"rank of the five as printed: {rank_6}, so {6 - rank_6} freedom; of the true ones: {int(right.wrench_rank.max())}",
                {"rank_printed": rank_6, "rank_true": float(right.wrench_rank.max())},
            ),
            verdict(6 - rank_6 == 2, "not reproduced"),
            "row 1 is about B1, the others about P, in mixed order; with row 1 moved to P the rank is 4 and Eq (7) follows",
            {"freedoms": 2.0},
        ),
        _stroke(),
    ]


def _stroke() -> Claim:
    travel = Travel(*LENGTHS_M, LIMIT_RAD, LIMIT_RAD, -1.0, 1.0)
    rods = workspace(travel, 81).rods
    low, high = 1e3 * min(r.shortest_m for r in rods), 1e3 * max(r.longest_m for r in rods)
    one = [1e3 * (float(length) - HEIGHT_M) for length in rod_lengths(np.array([LIMIT_RAD, -LIMIT_RAD]), 0.0, *LENGTHS_M)[0]]
    widest = abs(low - one[0]) < 1e-9 and abs(high - one[1]) < 1e-9
    return Claim(
        "table1-stroke",
        "Table 1",
        "±20° need a rod displacement of 34.26 mm",
        Answer(
            f"{one[0]:+.3f} mm at +20°, {one[1]:+.3f} mm at −20°, for either axis; a combined tilt needs "
            + ("no more" if widest else f"{low:+.3f} … {high:+.3f} mm"),
            {"at_plus_20_deg_mm": one[0], "at_minus_20_deg_mm": one[1], "whole_min_mm": low, "whole_max_mm": high},
        ),
        verdict(rounds_to(high, 34.26, 2)),
        "34.26 mm is the extension; the retraction is shorter",
        {"stroke_mm": 34.26},
    )


def _by_complex_step(f: Callable[..., Any], arguments: list[Any], k: int) -> Array:
    stepped = list(arguments)
    stepped[k] = np.asarray(stepped[k]) + 1j * STEP
    return np.asarray(np.imag(f(*stepped)) / STEP)


def _eq_9(pitch: Any, length: Any, r: Any, h: Any) -> Any:
    """f1 of (A1): right side of Eq (9) as printed, less l1^2."""
    return r**2 * (1.0 - np.cos(pitch)) ** 2 + (h - r * np.sin(pitch)) ** 2 - length**2


def _eq_10(pitch: Any, roll: Any, length: Any, r: Any, h: Any) -> Any:
    """f2 of (A1): right side of Eq (10) as printed, less l2^2."""
    return (
        r**2 * (1.0 - np.cos(roll)) ** 2
        + r**2 * np.sin(pitch) ** 2 * np.sin(roll) ** 2
        + (h - r * np.sin(roll) * np.cos(pitch)) ** 2
        - length**2
    )


def section_31() -> list[Claim]:
    """The equations: what of them is right."""
    return [_eq_8(), _eqs_9_10(), *_appendix_a()]


def _eq_8() -> Claim:
    # Fig 4: O static centre, A lower hinge, B upper hinge, C platform centre; pitch leg at level
    o, a = np.zeros(3), np.array([RADIUS_M, 0.0, 0.0])
    b, c = np.array([RADIUS_M, 0.0, HEIGHT_M]), np.array([0.0, 0.0, HEIGHT_M])
    left, right = a - o, (b - a) + (c - b) + (o - c)
    return Claim(
        "eq8",
        "3.1, Eq (8)",
        "OA = AB + BC + CO",
        Answer(f"left {1e3 * left[0]:+.0f} mm, right {1e3 * right[0]:+.0f} mm along x", {"left_mm": 1e3 * left[0], "right_mm": 1e3 * right[0]}),
        verdict(bool(np.allclose(left, right))),
        "the right side closes the loop backwards: it is AO. Eqs (9) and (10) are not affected",
    )


def _eqs_9_10() -> Claim:
    pitch, roll = _random_poses()
    printed = np.stack((np.sqrt(_eq_9(pitch, 0.0, RADIUS_M, HEIGHT_M)), np.sqrt(_eq_10(pitch, roll, 0.0, RADIUS_M, HEIGHT_M))))

    def apart(rotation: Array) -> float:
        foot = np.array([[RADIUS_M, 0.0, -HEIGHT_M], [0.0, RADIUS_M, -HEIGHT_M]])
        rods = [np.linalg.norm(RADIUS_M * rotation[:, :, k] - foot[k], axis=-1) for k in (0, 1)]
        return float(np.abs(np.stack(rods) - printed).max())

    here = apart(matrix(joint_rotation(pitch, roll)))
    plus = apart(matrix(rotation_from_euler(np.zeros_like(pitch), pitch, roll)))
    other = apart(matrix(rotation_from_euler(0.0 * pitch, 0.0 * pitch, -roll)) @ matrix(rotation_from_euler(0.0 * pitch, pitch, 0.0 * pitch)))
    return Claim(
        "eq9-10",
        "3.1, Eqs (9), (10)",
        "rod lengths for pitch θx and roll θy",
        Answer(
            f"differ from the geometry by {residual(here)} m for R = Ry(θx) Rx(−θy); {1e3 * plus:.1f} mm for Ry(θx) Rx(θy), "
            f"{1e3 * other:.1f} mm for Rx(−θy) Ry(θx)",
            {"ry_rx_minus_m": here, "ry_rx_plus_m": plus, "rx_ry_m": other},
        ),
        verdict(here < 1e-12),
        "right for this one order and sign, with the legs on +x and +y and z up",
    )


def _appendix_a() -> list[Claim]:
    pitch, roll = _random_poses()
    h, r = 1e3 * HEIGHT_M, 1e3 * RADIUS_M
    l1, l2 = rod_lengths(pitch, roll, h, r, r)
    sx, cx, sy, cy = np.sin(pitch), np.cos(pitch), np.sin(roll), np.cos(roll)
    one: list[Any] = [pitch, l1, r, h]
    two: list[Any] = [pitch, roll, l2, r, h]
    a4 = {
        "∂f1/∂θx": (2 * r**2 * (sx - h / r * cx), _by_complex_step(_eq_9, one, 0)),
        "∂f1/∂l1": (-2 * l1, _by_complex_step(_eq_9, one, 1)),
        "∂f1/∂r": (4 * r - 4 * r * cx - 2 * h * sx, _by_complex_step(_eq_9, one, 2)),
        "∂f1/∂h": (2 * (h - r * sx), _by_complex_step(_eq_9, one, 3)),
    }
    a5 = {
        "∂f2/∂l2": (-2 * l2, _by_complex_step(_eq_10, two, 2)),
        "∂f2/∂r": (4 * r - 4 * r * cy - 2 * h * cx * sy, _by_complex_step(_eq_10, two, 3)),
        "∂f2/∂h": (2 * (h - r * cx * sy), _by_complex_step(_eq_10, two, 4)),
    }

    def right(pairs: dict[str, tuple[Array, Array]]) -> float:
        return max(float(np.abs(printed - true).max() / np.abs(true).max()) for printed, true in pairs.values())

    to_pitch = 2 * h * sx * sy
    true_pitch = _by_complex_step(_eq_10, two, 0)
    ratio = float(np.median(to_pitch / true_pitch))
    same = float(np.abs(r * to_pitch - true_pitch).max() / np.abs(true_pitch).max())
    first, second = 2 * r**2 * sy, -2 * h * cx * cy
    true_roll = _by_complex_step(_eq_10, two, 1)
    left = float(np.abs(first + r * second - true_roll).max() / np.abs(true_roll).max())
    at_level = float(-2 * h / -(2 * h * r))
    rest = ", ".join(a5)
    return [
        Claim(
            "A4",
            "Appendix A, (A4)",
            "the four derivatives of f1",
            Answer(f"relative difference {residual(right(a4))}", {"relative_difference": right(a4)}),
            verdict(right(a4) < 1e-12),
            "checked by complex step on Eq (9)",
        ),
        Claim(
            "A5-pitch",
            "Appendix A, (A5)",
            "∂f2/∂θx = 2h sin θx sin θy",
            Answer(f"2hr sin θx sin θy (relative difference {residual(same)})", {"relative_difference": same}),
            verdict(abs(ratio - 1.0) < 1e-9),
            "misprint: a factor r is missing",
            printed_mm=Answer(f"{ratio:g} of the true value", {"ratio": ratio}),
            printed_m=Answer(f"{1e3 * ratio:g} times the true value", {"ratio": 1e3 * ratio}),
        ),
        Claim(
            "A5-roll",
            "Appendix A, (A5)",
            "∂f2/∂θy = 2r² sin θy − 2h cos θx cos θy",
            Answer(f"2r² sin θy − 2hr cos θx cos θy (relative difference {residual(left)})", {"relative_difference": left}),
            verdict(abs(at_level - 1.0) < 1e-9),
            "misprint: a factor r is missing in the second term",
            printed_mm=Answer(f"{at_level:g} of the true value at level", {"ratio_at_level": at_level}),
            printed_m=Answer(f"{1e3 * at_level:g} times the true value at level", {"ratio_at_level": 1e3 * at_level}),
        ),
        Claim(
            "A5-rest",
            "Appendix A, (A5)",
            rest,
            Answer(f"relative difference {residual(right(a5))}", {"relative_difference": right(a5)}),
            verdict(right(a5) < 1e-12),
            "checked by complex step on Eq (10)",
        ),
    ]
