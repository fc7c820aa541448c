"""Find: in which channel and regime a residual is larger than its floor, how large, and how sure that is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from spsp_ctrl.discrepancy.fitting import Bench, Split
from spsp_ctrl.discrepancy.masks import Mask, regimes
from spsp_ctrl.discrepancy.replica import UNITS
from spsp_ctrl.discrepancy.statistics import blocks, bootstrap, correlation_length, holm, rms

FAMILY = 0.01
"""Family-wise error rate over all channels and regimes."""
DRAWS = 1000
STAGES = {"force": "drive", "current": "drive", "drive": "drive", "resolver": "sensors", "ruler": "transmission"}


@dataclass(frozen=True, slots=True)
class Found:
    """One channel and regime with more than its floor."""

    channel: str
    stage: str
    where: str
    regime: str
    size: float
    unit: str
    p_value: float
    share: float
    """Share of the energy of the channel."""
    enrichment: float
    """That share over the share of time."""


@dataclass(frozen=True, slots=True)
class Machine:
    """What the finding of regimes must know about a kind of machine."""

    regimes: Callable[[Any, str], dict[str, Mask]]
    """Regimes of a replica for a channel."""
    stages: Callable[[str], str]
    where: Callable[[str], str]
    units: Mapping[str, str]


AXIS = Machine(lambda one, channel: regimes(one), lambda channel: STAGES[channel], lambda channel: "axis", UNITS)


def find(bench: Bench, residuals: Split, seed: int, machine: Machine = AXIS) -> list[Found]:
    """Regimes of a bench whose mean square exceeds the squared floor; p-values by block bootstrap, Holm over everything."""
    rng = np.random.default_rng([seed, 5])
    raw: list[tuple[str, str, float, float, float, float]] = []
    for channel, values in residuals.items():
        floor = bench.floor.get(channel, 0.0)
        length = int(max(8, 4 * correlation_length(values), len(values) // 150))
        parts = blocks(len(values), length)
        masks: dict[str, list[np.ndarray]] = {}
        for one, use in zip(bench.replicas, bench.use, strict=True):
            rows = one.rows(channel)[use[channel]]
            for name, mask in machine.regimes(one, channel).items():
                masks.setdefault(name, []).append(mask[rows])
        total = float(np.sum(values**2))
        for name, pieces in [("everywhere", [np.ones(len(values), bool)]), *masks.items()]:
            mask = np.concatenate(pieces)
            if len(mask) != len(values) or mask.sum() < 20:
                continue
            energy = np.array([[np.sum(values[a:b][mask[a:b]] ** 2), np.sum(mask[a:b])] for a, b in parts])
            drawn = bootstrap(energy, DRAWS, rng)
            level = drawn[:, 0] / np.maximum(drawn[:, 1], 1.0)
            size = rms(values[mask])
            # how often a redrawn record is back at its floor, with the rule of succession; far tails by their normal approximation
            p_count = (1.0 + float(np.sum(level <= floor**2))) / (DRAWS + 1.0)
            spread = float(np.std(level))
            z = (size**2 - floor**2) / spread if spread > 0.0 else 0.0
            p = p_count if p_count > 2.0 / DRAWS else min(p_count, float(np.exp(-0.5 * min(z, 37.0) ** 2)))
            share = float(np.sum(values[mask] ** 2)) / max(total, 1e-300)
            raw.append((channel, name, size, p, share, share / max(float(mask.mean()), 1e-12)))
    adjusted = holm([r[3] for r in raw])
    found = []
    for (channel, name, size, _, share, enrichment), p in zip(raw, adjusted, strict=True):
        floor = bench.floor.get(channel, 0.0)
        if p < FAMILY and size > 1.05 * floor and (name == "everywhere" or enrichment > 1.3):
            found.append(Found(channel, machine.stages(channel), machine.where(channel), name, size, machine.units[channel], p, share, enrichment))
    return sorted(found, key=lambda f: (f.regime != "everywhere", -(f.size / max(bench.floor.get(f.channel, 0.0), 1e-15))))
