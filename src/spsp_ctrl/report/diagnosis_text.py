"""A diagnosis in plain words: for the terminal, and for the top of the page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from spsp_ctrl.discrepancy.result import Diagnosis, NamedEffect, Value
from spsp_ctrl.discrepancy.show import Gap
from spsp_ctrl.discrepancy.unknown import Sketch

SCALES = {"m": (1e6, "µm"), "rad": (1e3, "mrad"), "A": (1e3, "mA"), "N m": (1e3, "mN m"), "s": (1e3, "ms"), "N": (1.0, "N")}
WIDTH = 150


def quantity(value: Value) -> str:
    """A number with its deviation, in a unit that people use."""
    factor, unit = SCALES.get(value.unit, (1.0, value.unit))
    spread = f" ± {value.sigma * factor:.2g}" if value.sigma is not None else ""
    return f"{value.value * factor:.4g}{spread}" + ("" if unit == "1" else f" {unit}")


def size(value: float, unit: str) -> str:
    """A size in a unit that people use."""
    factor, name = SCALES.get(unit, (1.0, unit))
    return f"{value * factor:.3g} {name}"


def class_of(effect: NamedEffect) -> str:
    """The names that cannot be told apart, with their weights; empty for one."""
    return ", ".join(f"{n} {w:.0%}" for n, w in effect.members) if len(effect.members) > 1 else ""


def plain(name: str) -> str:
    """A standard name as words."""
    return name.replace("_", " ")


def listed(words: list[str]) -> str:
    """``a, b and c``."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1] if words else ""


def story(answer: Diagnosis) -> Iterator[str]:
    """The answer in a few sentences."""
    if answer.verdict == "not-understood":
        yield f"The log cannot be used: {answer.reason}. Nothing is said about the machine and no model was written."
        return
    if answer.verdict == "invalid":
        yield f"This answer is invalid: {answer.reason}. Do not use it."
        return
    opened = [(c, g) for c, g in answer.gap.items() if g.closed is not None and g.floor > 0.0]
    if opened:
        parts = [f"{c} by {size(g.before, g.unit)} ({g.before / g.floor:.3g} floors)" for c, g in opened]
        yield f"Even recalibrated, the model misses {listed(parts)} on motion that was not fitted."
    elif answer.gap:
        yield "Recalibrated, the model is at the floor of every channel on motion that was not fitted."
    for k, e in enumerate(answer.effects):
        sizes = [(n, v) for n, v in e.parameters.items() if "phase" not in n]
        numbers = ", ".join(quantity(v) if len(sizes) == 1 else f"{plain(n)} {quantity(v)}" for n, v in sizes)
        more = f" It cannot be told from {listed([plain(n) for n, _ in e.members if n != e.name])} on these logs." if len(e.members) > 1 else ""
        lead = "What is missing" if k == 0 else "Then"
        place = "" if e.where == "axis" else f" of {e.where}"
        yield f"{lead}: {plain(e.name)}{place} ({numbers}), in the {e.stage}.{more}"
    closed = [f"{_share(g)} of the gap in {c}" for c, g in opened if answer.effects]
    if closed:
        yield f"With the new model file {listed(closed)} is gone."
    for r in answer.refused:
        nearest = f"{plain(r.name).capitalize()} came nearest in {r.channel} and is refused"
        yield f"{nearest}: it closes less than half of the gap there. Not explained by the library."
    shapes = {s.channel: s for s in answer.sketches}
    for u in answer.unexplained:
        drawn = f"; {shape(shapes[u.channel])}" if u.channel in shapes else ""
        yield f"Left in {u.channel}, {u.regime}: {size(u.size, u.unit)}{drawn}."
    if answer.verdict == "nothing-missing" and not answer.effects:
        yield "Nothing is missing that these logs could show."
    if answer.plan is not None and answer.plan.scenario is not None:
        pairs = [f"{plain(p.name)} and {plain(p.rival)} (predicted: {p.most:.3g} floors apart)" for p in answer.plan.partings]
        yield f"To tell apart {listed(pairs)}, run next.yaml: {answer.plan.scenario.title.lower()}, {answer.plan.scenario.seconds:g} s."
    if answer.plan is not None and answer.plan.together:
        pairs = [f"{plain(a)} from {plain(b)}" for a, b in answer.plan.together]
        yield f"No motion that was looked at tells {listed(pairs)}: that takes a second reference or a wider reach."


def shape(sketch: Sketch) -> str:
    """What a sketch shows, in one line."""
    name, at, value, spread = sketch.peak
    factor, unit = SCALES.get(sketch.unit, (1.0, sketch.unit))
    what = "size" if sketch.kind == "rms" else "mean"
    where = f"{at:.3g} {sketch.over_unit}" + ("" if name == "all" else f", {name}")
    sides = f", {sketch.sides}" if sketch.sides else ""
    top = f"{value * factor:.3g} ± {spread * factor:.1g} {unit}"
    return f"over {sketch.over} (which orders {sketch.explained:.0%} of it) its {what} is largest, {top}, at {where}{sides}"


def _share(gap: Gap) -> str:
    """How much is gone, in words where a number says less."""
    if gap.after <= gap.floor:
        return "all"
    return "nothing" if gap.closed is None or gap.closed < 0.005 else f"{gap.closed:.0%}"


def screen_of(answer: Diagnosis, out: Path) -> Iterator[str]:
    """Lines for the screen: the story, the gap by channel, what these logs say nothing about."""
    yield answer.verdict.upper() + (f": {answer.reason}" if answer.reason else "")
    yield ""
    for name, gate in answer.gates.items():
        for text in gate.problems:
            yield f"  gate {name}: {text}"
        for text in gate.remarks:
            yield f"  note {name}: {text}"
    if answer.floor_quality == "weak" and answer.verdict != "not-understood":
        yield "  weak floor: no commissioning log and no laps that repeat; what is said about `closed` rests on a guess of the noise"
    for text in story(answer):
        yield from _wrapped(text)
    if answer.gap:
        yield ""
    for channel, gap in answer.gap.items():
        ratio = f"{gap.before / gap.floor:.2f} -> {gap.after / gap.floor:.2f} floors" if gap.floor > 0 else f"{gap.before:.3g} -> {gap.after:.3g}"
        if gap.closed is None:
            yield f"  gap  {channel:<9} at floor ({ratio})"
        else:
            low, high = gap.interval or (gap.closed, gap.closed)
            yield f"  gap  {channel:<9} {gap.closed:.1%} closed on held-out data [{low:.1%}, {high:.1%}] ({ratio})"
    for effect in answer.effects:
        if text := class_of(effect):
            yield f"  class {effect.name}: {text}"
        for remark in effect.remarks:
            yield f"  note {effect.name}: {remark}"
    for text in answer.not_excited:
        yield f"  not excited: {text}"
    yield ""
    yield f"{out / 'report.html'}"


def _wrapped(text: str) -> Iterator[str]:
    import textwrap

    yield from textwrap.wrap(text, WIDTH, initial_indent="  ", subsequent_indent="  ")
