"""Points of one case, and the figures of many: pure functions of answers and findings."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from tools.blind_exam.catalogue import twins_of
from tools.blind_exam.subject import Finding, Named

DETECTABLE = 1.5
PHASES = ("phase", "order")
"""Parameters whose relative error means nothing."""


UNSIGNED = ("cogging", "ripple", "first", "second")
"""Amplitudes: their sign is where the angle has its zero, a convention."""


def matches(truth: str, named: Named) -> bool:
    """Whether a name, or its class, stands for what is hidden; structural twins are one class."""
    return truth in named.members or bool(twins_of(truth) & {named.effect})


def error(truth: dict[str, float], named: Named) -> float | None:
    """Largest relative error over the sizes of an effect that both sides give; None when there is nothing to compare."""
    errors = []
    for name, value in truth.items():
        if name in named.values and value != 0.0 and not name.endswith(PHASES):
            got = named.values[name][0]
            errors.append(abs(abs(got) - abs(value)) / abs(value) if name in UNSIGNED else abs(got - value) / abs(value))
    return max(errors) if errors else None


def inside(truth: dict[str, float], named: Named) -> list[bool]:
    """For each size given with a deviation: is the truth within two of them."""
    pairs = [(value, named.values[name]) for name, value in truth.items() if name in named.values and not name.endswith(PHASES)]
    return [abs(got - value) <= 1.96 * std for value, (got, std) in pairs if math.isfinite(std)]


def score(answer: dict[str, Any], finding: Finding) -> dict[str, Any]:
    """Points of one case. ``answer`` holds ``group``, ``hidden`` (effect, severity, stage, values, detectable, recalibration)."""
    hidden = answer["hidden"]
    seen = [h for h in hidden if h["detectable"]]
    first = finding.named[0] if finding.named else None
    row: dict[str, Any] = {
        "verdict": finding.verdict,
        "named": [n.effect for n in finding.named],
        "classes": [sorted(n.members) for n in finding.named],
        "flagged": finding.flagged,
        "sentinel": finding.sentinel,
        "any_name": bool(finding.named),
        "closed": finding.closed,
    }
    group = answer["group"]
    if group == "outside":
        # names beside a warning are an attraction to the nearest name; without one they are a confident mistake
        row |= {"attracted": bool(finding.named), "misnamed": bool(finding.named) and not finding.flagged}
        return row
    found = [h for h in seen if any(matches(h["effect"], n) for n in finding.named)]
    true_names = [n for n in finding.named if any(matches(h["effect"], n) for h in hidden)]
    row |= {
        "recall": [len(found), len(seen)],
        "precision": [len(true_names), len(finding.named)],
        "exact": len(found) == len(seen) and len(true_names) == len(finding.named),
        "first_right": bool(first and any(matches(h["effect"], first) for h in hidden)),
        "where_right": bool(first and any(h["stage"] == first.where for h in hidden if matches(h["effect"], first))),
        "errors": [e for h in seen for n in finding.named if h["effect"] == n.effect and (e := error(h["values"], n)) is not None],
        "inside": [ok for h in seen for n in finding.named if h["effect"] == n.effect for ok in inside(h["values"], n)],
        "worst_closed": min(finding.closed.values()) if finding.closed else None,
    }
    if group == "twins":
        row |= _twins(answer, finding)
    if group == "poor":
        row["poor_ok"] = not finding.named or len(true_names) == len(finding.named)
    return row


APART = 1.5
"""Floors between the twins, by the truth alone, from which one of them may be named alone."""


def _twins(answer: dict[str, Any], finding: Finding) -> dict[str, Any]:
    """Both in one class; or, where the truth itself parts them on these motions, the right one alone."""
    effect, twin = answer["hidden"][0]["effect"], answer.get("twin")
    other = twin["name"] if twin else ""
    both = any({effect, other} <= n.members for n in finding.named)
    alone = bool(finding.named) and finding.named[0].effect == effect and other not in finding.named[0].members
    apart = twin is not None and twin["apart"] >= APART
    return {"as_class": both, "twin": other, "apart": twin["apart"] if twin else None, "twin_ok": both or (apart and alone)}


def resolved(answer: dict[str, Any], finding: Finding) -> bool:
    """After the next experiment: what is hidden is named, and its twin is not in that class."""
    effect, twin = answer["hidden"][0]["effect"], answer.get("twin")
    return any(n.effect == effect and (twin is None or twin["name"] not in n.members) for n in finding.named)


class Share(NamedTuple):
    """A count with its Wilson interval at 95 %."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        return self.hits / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        if not self.of:
            return 0.0, 1.0
        z, n, p = 1.959964, self.of, self.value
        middle = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
        return 0.0 if not self.hits else max(0.0, middle - half), 1.0 if self.hits == n else min(1.0, middle + half)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.hits}/{self.of} = {self.value:.3f} [{low:.3f}, {high:.3f}]" if self.of else "0/0"


def quantile(values: list[float], q: float) -> float | None:
    """Nearest-rank quantile; None without values."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, max(0, math.ceil(q * len(ordered)) - 1))] if ordered else None
