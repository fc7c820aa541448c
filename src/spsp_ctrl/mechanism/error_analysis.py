"""Dynamic and static error analysis (sections 3.2 and 3.3 of the paper): attitude errors along a motion, and at poses over the error's size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import lcm

import numpy as np
from numpy.typing import ArrayLike

from spsp_ctrl.mechanism.error_model import Lengths, Source, elementary, exact_error, sensitivity
from spsp_ctrl.mechanism.vectorised import Array

SAMPLES_PER_S = 1000
LONGEST_S = 600.0
TABLE_3_M = tuple(v * 1e-3 for v in (0.01, 0.03, 0.05, 0.08, 0.1, 0.15, 0.3, 0.5))
"""Sizes of the error in Table 3 of the paper."""

Valued = tuple[tuple[Source, float], ...]
"""Sources with their values in SI units."""
Wave = tuple[float, float, float]
"""Amplitude (rad), period (s), phase (rad) of a sine."""


@dataclass(frozen=True)
class Motion:
    """A motion of the platform; arrays over time."""

    t_s: Array
    pitch_rad: Array
    roll_rad: Array


def sine_motion(pitch: Sequence[Wave], roll: Sequence[Wave]) -> Motion:
    """Sums of sines over the time after which they repeat together (at most :data:`LONGEST_S`)."""
    periods = [wave[1] for wave in (*pitch, *roll)]
    end = min(lcm(*(max(1, round(1e3 * p)) for p in periods)) * 1e-3, LONGEST_S) if periods else 1.0
    t = np.linspace(0.0, end, max(2, round(end * SAMPLES_PER_S) + 1))

    def angle(waves: Sequence[Wave]) -> Array:
        return sum((a * np.sin(2.0 * np.pi * t / period + phase) for a, period, phase in waves), np.zeros_like(t))

    return Motion(t, angle(pitch), angle(roll))


def paper_motion() -> Motion:
    """The motion of section 3.2: pitch 15 deg / 4 s, roll 20 deg / 8 s, in phase."""
    return sine_motion([(np.radians(15.0), 4.0, 0.0)], [(np.radians(20.0), 8.0, 0.0)])


@dataclass(frozen=True)
class Case:
    """Errors that act at the same time."""

    name: str
    values: Valued


@dataclass(frozen=True)
class Response:
    """Attitude error of one case, shape (2, poses): pitch first, rad."""

    case: Case
    linear: Array
    exact: Array

    @property
    def nonlinearity(self) -> float:
        """Largest difference of the two models, rad."""
        return float(np.max(np.abs(self.exact - self.linear)))


def respond(case: Case, pitch_rad: ArrayLike, roll_rad: ArrayLike, lengths_m: Lengths) -> Response:
    """Attitude error of a case at poses, by both models."""
    sources = [source for source, _ in case.values]
    matrix = sensitivity(pitch_rad, roll_rad, lengths_m, sources)
    linear = np.einsum("as...,s->a...", matrix, [value for _, value in case.values])
    return Response(case, linear, exact_error(pitch_rad, roll_rad, lengths_m, elementary(case.values)))


def separate_and_together(values: Valued) -> list[Case]:
    """Each source alone, then all together with the signs of the values (when there are several)."""
    cases = [Case(source.name, ((source, value),)) for source, value in values]
    return [*cases, Case("all together", values)] if len(values) > 1 else cases


@dataclass(frozen=True)
class PoseTable:
    """Static analysis of one source: attitude error at each pose for each size, shape (2, poses, sizes), rad."""

    source: Source
    sizes: Array
    per_unit: Array
    """Linear model, shape (2, poses): rad per m, rad or K."""
    exact: Array

    @property
    def linear(self) -> Array:
        """The straight lines of Figs 8 and 9."""
        return self.per_unit[..., None] * self.sizes

    @property
    def nonlinearity(self) -> float:
        """Largest difference of exact and linear model, rad."""
        return float(np.max(np.abs(self.exact - self.linear)))


def static_tables(
    pitch_rad: ArrayLike, roll_rad: ArrayLike, lengths_m: Lengths, sources: Sequence[Source], sizes: Sequence[float] = TABLE_3_M
) -> list[PoseTable]:
    """Each source alone at each pose, over its size."""
    pitch, roll = np.atleast_1d(np.asarray(pitch_rad, dtype=np.float64)), np.atleast_1d(np.asarray(roll_rad, dtype=np.float64))
    each = sensitivity(pitch, roll, lengths_m, sources)
    steps = np.asarray(sizes, dtype=np.float64)
    return [
        PoseTable(
            source, steps, each[:, k], exact_error(pitch[:, None], roll[:, None], lengths_m, elementary([(source, steps[None, :])]))
        )
        for k, source in enumerate(sources)
    ]


def corners(pitch_limit_rad: float, roll_limit_rad: float) -> tuple[tuple[str, float, float], ...]:
    """The extreme poses A, B, C, D of Eq (12) for given limits: (name, pitch, roll)."""
    p, r = pitch_limit_rad, roll_limit_rad
    return ("A", p, r), ("B", -p, -r), ("C", p, -r), ("D", -p, r)
