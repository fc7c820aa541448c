"""Name: refit what the screening puts first, accept what earns its place, prune, swap, and say what cannot be told apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from spsp_ctrl.discrepancy.confirming import Confirmed, confirm
from spsp_ctrl.discrepancy.fitting import Bench, Fitted, fit
from spsp_ctrl.discrepancy.library import Candidate
from spsp_ctrl.discrepancy.screening import screen
from spsp_ctrl.discrepancy.statistics import rms
from spsp_ctrl.discrepancy.variables import Variable
from spsp_ctrl.discrepancy.whitening import Colour, Split, colours, judged, log_likelihood, robust_rms
from spsp_ctrl.plant.arrays import Array

TRAIN_SHARE, HELD_SHARE, WORSE = 0.15, 0.02, 0.02
"""Accepted: a channel loses this share of its excess in training, this share of its rms on held-out motion, and none gets worse by more than this."""
CERTAIN_SHARE, CERTAIN_HELD, CERTAIN = 0.08, 0.04, 60.0
"""Or a smaller share of both that is beyond doubt: a real machine has many small faults, none of which is 15 % of what is left."""
FORETOLD_SHARE = 0.03
"""Or this share of a channel, where held-out motion shows what the name foretells beyond doubt."""
ABOVE, LATER = 1.15, 1.3
"""A channel nearer to its floor than this has nothing to name; a floor is known to some per cent only, so later names need more."""
EVIDENCE = 20.0
"""Least gain of the score (difference of BIC)."""
SURE, TELLING, UNTOLD, UNFORETOLD = 2.3, 3.0, 1000.0, 250.0
"""Held-out motion confirms from so many deviations on, where it can tell at all (a true name would stand at ``TELLING``); where it cannot,
training must give
this evidence, and this by what the residuals foretell of themselves (slow drift between two records of one machine: up to 1100, 172)."""
CLEAR = 5.0
"""The same for a name that leaves so much that what is left foretells itself as well as before."""
TWIN_EVIDENCE, TWIN_COSINE = 6.0, 0.95
BEST, MORE, LEAST = 5, 10, 3
"""So many are refitted (more where the numbers of the model are free), and what leads a channel; what makes its start worse only among the first."""
MOST = 8
"""Names at the most."""
SAME_SIZE = 0.06
"""A late name in channel and regime of an earlier one that moves the channel by less than this of it is uncertainty about the shape of the first."""
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
    confirmed: Confirmed


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
    size: dict[str, float]
    """rms by which it moves each channel in training."""
    confirmed: Confirmed
    runners: tuple[Candidate, ...] = ()
    """What came next when it was chosen: tried again once all names are there."""
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
    """The search on one set of training and held-out data.

    ``calibrated``: the training data are relative to a commissioning log of the same motion, so no number of the model is free beside the names.
    """

    def __init__(
        self,
        train: Bench,
        held: Bench,
        nominal: Callable[[Array], tuple[Variable, ...]],
        library: Callable[[State], list[Candidate]],
        tick: Callable[[str], None] = lambda text: None,
        calibrated: bool = False,
        clean: Split | None = None,
    ) -> None:
        self.train, self.held, self.nominal, self.library, self.tick, self.calibrated = train, held, nominal, library, tick, calibrated
        self.clean = clean
        self.trace: list[tuple[str, list[tuple[str, float]]]] = []

    # -- scores --------------------------------------------------------------------------------------------------------
    def likelihood(self, residuals: Split, white: dict[str, Colour]) -> float:
        """Twice the logarithm of the likelihood; by the colour of the noise where that is known, else by what the residual foretells of itself."""
        return 2.0 * sum((judged(residuals, white) if self.train.motion else log_likelihood(residuals, self.train.floor)).values())

    def white(self, residuals: Split) -> dict[str, Colour]:
        """The colour of the noise in what is left."""
        return colours(residuals, self.train.floor, self.train.motion)

    def gain(self, before: Split, after: Split) -> float:
        """What ``after`` is better by."""
        white = self.white(before)
        return self.likelihood(after, white) - self.likelihood(before, white)

    def foretold(self, before: Split, after: Split) -> float:
        """The same by what each foretells of itself: a name that takes off only a part of a slow wave gains nothing here."""
        return 2.0 * (sum(log_likelihood(after, self.train.floor).values()) - sum(log_likelihood(before, self.train.floor).values()))

    def price(self, residuals: Split, count: int) -> float:
        """Of ``count`` more variables (BIC)."""
        return float(count * np.log(max(2, sum(len(r) for r in residuals.values()))))

    def start(self, p: Array) -> State:
        """Refit the nominal numbers within their tolerances: only what is left counts."""
        self.tick("refit")
        fitted = fit(self.train, p, self.nominal(p), steps=6)
        return State(fitted.p, fitted, self.held.residuals(fitted.p), [])

    # -- one step ------------------------------------------------------------------------------------------------------
    def variables(self, p: Array, named: list[Named], extra: Candidate | None = None) -> tuple[Variable, ...]:
        """Nominal numbers, the variables of the names, those of a candidate; a number that is both is free."""
        chosen: dict[str, Variable] = {}
        for candidate in [*(n.candidate for n in named), *([extra] if extra else [])]:
            for v in candidate.variables:
                chosen[v.name] = v
        nominal = {v.name: v for v in self.nominal(p) if v.name not in chosen}
        return (*nominal.values(), *chosen.values())

    def refit(self, state: State, candidate: Candidate, start: Array, steps: int = 4, again: bool = True) -> Fitted:
        """Nominal, named and candidate together."""
        own = {v.name for v in candidate.variables}
        keep = [k for k, v in enumerate(state.fitted.variables) if v.name not in own]
        known = [state.fitted.variables[k] for k in keep], {c: j[:, keep] for c, j in state.fitted.jacobian.items()}
        fitted = fit(self.train, start, self.variables(start, state.named, candidate), steps=steps, known=known)
        if again and self.gain(state.fitted.residuals, fitted.residuals) > EVIDENCE:
            # whitened anew: what is left is of another colour than where the fit began
            fitted = fit(self.train, fitted.p, fitted.variables, steps=2, known=known)
        return fitted

    def accepts(
        self, count: int, evidence: float, before: Split, after: Split, held_before: Split, held_after: Split
    ) -> tuple[bool, str, dict[str, float], Confirmed]:
        """The rule of acceptance; names the channel that gains most."""
        floor, above = self.train.floor, LATER if count else ABOVE
        shares = {c: excess_share(robust_rms(before[c]), robust_rms(after[c]), floor.get(c, 0.0)) for c in before}
        gains = {c: 1.0 - robust_rms(held_after[c]) / max(robust_rms(held_before[c]), 1e-15) for c in held_before}
        worse = [c for c in held_before if gains[c] < -WORSE and robust_rms(held_after[c]) > 1.05 * self.held.floor.get(c, 0.0)]
        confirmed = confirm(held_before, held_after, self.held.floor, self.clean)
        best = log_likelihood(after, floor)
        was = log_likelihood(before, floor)
        channel = max(best, key=lambda c: best[c] - was[c])
        if self.calibrated:
            told = confirmed.expected >= TELLING
            whole = self.foretold(before, after)
            if told:
                good = confirmed.score >= (SURE if whole > EVIDENCE else CLEAR)
            else:
                good = whole >= UNFORETOLD and evidence >= UNTOLD and confirmed.score > -SURE
            return good and not worse, channel, shares, confirmed
        reach = [c for c in shares if robust_rms(before[c]) > above * floor.get(c, 0.0)]
        share, held = (CERTAIN_SHARE, CERTAIN_HELD) if evidence >= CERTAIN else (TRAIN_SHARE, HELD_SHARE)
        certain = evidence >= CERTAIN and confirmed.score >= CLEAR and confirmed.factor >= 0.5
        earned = [
            c for c in reach
            if (shares[c] >= TRAIN_SHARE and gains[c] >= HELD_SHARE)
            or (shares[c] >= share and gains[c] >= held)
            or (certain and shares[c] >= FORETOLD_SHARE and gains[c] > 0.0)
        ]  # fmt: skip
        channel = max(earned, key=lambda c: gains[c]) if earned else channel
        return bool(earned) and not worse, channel, shares, confirmed

    def trials(self, state: State) -> list[Trial]:
        """What the screening puts first, refitted; best evidence first."""
        taken = {n.candidate.name for n in state.named}
        candidates = [c for c in self.library(state) if c.name not in taken]
        self.tick("screen")
        screened = screen(self.train, state.fitted, candidates)
        self.trace.append((f"after {len(state.named)}", [(s.candidate.name, s.gain) for s in screened]))
        base = state.fitted.residuals
        refits: list[tuple[float, Candidate, Fitted]] = []
        for rank, (gain, candidate, start, leads) in enumerate(screened):
            if (rank >= (BEST if self.calibrated else MORE) and not leads) or (gain < 0.0 and rank >= LEAST):
                continue
            self.tick(f"refit {candidate.name}")
            fitted = self.refit(state, candidate, start, again=False)
            refits.append((self.gain(base, fitted.residuals) - self.price(base, len(candidate.variables)), candidate, fitted))
        refits.sort(key=lambda r: -r[0])
        tried = []
        for rank, (evidence, candidate, fitted) in enumerate(refits):
            if rank < LEAST and evidence > EVIDENCE:
                fitted = self.refit(state, candidate, fitted.p)
                evidence = self.gain(base, fitted.residuals) - self.price(base, len(candidate.variables))
            held = self.held.residuals(fitted.p)
            tried.append(
                Trial(evidence, candidate, fitted, held, *self.accepts(len(state.named), evidence, base, fitted.residuals, state.held, held))
            )
        return sorted(tried, key=lambda t: -t.evidence)

    def step(self, state: State) -> State | None:
        """One more name, or none."""
        base = state.fitted.residuals
        if not self.calibrated and all(robust_rms(r) <= ABOVE * self.train.floor.get(c, 0.0) for c, r in base.items()):
            return None
        tried = self.trials(state)
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
        size = {c: rms(base[c] - best.fitted.residuals[c]) for c in base}
        runners = tuple(t.candidate for t in tried if t is not best and not t.candidate.hypothesis.sentinel)[:3]
        named = Named(best.candidate, best.evidence, rivals, best.channel, best.shares, size, best.confirmed, runners)
        names = [*state.named, named]
        # whitened by what is left now, not by what was left before: small channels get their weight, deviations their size
        polished = fit(self.train, best.fitted.p, self.variables(best.fitted.p, names), steps=3)
        return State(polished.p, polished, self.held.residuals(polished.p), names)

    def prune(self, state: State, before: Array) -> State:
        """Backward elimination: a name that no longer earns its place goes."""
        for one in list(state.named[:-1]):
            rest = [n for n in state.named if n is not one]
            self.tick(f"without {one.candidate.name}")
            p = taken_out(state.p, before, one, rest)
            fitted = fit(self.train, p, self.variables(p, rest), steps=2)
            loss = self.gain(fitted.residuals, state.fitted.residuals)
            if loss < EVIDENCE + self.price(fitted.residuals, len(one.candidate.variables)):
                state = State(fitted.p, fitted, self.held.residuals(fitted.p), rest)
        return state

    def swap(self, state: State, before: Array) -> State:
        """A name chosen early may have stood for another that shows only beside the later ones: its rivals are tried in its place."""
        for one in list(state.named):
            rest = [n for n in state.named if n is not one]
            taken = {n.candidate.name for n in rest}
            without_it = taken_out(state.p, before, one, rest)
            bare = fit(self.train, without_it, self.variables(without_it, rest), steps=2)
            alone = State(bare.p, bare, self.held.residuals(bare.p), rest)
            fresh = {c.name: c for c in self.library(alone)}
            for runner in one.runners:
                if runner.name in taken or runner.name not in fresh:
                    continue
                self.tick(f"{runner.name} for {one.candidate.name}")
                screened = next(iter(screen(self.train, bare, [fresh[runner.name]])), None)
                if screened is None:
                    continue
                fitted = self.refit(alone, screened.candidate, screened.start)
                gain = self.gain(state.fitted.residuals, fitted.residuals)
                gain -= self.price(fitted.residuals, len(screened.candidate.variables) - len(one.candidate.variables))
                if gain > TWIN_EVIDENCE:
                    size = {c: rms(bare.residuals[c] - fitted.residuals[c]) for c in bare.residuals}
                    held = self.held.residuals(fitted.p)
                    confirmed = confirm(alone.held, held, self.held.floor, self.clean)
                    new = Named(screened.candidate, one.evidence + gain, {}, one.channel, one.shares, size, confirmed)
                    names = [new if n is one else n for n in state.named]
                    state = State(fitted.p, fitted, held, names)
                    break
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
            untold = self.calibrated and late.confirmed.expected < TELLING
            earlier = [n for n in after.named[:-1] if untold or (not self.calibrated and regimes & set(n.candidate.hypothesis.regimes))]
            head = next((n for n in earlier if late.size[late.channel] < SAME_SIZE * n.size[late.channel]), None)
            if head is not None:
                share = late.size[late.channel] / head.size[late.channel]
                head.remarks.append(f"its shape is uncertain: {late.candidate.name} would move {late.channel} by {share:.1%} of what it moves")
                break
            state = after
        if len(state.named) > 1:
            state = self.swap(self.prune(state, first.p), first.p)
        return first, state


def taken_out(p: Array, before: Array, named: Named, rest: list[Named]) -> Array:
    """Parameters with a name taken out: what no other name holds goes back to what it was ``before``, which is zero only for what was absent."""
    held = {v.index for n in rest for v in n.candidate.variables}
    q = p.copy()
    for v in named.candidate.variables:
        if v.index not in held:
            for i in (v.index, v.phase, v.along):
                if i >= 0:
                    q[i] = before[i]
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
