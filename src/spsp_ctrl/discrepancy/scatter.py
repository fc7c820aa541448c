"""Names that change only the scatter of a reading: noise, lost samples, coarse steps. Seen against the scatter of the commissioning log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spsp_ctrl.discrepancy.replica import Replica
from spsp_ctrl.plant.arrays import Array

RATIO = 1.12
"""Scatter that counts as changed."""
FAST = 16.0
"""Motion by so many times scatter and step in a cycle: a reading cannot stay as it is."""
FEWEST, TIMES = 4, 3.0
"""Repeated readings in fast motion that count as lost samples: at least so many more, and so many times as many, as in the commissioning log."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """How the readings of one record scatter."""

    resolver_rad: float
    resolver_step_rad: float
    held_resolver: float
    """Share of the cycles in fast motion in which the reading stayed as it was."""
    held_ruler: float
    cycles: int
    """Cycles in fast motion."""


@dataclass(frozen=True, slots=True)
class Random:
    """A name from scatter."""

    name: str
    parameter: str
    value: float
    unit: str
    ratio: float


def scatter(one: Replica) -> Scatter:
    """Scatter of a record from second differences of its readings, which motion hardly changes."""
    motor, load = one.measured["motor"], one.measured["load"]
    speed = np.abs(motor[2:] - motor[:-2]) * 0.5
    spread, step = _spread(motor), _step(motor)
    fast = speed > max(FAST * spread, FAST * step, 1e-3)
    ruler_fast = fast & (np.abs(load[2:] - load[:-2]) * 0.5 > max(FAST * _spread(load), FAST * _step(load), 1e-12))
    return Scatter(
        spread,
        step,
        float(np.mean(np.diff(motor)[:-1][fast] == 0.0)) if fast.sum() > 100 else 0.0,
        float(np.mean(np.diff(load)[:-1][ruler_fast] == 0.0)) if ruler_fast.sum() > 100 else 0.0,
        int(fast.sum()),
    )


def repeated(values: Array) -> Array:
    """1 where a reading in motion is that of the cycle before."""
    out = np.zeros(len(values))
    speed = np.abs(values[2:] - values[:-2]) * 0.5
    out[1:-1] = (np.diff(values)[:-1] == 0.0) & (speed > 4.0 * max(_spread(values), _step(values)))
    return out


def _spread(values: Array) -> float:
    """Scatter about a straight line through the neighbours; what lies far out is cut, since motion bends the line there."""
    curve = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    level = float(np.quantile(np.abs(curve), 0.7))
    if level == 0.0:
        return 0.0
    kept = curve[np.abs(curve) <= 2.0 * level]
    return float(np.sqrt(np.mean(kept**2)) / 1.5**0.5)


def _step(values: Array) -> float:
    """Smallest change between neighbours that comes more than a few times."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > 1e-9 * max(float(np.ptp(values)), 1e-12)]
    return float(np.partition(steps, FEWEST)[FEWEST]) if len(steps) > FEWEST else 0.0


def lost_or_coarse(now: Scatter, clean: Scatter) -> list[Random]:
    """Names that readings alone give: samples that were lost, a coarser step."""
    found = []
    for share, before, parameter in ((now.held_resolver, clean.held_resolver, "resolver_lost"), (now.held_ruler, clean.held_ruler, "ruler_lost")):
        if (share - before) * now.cycles >= FEWEST and share >= TIMES * before:
            found.append(Random("sensor_dropout", parameter, share - before, "1", share / max(before, 1.0 / max(1, now.cycles))))
    if now.resolver_step_rad > 1.9 * clean.resolver_step_rad > 0.0:
        ratio = now.resolver_step_rad / clean.resolver_step_rad
        found.append(Random("resolver_quantisation", "res_step_rad", now.resolver_step_rad, "rad", ratio))
    return found


def noisier(now: Array, clean: Array) -> list[Random]:
    """The name for a resolver that scatters more about its model than in the commissioning log; from what the model leaves of both."""
    a, b = _spread(now), _spread(clean)
    if not a > RATIO * b > 0.0:
        return []
    return [Random("resolver_noise", "res_noise_rad", float(np.sqrt(a * a - b * b)), "rad", a / b)]
