"""The next experiment: the safe motion on which names that cannot be told apart would part most, rival by rival refitted first.

Divergence of refitted rivals over a menu of motions: Hunter and Reiner, Technometrics 7 (1965); Buzzi-Ferraris and Forzatti (1984).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from spsp_ctrl.discrepancy.fitting import Bench, fit, robust_rms
from spsp_ctrl.discrepancy.library import Candidate
from spsp_ctrl.discrepancy.motion_menu import menu, reach_of
from spsp_ctrl.discrepancy.naming import Named, Search, State, taken_out
from spsp_ctrl.discrepancy.records import Motion, Record
from spsp_ctrl.discrepancy.replica import Replica, replica
from spsp_ctrl.discrepancy.statistics import rms
from spsp_ctrl.discrepancy.variables import Variable, place, values_of
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, INPUTS, OUT
from spsp_ctrl.plant.axis_model import AxisModel
from spsp_ctrl.plant.axis_scenario import AxisScenario, course, document
from spsp_ctrl.plant.layout import A, L
from spsp_ctrl.recording.schema import TOPICS

ENOUGH = 1.0
"""Floors by which rivals must part on a motion, at the least, for it to be worth running."""
LOOP = ("loop", "kp_1_s", "kv", "feedforward", "limit", "rate_span")


@dataclass(frozen=True)
class Pair:
    """Two fitted answers to the same logs."""

    name: str
    rival: str
    p: Array
    p_rival: Array
    variables: tuple[Variable, ...]
    """What the rival could still give way with."""
    at_hand: tuple[Array, Array] = (np.zeros(0), np.zeros((0, 0)))
    """Their difference on the logs at hand, and how the rival's numbers move it: what holds the rival back."""


@dataclass(frozen=True)
class Parting:
    """How far one pair parts on the chosen motion."""

    name: str
    rival: str
    floors: dict[str, float]

    @property
    def most(self) -> float:
        """In the channel that tells most."""
        return max(self.floors.values(), default=0.0)


@dataclass(frozen=True)
class Plan:
    """The motion that parts them, or none that does."""

    scenario: AxisScenario | None
    partings: tuple[Parting, ...]
    """Of the pairs that it parts."""
    together: tuple[tuple[str, str], ...]
    """Pairs that no motion of this bench parts."""
    tried: tuple[tuple[str, float], ...]
    """Every motion with the floors by which it parts the pair that it parts least."""


def plan(
    model: AxisModel,
    search: Search,
    first: State,
    state: State,
    floor: dict[str, float],
    records: Sequence[Record],
    tick: Callable[[str], None] = lambda text: None,
) -> Plan | None:
    """None where every name stands alone. ``floor`` is that of a record of its own, not of a difference of two."""
    pairs = [pair for n in state.named for pair in _pairs(search, first, state, n, tick)]
    if not pairs:
        return None
    pairs = [replace(pair, at_hand=difference(search.train, pair, floor)) for pair in pairs]
    reach = reach_of(model, records)
    tick("next: motions")
    motions = list(menu(reach))
    with ThreadPoolExecutor(search.train.jobs) as pool:
        rows = list(pool.map(lambda scenario: [part(model, scenario, pair, floor) for pair in pairs], motions))
    table: list[tuple[AxisScenario, list[Parting]]] = list(zip(motions, rows, strict=True))
    can = [k for k in range(len(pairs)) if any(row[k].most >= ENOUGH for _, row in table)]
    together = tuple((pairs[k].name, pairs[k].rival) for k in range(len(pairs)) if k not in can)
    tried = tuple((s.name, min((row[k].most for k in can), default=max((p.most for p in row), default=0.0))) for s, row in table)
    if not can:
        return Plan(None, (), together, tried)
    best, row = max(table, key=lambda entry: min(entry[1][k].most for k in can))
    parted = tuple(row[k] for k in can)
    words = "; ".join(f"{p.name} and {p.rival} part by {p.most:.3g} floors in {max(p.floors, key=lambda c: p.floors[c])}" for p in parted)
    return Plan(
        best.model_copy(update={"note": f"Written by spsp-ctrl diagnose to tell apart what the logs could not: {words}."}), parted, together, tried
    )


def _pairs(search: Search, first: State, state: State, named: Named, tick: Callable[[str], None]) -> list[Pair]:
    rest = [n for n in state.named if n is not named]
    bare = taken_out(state.p, first.p, named, rest)
    library = {c.name: c for c in search.library(replace(state, p=bare, named=rest))}
    pairs = []
    for rival in named.rivals:
        if rival in library:
            tick(f"next: {rival} for {named.candidate.name}")
            pairs.append(Pair(named.candidate.name, rival, state.p, refitted(search, library[rival], bare, rest), library[rival].variables))
    return pairs


def refitted(search: Search, candidate: Candidate, p: Array, rest: list[Named]) -> Array:
    """The best fit of a rival in place of a name, from each of its starts."""
    best: tuple[float, Array] | None = None
    for start in starts(candidate, p):
        fitted = fit(search.train, start, search.variables(start, rest, candidate), steps=4)
        size = sum(len(r) * float(np.log(max(robust_rms(r), search.train.floor.get(c, 0.0), 1e-15))) for c, r in fitted.residuals.items())
        if best is None or size < best[0]:
            best = size, fitted.p
    return p if best is None else best[1]


def starts(candidate: Candidate, p: Array) -> list[Array]:
    """Parameters with the candidate at each of its finite sizes, both signs where it may have both."""
    base = p.copy()
    for v in candidate.variables:
        if v.nuisance and base[v.index] == 0.0 and v.low > 0.0:
            base[v.index] = 10.0 * v.step
    out = []
    longest = max((len(f.starts) for f in candidate.hypothesis.free), default=0)
    signs = (1.0, -1.0) if any(f.low < 0.0 for f in candidate.hypothesis.free) else (1.0,)
    for k in range(min(longest, 2)):
        for sign in signs:
            values = values_of(base, candidate.variables)
            for j, v in enumerate(candidate.variables):
                free = next((f for f in candidate.hypothesis.free if f.name == v.name.split(".")[0]), None)
                if free is not None:
                    size = free.starts[min(k, len(free.starts) - 1)]
                    values[j] = min(max(size * (sign if free.low < 0.0 else 1.0), v.low), v.high)
            out.append(place(base, candidate.variables, values))
    return out


def part(model: AxisModel, scenario: AxisScenario, pair: Pair, floor: dict[str, float]) -> Parting:
    """By how many floors the rival misses what the other would log, after it has given way as far as the logs at hand let it.

    Nothing where the current would be too high.
    """
    inputs = course(scenario).inputs
    record = imagined(model, scenario, pair.p, inputs)
    if float(np.max(np.abs(record.rows["command_a"]))) > scenario.limits.current_a:
        return Parting(pair.name, pair.rival, {})
    bench = _bench(model, record, floor)
    channels = [c for c in floor if floor[c] > 0.0]
    target, columns = difference(bench, pair, floor)
    known, held = pair.at_hand
    matrix = np.concatenate([columns, held])
    left = target - columns @ np.linalg.lstsq(matrix, np.concatenate([target, known]), rcond=1e-9)[0] if matrix.shape[1] else target
    sizes = bench.residuals(pair.p)
    edges = np.cumsum([0, *(len(sizes[c]) for c in channels)])
    return Parting(pair.name, pair.rival, {c: rms(left[edges[k] : edges[k + 1]]) for k, c in enumerate(channels)})


def difference(bench: Bench, pair: Pair, floor: dict[str, float]) -> tuple[Array, Array]:
    """Rival less name on a bench, in floors, and how the rival's own numbers move that (each per its step)."""
    truth, rival = bench.residuals(pair.p), bench.residuals(pair.p_rival)
    channels = [c for c in floor if floor[c] > 0.0]
    target = np.concatenate([(rival[c] - truth[c]) / floor[c] for c in channels])
    at, columns = values_of(pair.p_rival, pair.variables), []
    for k, v in enumerate(pair.variables):
        moved = at.copy()
        moved[k] += v.step if at[k] + v.step <= v.high else -v.step
        after = bench.residuals(place(pair.p_rival, pair.variables, moved))
        columns.append(np.concatenate([(after[c] - rival[c]) / floor[c] for c in channels]))
    matrix = np.stack(columns, axis=1) if columns else np.zeros((len(target), 0))
    return np.nan_to_num(target), np.nan_to_num(matrix)


def _bench(model: AxisModel, record: Record, floor: dict[str, float]) -> Bench:
    one: Replica = replica(model, record)
    return Bench((one,), ({c: np.ones(len(one.rows(c)), bool) for c in one.channels},), floor)


def imagined(model: AxisModel, scenario: AxisScenario, p: Array, inputs: Array) -> Record:
    """The log that a machine with the numbers ``p`` would write, without noise."""
    looped = replace(model, file=model.file.model_copy(update={"controller": scenario.controller})).parameters()
    q = p.copy()
    for name in LOOP:
        q[getattr(L, name)] = looped[getattr(L, name)]
    y = model.simulate(q, inputs)
    rows = np.zeros(len(inputs), TOPICS["/axis"].dtype)
    for name in INPUTS:
        if name in (rows.dtype.names or ()):
            rows[name] = inputs[:, getattr(IN, name)]
    rows["cycle"] = np.arange(len(rows))
    rows["stamp_ns"] = np.round((rows["cycle"] + 1) * 1e9 / scenario.rate_hz)
    rows["enabled"] = True
    rows["command_a"], rows["current_a"], rows["load_m"] = y[:, OUT.command_a], y[:, OUT.current_a], y[:, OUT.load_m]
    counts = float(p[A.resolver_counts])
    if counts > 0.0:
        rows["resolver_counts"] = np.round(y[:, OUT.motor_rad] * counts / (2.0 * np.pi)).astype(np.int64)
    return Record(Path(scenario.name), rows, scenario.rate_hz, "cascade", (Motion(scenario.name, 0, len(rows)),), {})


def text(chosen: Plan) -> str:
    """The file ``next.yaml``."""
    if chosen.scenario is None:
        return ""
    raw: dict[str, Any] = document(chosen.scenario)
    head = f"# {chosen.scenario.note}\n" if chosen.scenario.note else ""
    head += "# Run it (a virtual bench: spsp-ctrl experiment next.yaml --model MODEL), then give its log to diagnose beside the others.\n"
    return head + yaml.safe_dump(raw, sort_keys=False, allow_unicode=True, width=150)


def summary(chosen: Plan) -> dict[str, Any]:
    """For ``diagnosis.json``."""
    return {
        "motion": None if chosen.scenario is None else chosen.scenario.name,
        "seconds": None if chosen.scenario is None else chosen.scenario.seconds,
        "separates": [{"names": [p.name, p.rival], "floors": {c: float(f"{f:.4g}") for c, f in p.floors.items()}} for p in chosen.partings],
        "not_separable_here": [list(pair) for pair in chosen.together],
        "tried": [{"motion": name, "floors": float(f"{value:.4g}")} for name, value in chosen.tried],
    }
