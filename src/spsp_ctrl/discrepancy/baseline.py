"""The commissioning log as a baseline: what the model leaves of a motion while nothing is wrong is taken off what it leaves of the same motion later.

A model is never exact: its friction law, its small ripples and its elasticity leave a residual of many times the noise of the sensors. On the
same motion that residual is the same again and cancels, and an effect shows from the noise up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from spsp_ctrl.discrepancy.records import Record
from spsp_ctrl.discrepancy.replica import Replica
from spsp_ctrl.discrepancy.whitening import Split, robust_rms
from spsp_ctrl.plant.arrays import Array

INPUTS = ("reference_m", "load_force_n", "load_mass_kg")
"""What makes a motion: equal to the millionth part of its range."""
DRIFT = 1.2
"""Two records of one machine part by so much more than their noise: slow drift of a motor that is held by noisy readings (seen: 1.0 to 1.35)."""


def same_motion(one: Record, other: Record) -> bool:
    """Whether two records ask the same of the axis."""
    if len(one.rows) != len(other.rows) or abs(one.rate_hz - other.rate_hz) > 1e-9 * one.rate_hz:
        return False
    for name in INPUTS:
        a, b = np.asarray(one.rows[name], np.float64), np.asarray(other.rows[name], np.float64)
        if np.max(np.abs(a - b)) > 1e-6 * max(float(np.ptp(b)), 1e-12) + 1e-12:
            return False
    return float(np.ptp(one.rows["reference_m"])) > 0.0


def baselines(records: Sequence[Record], commissioning: Sequence[Replica], p: Array) -> tuple[Split, ...] | None:
    """For each record the residual of the commissioning log of the same motion at ``p``; None unless every record has one."""
    found = []
    for record in records:
        match = next((c for c in commissioning if same_motion(record, c.record)), None)
        if match is None:
            return None
        found.append(match.residuals(p))
    return tuple(found) if found else None


def difference_floor(difference: Split, motion: Mapping[str, Array]) -> dict[str, float]:
    """Floor of a difference of two records, by channel: what is left of it without all that a motion could do (``motion``: orthonormal bases)."""
    freedom = {c: (len(r) / max(1, len(r) - motion[c].shape[1])) ** 0.5 for c, r in difference.items()}
    return {c: DRIFT * freedom[c] * robust_rms(r - motion[c] @ (motion[c].T @ r)) for c, r in difference.items()}
