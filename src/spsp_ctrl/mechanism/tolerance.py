"""Does a set of tolerances keep a requirement on the attitude (section 3.4 of the paper): worst case, root sum square, Monte Carlo.

All three use the linear model, in which the attitude errors over the poses are a matrix product; what linearity hides is measured against
the exact model. An attitude error here is the largest |pitch| or |roll| error over the workspace. Lengths in m, angles in rad.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.tolerances import ToleranceFile
from spsp_ctrl.mechanism.error_model import (
    Lengths,
    Materials,
    Source,
    elementary,
    error_sources,
    exact_error,
    level_length,
    sensitivity,
    zeroed_sensitivity,
    zeroing,
)
from spsp_ctrl.mechanism.vectorised import Array

Distribution = Literal["uniform", "normal"]
AXES = ("pitch", "roll")
WORST_GRID = 41
"""Poses per axis for worst case and root sum square; odd, so that level is among them."""
YIELD_GRID = 9
BLOCK = 8192
"""Units per block of the Monte Carlo: a block with all its poses stays in the cache."""


@dataclass(frozen=True)
class Tolerance:
    """One error and its limit, in SI units: ``-limit <= error <= limit``."""

    source: Source
    limit: float
    distribution: Distribution | None = None
    sigmas: float = 3.0
    varies: bool = False
    """Differs from pose to pose, so zeroing at level does not remove it."""
    cost: float = 1.0
    group: str = ""
    least: float | None = None
    most: float | None = None
    """What the allocation may go down and up to."""


def materials_of(file: ToleranceFile, lengths_m: Lengths) -> Materials:
    """Thermal growth as a tolerance file states it."""
    m = file.materials
    length = level_length(lengths_m) if m.screw_length is None else m.screw_length.si
    return Materials(length, m.screw_expansion.si, m.column_expansion.si, m.frame_expansion.si)


def tolerances_of(file: ToleranceFile, lengths_m: Lengths) -> tuple[Tolerance, ...]:
    """Entries of a tolerance file in SI units."""
    known = error_sources(lengths_m, materials_of(file, lengths_m))
    found = []
    for e in file.tolerances:
        low, high = (e.limit, e.limit) if e.fixed else (e.min, e.max)
        found.append(
            Tolerance(
                known[e.source],
                e.si(e.limit),
                e.distribution,
                e.sigmas,
                e.varies,
                e.cost,
                e.group,
                None if low is None else e.si(low),
                None if high is None else e.si(high),
            )
        )
    return tuple(found)


@dataclass(frozen=True)
class Poses:
    """Poses of the workspace, flat."""

    pitch_rad: Array
    roll_rad: Array

    @classmethod
    def grid(cls, pitch_limit_rad: float, roll_limit_rad: float, points: int) -> Poses:
        """``points`` x ``points`` poses over the joint limits, ends included."""
        axes = (np.linspace(-1.0, 1.0, points) * limit for limit in (pitch_limit_rad, roll_limit_rad))
        pitch, roll = np.meshgrid(*axes, indexing="ij")
        return cls(pitch.ravel(), roll.ravel())


def attitude_matrix(tolerances: Sequence[Tolerance], poses: Poses, lengths_m: Lengths, zeroed: bool = False) -> Array:
    """Attitude error per unit of each error at each pose, shape (2, errors, poses).

    ``zeroed``: after the rod lengths were set so that the platform is level at level. That takes away the part of every constant error
    which is there at level; errors that vary from pose to pose stay as they are.
    """
    sources = [t.source for t in tolerances]
    matrix = sensitivity(poses.pitch_rad, poses.roll_rad, lengths_m, sources)
    if not zeroed:
        return matrix
    known = error_sources(lengths_m)
    rods = [known["dl1"], known["dl2"]]
    constant = zeroed_sensitivity(
        matrix,
        sensitivity(0.0, 0.0, lengths_m, sources),
        sensitivity(poses.pitch_rad, poses.roll_rad, lengths_m, rods),
        sensitivity(0.0, 0.0, lengths_m, rods),
    )
    varies = np.array([t.varies for t in tolerances])[None, :, None]
    return np.where(varies, matrix, constant)


def limits_of(tolerances: Sequence[Tolerance]) -> Array:
    """Limits as an array."""
    return np.array([t.limit for t in tolerances])


def as_given(matrix: Array, limits: Array) -> Array:
    """Every error at its limit, all positive, as the paper adds them for its Fig 10: shape (2, poses)."""
    error: Array = np.einsum("asp,s->ap", matrix, limits)
    return error


def worst_case(matrix: Array, limits: Array) -> Array:
    """Every error at its limit with the worst sign for each axis and pose: shape (2, poses)."""
    error: Array = np.einsum("asp,s->ap", np.abs(matrix), limits)
    return error


def root_sum_square(matrix: Array, limits: Array) -> Array:
    """Limits added in squares: shape (2, poses)."""
    error: Array = np.sqrt(np.einsum("asp,s->ap", matrix * matrix, limits * limits))
    return error


def exact_worst_case(
    matrix: Array, tolerances: Sequence[Tolerance], limits: Array, poses: Poses, lengths_m: Lengths, zeroed: bool = False
) -> Array:
    """Worst case by the exact model: the worst signs of the linear one and their opposites, solved again at every pose; (2, poses)."""
    result = np.zeros(matrix[:, 0].shape)
    for axis in (0, 1):
        for side in (1.0, -1.0):
            values = side * np.sign(matrix[axis]) * limits[:, None]
            errors = elementary((t.source, v) for t, v in zip(tolerances, values, strict=True))
            if zeroed:
                constant = elementary((t.source, v) for t, v in zip(tolerances, values, strict=True) if not t.varies)
                for name, correction in zip(("dl1", "dl2"), zeroing(constant, lengths_m), strict=True):
                    errors[name] = errors.get(name, 0.0) + correction
            found = exact_error(poses.pitch_rad, poses.roll_rad, lengths_m, errors)[axis]
            result[axis] = np.maximum(result[axis], np.abs(found))
    return result


@dataclass(frozen=True)
class MonteCarlo:
    """Worst attitude error over the poses of each unit: sorted, rad, per axis and of both."""

    pitch_rad: Array
    roll_rad: Array
    worst_rad: Array

    @property
    def units(self) -> int:
        """How many were made."""
        return len(self.worst_rad)

    def beyond(self, requirement_rad: float) -> float:
        """Part of the units beyond a requirement on either axis."""
        return float(self.units - np.searchsorted(self.worst_rad, requirement_rad, side="right")) / self.units

    def standard_error(self, requirement_rad: float) -> float:
        """Of :meth:`beyond`."""
        p = self.beyond(requirement_rad)
        return float(np.sqrt(max(p * (1.0 - p), 1.0 / self.units) / self.units))

    def quantile(self, part: float) -> float:
        """Worst attitude error that this part of the units keeps, rad."""
        return float(np.quantile(self.worst_rad, part))


def monte_carlo(
    matrix: Array,
    tolerances: Sequence[Tolerance],
    units: int,
    seed: int,
    distribution: Distribution | None = None,
    limits: Array | None = None,
    advance: Callable[[int, int], None] = lambda done, total: None,
) -> MonteCarlo:
    """Make ``units`` mechanisms with random errors and find the worst attitude error of each over the poses.

    ``distribution`` overrides that of the tolerances (which is uniform when a file does not say). Uniform lies within the limits; normal has
    its limits at :attr:`Tolerance.sigmas` standard deviations and is not cut off there. Blocks of fixed size, so that the same seed
    gives the same units.
    """
    limit = limits_of(tolerances) if limits is None else limits
    kinds = [distribution or t.distribution or "uniform" for t in tolerances]
    normal = np.array([kind == "normal" for kind in kinds])
    scale = np.where(normal, limit / np.array([t.sigmas for t in tolerances]), limit)
    rng = np.random.default_rng(seed)
    count = matrix.shape[-1]
    flat = np.ascontiguousarray(np.concatenate((matrix[0], matrix[1]), axis=-1) * scale[:, None])
    worst: NDArray[np.float64] = np.empty((2, units))
    attitude = np.empty((BLOCK, 2 * count))
    for start in range(0, units, BLOCK):
        size = min(BLOCK, units - start)
        errors = np.empty((BLOCK, len(limit)))
        if not normal.all():
            errors[:, ~normal] = rng.uniform(-1.0, 1.0, (BLOCK, int((~normal).sum())))
        if normal.any():
            errors[:, normal] = rng.standard_normal((BLOCK, int(normal.sum())))
        np.matmul(errors, flat, out=attitude)
        for axis in (0, 1):
            part = attitude[:size, axis * count : (axis + 1) * count]
            np.maximum(part.max(axis=1), -part.min(axis=1), out=worst[axis, start : start + size])
        advance(start + size, units)
    return MonteCarlo(np.sort(worst[0]), np.sort(worst[1]), np.sort(worst.max(axis=0)))


@dataclass(frozen=True)
class Worst:
    """Where the worst case over the workspace is, and which error has how much of it."""

    axis: int
    pose: int
    """Index into the poses."""
    error_rad: float
    shares_rad: Array
    """Of each error; they add up to the error."""


def governing(matrix: Array, limits: Array) -> Worst:
    """The worst of the worst cases."""
    over = worst_case(matrix, limits)
    axis, pose = np.unravel_index(int(np.argmax(over)), over.shape)
    return Worst(int(axis), int(pose), float(over[axis, pose]), np.abs(matrix[axis, :, pose]) * limits)
