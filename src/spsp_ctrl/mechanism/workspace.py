"""Workspace: which attitudes joint limits and rod strokes allow, how far singularities are, how well conditioned the platform is.

Lengths in m, angles in rad. Functions of plain numbers and arrays; the ``mechanism:`` section of a file becomes a :class:`Travel`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.mechanism import vectorised
from spsp_ctrl.mechanism.kinematics import attitude_from_rods, rod_lengths
from spsp_ctrl.mechanism.vectorised import Array

if TYPE_CHECKING:
    from spsp_ctrl.config.rig import Mechanism


class UnreachablePose(ValueError):
    """A pose outside the travel. ``field`` is the key of the ``mechanism:`` section that forbids it."""

    def __init__(self, field: str, message: str) -> None:
        self.field = field
        super().__init__(message)


@dataclass(frozen=True)
class Travel:
    """Geometry and travel of a mechanism in SI units."""

    height_m: float
    moving_radius_m: float
    static_radius_m: float
    pitch_limit_rad: float
    roll_limit_rad: float
    stroke_min_m: float
    stroke_max_m: float

    @classmethod
    def of(cls, mechanism: Mechanism) -> Travel:
        """From the ``mechanism:`` section of a file."""
        return cls(
            *mechanism.lengths_m,
            float(np.radians(mechanism.pitch_limit_deg)),
            float(np.radians(mechanism.roll_limit_deg)),
            mechanism.stroke_min_mm * 1e-3,
            mechanism.stroke_max_mm * 1e-3,
        )

    @property
    def lengths_m(self) -> tuple[float, float, float]:
        """Height, moving and static radius: the last arguments of the kinematics."""
        return self.height_m, self.moving_radius_m, self.static_radius_m

    @property
    def level_m(self) -> float:
        """Rod length at level."""
        return hypot(self.height_m, self.moving_radius_m - self.static_radius_m)


@dataclass(frozen=True)
class RodRange:
    """Rod travel from level over all attitudes within the joint limits, and where its ends are (pitch, roll)."""

    shortest_m: float
    longest_m: float
    shortest_at_rad: tuple[float, float]
    longest_at_rad: tuple[float, float]


@dataclass(frozen=True)
class Map:
    """Everything over a grid of attitudes, arrays of shape (pitch, roll)."""

    pitch_rad: Array
    roll_rad: Array
    travel1_m: Array
    travel2_m: Array
    within: NDArray[np.bool_]
    """Attitude inside joint limits and strokes (bool)."""
    conditioning: Array
    """Smallest over largest singular value of the Jacobian, 0..1."""
    weakest_m: Array
    """Smallest singular value, m/rad: an error of this much rod turns the platform by up to 1 rad."""


@dataclass(frozen=True)
class Workspace:
    """What a mechanism can reach."""

    travel: Travel
    rods: tuple[RodRange, RodRange]
    """Pitch rod and roll rod."""
    pitch_by_stroke_rad: tuple[float, float]
    """Pitch at the ends of the stroke (fully extended, fully retracted), with roll at zero; NaN where the stroke has no end."""
    roll_by_stroke_rad: tuple[float, float]
    reachable: float
    """Part of the attitudes within the joint limits that the strokes reach too."""
    any_direction_rad: float
    """Tilt of the platform's normal that every direction allows."""
    pitch_singular_rad: float
    roll_singular_rad: float
    """Nearest singularity of the roll rod: at zero pitch and at the pitch limit the smaller."""
    conditioning_min: float
    conditioning_min_at_rad: tuple[float, float]
    weakest_m: float
    """Least of :attr:`Map.weakest_m` within the workspace."""
    ball_swing_rad: tuple[float, float]
    """Largest angle between rod and its position on the platform at level, pitch and roll leg: what the ball joint must allow."""
    lower_swing_rad: tuple[float, float]
    """The same at the lower hinge, from the position at level."""


def pitch_singularity(height_m: float, static_radius_m: float) -> float:
    """Pitch at which the pitch rod lies in one plane with the U axis and cannot turn the platform: tan pitch = h / r."""
    return atan2(height_m, static_radius_m)


def roll_singularity(pitch_rad: float, height_m: float, static_radius_m: float) -> float:
    """The same of the roll rod: tan roll = (h / r) cos pitch."""
    return atan2(height_m * cos(pitch_rad), static_radius_m)


def check_pose(travel: Travel, pitch_rad: float, roll_rad: float) -> None:
    """Raises :class:`UnreachablePose` for an attitude outside joint limits or strokes."""
    for name, value, limit in (("pitch", pitch_rad, travel.pitch_limit_rad), ("roll", roll_rad, travel.roll_limit_rad)):
        if not abs(value) <= limit * (1.0 + 1e-12):
            raise UnreachablePose(
                f"{name}_limit_deg",
                f"unreachable pose: {name} {np.degrees(value):g} deg is beyond {name}_limit_deg = {np.degrees(limit):g}",
            )
    for name, length in zip(("pitch", "roll"), rod_lengths(pitch_rad, roll_rad, *travel.lengths_m), strict=True):
        moved = length - travel.level_m
        low, high = travel.stroke_min_m, travel.stroke_max_m
        if not low <= moved <= high:
            field, end = ("stroke_min_mm", low) if moved < low else ("stroke_max_mm", high)
            raise UnreachablePose(
                field,
                f"unreachable pose: pitch {np.degrees(pitch_rad):g} deg, roll {np.degrees(roll_rad):g} deg moves the {name} rod by "
                f"{1e3 * moved:+.3f} mm, beyond {field} = {1e3 * end:g}",
            )


def conditioning_map(travel: Travel, pitch_rad: Array, roll_rad: Array) -> Map:
    """The map over the grid of two axes."""
    pitch, roll = np.meshgrid(pitch_rad, roll_rad, indexing="ij")
    l1, l2 = vectorised.rod_lengths(pitch, roll, *travel.lengths_m)
    largest, weakest = vectorised.jacobian_gains(*vectorised.jacobian(pitch, roll, l1, l2, *travel.lengths_m))
    travel1, travel2 = l1 - travel.level_m, l2 - travel.level_m
    within = (np.abs(pitch) <= travel.pitch_limit_rad * (1.0 + 1e-12)) & (np.abs(roll) <= travel.roll_limit_rad * (1.0 + 1e-12))
    for moved in (travel1, travel2):
        within &= (moved >= travel.stroke_min_m) & (moved <= travel.stroke_max_m)
    return Map(pitch, roll, travel1, travel2, within, weakest / largest, weakest)


def workspace(travel: Travel, points: int = 201) -> Workspace:
    """Everything about the reach, from a grid of ``points`` x ``points`` attitudes that includes the limits and level."""
    count = points | 1
    axes = (np.linspace(-1.0, 1.0, count) * limit for limit in (travel.pitch_limit_rad, travel.roll_limit_rad))
    grid = conditioning_map(travel, *axes)
    inside = np.where(grid.within, grid.conditioning, np.inf)
    worst = np.unravel_index(int(np.argmin(inside)), inside.shape)
    ball, lower = _swings(travel, grid)
    return Workspace(
        travel,
        (_range(grid, grid.travel1_m), _range(grid, grid.travel2_m)),
        _by_stroke(travel, 0),
        _by_stroke(travel, 1),
        float(np.mean(grid.within)),
        _any_direction(travel),
        pitch_singularity(travel.height_m, travel.static_radius_m),
        roll_singularity(travel.pitch_limit_rad, travel.height_m, travel.static_radius_m),
        float(grid.conditioning[worst]),
        (float(grid.pitch_rad[worst]), float(grid.roll_rad[worst])),
        float(np.min(np.where(grid.within, grid.weakest_m, np.inf))),
        ball,
        lower,
    )


def _range(grid: Map, moved: Array) -> RodRange:
    low = np.unravel_index(int(np.argmin(moved)), moved.shape)
    high = np.unravel_index(int(np.argmax(moved)), moved.shape)
    at = [(float(grid.pitch_rad[i]), float(grid.roll_rad[i])) for i in (low, high)]
    return RodRange(float(moved[low]), float(moved[high]), at[0], at[1])


def _by_stroke(travel: Travel, leg: int) -> tuple[float, float]:
    """Angle of one axis at the ends of its rod's stroke, the other axis at zero."""
    angles = []
    for end in (travel.stroke_max_m, travel.stroke_min_m):
        lengths = [travel.level_m, travel.level_m]
        lengths[leg] += end
        try:
            angles.append(attitude_from_rods(lengths[0], lengths[1], *travel.lengths_m)[leg])
        except ValueError:
            angles.append(float("nan"))  # the stroke is longer than the rod can go: no end
    return angles[0], angles[1]


def _any_direction(travel: Travel, directions: int = 720) -> float:
    """Largest tilt that is inside the workspace towards every direction: each direction by bisection from level."""
    towards = np.linspace(0.0, 2.0 * np.pi, directions, endpoint=False)
    low, high = np.zeros(directions), np.full(directions, np.pi / 2.0 - 1e-6)
    for _ in range(50):
        tilt = 0.5 * (low + high)
        # normal of the platform: z axis of Ry(pitch) Rx(-roll) is (sin p cos r, sin r, cos p cos r)
        nx, ny, nz = np.sin(tilt) * np.cos(towards), np.sin(tilt) * np.sin(towards), np.cos(tilt)
        pitch, roll = np.arctan2(nx, nz), np.arctan2(ny, np.hypot(nx, nz))
        good = (np.abs(pitch) <= travel.pitch_limit_rad) & (np.abs(roll) <= travel.roll_limit_rad)
        for length in vectorised.rod_lengths(pitch, roll, *travel.lengths_m):
            moved = length - travel.level_m
            good &= (moved >= travel.stroke_min_m) & (moved <= travel.stroke_max_m)
        low, high = np.where(good, tilt, low), np.where(good, high, tilt)
    return float(low.min())


def _swings(travel: Travel, grid: Map) -> tuple[tuple[float, float], tuple[float, float]]:
    """Swing of the rods at their upper and lower hinges within the workspace, from level."""
    rotation = vectorised.matrix(vectorised.joint_rotation(grid.pitch_rad, grid.roll_rad))
    ball: list[float] = []
    lower: list[float] = []
    for k in (0, 1):
        foot = np.array([0.0, 0.0, -travel.height_m])
        foot[k] = travel.static_radius_m
        rod = travel.moving_radius_m * rotation[..., :, k] - foot
        rod /= np.linalg.norm(rod, axis=-1, keepdims=True)
        level = -foot
        level[k] += travel.moving_radius_m
        level /= np.linalg.norm(level)
        seen = np.einsum("...ji,...j->...i", rotation, rod)  # in platform axes
        for swings, direction in ((ball, seen), (lower, rod)):
            angle = np.arctan2(np.linalg.norm(np.cross(direction, level), axis=-1), direction @ level)
            swings.append(float(np.max(np.where(grid.within, angle, 0.0))))
    return (ball[0], ball[1]), (lower[0], lower[1])
