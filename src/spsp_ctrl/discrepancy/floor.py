"""The floor of each channel: what even a right model leaves. Measured by a commissioning log or by laps that repeat, else only guessed."""

from __future__ import annotations

from typing import Literal

import numpy as np

from spsp_ctrl.discrepancy.fitting import Bench, Split, robust_rms
from spsp_ctrl.discrepancy.replica import Replica
from spsp_ctrl.plant.arrays import Array

Quality = Literal["measured", "weak"]
LEAST_PERIOD_S = 0.5


def from_commissioning(residuals: Split) -> dict[str, float]:
    """Model-form floor: what the recalibrated model leaves of a log on which nothing is hidden."""
    return {c: robust_rms(r) for c, r in residuals.items()}


def period_of(reference: Array, rate_hz: float) -> int:
    """Samples after which a reference repeats exactly over all the rest of the record; 0 when it does not."""
    n = len(reference)
    if n < 4 or np.ptp(reference) == 0.0:
        return 0
    tolerance = 1e-6 * float(np.ptp(reference))
    for period in range(max(2, round(LEAST_PERIOD_S * rate_hz)), n // 2 + 1):
        if abs(reference[period] - reference[0]) > tolerance or abs(reference[-1] - reference[-1 - period]) > tolerance:
            continue
        if np.max(np.abs(reference[period:] - reference[:-period])) <= tolerance and np.ptp(reference[:period]) > 0.5 * np.ptp(reference):
            return period
    return 0


def from_repeats(one: Replica, residuals: Split) -> dict[str, float] | None:
    """Repeatability between laps: rms of the difference of two laps over root two. None where nothing repeats.

    Laps are a reference that repeats exactly, or motions named ``repeat``, of which the first is compared with those after it.
    """
    period = period_of(np.asarray(one.record.rows["reference_m"], np.float64), one.record.rate_hz)
    spans: list[tuple[int, int]] = []
    if period:
        n = len(one.inputs)
        length = min(period, n - one.skip - (n // period - 1) * period)  # without the settling start of the first lap
        spans = [(one.skip + k * period, one.skip + k * period + length) for k in range(n // period)]
    else:
        laps = [m for m in one.record.motions if m.name == "repeat" and m.start >= one.skip]
        if len(laps) > 1:
            length = min(m.stop - m.start for m in laps)
            spans = [(m.start, m.start + length) for m in laps]
    if len(spans) < 2:
        return None
    out = {}
    for channel, values in residuals.items():
        rows = one.rows(channel)
        laps_of = [values[(rows >= a) & (rows < b)] for a, b in spans]
        n = min(len(v) for v in laps_of)
        difference = np.concatenate([laps_of[0][:n] - other[:n] for other in laps_of[1:]])
        out[channel] = robust_rms(difference) / 2.0**0.5
    return out


def guessed(residuals: Split) -> dict[str, float]:
    """Without repeats: the scatter of neighbours around a straight line, an estimate of white noise only. Weak."""
    return {c: robust_rms(r[1:-1] - 0.5 * (r[:-2] + r[2:])) / 1.5**0.5 if len(r) > 4 else 0.0 for c, r in residuals.items()}


def measure(bench: Bench, p: Array) -> tuple[dict[str, float], Quality]:
    """Floor from the logs to be judged themselves: laps that repeat, else a guess."""
    for one in bench.replicas:
        found = from_repeats(one, one.residuals(p))
        if found is not None:
            return found, "measured"
    return guessed(bench.residuals(p)), "weak"
