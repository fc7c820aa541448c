"""Mobility of the U-RPS/UPS stage by screw theory: twists and wrenches of each branch from geometry, at any pose.

Screws are taken about P (the centre of the U joint) in axes of the static platform, with lengths in units of the moving hinge
radius. A twist is (angular velocity; velocity of P), a wrench (couple about P; force): so a wrench that a branch cannot give work
to is an orthogonal vector, and the constraint wrenches of a branch are the orthogonal complement of its joint twists. Both orders are ours;
the paper mixes two (its Eqs 2 and 5).

Each branch's wrench space is kept as its projector, so that poses of different rank go through one vectorised computation. Ranks are
numbers of singular values above :data:`TOLERANCE`; the platform's mobility is 6 less the rank of all wrenches together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spsp_ctrl.mechanism.vectorised import Array, joint_rotation, matrix

Axis = Literal["x", "y"]
Ints = NDArray[np.int_]

TOLERANCE = 1e-9
"""Singular values of unit screws above this count; rounding leaves about 1e-16."""
UNIT = {"x": np.array([1.0, 0.0, 0.0]), "y": np.array([0.0, 1.0, 0.0])}


@dataclass(frozen=True)
class Branch:
    """One branch between static and moving platform: its joint twists, row by row, shape (..., n, 6)."""

    name: str
    joints: tuple[str, ...]
    """Name of each row."""
    twists: Array
    actuated: int | None = None
    """Row of the driven joint."""


@dataclass(frozen=True)
class BranchMobility:
    """What one branch allows and forbids; arrays over the poses."""

    name: str
    joints: tuple[str, ...]
    twist_rank: Ints
    wrench_dimension: Ints
    redundant: Ints
    """How many of its wrenches lie in the span of the other branches' wrenches."""
    residual: Array
    """Distance (0..1) of its nearest wrench from that span; NaN for a branch without wrenches."""


@dataclass(frozen=True)
class Mobility:
    """Mobility at one pose or over an array of poses."""

    pitch_rad: Array
    roll_rad: Array
    branches: tuple[BranchMobility, ...]
    wrench_rank: Ints
    """Rank of all constraint wrenches together."""
    locked_rank: Ints
    """The same with both driven joints locked: 6 when the rods hold the platform."""
    locked_condition: Array
    """Condition number of the locked platform's wrenches (each branch's as an orthonormal set); infinite below rank 6."""

    @property
    def mobility(self) -> Ints:
        """Degrees of freedom of the platform."""
        return 6 - self.wrench_rank

    @property
    def redundant_constraints(self) -> Ints:
        """Wrenches beyond the rank: how often the platform is over-constrained."""
        total: Ints = sum((b.wrench_dimension for b in self.branches), np.zeros_like(self.wrench_rank))
        return total - self.wrench_rank


def _revolute(axis: Array, point: Array) -> Array:
    """Unit turn about an axis through a point: P moves with ``axis x (P - point)``."""
    return np.concatenate(np.broadcast_arrays(axis, np.cross(point, axis)), axis=-1)


def _prismatic(direction: Array) -> Array:
    return np.concatenate((np.zeros_like(direction), direction), axis=-1)


def _unit(v: Array) -> Array:
    unit: Array = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return unit


def _spherical(point: Array) -> list[Array]:
    return [_revolute(e, point) for e in np.eye(3)]


def branches(
    pitch_rad: ArrayLike,
    roll_rad: ArrayLike,
    height_m: float,
    moving_radius_m: float,
    static_radius_m: float,
    r_axis: Axis = "y",
    u_axis: Axis = "y",
) -> tuple[Branch, Branch, Branch]:
    """The U, the RPS and the UPS branch at poses of any broadcast shape.

    ``r_axis`` is the axis of the R joint of the pitch leg: y in a mechanism that moves, x as Eq (1) prints it. ``u_axis`` is the
    axis of the U joint that is fixed to the column; the other one is fixed to the platform. The leg goes from its lower to its upper
    hinge at every pose, so a variant that cannot reach a pose by itself is taken as assembled there.
    """
    rotation = matrix(joint_rotation(np.asarray(pitch_rad, dtype=np.float64), np.asarray(roll_rad, dtype=np.float64)))
    height, static = height_m / moving_radius_m, static_radius_m / moving_radius_m
    a1, a2 = rotation[..., :, 0], rotation[..., :, 1]
    b1, b2 = np.array([static, 0.0, -height]), np.array([0.0, static, -height])
    p = np.zeros(3)
    rod1, rod2 = _unit(a1 - b1), _unit(a2 - b2)
    column = UNIT[u_axis]
    platform = a1 if u_axis == "y" else a2
    parallel = UNIT[r_axis]
    across = _unit(np.cross(parallel, rod2))

    def rows(*screws: Array) -> Array:
        return np.stack(np.broadcast_arrays(*screws), axis=-2)

    other = "x" if u_axis == "y" else "y"
    u = Branch("U", (f"turn about {u_axis} (column)", f"turn about {other}' (platform)"), rows(_revolute(column, p), _revolute(platform, p)))
    rps = Branch(
        "RPS",
        (f"R about {r_axis} at B1", "P along the pitch rod", "S at A1", "S at A1", "S at A1"),
        rows(_revolute(parallel, b1), _prismatic(rod1), *_spherical(a1)),
        actuated=1,
    )
    ups = Branch(
        "UPS",
        (f"U about {r_axis} at B2", "U across it at B2", "P along the roll rod", "S at A2", "S at A2", "S at A2"),
        rows(_revolute(parallel, b2), _revolute(across, b2), _prismatic(rod2), *_spherical(a2)),
        actuated=2,
    )
    return u, rps, ups


def wrench_projector(twists: Array) -> tuple[Array, Ints]:
    """Projector (..., 6, 6) on the wrenches that do no work on any of the twists, and the rank of the twists."""
    _, s, vh = np.linalg.svd(twists, full_matrices=False)
    kept = s > TOLERANCE * s[..., :1]
    basis = vh * kept[..., None]
    return np.eye(6) - np.swapaxes(basis, -1, -2) @ basis, np.count_nonzero(kept, axis=-1)


def _rank(projectors: Sequence[Array]) -> Ints:
    s = np.linalg.svd(np.concatenate(list(projectors), axis=-2), compute_uv=False)
    return np.asarray(np.count_nonzero(s > TOLERANCE, axis=-1))


def mobility(
    pitch_rad: ArrayLike,
    roll_rad: ArrayLike,
    height_m: float,
    moving_radius_m: float,
    static_radius_m: float,
    r_axis: Axis = "y",
    u_axis: Axis = "y",
) -> Mobility:
    """Ranks, mobility and redundant constraints at poses of any broadcast shape; arguments as for :func:`branches`."""
    pitch, roll = np.broadcast_arrays(np.asarray(pitch_rad, dtype=np.float64), np.asarray(roll_rad, dtype=np.float64))
    parts = branches(pitch, roll, height_m, moving_radius_m, static_radius_m, r_axis, u_axis)
    free = [wrench_projector(part.twists) for part in parts]
    projectors = [projector for projector, _ in free]
    total = _rank(projectors)
    each = []
    for k, part in enumerate(parts):
        dimension = 6 - free[k][1]
        others = [projector for i, projector in enumerate(projectors) if i != k]
        each.append(
            BranchMobility(
                part.name,
                part.joints,
                free[k][1],
                dimension,
                dimension + _rank(others) - total,
                _distance(projectors[k], others, dimension),
            )
        )
    locked = [wrench_projector(_without(part))[0] for part in parts]
    s = np.linalg.svd(np.concatenate(locked, axis=-2), compute_uv=False)
    full = s[..., -1] > TOLERANCE
    condition = np.where(full, s[..., 0] / np.where(full, s[..., -1], 1.0), np.inf)
    return Mobility(pitch, roll, tuple(each), total, np.asarray(np.count_nonzero(s > TOLERANCE, axis=-1)), condition)


def _without(branch: Branch) -> Array:
    """Twists with the driven joint locked."""
    if branch.actuated is None:
        return branch.twists
    kept: Array = np.delete(branch.twists, branch.actuated, axis=-2)
    return kept


def _distance(own: Array, others: Sequence[Array], dimension: Ints) -> Array:
    """Sine of the smallest angle between a wrench of ``own`` and the span of ``others``."""
    stacked = np.concatenate(list(others), axis=-2)
    _, s, vh = np.linalg.svd(stacked, full_matrices=False)
    basis = vh * (s > TOLERANCE)[..., None]
    outside = np.eye(6) - np.swapaxes(basis, -1, -2) @ basis
    # least of what remains outside the others' span, over the unit wrenches of ``own``; the second block keeps all others away
    leftover = np.linalg.svd(np.concatenate((outside @ own, 2.0 * (np.eye(6) - own)), axis=-2), compute_uv=False)
    distance: Array = np.where(dimension > 0, leftover[..., -1], np.nan)
    return distance


def redundant_wrench(
    pitch_rad: float, roll_rad: float, height_m: float, moving_radius_m: float, static_radius_m: float, r_axis: Axis = "y"
) -> tuple[Array, float]:
    """The wrench of the RPS branch at one pose, (couple; force) about P for a unit force, couple in units of the moving radius,
    and its distance from the span of the U joint's wrenches: 0 when the leg adds no constraint, only a self-stress.

    In a mechanism that moves this is a force along y through A1: the U joint already takes it, as its y force and its torsion.
    """
    u, rps, _ = branches(pitch_rad, roll_rad, height_m, moving_radius_m, static_radius_m, r_axis)
    own, _ = wrench_projector(rps.twists)
    span, _ = wrench_projector(u.twists)
    wrench = np.linalg.svd(own)[2][0]
    distance = float(np.linalg.norm(wrench - span @ wrench))
    force = float(np.linalg.norm(wrench[3:]))
    largest = wrench[3 + int(np.argmax(np.abs(wrench[3:])))]
    return wrench / (force if largest > 0.0 else -force), distance


@dataclass(frozen=True)
class Kutzbach:
    """The count of freedoms that looks at numbers only."""

    bodies: int = 6
    """Column, platform, two links of each leg."""
    joints: int = 7
    freedoms: int = 13
    """U 2; R 1, P 1, S 3; U 2, P 1, S 3."""

    @property
    def mobility(self) -> int:
        """``6 (bodies - 1 - joints) + freedoms``: what the parts would have if no constraint were redundant."""
        return 6 * (self.bodies - 1 - self.joints) + self.freedoms
