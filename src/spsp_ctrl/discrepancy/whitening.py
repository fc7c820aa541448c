"""What a residual predicts of itself: an autoregression per channel, by which fits are whitened and names are scored.

Two models of one record are compared by what neither of them nor the past of the residual foretells. A slow wave that is left over then counts as the
few independent numbers that it is, and a small quick effect beside it is not drowned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spsp_ctrl.discrepancy.statistics import effective_size, rms
from spsp_ctrl.plant.arrays import Array

CLIP = 8.0
"""A residual beyond so many rms counts as if it were there: outliers do not steer a fit."""
ORDER = 3
"""Samples of the past that are looked at: more would foretell a slow effect as well as noise can be averaged, and nothing would be left to name."""
RIDGE = 1e-6
Split = dict[str, Array]


def robust_rms(values: Array) -> float:
    """rms with everything beyond ``CLIP`` times it cut down to that."""
    level = rms(values)
    for _ in range(3):
        level = rms(np.clip(values, -CLIP * level, CLIP * level))
    return level


@dataclass(frozen=True)
class Colour:
    """The whitening filter of one channel."""

    limit: float
    """Residuals are cut there."""
    taps: Array
    """Of the filter, divided by the innovation: what comes out has unit variance."""
    innovation: float
    """rms of what the past does not foretell."""

    def apply(self, values: Array) -> Array:
        """Cut and filter."""
        return np.convolve(np.clip(values, -self.limit, self.limit), self.taps)[: len(values)]

    def unlimited(self, level: float) -> Colour:
        """The same filter for residuals of another size."""
        return Colour(max(self.limit, CLIP * level), self.taps, self.innovation)

    def columns(self, matrix: Array) -> Array:
        """Filter each column."""
        return np.stack([np.convolve(column, self.taps)[: len(column)] for column in matrix.T], axis=1) if matrix.shape[1] else matrix


def colour(values: Array, floor: float = 0.0, cleaned: Array | None = None) -> Colour:
    """Autoregression of ``values`` by least squares; the innovation is not taken as less than a thousandth of ``floor``.

    ``cleaned``: the same without what the motion does to it. It gives the colour, so that an effect does not hide behind its own slowness.
    """
    level = max(robust_rms(values), 1e-15)
    noise = values if cleaned is None else cleaned
    size = max(robust_rms(noise), 1e-15)
    kept = np.clip(noise, -CLIP * size, CLIP * size) / size
    taps, innovation = np.array([1.0]), 1.0
    if len(kept) > 4 * ORDER:
        lagged = np.lib.stride_tricks.sliding_window_view(kept, ORDER + 1)
        gram = lagged.T @ lagged / len(lagged)
        past = gram[:ORDER, :ORDER] + RIDGE * np.trace(gram) / (ORDER + 1) * np.eye(ORDER)
        weights = np.linalg.solve(past, gram[:ORDER, ORDER])
        taps = np.concatenate([[1.0], -weights[::-1]])
        innovation = float(np.sqrt(max(taps[::-1] @ gram @ taps[::-1], 1e-12)))
    size = max(innovation * size, 1e-3 * floor, 1e-15)
    return Colour(CLIP * level, np.asarray(taps / size, np.float64), size)


def colours(residuals: Mapping[str, Array], floor: Mapping[str, float], motion: Mapping[str, Array] | None = None) -> dict[str, Colour]:
    """One for each channel; ``motion`` holds an orthonormal basis of what the motion can do, by channel."""
    if not motion:
        return {c: colour(r, floor.get(c, 0.0)) for c, r in residuals.items()}
    return {c: colour(r, floor.get(c, 0.0), r - motion[c] @ (motion[c].T @ r)) for c, r in residuals.items()}


def plain(residuals: Mapping[str, Array], floor: Mapping[str, float], motion: Mapping[str, Array] | None = None) -> dict[str, Colour]:
    """No filter, only scale and a weight by the share of independent samples: for a fit that is to leave little, slow waves included."""
    made = {}
    for c, r in residuals.items():
        level = max(robust_rms(r), floor.get(c, 0.0), 1e-15)
        made[c] = Colour(CLIP * level, np.array([np.sqrt(effective_size(r) / max(1, len(r))) / level]), level)
    return made


def log_likelihood(residuals: Mapping[str, Array], floor: Mapping[str, float]) -> dict[str, float]:
    """By channel ``-n log innovation``: Gaussian, without constants."""
    return {c: -len(r) * float(np.log(colour(r, floor.get(c, 0.0)).innovation)) for c, r in residuals.items()}


def judged(residuals: Mapping[str, Array], white: Mapping[str, Colour]) -> dict[str, float]:
    """The same by given colours: what is left, filtered, in place of the innovation."""
    return {c: -len(r) * float(np.log(max(rms(white[c].unlimited(robust_rms(r)).apply(r)), 1e-9))) for c, r in residuals.items()}
