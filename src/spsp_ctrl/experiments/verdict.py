"""Acceptance of an experiment: each row on every run it applies to, the worst value counts; shape claims from variant to variant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from math import inf
from typing import Any

from spsp_ctrl.config.scenario import Acceptance
from spsp_ctrl.experiments.signals import Curves, Figures
from spsp_ctrl.experiments.summary import look_up, within


@dataclass(frozen=True, slots=True)
class CaseResult:
    """A finished run of an experiment."""

    key: str
    variant: str
    law: str
    repeat: int
    seed: int
    ended: str
    figures: Figures
    curves: Curves = field(default_factory=dict)
    motion: str = ""
    drawn: dict[str, Any] = field(default_factory=dict)
    """What was drawn from the seed."""
    identified: dict[str, float] = field(default_factory=dict)
    """Keys of the rig file that were taken from figures of other runs."""


@dataclass(frozen=True, slots=True)
class Found:
    """What a row found under one law."""

    value: float | None
    """The worst; None when a run has no such figure or did not complete."""
    at: str
    """The run it comes from."""
    passed: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """A row and what it found, by law."""

    name: str
    paper: str
    requirement: str
    bound: str
    unit: str
    note: str
    by_law: dict[str, Found]

    @property
    def passed(self) -> bool:
        """Under every law it was judged with."""
        return bool(self.by_law) and all(found.passed for found in self.by_law.values())

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"pass": self.passed}


def bound_text(row: Acceptance) -> str:
    """What a row asks for, in words."""
    if row.across:
        way = "rises" if row.order == "rising" else "falls"
        return f"{way} by > {row.margin:g} from {' to '.join(row.across)}"
    if row.limit is not None:
        return f"|·| ≤ {row.limit:g}"
    if row.min is not None and row.max is not None:
        return f"{row.min:g} to {row.max:g}"
    return f"≥ {row.min:g}" if row.min is not None else f"≤ {row.max:g}"


def judge(rows: Sequence[Acceptance], results: Sequence[CaseResult]) -> list[Verdict]:
    """Every row of an experiment over its runs, in order."""
    laws = list(dict.fromkeys(r.law for r in results))
    verdicts = []
    for row in rows:
        by_law = {}
        for law in laws:
            if row.law is not None and row.law != law:
                continue
            found = _found(row, [r for r in results if r.law == law and row.motion in ("", r.motion)])
            if found is not None:
                by_law[law] = found
        unit = "%" if row.relative_to else row.unit
        verdicts.append(Verdict(row.name, row.paper, row.requirement, bound_text(row), unit, row.note, by_law))
    return verdicts


def _figure(result: CaseResult, path: str) -> float | None:
    return look_up(result.figures, path) if result.ended == "completed" else None


def _found(row: Acceptance, results: Sequence[CaseResult]) -> Found | None:
    if row.across:
        return _shape(row, results)
    names = [name for name in row.variants if name]
    chosen = [r for r in results if not names or r.variant in names]
    if not chosen:
        return None
    values: list[tuple[float | None, CaseResult]] = [(_value(row, r, results), r) for r in chosen]
    missing = next((r for value, r in values if value is None), None)
    if missing is not None:
        return Found(None, missing.key, False)
    worst, where = max(((v, r) for v, r in values if v is not None), key=lambda pair: _badness(row, pair[0]))
    return Found(worst, where.key, within(row, worst))


def _value(row: Acceptance, result: CaseResult, results: Sequence[CaseResult]) -> float | None:
    value = _figure(result, row.value)
    if not row.relative_to or value is None:
        return value
    twin = next((r for r in results if r.variant == row.relative_to and r.repeat == result.repeat and r.motion == result.motion), None)
    below = _figure(twin, row.value) if twin is not None else None
    return 100.0 * value / below if below else None


def _badness(row: Acceptance, value: float) -> float:
    """How far beyond (or how near to) the bound; larger is worse."""
    if row.limit is not None:
        return abs(value)
    over = value - row.max if row.max is not None else -inf
    under = row.min - value if row.min is not None else -inf
    return max(over, under)


def _shape(row: Acceptance, results: Sequence[CaseResult]) -> Found | None:
    """The smallest step from one variant to the next, repeat by repeat."""
    sign = 1.0 if row.order == "rising" else -1.0
    smallest, at, seen = inf, "", False
    for motion, repeat in sorted({(r.motion, r.repeat) for r in results}):
        line = [next((r for r in results if (r.variant, r.motion, r.repeat) == (name, motion, repeat)), None) for name in row.across]
        if any(r is None for r in line):
            continue
        values = [_figure(r, row.value) for r in line if r is not None]
        for k in range(1, len(values)):
            a, b, here = values[k - 1], values[k], line[k]
            assert here is not None
            seen = True
            if a is None or b is None:
                return Found(None, here.key, False)
            if sign * (b - a) < smallest:
                smallest, at = sign * (b - a), here.key
    if not seen:
        return None
    return Found(smallest, at, smallest > row.margin)
