"""The known cascade of a single axis as a pure step: it drives the virtual bench, and a diagnosis replays it before it blames the plant.

``docs/log-format.md`` states the same line for who writes a log with other software.
"""

from __future__ import annotations

import numpy as np

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.stages.drive import clip

MAX_SPAN = 4
"""Cycles over which the speed may be taken at the most: as many positions as the state remembers."""


@stage
def cascade_step(
    reference: float,
    reference_rate: float,
    position: float,
    position_before: float,
    span_s: float,
    kp: float,
    kv: float,
    feedforward: float,
    limit: float,
) -> float:
    """Command (A, or V) from reference and position in m; ``position_before`` was read ``span_s`` earlier.

    ``kp`` in 1/s, ``kv`` in A s/m (V s/m), ``feedforward`` the share of the reference rate, ``limit`` in A (V).
    """
    rate = (position - position_before) / span_s
    return clip(kv * (kp * (reference - position) + feedforward * reference_rate - rate), -limit, limit)


def replay(
    reference: Array,
    reference_rate: Array,
    position: Array,
    rate_hz: float,
    *,
    kp: float,
    kv: float,
    feedforward: float = 0.0,
    limit: float = float("inf"),
    rate_span: int = 1,
) -> Array:
    """The commands that the cascade gives on recorded readings, one for each cycle."""
    before = np.concatenate([np.full(rate_span, position[0]), position[:-rate_span]]) if len(position) else position
    rate = (position - before) / (rate_span / rate_hz)
    return np.asarray(np.clip(kv * (kp * (reference - position) + feedforward * reference_rate - rate), -limit, limit))
