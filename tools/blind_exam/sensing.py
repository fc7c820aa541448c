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


def draw(cycles: int, climate: Climate, rng: np.random.Generator) -> Array:
    """Columns: current A, resolver (unit, its size is the machine's), ruler m, bus V, unit uniform (for dropouts), screw temperature K."""
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
    return noise
