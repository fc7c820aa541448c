"""Show: how much of the gap is gone, on held-out data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spsp_ctrl.discrepancy.fitting import Split
from spsp_ctrl.discrepancy.replica import UNITS
from spsp_ctrl.discrepancy.statistics import blocks, bootstrap, correlation_length, rms

OPEN = 1.2
"""A gap is spoken of from this ratio of residual to floor on."""
DRAWS = 1000


@dataclass(frozen=True, slots=True)
class Gap:
    """One channel before and after."""

    floor: float
    before: float
    after: float
    closed: float | None
    """None: the channel was at its floor before."""
    interval: tuple[float, float] | None
    unit: str


def gaps(before: Split, after: Split, floor: dict[str, float], seed: int, units: Mapping[str, str] = UNITS) -> dict[str, Gap]:
    """Gap closed by channel with its 95 % interval (blocks of the record redrawn)."""
    rng = np.random.default_rng([seed, 6])
    out = {}
    for channel, old in before.items():
        new, level = after[channel], floor[channel]
        a, b = rms(old), rms(new)
        if level <= 0.0 or a < OPEN * level:
            out[channel] = Gap(level, a, b, None, None, units[channel])
            continue
        parts = blocks(len(old), int(max(8, 4 * correlation_length(old), len(old) // 150)))
        sums = np.array([[np.sum(old[i:j] ** 2), np.sum(new[i:j] ** 2), j - i] for i, j in parts])
        drawn = bootstrap(sums, DRAWS, rng)
        d = np.sqrt(drawn[:, :2] / drawn[:, 2:]) / level
        shares = (d[:, 0] - d[:, 1]) / np.maximum(d[:, 0] - 1.0, 1e-3)
        low, high = np.quantile(shares, [0.025, 0.975])
        out[channel] = Gap(level, a, b, (a - b) / (a - level), (float(low), float(high)), units[channel])
    return out
