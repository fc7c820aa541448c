"""Bounded least squares over several records, every channel whitened by the autoregression of what it has left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from spsp_ctrl.discrepancy.replica import Replica
from spsp_ctrl.discrepancy.variables import Variable, place, values_of
from spsp_ctrl.discrepancy.whitening import Colour, Split, colours, robust_rms
from spsp_ctrl.plant.arrays import Array

__all__ = ["Bench", "Fitted", "Split", "fit", "jacobian", "robust_rms"]


@dataclass(frozen=True)
class Bench:
    """The records that a fit sees, with the samples of each channel that belong to it (1) or not (0)."""

    replicas: tuple[Replica, ...]
    use: tuple[dict[str, Array], ...]
    floor: dict[str, float]
    baseline: tuple[Split | None, ...] = ()
    """What the model left of the same motion when nothing was wrong yet, for each record: it is taken off."""
    motion: dict[str, Array] = field(default_factory=dict)
    """Orthonormal basis of what the motion can do to each channel; empty: a residual is whitened by its own colour."""
    calls: list[int] = field(default_factory=lambda: [0])

    def residuals(self, p: Array) -> Split:
        """Residuals by channel over all records, only what is used. Huge but finite where the model ran away."""
        self.calls[0] += len(self.replicas)
        parts: dict[str, list[Array]] = {}
        for k, (one, use) in enumerate(zip(self.replicas, self.use, strict=True)):
            known = self.baseline[k] if self.baseline else None
            for channel, values in one.residuals(p).items():
                left = values if known is None else values - known[channel]
                parts.setdefault(channel, []).append(np.nan_to_num(left[use[channel]], nan=1e6, posinf=1e6, neginf=-1e6))
        return {channel: np.concatenate(values) for channel, values in parts.items()}


@dataclass(frozen=True)
class Fitted:
    """A fit: parameters, what is left, and how well the variables are known."""

    p: Array
    variables: tuple[Variable, ...]
    residuals: Split
    covariance: Array
    jacobian: dict[str, Array]
    """Change of the residuals per unit of each variable, by channel."""

    def sigma(self, k: int) -> float:
        """Standard deviation of variable ``k``."""
        return float(np.sqrt(max(0.0, self.covariance[k, k])))


def jacobian(bench: Bench, p: Array, variables: Sequence[Variable], base: Split) -> dict[str, Array]:
    """One-sided differences, stepped inwards at a bound."""
    columns: dict[str, list[Array]] = {c: [] for c in base}
    at = values_of(p, variables)
    for k, variable in enumerate(variables):
        step = variable.step if at[k] + variable.step <= variable.high else -variable.step
        moved = at.copy()
        moved[k] += step
        after = bench.residuals(place(p, variables, moved))
        for c in base:
            columns[c].append((after[c] - base[c]) / step)
    return {c: np.stack(v, axis=1) if v else np.zeros((len(base[c]), 0)) for c, v in columns.items()}


def _slopes(
    bench: Bench, p: Array, variables: Sequence[Variable], base: Split, known: tuple[Sequence[Variable], dict[str, Array]] | None
) -> dict[str, Array]:
    if known is None:
        return jacobian(bench, p, variables, base)
    have = {v.name: k for k, v in enumerate(known[0])}
    fresh = [v for v in variables if v.name not in have]
    # a part of a pair moves with the other part in place
    pairs = [v for v in variables if v.name in have or v in fresh]
    at, new = values_of(p, pairs), {}
    for v in fresh:
        k = pairs.index(v)
        moved = at.copy()
        step = v.step if at[k] + v.step <= v.high else -v.step
        moved[k] += step
        after = bench.residuals(place(p, pairs, moved))
        new[v.name] = {c: (after[c] - base[c]) / step for c in base}
    return {c: np.stack([known[1][c][:, have[v.name]] if v.name in have else new[v.name][c] for v in variables], axis=1) for c in base}


def fit(
    bench: Bench,
    p: Array,
    variables: Sequence[Variable],
    *,
    steps: int = 5,
    whitened: Callable[[Split, dict[str, float], dict[str, Array]], dict[str, Colour]] = colours,
    known: tuple[Sequence[Variable], dict[str, Array]] | None = None,
    tick: Callable[[], None] = lambda: None,
) -> Fitted:
    """Levenberg-Marquardt with bounds and Gaussian priors; ends when a step gains less than a thousandth of the cost.

    ``known``: variables whose columns are taken as given (they hardly change while a candidate is tried); only the others are differenced.
    """
    variables = tuple(variables)
    p = place(p, variables, values_of(p, variables))
    base = bench.residuals(p)
    white = whitened(base, bench.floor, bench.motion)
    mean = np.array([v.mean for v in variables])
    inverse = np.array([1.0 / v.sigma if isfinite(v.sigma) else 0.0 for v in variables])
    low, high = np.array([v.low for v in variables]), np.array([v.high for v in variables])
    unit = np.array([v.step for v in variables])

    def cost(residuals: Split, at: Array) -> float:
        w = np.concatenate([white[c].apply(residuals[c]) for c in white])
        return float(w @ w + np.sum(((at - mean) * inverse) ** 2))

    at = values_of(p, variables)
    now, damping = cost(base, at), 1e-3
    slope = _slopes(bench, p, variables, base, known)
    normal = np.zeros((len(variables), len(variables)))
    for step in range(steps + 1):
        matrix = np.concatenate([white[c].columns(slope[c] * (np.abs(base[c]) < white[c].limit)[:, None]) for c in white])
        right = matrix.T @ np.concatenate([white[c].apply(base[c]) for c in white]) + inverse**2 * (at - mean)
        normal = matrix.T @ matrix + np.diag(inverse**2)
        if step == steps or not len(variables):
            break
        better = False
        for _ in range(4):
            free = ~(((at <= low) & (right > 0)) | ((at >= high) & (right < 0)))
            move = np.zeros(len(at))
            if free.any():
                scaled = normal[np.ix_(free, free)] * np.outer(unit[free], unit[free])
                scaled += damping * np.diag(np.diag(scaled)) + 1e-12 * np.eye(len(scaled))
                move[free] = -np.linalg.solve(scaled, right[free] * unit[free]) * unit[free]
            trial = np.clip(at + move, low, high)
            q = place(p, variables, trial)
            after = bench.residuals(q)
            value = cost(after, trial)
            if value < now:
                better, gain = True, (now - value) / max(now, 1e-30)
                p, at, base, now = q, trial, after, value
                damping = max(1e-6, damping * 0.2)
                break
            damping *= 8.0
        tick()
        if not better or gain < 1e-3:
            break
        slope = _slopes(bench, p, variables, base, known)
    covariance: Array = np.asarray(np.linalg.pinv(normal, hermitian=True), np.float64) if len(variables) else np.zeros((0, 0))
    return Fitted(p, variables, base, covariance, slope)
