"""Numbers that a judgement rests on: effective sample size, block bootstrap, family-wise significance."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.plant.arrays import Array


def rms(values: Array) -> float:
    """Root of the mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(values * values))) if len(values) else 0.0


def correlation_length(values: Array) -> float:
    """Samples that count as one: 1 + 2 sum of the autocorrelation up to its first zero."""
    n = len(values)
    centred = values - values.mean() if n else values
    power = float(centred @ centred)
    if n < 8 or power <= 0.0:
        return 1.0
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum), size)[: n // 2] / power
    below = np.flatnonzero(correlation <= 0.05)
    end = int(below[0]) if len(below) else n // 2
    return float(max(1.0, 1.0 + 2.0 * np.sum(correlation[1:end])))


def effective_size(values: Array) -> float:
    """Independent samples in a correlated series."""
    return len(values) / correlation_length(values)


def blocks(n: int, length: int) -> list[tuple[int, int]]:
    """Consecutive blocks of about ``length`` samples that cover ``n``."""
    count = max(2, round(n / max(1, length)))
    edges = np.linspace(0, n, count + 1).astype(int)
    return [(int(a), int(b)) for a, b in pairwise(edges) if b > a]


def bootstrap(sums: Array, draws: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Sums over blocks drawn with replacement: ``sums`` has one row per block; the result has one row per draw."""
    counts = rng.multinomial(len(sums), np.full(len(sums), 1.0 / len(sums)), size=draws)
    return np.asarray(counts @ sums, np.float64)


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values: what is below alpha holds family-wise at alpha (Scand. J. Statist. 6, 1979)."""
    order = np.argsort(p_values)
    adjusted, highest = [0.0] * len(p_values), 0.0
    for rank, at in enumerate(order):
        highest = max(highest, min(1.0, (len(p_values) - rank) * float(p_values[at])))
        adjusted[int(at)] = highest
    return adjusted
