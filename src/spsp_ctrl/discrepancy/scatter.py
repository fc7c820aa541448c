"""Names that change only the scatter of a reading: noise, lost samples, coarse steps. Seen against the scatter of the commissioning log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spsp_ctrl.discrepancy.replica import Replica

RATIO = 1.25
"""Scatter that counts as changed."""
LOST = 0.004


@dataclass(frozen=True, slots=True)
class Scatter:
    """How the readings of one record scatter."""

    resolver_rad: float
    resolver_step_rad: float
    held_resolver: float
    """Share of the cycles in fast motion in which the reading stayed as it was."""
    held_ruler: float


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
    curve = motor[1:-1] - 0.5 * (motor[:-2] + motor[2:])
    spread = float(np.median(np.abs(curve)) / 0.6745 / 1.5**0.5)
    steps = np.abs(np.diff(motor))
    step = float(np.quantile(steps[steps > 0], 0.02)) if (steps > 0).any() else 0.0
    fast = speed > max(8.0 * spread, 4.0 * step, 1e-3)
    ruler_speed = np.abs(load[2:] - load[:-2]) * 0.5
    ruler_fast = fast & (ruler_speed > 4.0 * float(np.median(np.abs(np.diff(load, 2)))) + 1e-12)
    return Scatter(
        spread,
        step,
        float(np.mean(np.diff(motor)[:-1][fast] == 0.0)) if fast.sum() > 100 else 0.0,
        float(np.mean(np.diff(load)[:-1][ruler_fast] == 0.0)) if ruler_fast.sum() > 100 else 0.0,
    )


def compare(now: Scatter, clean: Scatter) -> list[Random]:
    """Names for what scatters more than in the commissioning log."""
    found = []
    for share, before, parameter in ((now.held_resolver, clean.held_resolver, "resolver_lost"), (now.held_ruler, clean.held_ruler, "ruler_lost")):
        if share > before + LOST:
            found.append(Random("sensor_dropout", parameter, share - before, "1", share / max(before, LOST)))
    if found:
        return [max(found, key=lambda r: r.ratio)]
    if now.resolver_step_rad > 1.9 * clean.resolver_step_rad > 0.0:
        return [Random("resolver_quantisation", "res_step_rad", now.resolver_step_rad, "rad", now.resolver_step_rad / clean.resolver_step_rad)]
    if now.resolver_rad > RATIO * clean.resolver_rad > 0.0:
        extra = float(np.sqrt(now.resolver_rad**2 - clean.resolver_rad**2))
        found.append(Random("resolver_noise", "res_noise_rad", extra, "rad", now.resolver_rad / clean.resolver_rad))
    return found
