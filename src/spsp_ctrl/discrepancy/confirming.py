"""Confirm: whether a name foretells what held-out motion shows. Nothing is fitted here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spsp_ctrl.discrepancy.whitening import Split, colours, robust_rms
from spsp_ctrl.plant.arrays import Array

BLOCK = 60
"""Samples of a block over which a whitened residual may still hang together."""


class Confirmed(NamedTuple):
    """How far the change that a name foretells is found on held-out motion."""

    factor: float
    """1: all of it; 0: nothing; negative: the opposite."""
    sigma: float
    """Its standard deviation."""
    expected: float
    """Standard deviations at which a true name would stand: below 2 or 3 this motion cannot tell."""

    @property
    def score(self) -> float:
        """Standard deviations above nothing."""
        return self.factor / self.sigma if self.sigma > 0.0 else 0.0


def confirm(before: Split, after: Split, floor: dict[str, float], clean: Split | None = None) -> Confirmed:
    """Regress what is left on what the name takes off, over all channels; deviation from blocks.

    Whitened by the colour of ``clean``, the residual of a commissioning log, which holds what the model lacks anyway; without one, by what is left.
    """
    white = colours(before if clean is None else clean, floor)
    white = {c: w.unlimited(robust_rms(before[c])) for c, w in white.items()}
    top, bottom, pieces = 0.0, 0.0, []
    parts: list[tuple[Array, Array]] = []
    for c, w in white.items():
        y = w.apply(before[c])
        x = y - w.apply(after[c])
        parts.append((x, y))
        top, bottom = top + float(x @ y), bottom + float(x @ x)
    if bottom <= 0.0:
        return Confirmed(0.0, np.inf, 0.0)
    factor = top / bottom
    for x, y in parts:
        wrong = x * (y - factor * x)
        n = len(wrong) // BLOCK
        pieces.append(wrong[: n * BLOCK].reshape(n, BLOCK).sum(axis=1))
    sigma = float(np.sqrt(np.sum(np.concatenate(pieces) ** 2))) / bottom
    return Confirmed(factor, sigma, 1.0 / sigma if sigma > 0.0 else 0.0)
