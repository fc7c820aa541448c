"""Name, for a platform: screen every (name, where) by its columns, refit the best, accept what earns its place, prune, and say what is alike.

Residuals are whitened by the spectrum of the noise (``platform_noise``), so the fall of their squared sum is evidence as it stands. Simulations run
on several threads: the kernel lets go of the interpreter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from spsp_ctrl.discrepancy.fitting import Bench
from spsp_ctrl.discrepancy.library import Candidate
from spsp_ctrl.discrepancy.platform_noise import Whitener
from spsp_ctrl.discrepancy.variables import Variable, place, values_of
from spsp_ctrl.plant.arrays import Array

EVIDENCE = 30.0
"""Least gain of a name: fall of the whitened squared sum, less the price of its variables."""
SURE, TELLING, UNTOLD = 2.3, 3.0, 100.0
"""Held-out motion confirms from so many deviations on, where it can tell at all; where it cannot, training must give this evidence."""
SHARE = 0.06
"""What a name takes off a channel, as share of what is left of its excess there: less is the untidy rest of a greater one."""
TWIN_EVIDENCE, TWIN_COSINE, TWIN_SHARE = 6.0, 0.95, 0.15
"""Names within this evidence of the best, or with columns as alike as this and within this share, are one class."""
BEST, AGAIN = 5, 8
"""So many are refitted in a round; so many are screened anew in later rounds."""
MOST = 6
STRETCH, LEAST = 8.0, 0.02
WORSE = 1.1
"""No channel of the held-out motion may grow by more."""


@dataclass
class Fit:
    """Variables at their best."""

    p: Array
    variables: tuple[Variable, ...]
    z: Array
    jacobian: Array
    covariance: Array

    def sigma(self, k: int) -> float:
        """Standard deviation of variable ``k``."""
        return float(np.sqrt(max(0.0, self.covariance[k, k])))


@dataclass
class Trial:
    """A candidate, refitted."""

    candidate: Candidate
    fit: Fit
    evidence: float
    channel: str
    accepted: bool = False
    held_score: float = 0.0
    held_expected: float = 0.0


@dataclass
class Name:
    """An accepted name."""

    candidate: Candidate
    evidence: float
    channel: str
    rivals: dict[str, float]
    closed: float | None
    remarks: list[str] = field(default_factory=list)


@dataclass
class Column:
    """What a candidate does to the whitened residual from one of its starts."""

    candidate: Candidate
    group: int
    columns: Array
    """One for each step of the group; for a group without steps the fall to its values."""


class PlatformSearch:
    """The search on one set of training and held-out data."""

    def __init__(
        self,
        train: Bench,
        held: Bench,
        white: Whitener,
        white_held: Whitener,
        library: Callable[[Array, Array], list[Candidate]],
        nominal: tuple[Variable, ...],
        jobs: int,
        tick: Callable[[str], None],
    ) -> None:
        self.train, self.held, self.white, self.white_held = train, held, white, white_held
        self.library, self.nominal, self.tick = library, nominal, tick
        self.pool = ThreadPoolExecutor(max(1, jobs))
        self.trace: list[tuple[str, list[tuple[str, float]]]] = []
        self.rejected: list[str] = []

    def z(self, p: Array) -> Array:
        """Whitened residual of the training data."""
        return self.white.apply(self.train.residuals(p))

    def many(self, points: Sequence[Array]) -> list[Array]:
        """The same at many points, on all threads."""
        return list(self.pool.map(self.z, points))

    # -- fits ----------------------------------------------------------------------------------------------------------
    def differences(self, p: Array, variables: Sequence[Variable], wanted: Sequence[int], z: Array) -> Array:
        """Columns of the wanted variables by one-sided differences, stepped inwards at a bound."""
        at = values_of(p, variables)
        points, steps = [], []
        for k in wanted:
            v = variables[k]
            step = v.step if at[k] + v.step <= v.high else -v.step
            moved = at.copy()
            moved[k] += step
            points.append(place(p, variables, moved))
            steps.append(step)
        return np.stack([(after - z) / s for after, s in zip(self.many(points), steps, strict=True)], axis=1) if points else np.zeros((len(z), 0))

    def fit(self, p: Array, variables: Sequence[Variable], steps: int, known: dict[str, Array] | None = None, last: bool = True) -> Fit:
        """Levenberg-Marquardt with bounds and priors.

        ``known``: columns by name of variable that are taken as given; ``last``: columns at the end too.
        """
        variables, known = tuple(variables), known or {}
        p = place(p, variables, values_of(p, variables))
        z = self.z(p)
        mean = np.array([v.mean for v in variables])
        weight = np.array([1.0 / v.sigma**2 if np.isfinite(v.sigma) else 0.0 for v in variables])
        low, high = np.array([v.low for v in variables]), np.array([v.high for v in variables])
        unit = np.array([v.step for v in variables])
        at, damping = values_of(p, variables), 1e-4
        fresh = [k for k, v in enumerate(variables) if v.name not in known]
        jacobian = np.zeros((len(z), len(variables)))
        for k, v in enumerate(variables):
            if v.name in known:
                jacobian[:, k] = known[v.name]
        if not variables:
            return Fit(p, variables, z, jacobian, np.zeros((0, 0)))
        normal = np.zeros((len(variables), len(variables)))
        for step in range(steps + last):
            jacobian[:, fresh] = self.differences(p, variables, fresh, z)
            normal = jacobian.T @ jacobian + np.diag(weight)
            right = jacobian.T @ z + weight * (at - mean)
            if step == steps or not variables:
                break
            now, better, gain = float(z @ z + weight @ (at - mean) ** 2), False, 0.0
            for _ in range(3):
                free = ~(((at <= low) & (right > 0)) | ((at >= high) & (right < 0)))
                move = np.zeros(len(at))
                if free.any():
                    scaled = normal[np.ix_(free, free)] * np.outer(unit[free], unit[free])
                    scaled += damping * np.diag(np.diag(scaled)) + 1e-12 * np.eye(len(scaled))
                    move[free] = -np.linalg.solve(scaled, right[free] * unit[free]) * unit[free]
                trial = np.clip(at + move, low, high)
                q = place(p, variables, trial)
                after = self.z(q)
                value = float(after @ after + weight @ (trial - mean) ** 2)
                if value < now:
                    better, gain = True, now - value
                    p, at, z = q, trial, after
                    damping = max(1e-7, 0.2 * damping)
                    break
                damping = max(1e-3, damping * 20.0)
            if not better or gain < max(0.5, 1e-4 * now):
                break
        covariance = np.asarray(np.linalg.pinv(normal, hermitian=True), np.float64) if len(variables) else np.zeros((0, 0))
        return Fit(p, variables, z, jacobian, covariance)

    def variables(self, names: Sequence[Name], extra: Candidate | None = None) -> tuple[Variable, ...]:
        """Nominal numbers, those of the names, those of a candidate; each number once, the last meaning wins."""
        chosen = {(v.index, v.part): v for c in [*(n.candidate for n in names), *([extra] if extra else [])] for v in c.variables}
        taken = {i for i, _ in chosen}
        return (*(v for v in self.nominal if v.index not in taken), *chosen.values())

    # -- evidence ------------------------------------------------------------------------------------------------------
    def gains(self, before: Array, after: Array) -> dict[str, float]:
        """Fall of the squared sum by channel, in units of what is left: a channel that stays above its noise counts for less."""
        b, a = self.white.parts(before), self.white.parts(after)
        return {c: (float(b[c] @ b[c]) - float(a[c] @ a[c])) / max(1.0, float(a[c] @ a[c]) / len(a[c])) for c in b}

    def price(self, count: int) -> float:
        """Of ``count`` more variables (BIC)."""
        return count * float(np.log(sum(len(s) for s in self.white.scale.values())))

    def excess(self, z: Array) -> dict[str, float]:
        """Mean square above the noise, by channel."""
        return {c: float(v @ v) / len(v) - 1.0 for c, v in self.white.parts(z).items()}

    # -- one step ------------------------------------------------------------------------------------------------------
    def columns(self, candidates: Sequence[Candidate], z: Array) -> list[Column]:
        """Simulate every start of every candidate."""
        jobs: list[tuple[Candidate, int, int, Array]] = []
        for c in candidates:
            for g, group in enumerate(c.groups):
                if not group.steps:
                    jobs.append((c, g, -1, c.at(group.values)))
                for k, size in group.steps:
                    values = group.values.copy()
                    values[k] += size
                    jobs.append((c, g, k, c.at(values)))
        fallen = self.many([job[3] for job in jobs])
        made: dict[tuple[str, int], list[Array]] = {}
        owner = {}
        for (c, g, _, _), after in zip(jobs, fallen, strict=True):
            made.setdefault((c.name, g), []).append(z - after)
            owner[(c.name, g)] = c
        return [Column(owner[at], at[1], np.stack(v, axis=1)) for at, v in made.items()]

    def screened(self, columns: Sequence[Column], fit: Fit) -> list[tuple[float, Candidate, Array]]:
        """Candidates by what they could take off at the most, linearly, beside what is free already; best start of each."""
        prior = np.diag([1.0 / v.sigma if np.isfinite(v.sigma) else 0.0 for v in fit.variables])
        basis = np.zeros((len(fit.z) + len(prior), 0))
        if len(fit.variables):
            stacked = np.concatenate([fit.jacobian, prior])
            norms = np.linalg.norm(stacked, axis=0)
            basis = np.linalg.qr(stacked / np.where(norms > 0, norms, 1.0))[0]
        zeros = np.zeros(len(prior))
        target = np.concatenate([fit.z, zeros])
        target = target - basis @ (basis.T @ target)
        was = float(target @ target)
        found: dict[str, tuple[float, Candidate, Array]] = {}
        for column in columns:
            c, group = column.candidate, column.candidate.groups[column.group]
            matrix = np.concatenate([column.columns, np.zeros((len(prior), column.columns.shape[1]))])
            matrix = matrix - basis @ (basis.T @ matrix)
            values = group.values.copy()
            if group.steps:
                factor = np.asarray(np.linalg.lstsq(matrix, target, rcond=1e-9)[0], np.float64)
                for j, (k, size) in enumerate(group.steps):
                    v, zero = c.variables[k], group.values[k]
                    ends = sorted(((v.low - zero) / size, (v.high - zero) / size))
                    factor[j] = np.clip(factor[j], max(-STRETCH, ends[0]), min(STRETCH, ends[1]))
                    values[k] += size * (factor[j] if abs(factor[j]) > LEAST else LEAST * (1.0 if factor[j] >= 0.0 else -1.0))
            else:
                factor = np.ones(matrix.shape[1])
            left = target - matrix @ factor
            gain = was - float(left @ left) - self.price(len(c.variables))
            if c.name not in found or gain > found[c.name][0]:
                found[c.name] = gain, c, c.at(values)
        return sorted(found.values(), key=lambda f: -f[0])

    def trial(self, state: Fit, names: list[Name], candidate: Candidate, start: Array, held: Array) -> Trial:
        """Refit nominal numbers, names and candidate together, and judge."""
        known = {v.name: state.jacobian[:, k] for k, v in enumerate(state.variables)}
        own = {v.name for v in candidate.variables}
        known = {n: j for n, j in known.items() if n not in own}
        fit = self.fit(start, self.variables(names, candidate), 3, known)
        gains = self.gains(state.z, fit.z)
        total = sum(gains.values()) - self.price(len(candidate.variables))
        channel = max(gains, key=lambda c: gains[c])
        one = Trial(candidate, fit, total, channel)
        if total < EVIDENCE:
            return one
        before = self.white_held.parts(held)
        after = self.white_held.parts(self.white_held.apply(self.held.residuals(fit.p)))
        x, y = np.concatenate([before[c] - after[c] for c in before]), np.concatenate(list(before.values()))
        size = float(x @ x)
        factor = float(x @ y) / size if size > 0.0 else 0.0
        left = y - factor * x
        wide = max(1.0, float((left * x) @ (left * x)) / max(size, 1e-300)) ** 0.5  # what is left where it acts, against noise
        one.held_expected = size**0.5 / wide
        one.held_score = factor * one.held_expected
        worse = [c for c in before if float(after[c] @ after[c]) > WORSE * max(float(before[c] @ before[c]), float(len(before[c])))]
        excess = self.excess(state.z)[channel]
        share = (excess - self.excess(fit.z)[channel]) / max(excess, 1e-9)
        told = one.held_score >= SURE if one.held_expected >= TELLING else total >= UNTOLD and one.held_score > -SURE
        one.accepted = told and not worse and share >= SHARE
        return one

    def run(self, p: Array) -> tuple[Fit, Fit, list[Name]]:
        """From the calibrated model to the last name."""
        self.tick("refit")
        first = state = self.fit(p, self.nominal, 3 if self.nominal else 0)
        names: list[Name] = []
        cache: list[Column] = []
        while len(names) < MOST:
            self.tick("screen")
            held = self.white_held.apply(self.held.residuals(state.p))
            taken = {n.candidate.name for n in names}
            candidates = {c.name: c for c in self.library(state.p, state.z) if c.name not in taken}
            if not cache:
                cache = self.columns(list(candidates.values()), state.z)
                ranked = self.screened(cache, state)
            else:
                rough = [s[1].name for s in self.screened([c for c in cache if c.candidate.name in candidates], state)]
                again = [n for n in rough if n in candidates][:AGAIN]
                ranked = self.screened(self.columns([candidates[n] for n in again], state.z), state)
            self.trace.append((f"after {len(names)}", [(c.name, g) for g, c, _ in ranked]))
            tried: list[Trial] = []
            for gain, candidate, start in ranked[:BEST]:
                if gain < 0.0 and tried:
                    continue
                self.tick(f"refit {candidate.name}")
                tried.append(self.trial(state, names, candidate, start, held))
            good = sorted((t for t in tried if t.accepted), key=lambda t: -t.evidence)
            if not good:
                self.rejected += [f"{t.candidate.name} {t.evidence:.0f} held {t.held_score:.1f}/{t.held_expected:.1f}" for t in tried]
                break
            best = good[0]
            rivals = {t.candidate.name: t.evidence - best.evidence for t in tried if t is not best and self.alike(best, t)}
            was, now = self.excess(state.z)[best.channel], self.excess(best.fit.z)[best.channel]
            names.append(Name(best.candidate, best.evidence, best.channel, rivals, (was - now) / max(was, 1e-9)))
            state = self.fit(best.fit.p, self.variables(names), 2)
        if len(names) > 1:
            state, names = self.prune(state, names)
        return first, state, names

    def alike(self, best: Trial, other: Trial) -> bool:
        """Whether two names cannot be told apart by this data."""
        near = best.evidence - other.evidence
        if other.candidate.hypothesis.sentinel or other.evidence < EVIDENCE:
            return False
        if near < TWIN_EVIDENCE:
            return True
        return near < TWIN_SHARE * best.evidence and self.cosine(best, other) > TWIN_COSINE

    def cosine(self, one: Trial, other: Trial) -> float:
        """Likeness of what two names do to the whitened residual."""
        spans = []
        for t in (one, other):
            own = [k for k, v in enumerate(t.fit.variables) if v.name in {x.name for x in t.candidate.variables}]
            columns = t.fit.jacobian[:, own]
            norms = np.linalg.norm(columns, axis=0)
            if not len(own) or not norms.any():
                return 0.0
            spans.append(np.linalg.qr(columns[:, norms > 0] / norms[norms > 0])[0])
        return float(np.linalg.svd(spans[0].T @ spans[1], compute_uv=False)[0])

    def prune(self, state: Fit, names: list[Name]) -> tuple[Fit, list[Name]]:
        """Backward elimination: a name that no longer earns its place goes."""
        for one in names[:-1]:
            rest = [n for n in names if n is not one]
            self.tick(f"without {one.candidate.name}")
            p = state.p.copy()
            held = {v.index for n in rest for v in n.candidate.variables}
            for v in one.candidate.variables:
                if v.index not in held:
                    p[v.index] = one.candidate.base[v.index]
                    if v.part:
                        p[v.phase] = one.candidate.base[v.phase]
            known = {v.name: state.jacobian[:, k] for k, v in enumerate(state.variables)}
            fit = self.fit(p, self.variables(rest), 2, known)
            loss = sum(self.gains(fit.z, state.z).values()) - self.price(len(one.candidate.variables))
            if loss < EVIDENCE:
                state, names = self.fit(fit.p, self.variables(rest), 1), rest
        return state, names
