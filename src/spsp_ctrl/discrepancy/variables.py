"""What a fit may move: single parameters, and amplitude with phase as a pair of cosine and sine (which has no dead point at zero)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, hypot, inf, sin

import numpy as np

from spsp_ctrl.plant.arrays import Array


@dataclass(frozen=True, slots=True)
class Variable:
    """One number of a fit. ``part`` is empty for a plain parameter, else ``cos`` or ``sin`` of amplitude ``index`` and phase ``phase``."""

    name: str
    index: int
    low: float
    high: float
    step: float
    """Finite difference, and the natural size of a change."""
    phase: int = -1
    part: str = ""
    mean: float = 0.0
    sigma: float = inf
    """Prior: what is known before the data."""
    nuisance: bool = False
    along: int = -1
    """A parameter that moves by as much (the level at rest with the level in motion)."""

    def get(self, p: Array) -> float:
        """Value in a parameter array."""
        if not self.part:
            return float(p[self.index])
        return float(p[self.index]) * (cos(p[self.phase]) if self.part == "cos" else sin(p[self.phase]))


def place(p: Array, variables: Sequence[Variable], values: Array) -> Array:
    """A copy of ``p`` with the values in place; the two parts of a pair must both be among the variables."""
    q = p.copy()
    pairs: dict[int, list[float]] = {}
    for variable, value in zip(variables, values, strict=True):
        if variable.part:
            pair = pairs.setdefault(variable.index, [0.0, 0.0, variable.phase])
            pair[0 if variable.part == "cos" else 1] = float(value)
        else:
            if variable.along >= 0:
                q[variable.along] += value - q[variable.index]
            q[variable.index] = value
    for index, (c, s, phase) in pairs.items():
        q[index] = hypot(c, s)
        q[int(phase)] = atan2(s, c)
    return q


def pair(
    name: str, index: int, phase: int, high: float, step: float, p: Array, sigma: float = inf, nuisance: bool = False
) -> tuple[Variable, Variable]:
    """Amplitude and phase as two variables; the prior stands at what ``p`` has."""
    made = []
    for part in ("cos", "sin"):
        v = Variable(f"{name}.{part}", index, -high, high, step, phase, part, nuisance=nuisance)
        made.append(Variable(v.name, index, -high, high, step, phase, part, v.get(p), sigma, nuisance))
    return made[0], made[1]


def values_of(p: Array, variables: Sequence[Variable]) -> Array:
    """Values of the variables in ``p``, inside their bounds."""
    return np.array([min(max(v.get(p), v.low), v.high) for v in variables])
