"""Error model of the stage: what manufacturing and thermal errors do to the attitude (Eq 11 of the paper, and beyond it).

All geometry stands in :func:`closure`: the loop of each leg with every error in it. From it come the linear model (derivatives by complex
step, exact to rounding; with the paper's four errors it is Eq (11) with the two misprints of (A5) corrected) and the exact model (the loops
solved again). The controller commands the rod lengths that would give an attitude without errors; the attitude error is what a level
gyro horizon on the platform reads beyond that attitude.

Errors are measured at level: hinges where they are, and the platform's reference faces level when both axes stand at zero. Lengths in m,
angles in rad, temperatures in K. Arrays of poses broadcast.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spsp_ctrl.config.error_sources import ELEMENTARY, ERROR_SOURCES
from spsp_ctrl.mechanism import vectorised
from spsp_ctrl.mechanism.frames import imu_roll_from_roll
from spsp_ctrl.mechanism.vectorised import NUMPY, Array, apply, multiply, rotation_from_euler, transpose

Lengths = tuple[float, float, float]
"""Column height, hinge radius of the moving and of the static platform, m."""
Errors = Mapping[str, Any]
"""Elementary error -> value (m, rad), a number or an array over the poses."""

STEP = 1e-30
"""Of the complex-step derivatives."""
LEVEL = np.zeros(1)


@dataclass(frozen=True)
class Source:
    """One cause of attitude errors, as a combination of elementary errors: each is ``factor`` times the source's value."""

    name: str
    si_unit: str
    text: str
    parts: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Materials:
    """Thermal growth, Eq (13): length of screw and rod that grows (m), and expansion coefficients (1/K)."""

    screw_length_m: float
    screw_1_k: float = 11.5e-6
    column_1_k: float = 11.5e-6
    frame_1_k: float = 11.5e-6


def level_length(lengths_m: Lengths) -> float:
    """Rod length at level, m."""
    height, upper, lower = lengths_m
    return float(np.hypot(height, upper - lower))


def error_sources(lengths_m: Lengths, materials: Materials | None = None) -> dict[str, Source]:
    """Every known source for a geometry; all of steel when no materials are given."""
    height, upper, lower = lengths_m
    m = materials or Materials(level_length(lengths_m))
    screw = m.screw_1_k * m.screw_length_m
    radii = ("a1_x", upper), ("a2_y", upper), ("b1_x", lower), ("b2_y", lower)
    hot_screw = ("dl1", screw), ("dl2", screw)
    hot_column = (("u_z", m.column_1_k * height),)
    hot_frame = tuple((name, m.frame_1_k * radius) for name, radius in radii)
    parts: dict[str, tuple[tuple[str, float], ...]] = {name: ((name, 1.0),) for name in ELEMENTARY}
    parts |= {
        "dr": tuple((name, 1.0) for name, _ in radii),
        "dh": (("u_z", 1.0),),
        "upper_radius": (("a1_x", 1.0), ("a2_y", 1.0)),
        "lower_radius": (("b1_x", 1.0), ("b2_y", 1.0)),
        "screw_temperature": hot_screw,
        "column_temperature": hot_column,
        "frame_temperature": hot_frame,
        "temperature": hot_screw + hot_column + hot_frame,
    }
    return {name: Source(name, kind.si_unit, kind.text, parts[name]) for name, kind in ERROR_SOURCES.items()}


def elementary(values: Iterable[tuple[Source, Any]]) -> dict[str, Any]:
    """Elementary errors that belong to values of sources (numbers or arrays)."""
    total: dict[str, Any] = {}
    for source, value in values:
        for name, factor in source.parts:
            total[name] = total.get(name, 0.0) + factor * np.asarray(value)
    return total


def _sum(*vectors: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(sum(parts[1:], parts[0]) for parts in zip(*vectors, strict=True))


def _placed(pitch: Any, roll: Any, lengths_m: Lengths, errors: Errors) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...]]:
    """Both rods as vectors from lower to upper hinge, and the platform's attitude, at given angles of the two U axes."""

    def e(name: str) -> Any:
        return errors.get(name, 0.0)

    height, upper, lower = lengths_m
    column = rotation_from_euler(e("u_yaw"), 0.0, e("u_tilt"))
    pitched = multiply(column, rotation_from_euler(0.0, pitch, 0.0))
    rolled = multiply(pitched, rotation_from_euler(e("u_square"), 0.0, imu_roll_from_roll(roll)))
    # the joint is assembled so that everything is level when both its angles are zero
    attitude = multiply(rolled, transpose(multiply(column, rotation_from_euler(e("u_square"), 0.0, 0.0))))
    centre = _sum((e("u_x"), e("u_y"), e("u_z")), apply(pitched, (0.0, 0.0, e("u_offset"))))
    above = (upper + e("a1_x"), e("a1_y"), e("a1_z")), (e("a2_x"), upper + e("a2_y"), e("a2_z"))
    below = (lower + e("b1_x"), e("b1_y"), e("b1_z") - height), (e("b2_x"), lower + e("b2_y"), e("b2_z") - height)
    rod1, rod2 = (_sum(centre, apply(attitude, a), tuple(-v for v in b)) for a, b in zip(above, below, strict=True))
    return rod1, rod2, attitude


def _square(v: tuple[Any, ...]) -> Any:
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


def closure(pitch: Any, roll: Any, l1_m: Any, l2_m: Any, lengths_m: Lengths, errors: Errors) -> tuple[Any, Any, Any, Any]:
    """What the loops of both legs miss by (m^2; zero for a real attitude), and the pitch and roll that a level reference reads.

    ``l1_m, l2_m`` are the commanded rod lengths; the errors dl1, dl2 come on top.
    """
    rod1, rod2, r = _placed(pitch, roll, lengths_m, errors)
    f1 = _square(rod1) - (l1_m + errors.get("dl1", 0.0)) ** 2
    f2 = _square(rod2) - (l2_m + errors.get("dl2", 0.0)) ** 2
    read_pitch = NUMPY["atan2"](-r[6], np.sqrt(r[0] * r[0] + r[3] * r[3]))
    return f1, f2, read_pitch, -NUMPY["atan2"](r[7], r[8])


def _derivative(value: Any) -> Array:
    return np.asarray(np.imag(value) / STEP)


def sensitivity(pitch_rad: ArrayLike, roll_rad: ArrayLike, lengths_m: Lengths, sources: Sequence[Source]) -> Array:
    """Linear model: attitude error per unit of each source, shape (2, sources, *poses), pitch first; rad per m, rad or K."""
    pitch, roll = np.broadcast_arrays(np.asarray(pitch_rad, dtype=np.float64), np.asarray(roll_rad, dtype=np.float64))
    l1, l2 = vectorised.rod_lengths(pitch, roll, *lengths_m)
    along_pitch = closure(pitch + 1j * STEP, roll, l1, l2, lengths_m, {})
    j11, j21 = (_derivative(f) for f in along_pitch[:2])
    j22 = _derivative(closure(pitch, roll + 1j * STEP, l1, l2, lengths_m, {})[1])
    single: dict[str, tuple[Array, Array]] = {}
    for name in dict.fromkeys(part for source in sources for part, _ in source.parts):
        f1, f2, p, r = (_derivative(v) for v in closure(pitch, roll, l1, l2, lengths_m, {name: 1j * STEP}))
        d_pitch = -f1 / j11
        d_roll = -(f2 + j21 * d_pitch) / j22
        single[name] = d_pitch + p, d_roll + r
    result = np.zeros((2, len(sources), *pitch.shape))
    for k, source in enumerate(sources):
        for name, factor in source.parts:
            for axis in (0, 1):
                result[axis, k] += factor * single[name][axis]
    return result


def exact_error(pitch_rad: ArrayLike, roll_rad: ArrayLike, lengths_m: Lengths, errors: Errors) -> Array:
    """Exact model: attitude error with the loops solved again by Newton's method, shape (2, *poses), rad.

    Raises ``ValueError`` when errors are so large that no attitude closes the loops.
    """
    arrays = np.broadcast_arrays(
        np.asarray(pitch_rad, dtype=np.float64),
        np.asarray(roll_rad, dtype=np.float64),
        *(np.asarray(value, dtype=np.float64) for value in errors.values()),
    )
    nominal_pitch, nominal_roll = arrays[:2]
    l1, l2 = vectorised.rod_lengths(nominal_pitch, nominal_roll, *lengths_m)
    pitch, roll = nominal_pitch.copy(), nominal_roll.copy()
    with np.errstate(all="ignore"):
        for _ in range(30):
            f1, f2, _, _ = closure(pitch, roll, l1, l2, lengths_m, errors)
            j11, j21 = (_derivative(f) for f in closure(pitch + 1j * STEP, roll, l1, l2, lengths_m, errors)[:2])
            j12, j22 = (_derivative(f) for f in closure(pitch, roll + 1j * STEP, l1, l2, lengths_m, errors)[:2])
            determinant = j11 * j22 - j12 * j21
            d_pitch = (f1 * j22 - f2 * j12) / determinant
            d_roll = (f2 * j11 - f1 * j21) / determinant
            pitch, roll = pitch - d_pitch, roll - d_roll
            left = max(float(np.max(np.abs(d_pitch))), float(np.max(np.abs(d_roll))))
            if left < 1e-14 or not np.isfinite(left):
                break
        _, _, read_pitch, read_roll = closure(pitch, roll, l1, l2, lengths_m, errors)
    if not left < 1e-9:
        raise ValueError("errors too large: with them no attitude has the commanded rod lengths")
    return np.stack((read_pitch - nominal_pitch, read_roll - nominal_roll))


def zeroing(errors: Errors, lengths_m: Lengths) -> tuple[Any, Any]:
    """Rod lengths (m) to add so that the platform with these errors is level when level is commanded: what zeroing at level sets."""
    rod1, rod2, _ = _placed(0.0, 0.0, lengths_m, errors)
    level = level_length(lengths_m)
    return tuple(np.sqrt(_square(rod)) - level - errors.get(name, 0.0) for rod, name in ((rod1, "dl1"), (rod2, "dl2")))


def zeroed_sensitivity(matrix: Array, at_level: Array, rods: Array, rods_at_level: Array) -> Array:
    """Linear model after zeroing at level.

    ``matrix`` (2, sources, *poses) and ``at_level`` (2, sources) are sensitivities of the sources, ``rods`` (2, 2, *poses) and
    ``rods_at_level`` (2, 2) those of dl1 and dl2, which the zeroing sets.
    """
    correction = -np.linalg.solve(rods_at_level, at_level)
    zeroed: Array = matrix + np.einsum("ar...,rs->as...", rods, correction)
    return zeroed
