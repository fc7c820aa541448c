"""Noise of one log, drawn before the run: white or coloured, with outliers and dropouts where a case asks for them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tools.blind_exam.physics import Array

CURRENT_A, RULER_M, BUS_V, SCREW_K = 5e-3, 5e-8, 0.02, 0.02


class Climate(NamedTuple):
    """How the sensors of a case behave."""

    colour: float = 0.0
    """Pole of a first-order colouring, 0 = white; the variance stays."""
    outliers: float = 0.0
    """Share of samples with a tenfold error."""
    gain: float = 1.0
    lost: float = 0.0
    """Share of the cycles that are missing from the log."""
    held: float = 0.0
    """Share of the ruler's readings that repeat the one before, in every log of the case alike."""
    jitter: float = 0.0
    """Deviation of a sampling instant, as a share of the period; the stamps tell it."""


def draw(cycles: int, climate: Climate, rng: np.random.Generator) -> Array:
    """Columns: current A, resolver (unit, its size is the machine's), ruler m, bus V, unit uniform (for dropouts), screw temperature K, and when the
    cycle was sampled, as a share of the period."""
    noise = rng.standard_normal((cycles, 6))
    if climate.colour > 0.0:
        a = climate.colour
        for column in range(4):
            white, state = noise[:, column], 0.0
            for k in range(cycles):
                state = a * state + np.sqrt(1.0 - a * a) * white[k]
                noise[k, column] = state
    if climate.outliers > 0.0:
        for column in (0, 2):
            noise[rng.random(cycles) < climate.outliers, column] *= 10.0
    noise[:, :4] *= climate.gain * np.array([CURRENT_A, 1.0, RULER_M, BUS_V])
    noise[:, 4] = rng.random(cycles)
    noise[:, 5] *= SCREW_K
    when = np.clip(rng.standard_normal(cycles), -3.0, 3.0) * climate.jitter
    return np.column_stack([noise, when])


def lost(cycles: int, climate: Climate, rng: np.random.Generator) -> Array:
    """1 for the cycles that the log does not have; the first second is whole."""
    gone = (rng.random(cycles) < climate.lost).astype(np.float64)
    gone[:500] = 0.0
    return gone
