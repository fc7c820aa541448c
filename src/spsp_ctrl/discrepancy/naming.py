"""Name: screen the library, refit the best jointly, accept what earns its place, prune, swap, and say what cannot be told apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from spsp_ctrl.discrepancy.fitting import Bench, Fitted, Split, fit, robust_rms, weights_of
from spsp_ctrl.discrepancy.library import Candidate
from spsp_ctrl.discrepancy.statistics import effective_size
from spsp_ctrl.discrepancy.variables import Variable, place
from spsp_ctrl.plant.arrays import Array

TRAIN_SHARE, HELD_SHARE, WORSE = 0.15, 0.02, 0.02
"""Accepted: a channel loses this share of its excess in training, this share of its rms on held-out motion, and none gets worse by more than this."""
CERTAIN_SHARE, CERTAIN_HELD, CERTAIN = 0.08, 0.04, 60.0
"""Or a smaller share of both that is beyond doubt: a real machine has many small faults, none of which is 15 % of what is left."""
ABOVE, LATER = 1.15, 1.3
"""A channel nearer to its floor than this has nothing to name; a floor is known to some per cent only, so later names need more."""
EVIDENCE = 12.0
"""Least gain of the score (difference of BIC)."""
TWIN_EVIDENCE, TWIN_COSINE = 6.0, 0.95
BEST = 5
MOST = 8
"""Names at the most."""
SAME_SHARE = 0.05
"""A late name in channel and regime of an earlier one, worth less than this of it, is uncertainty about the shape of the first."""
SAME_CLASS = 0.1
"""Names whose sensitivities are alike form a class only while their evidence differs by less than this share."""
SENTINEL_LEAD = 0.1


class Trial(NamedTuple):
    """A refitted candidate."""

    evidence: float
    candidate: Candidate
    fitted: Fitted
    held: Split
    accepted: bool
    channel: str
    shares: dict[str, float]


@dataclass
class Named:
    """An accepted name."""

    candidate: Candidate
    evidence: float
    rivals: dict[str, float]
    """Names as good as this one: score relative to it (0 = equal, negative = worse)."""
    channel: str
    shares: dict[str, float]
    """Share of its excess that each channel lost in training."""
    remarks: list[str] = field(default_factory=list)


@dataclass
class State:
    """Where the search stands."""

    p: Array
    fitted: Fitted
    held: Split
    named: list[Named]


def excess_share(before: float, after: float, floor: float) -> float:
    """Share of the excess over the floor that is gone."""
    return (before - after) / max(before - floor, 1e-12 + 1e-3 * before)


class Search:
    """The search on one set of training and held-out data."""

    def __init__(
        self,
        train: Bench,
        held: Bench,
        nominal: Callable[[Array], tuple[Variable, ...]],
        library: Callable[[State], list[Candidate]],
        tick: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.train, self.held, self.nominal, self.library, self.tick = train, held, nominal, library, tick
        self.trace: list[tuple[str, list[tuple[str, float]]]] = []

    # -- scores --------------------------------------------------------------------------------------------------------
    def score(self, residuals: Split, sizes: dict[str, float], count: int) -> float:
        """Sum over channels of independent samples times log variance, plus the price of the variables. Less is better."""
        total = sum(sizes[c] * 2.0 * np.log(max(robust_rms(r), self.train.floor.get(c, 0.0), 1e-12)) for c, r in residuals.items())
        return float(total + count * np.log(max(2.0, sum(sizes.values()))))

    def start(self, p: Array) -> State:
        """Refit the nominal numbers within their tolerances: only what is left counts."""
        self.tick("refit")
        fitted = fit(self.train, p, self.nominal(p), steps=6)
        return State(fitted.p, fitted, self.held.residuals(fitted.p), [])

    # -- one step ------------------------------------------------------------------------------------------------------
    def screen(self, state: State, candidates: list[Candidate]) -> list[tuple[float, Candidate, Array]]:
        """Linear gain of each candidate's finite starts after projecting out what is free already, whitened per channel; best first."""
        base = state.fitted.residuals
        scales, weights = self.train.scales(base), weights_of(base)
        sizes = {c: effective_size(r) for c, r in base.items()}
        variables = state.fitted.variables
        known = np.concatenate([state.fitted.jacobian[c] * (weights[c] / scales[c]) for c in scales])
        prior = np.diag([1.0 / v.sigma if np.isfinite(v.sigma) else 0.0 for v in variables])
        stacked = np.concatenate([known, prior]) if len(variables) else np.zeros((len(known), 0))
        norms = np.linalg.norm(stacked, axis=0) if len(variables) else np.zeros(0)
        basis = np.linalg.svd(stacked / np.where(norms > 0, norms, 1.0), full_matrices=False)[0] if len(variables) else stacked
        rows = len(stacked) - len(known)
        edges = np.cumsum([0, *(len(base[c]) for c in scales)])
        target = np.concatenate([base[c] * (weights[c] / scales[c]) for c in scales] + [np.zeros(rows)])
        target = target - basis @ (basis.T @ target)
        before = {c: float(np.sum(target[edges[k] : edges[k + 1]] ** 2)) for k, c in enumerate(scales)}
        found = []
        for candidate in candidates:
            best: tuple[float, Candidate, Array] | None = None
            for group in candidate.groups:
                columns = []
                for start, _ in group:
                    after = self.train.residuals(start)
                    d = np.concatenate([np.clip((after[c] - base[c]) / scales[c], -50, 50) * weights[c] for c in scales] + [np.zeros(rows)])
                    columns.append(d - basis @ (basis.T @ d))
                matrix = np.stack(columns, axis=1)
                factor = np.asarray(np.linalg.lstsq(matrix, -target, rcond=1e-9)[0], np.float64)
                factor = self._bounded(candidate, group, factor)
                left = target + matrix @ factor
                gain = 0.0
                for k, c in enumerate(scales):
                    was, now = before[c], float(np.sum(left[edges[k] : edges[k + 1]] ** 2))
                    gain += sizes[c] * np.log(max(was, 1e-9) / max(now, 1e-3 * was, 1e-9))
                gain -= len(candidate.variables) * np.log(max(2.0, sum(sizes.values())))
                if best is None or gain > best[0]:
                    best = (float(gain), candidate, self._combined(candidate, group, factor))
            if best is not None:
                found.append(best)
        found.sort(key=lambda item: -item[0])
        return found

    @staticmethod
    def _bounded(candidate: Candidate, group: tuple[tuple[Array, Array], ...], factor: Array) -> Array:
        """Signs are part of a name: a positive size is not turned round. A start is never stretched more than eight times."""
        out = np.clip(factor, -8.0, 8.0)
        for k, (_, values) in enumerate(group):
            if len(group) == 1 or all("." not in v.name for v in candidate.variables):
                low = min((v.low for v, x in zip(candidate.variables, values, strict=True) if "." not in v.name and x != 0.0), default=0.0)
                if low >= 0.0:
                    out[k] = min(max(out[k], 0.0), 8.0)
        return out

    @staticmethod
    def _combined(candidate: Candidate, group: tuple[tuple[Array, Array], ...], factor: Array) -> Array:
        """Parameters at the combination of a group's columns."""
        p, values = group[0]
        if len(group) == 1 and any(v.name.endswith(("_limit_v", "_ceiling_a", "_ceiling_rad_s")) for v in candidate.variables):
            return p
        mean = np.mean([v for _, v in group], axis=0) if len(group) > 1 else values
        if len(group) == 1:
            zero = values.copy()
            own = [k for k, v in enumerate(candidate.variables) if v.low <= 0.0]
            for k in own[:1]:
                zero[k] = values[k] * max(factor[0], 0.05) if not np.isclose(values[k], 0.0) else 0.0
            result = zero
        else:
            # columns differ from their common zero in one variable each
            n = len(group)
            zero = np.array([np.median([v[k] for _, v in group]) if n > 2 else min((v[k] for _, v in group), key=abs) for k in range(len(mean))])
            result = zero + sum(f * (v - zero) for f, (_, v) in zip(factor, group, strict=True))
        low, high = np.array([v.low for v in candidate.variables]), np.array([v.high for v in candidate.variables])
        return place(p, candidate.variables, np.clip(result, low, high))

    def variables(self, p: Array, named: list[Named], extra: Candidate | None = None) -> tuple[Variable, ...]:
        """Nominal numbers, the variables of the names, those of a candidate; a number that is both is free."""
        chosen: dict[str, Variable] = {}
        for candidate in [*(n.candidate for n in named), *([extra] if extra else [])]:
            for v in candidate.variables:
                chosen[v.name] = v
        nominal = {v.name: v for v in self.nominal(p) if v.name not in chosen}
        return (*nominal.values(), *chosen.values())

    def refit(self, state: State, candidate: Candidate, start: Array, steps: int = 3) -> tuple[Fitted, Split]:
        """Nominal, named and candidate together."""
        base = state.fitted.residuals
        own = {v.name for v in candidate.variables}
        keep = [k for k, v in enumerate(state.fitted.variables) if v.name not in own]
        known = [state.fitted.variables[k] for k in keep], {c: j[:, keep] for c, j in state.fitted.jacobian.items()}
        fitted = fit(
            self.train,
            start,
            self.variables(start, state.named, candidate),
            steps=steps,
            scales=self.train.scales(base),
            weights=weights_of(base),
            known=known,
        )
        return fitted, self.held.residuals(fitted.p)

    def accepts(
        self, count: int, evidence: float, before: Split, after: Split, held_before: Split, held_after: Split
    ) -> tuple[bool, str, dict[str, float]]:
        """The rule of acceptance; names the channel that gains most."""
        floor, above = self.train.floor, LATER if count else ABOVE
        shares = {c: excess_share(robust_rms(before[c]), robust_rms(after[c]), floor.get(c, 0.0)) for c in before}
        reach = [c for c in shares if robust_rms(before[c]) > above * floor.get(c, 0.0)]
        gains = {c: 1.0 - robust_rms(held_after[c]) / max(robust_rms(held_before[c]), 1e-15) for c in held_before}
        worse = [c for c in held_before if gains[c] < -WORSE and robust_rms(held_after[c]) > 1.05 * self.held.floor.get(c, 0.0)]
        share, held = (CERTAIN_SHARE, CERTAIN_HELD) if evidence >= CERTAIN else (TRAIN_SHARE, HELD_SHARE)
        good = [c for c in reach if (shares[c] >= TRAIN_SHARE and gains[c] >= HELD_SHARE) or (shares[c] >= share and gains[c] >= held)]
        channel = max(good, key=lambda c: gains[c]) if good else ""
        return bool(good) and not worse, channel, shares

    def step(self, state: State) -> State | None:
        """One more name, or none."""
        taken = {n.candidate.name for n in state.named}
        candidates = [c for c in self.library(state) if c.name not in taken]
        if all(robust_rms(r) <= ABOVE * self.train.floor.get(c, 0.0) for c, r in state.fitted.residuals.items()):
            return None
        self.tick("screen")
        screened = self.screen(state, candidates)
        self.trace.append((f"after {len(state.named)}", [(c.name, gain) for gain, c, _ in screened]))
        base = state.fitted.residuals
        refits: list[tuple[Candidate, Fitted, Split]] = []
        for gain, candidate, start in screened[:BEST]:
            if gain < 0.0 and refits:
                break
            self.tick(f"refit {candidate.name}")
            refits.append((candidate, *self.refit(state, candidate, start)))
        # the residual of a wrong model is one long wave with few independent samples: the size of the sample is that of the best fit
        sizes = {c: max([effective_size(r), *(effective_size(f.residuals[c]) for _, f, _ in refits)]) for c, r in base.items()}
        was = self.score(base, sizes, 0)
        tried = []
        for candidate, fitted, held in refits:
            evidence = was - self.score(fitted.residuals, sizes, len(candidate.variables))
            tried.append(
                Trial(evidence, candidate, fitted, held, *self.accepts(len(state.named), evidence, base, fitted.residuals, state.held, held))
            )
        tried.sort(key=lambda t: -t.evidence)
        good = [t for t in tried if t.accepted and t.evidence > EVIDENCE]
        physical = [t for t in good if not t.candidate.hypothesis.sentinel]
        if physical and good[0].evidence - physical[0].evidence < max(TWIN_EVIDENCE, SENTINEL_LEAD * good[0].evidence):
            good = physical  # what cannot exist must be clearly better than all that can, or it is a stand-in for one of them
        if not good:
            return None
        best = good[0]
        rivals = {}
        for t in tried:
            if t is best or t.candidate.hypothesis.sentinel:
                continue
            near = best.evidence - t.evidence
            alike = near < SAME_CLASS * best.evidence and _cosine(best.fitted, best.candidate, t.fitted, t.candidate) > TWIN_COSINE
            if (near < TWIN_EVIDENCE and t.accepted) or alike:
                rivals[t.candidate.name] = -near
        named = Named(best.candidate, best.evidence, rivals, best.channel, best.shares)
        names = [*state.named, named]
        # whitened by what is left now, not by what was left before: small channels get their weight, deviations their size
        polished = fit(self.train, best.fitted.p, self.variables(best.fitted.p, names), steps=3)
        return State(polished.p, polished, self.held.residuals(polished.p), names)

    def prune(self, state: State) -> State:
        """Backward elimination: a name that no longer earns its place goes."""
        for one in list(state.named[:-1]):
            rest = [n for n in state.named if n is not one]
            self.tick(f"without {one.candidate.name}")
            p = without(state.p, one.candidate, rest)
            fitted = fit(self.train, p, self.variables(p, rest), steps=2)
            held = self.held.residuals(fitted.p)
            sizes = {c: effective_size(r) for c, r in state.fitted.residuals.items()}
            loss = self.score(fitted.residuals, sizes, 0) - self.score(state.fitted.residuals, sizes, len(one.candidate.variables))
            if loss < EVIDENCE:
                state = State(fitted.p, fitted, held, rest)
        return state

    def run(self, p: Array, first: State | None = None) -> tuple[State, State]:
        """From the model as given (or the state after ``start``) to the last name: (nominal refit, end)."""
        first = state = first or self.start(p)
        while len(state.named) < MOST:
            after = self.step(state)
            if after is None:
                break
            late = after.named[-1]
            regimes = set(late.candidate.hypothesis.regimes)
            earlier = [n for n in after.named[:-1] if n.channel == late.channel]
            head = next((n for n in earlier if regimes & set(n.candidate.hypothesis.regimes)), None)
            if head is not None and late.evidence < SAME_SHARE * head.evidence:
                head.remarks.append(f"its shape is uncertain: {late.candidate.name} would gain {late.evidence / head.evidence:.1%} of what it gained")
                break
            state = after
        if len(state.named) > 1:
            state = self.prune(state)
        return first, state


def without(p: Array, candidate: Candidate, rest: list[Named]) -> Array:
    """Parameters with a name taken out, as far as no other name holds them."""
    held = {v.index for n in rest for v in n.candidate.variables}
    q = p.copy()
    for v in candidate.variables:
        if v.index not in held:
            q[v.index] = 0.0
    return q


def _cosine(a: Fitted, ca: Candidate, b: Fitted, cb: Candidate) -> float:
    """Likeness of two names: cosine of the largest correlation between what their variables do to the whitened residuals."""

    def columns(f: Fitted, c: Candidate) -> Array:
        own = [k for k, v in enumerate(f.variables) if v.name in {x.name for x in c.variables}]
        return np.concatenate([f.jacobian[ch][:, own] / max(robust_rms(f.residuals[ch]), 1e-15) for ch in f.jacobian])

    x, y = columns(a, ca), columns(b, cb)
    if not x.size or not y.size:
        return 0.0
    qx, qy = np.linalg.qr(x)[0], np.linalg.qr(y)[0]
    return float(np.linalg.svd(qx.T @ qy, compute_uv=False)[0])
