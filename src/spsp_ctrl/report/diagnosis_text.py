"""What the terminal says at the end of a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from spsp_ctrl.discrepancy.result import Diagnosis, NamedEffect, Value


def quantity(value: Value) -> str:
    """A number with its deviation."""
    spread = f" ± {value.sigma:.2g}" if value.sigma is not None else ""
    unit = "" if value.unit == "1" else f" {value.unit}"
    return f"{value.value:.4g}{spread}{unit}"


def class_of(effect: NamedEffect) -> str:
    """The names that cannot be told apart, with their weights; empty for one."""
    return ", ".join(f"{n} {w:.0%}" for n, w in effect.members) if len(effect.members) > 1 else ""


def screen_of(answer: Diagnosis, out: Path) -> Iterator[str]:
    """Lines for the screen."""
    yield f"{answer.verdict}: {answer.reason}" if answer.reason else answer.verdict
    for name, gate in answer.gates.items():
        for text in gate.problems:
            yield f"  gate {name}: {text}"
        for text in gate.remarks:
            yield f"  note {name}: {text}"
    if answer.floor_quality == "weak" and answer.verdict != "not-understood":
        yield "  weak floor: no commissioning log and no laps that repeat; what is said about `closed` rests on a guess of the noise"
    for found in [f for f in answer.found if f.regime == "everywhere"] or answer.found[:3]:
        yield f"  find {found.channel}, {found.regime}: {found.size:.3g} {found.unit} (p = {found.p_value:.2g})"
    for k, effect in enumerate(answer.effects, 1):
        numbers = ", ".join(f"{n} {quantity(v)}" for n, v in effect.parameters.items())
        yield f"  {k}. {effect.name} ({effect.stage}): {numbers}"
        if text := class_of(effect):
            yield f"     cannot be told apart: {text}"
        for remark in effect.remarks:
            yield f"     {remark}"
    for channel, gap in answer.gap.items():
        ratio = f"{gap.before / gap.floor:.2f} -> {gap.after / gap.floor:.2f} floors" if gap.floor > 0 else f"{gap.before:.3g} -> {gap.after:.3g}"
        if gap.closed is None:
            yield f"  gap  {channel}: at floor ({ratio})"
        else:
            low, high = gap.interval or (gap.closed, gap.closed)
            yield f"  gap  {channel}: {gap.closed:.1%} closed on held-out data [{low:.1%}, {high:.1%}] ({ratio})"
    for left in answer.unexplained:
        yield f"  left {left.channel}, {left.regime}: {left.size:.3g} {left.unit}"
    for text in answer.not_excited:
        yield f"  not excited: {text}"
    yield f"{out / 'report.html'}"
