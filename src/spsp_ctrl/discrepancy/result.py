"""The answer of a diagnosis, and its form as ``diagnosis.json``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from spsp_ctrl.discrepancy.find import Found
from spsp_ctrl.discrepancy.gate import Gate
from spsp_ctrl.discrepancy.show import Gap
from spsp_ctrl.plant.arrays import Array

if TYPE_CHECKING:
    from spsp_ctrl.discrepancy.next_experiment import Plan
    from spsp_ctrl.discrepancy.unknown import Sketch

Verdict = Literal["explained", "partly-explained", "unexplained", "nothing-missing", "not-understood", "invalid"]
GOOD = ("explained", "partly-explained", "nothing-missing", "unexplained")


@dataclass(frozen=True)
class Value:
    """One identified number in SI."""

    value: float
    unit: str
    sigma: float | None


@dataclass(frozen=True)
class NamedEffect:
    """One name of the answer."""

    name: str
    where: str
    stage: str
    parameters: dict[str, Value]
    members: tuple[tuple[str, float], ...]
    """Names that cannot be told apart from it, itself included, with weights."""
    evidence: float
    channel: str
    gap_closed: float | None
    """Share of its channel's excess that went with it, in training."""
    remarks: tuple[str, ...]
    sentinel: bool


@dataclass(frozen=True)
class Unexplained:
    """What is left, and where."""

    channel: str
    regime: str
    size: float
    unit: str


@dataclass(frozen=True)
class Refused:
    """A name that closes too little of its channel to be given."""

    name: str
    channel: str
    evidence: float


@dataclass(frozen=True)
class Step:
    """One bar of the waterfall: held-out residual over floor by channel."""

    name: str
    floors: dict[str, float]


@dataclass(frozen=True)
class RegimeCell:
    """Held-out residual over floor in one regime."""

    channel: str
    regime: str
    before: float
    after: float


@dataclass(frozen=True)
class Correlation:
    """Correlation of fitted numbers."""

    names: tuple[str, ...]
    matrix: Array


@dataclass
class Curve:
    """Residual over time on held-out data, for the report."""

    channel: str
    unit: str
    t_s: Array
    before: Array
    after: Array


@dataclass
class Diagnosis:
    """Everything that a diagnosis says."""

    verdict: Verdict
    reason: str
    floor_quality: Literal["measured", "weak"]
    gates: dict[str, Gate]
    found: list[Found] = field(default_factory=list)
    effects: list[NamedEffect] = field(default_factory=list)
    unexplained: list[Unexplained] = field(default_factory=list)
    gap: dict[str, Gap] = field(default_factory=dict)
    not_excited: list[str] = field(default_factory=list)
    refused: list[Refused] = field(default_factory=list)
    waterfall: list[Step] = field(default_factory=list)
    regimes: list[RegimeCell] = field(default_factory=list)
    sketches: list[Sketch] = field(default_factory=list)
    correlation: Correlation | None = None
    plan: Plan | None = None
    next_experiment: str | None = None
    model: str | None = None
    seconds: float = 0.0
    curves: list[Curve] = field(default_factory=list)
    screening: list[tuple[str, list[tuple[str, float]]]] = field(default_factory=list)
    fingerprints: dict[str, str] = field(default_factory=dict)

    @property
    def good(self) -> bool:
        """Whether there is an answer (exit code 0): explained, in part, or nothing missing."""
        return self.verdict in ("explained", "partly-explained", "nothing-missing")

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json`` (docs/diagnose.md)."""
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "floor_quality": self.floor_quality,
            "gate": {
                name: {"problems": g.problems, "remarks": g.remarks, "controller_replay": g.controller_replay} for name, g in self.gates.items()
            },
            "found": [
                {"channel": f.channel, "stage": f.stage, "where": f.where, "regime": f.regime, "size": f.size, "unit": f.unit, "p_value": f.p_value,
                 "energy_share": f.share, "enrichment": f.enrichment}
                for f in self.found
            ],
            "effects": [
                {
                    "name": e.name, "where": e.where, "stage": e.stage,
                    "parameters": {n: {"value": v.value, "unit": v.unit, "sigma": v.sigma} for n, v in e.parameters.items()},
                    "class": [{"name": n, "weight": w} for n, w in e.members],
                    "evidence": e.evidence, "channel": e.channel, "gap_closed": e.gap_closed, "remarks": list(e.remarks),
                }
                for e in self.effects
            ],
            "unexplained": [
                {"channel": u.channel, "regime": u.regime, "size": u.size, "unit": u.unit, "sketch": self._sketch(u.channel)}
                for u in self.unexplained
            ],
            "refused": [{"name": r.name, "channel": r.channel, "evidence": r.evidence} for r in self.refused],
            "gap": {
                c: {"floor": g.floor, "before": g.before, "after": g.after, "closed": g.closed, "interval": list(g.interval) if g.interval else None,
                    "unit": g.unit, "at_floor": g.closed is None}
                for c, g in self.gap.items()
            },
            "waterfall": [{"name": s.name, "floors": {c: _short(d) for c, d in s.floors.items()}} for s in self.waterfall],
            "regimes": [{"channel": r.channel, "regime": r.regime, "before": _short(r.before), "after": _short(r.after)} for r in self.regimes],
            "correlation": None if self.correlation is None else {
                "parameters": list(self.correlation.names), "matrix": [[round(float(v), 3) for v in row] for row in self.correlation.matrix],
            },
            "not_excited": self.not_excited,
            "next": self._next(),
            "next_experiment": self.next_experiment,
            "model": self.model,
            "fingerprints": self.fingerprints,
            "seconds": round(self.seconds, 2),
        }  # fmt: skip

    def _sketch(self, channel: str) -> dict[str, Any] | None:
        found = next((s for s in self.sketches if s.channel == channel), None)
        if found is None:
            return None
        curves = [
            {"direction": name, "at": [_short(v) for v in x], "value": [_short(v) for v in y], "sigma": [_short(v) for v in e]}
            for name, x, y, e in found.curves
        ]
        return {"over": found.over, "over_unit": found.over_unit, "kind": found.kind, "explained": _short(found.explained), "curves": curves}

    def _next(self) -> dict[str, Any] | None:
        if self.plan is None:
            return None
        from spsp_ctrl.discrepancy.next_experiment import summary

        return summary(self.plan)


def _short(value: float) -> float:
    return float(f"{float(value):.5g}")
