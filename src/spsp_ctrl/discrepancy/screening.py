"""Screen: what each name could explain at the most, linearly from a few finite sizes, whitened per channel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spsp_ctrl.discrepancy.fitting import Bench, Fitted
from spsp_ctrl.discrepancy.library import Candidate, Group
from spsp_ctrl.discrepancy.variables import Variable, place, values_of
from spsp_ctrl.discrepancy.whitening import colours, judged, log_likelihood, robust_rms
from spsp_ctrl.plant.arrays import Array

STRETCH, LEAST = 8.0, 0.02
"""A start is not stretched more than this, and not shrunk below."""
TRIED = 2
"""Starts of a candidate that are simulated after stretching."""
LEADERS = 2


class Screened(NamedTuple):
    """A candidate at its best start."""

    gain: float
    """Twice the logarithm of the likelihood that it gains there, less the price of its variables."""
    candidate: Candidate
    start: Array
    leads: tuple[str, ...]
    """Channels in which it is among the ``LEADERS``."""


def screen(bench: Bench, fitted: Fitted, candidates: list[Candidate]) -> list[Screened]:
    """All candidates, best first.

    Each start is stretched by its linear response, with what is free already going along; the best two of a candidate are then simulated, since most
    effects bend: what counts is what they really explain.
    """
    base = fitted.residuals
    white = colours(base, bench.floor, bench.motion)
    was = judged(base, white) if bench.motion else log_likelihood(base, bench.floor)
    channels = list(base)
    size = sum(len(r) for r in base.values())
    variables = fitted.variables
    prior = np.diag([1.0 / v.sigma if np.isfinite(v.sigma) else 0.0 for v in variables])
    rows = len(variables)
    basis, inverse = np.zeros((size + rows, 0)), np.zeros((0, size + rows))
    if rows:
        stacked = np.concatenate([*(white[c].columns(fitted.jacobian[c]) for c in channels), prior])
        norms = np.linalg.norm(stacked, axis=0)
        norms = np.where(norms > 0, norms, 1.0)
        basis, values, turned = np.linalg.svd(stacked / norms, full_matrices=False)
        inverse = (turned.T * np.where(values > 1e-8 * values[0], 1.0 / np.maximum(values, 1e-300), 0.0)) @ basis.T / norms[:, None]
    flat = {c: white[c].apply(base[c]) for c in channels}
    whole = np.concatenate([*flat.values(), np.zeros(rows)])
    target = _less(basis, whole)
    price = float(np.log(max(2, size)))
    found: list[tuple[float, Candidate, Array, dict[str, float]]] = []
    for candidate in candidates:
        own = {v.name for v in candidate.variables}
        linear: list[tuple[float, Array, Array]] = []
        for group in candidate.groups:
            if not group.steps:
                linear.append((0.0, group.values, np.zeros(rows)))
                continue
            columns, full = [], []
            for values in (_stepped(group, k, step) for k, step in group.steps):
                after = bench.residuals(candidate.at(values))
                moved = [flat[c] - white[c].unlimited(robust_rms(after[c])).apply(after[c]) for c in channels]
                full.append(np.concatenate([*moved, np.zeros(rows)]))
                columns.append(_less(basis, full[-1]))
            matrix = np.stack(columns, axis=1)
            factor = _bounded(candidate, group, np.asarray(np.linalg.lstsq(matrix, target, rcond=1e-9)[0], np.float64))
            left = target - matrix @ factor
            values = group.values.copy()
            for (k, step), f in zip(group.steps, factor, strict=True):
                values[k] += step * (f if abs(f) > LEAST else LEAST if f >= 0.0 else -LEAST)
            linear.append((float(left @ left), values, -inverse @ (whole - np.stack(full, axis=1) @ factor)))
        linear.sort(key=lambda entry: entry[0])
        best: tuple[float, Array, dict[str, float]] | None = None
        for _, values, others in linear if not candidate.groups[0].steps else linear[:TRIED]:
            start = _with(candidate.at(values), [(v, d) for v, d in zip(variables, others, strict=True) if v.name not in own])
            left_over = bench.residuals(start)
            now = judged(left_over, white) if bench.motion else log_likelihood(left_over, bench.floor)
            off = {c: 2.0 * (now[c] - was[c]) for c in channels}
            if not any(off.values()):
                continue  # this start is out of reach of the records
            gain = sum(off.values()) - price * len(candidate.variables)
            if best is None or gain > best[0]:
                best = gain, start, off
        if best is not None:
            found.append((best[0], candidate, best[1], best[2]))
    leads = {c: {f[1].name for f in sorted(found, key=lambda f: -f[3][c])[:LEADERS]} for c in channels}
    out = [Screened(g, c, start, tuple(ch for ch in channels if c.name in leads[ch])) for g, c, start, _ in found]
    return sorted(out, key=lambda s: -s.gain)


def _with(p: Array, moves: list[tuple[Variable, float]]) -> Array:
    """Parameters with what is free already moved to where it goes beside the candidate."""
    variables = [v for v, _ in moves]
    low, high = np.array([v.low for v in variables]), np.array([v.high for v in variables])
    return place(p, variables, np.clip(values_of(p, variables) + np.array([d for _, d in moves]), low, high)) if moves else p


def _less(basis: Array, vector: Array) -> Array:
    return vector - basis @ (basis.T @ vector)


def _stepped(group: Group, k: int, size: float) -> Array:
    values = group.values.copy()
    values[k] += size
    return values


def _bounded(candidate: Candidate, group: Group, factor: Array) -> Array:
    """Factors inside the bounds of the variables: signs are part of a name, a positive size is not turned round."""
    out = factor.copy()
    for j, (k, size) in enumerate(group.steps):
        v, zero = candidate.variables[k], group.values[k]
        ends = sorted(((v.low - zero) / size, (v.high - zero) / size))
        out[j] = np.clip(out[j], max(-STRETCH, ends[0]), min(STRETCH, ends[1]))
    return out


