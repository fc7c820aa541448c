"""The whole diagnosis of an axis: gate, floor, refit, find, name, add, show. No clock and no files of its own beside the new model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from spsp_ctrl.discrepancy import floor as floors
from spsp_ctrl.discrepancy import library as names
from spsp_ctrl.discrepancy.baseline import baselines, difference_floor
from spsp_ctrl.discrepancy.closing import close
from spsp_ctrl.discrepancy.features import basis, features
from spsp_ctrl.discrepancy.find import find
from spsp_ctrl.discrepancy.fitting import Bench, Fitted, Split, fit, robust_rms
from spsp_ctrl.discrepancy.gate import Gate, filled, judge
from spsp_ctrl.discrepancy.masks import order_lines
from spsp_ctrl.discrepancy.model_writing import deviations, document, text
from spsp_ctrl.discrepancy.naming import Named, Search, State
from spsp_ctrl.discrepancy.records import Record
from spsp_ctrl.discrepancy.replica import UNITS, Replica, replica, smooth
from spsp_ctrl.discrepancy.result import Curve, Diagnosis, NamedEffect, Unexplained, Value
from spsp_ctrl.discrepancy.scatter import Random, lost_or_coarse, noisier, repeated, scatter
from spsp_ctrl.discrepancy.show import OPEN, gaps
from spsp_ctrl.discrepancy.unknown import refuse
from spsp_ctrl.discrepancy.whitening import colour, plain
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis_model import AxisModel, load_axis_model
from spsp_ctrl.plant.layout import A
from spsp_ctrl.plant.model import effect_keys

COMMISSIONED_SIGMA = 0.005
"""Tolerance of a number that a commissioning log has calibrated: what a machine may change by itself until the next log."""
HELD_PART = 0.4
"""Part of the motions that is kept back where no log is given for it."""
EXPLAINED = 0.5
SUBSTEP_S = 2e-4
"""Integration step while fitting: twice that of the plant, which costs less than the floor of any channel."""
STAGES = ("find", "name", "add", "show")


@dataclass(frozen=True)
class Task:
    """What to diagnose."""

    model: AxisModel
    logs: tuple[Record, ...]
    commissioning: tuple[Record, ...]
    held_out: tuple[Record, ...]
    seed: int
    last: str = "show"
    """Last stage to run."""
    jobs: int = 1
    """Threads; the answer does not depend on it."""


def split_by_motion(one: Replica) -> tuple[np.ndarray, np.ndarray]:
    """Rows to train on and rows to keep back: the last motions, at least one; the last part of a single motion."""
    n, motions = len(one.inputs), one.record.motions
    edge = int(n * (1.0 - HELD_PART))
    starts = [m.start for m in motions if m.start >= edge] or [m.start for m in motions[1:]][-1:]
    cut = starts[0] if starts and 0.2 * n < starts[0] < 0.9 * n else edge
    train = np.arange(n) < cut
    return train, ~train


def _bench(
    model: AxisModel,
    records: Sequence[Record],
    floor: dict[str, float],
    parts: Sequence[np.ndarray] | None = None,
    baseline: tuple[Split, ...] | None = None,
) -> Bench:
    replicas = tuple(replica(model, r) for r in records)
    use = []
    for k, one in enumerate(replicas):
        use.append({c: np.ones(len(one.rows(c)), bool) if parts is None else parts[k][one.rows(c)] for c in one.channels})
    return Bench(replicas, tuple(use), floor, baseline or ())


def diagnose(task: Task, new_model: Path, tick: Callable[[str], None] = lambda text: None) -> Diagnosis:
    """Run the stages. The new model file is written to ``new_model`` and read back for the last one."""
    model = replace(task.model, substep_s=SUBSTEP_S) if not task.model.file.bare else task.model
    tick("gate")
    gates: dict[str, Gate] = {}
    kept: dict[str, list[Record]] = {"logs": [], "commissioning": [], "held_out": []}
    for kind in kept:
        for record in getattr(task, kind):
            record = filled(record)
            gates[f"{record.path.name}"] = gate = judge(record, model)
            kept[kind].append(record)
            if not gate.passed:
                answer = Diagnosis("not-understood", f"{record.path.name}: {gate.problems[0]}", "weak", gates)
                return answer
    prints = {r.path.name: r.fingerprint() for records in kept.values() for r in records}
    p = model.parameters()
    reference, sigma = p, names.NOMINAL_SIGMA
    floor: dict[str, float] = {}
    quality: floors.Quality = "weak"
    commissioned = None
    if kept["commissioning"]:
        tick("floor")
        commissioned = replace(_bench(model, kept["commissioning"], {}), jobs=task.jobs)
        fitted = fit(commissioned, p, names.nominal_variables(model, p, p, sigma), steps=6, whitened=plain, tick=lambda: tick("floor"))
        floor, quality = floors.from_commissioning(fitted.residuals), "measured"
        p = reference = fitted.p
        sigma = COMMISSIONED_SIGMA
    base = baselines(kept["logs"], commissioned.replicas, p) if commissioned is not None else None
    if kept["held_out"]:
        train, held = _bench(model, kept["logs"], floor, None, base), _bench(model, kept["held_out"], floor)
    else:
        pairs = [split_by_motion(replica(model, r)) for r in kept["logs"]]
        train = _bench(model, kept["logs"], floor, [a for a, _ in pairs], base)
        held = _bench(model, kept["logs"], floor, [b for _, b in pairs], base)
    if not kept["commissioning"]:
        tick("floor")
        whole = _bench(model, kept["logs"], {})
        measured, quality = floors.measure(whole, p)
        floor.update(measured)
    randoms: list[Random] = []
    if commissioned is not None:
        clean = scatter(commissioned.replicas[0])
        randoms = lost_or_coarse(scatter(train.replicas[0]), clean)
        train, held, p = without_lost(train, randoms), without_lost(held, randoms), coarser(p, randoms)
    train = replace(train, motion=motion_of(train), jobs=task.jobs)
    if base is not None:
        train = replace(train, floor=difference_floor(train.residuals(p), train.motion))
    search = Search(
        train, held,
        lambda q: () if base is not None else names.nominal_variables(model, q, reference, sigma),
        lambda s: _library(model, train, s, base is not None), tick, base is not None,
        fitted.residuals if kept["commissioning"] else None,
    )  # fmt: skip
    before = search.start(p)
    tick("find")
    found = find(train, before.fitted.residuals, task.seed)
    answer = Diagnosis("nothing-missing", "", quality, gates, found=found, fingerprints=prints)
    answer.not_excited = not_excited(model, train, held)
    if task.last == "find":
        answer.verdict = "unexplained" if found else "nothing-missing"
        answer.reason = "only `find` was asked for"
        return answer
    first, state = search.run(p, before)
    state, refused = refuse(search, first, state, floor)
    answer.screening = search.trace
    if commissioned is not None and not randoms and "resolver" in train.replicas[0].channels:
        randoms = noisier(train.replicas[0].residuals(state.p)["resolver"], fitted.residuals["resolver"])
    answer.effects = [_random(r) for r in randoms] + [_effect(model, n, state.fitted, reference) for n in state.named]
    if task.last != "name":
        tick("add")
        raw = document(
            model, writable(state.p), state.fitted, state.named, "I: identified from " + ", ".join(f"{k} ({v})" for k, v in prints.items())
        )
        new_model.write_text(text(raw, _notes(state, prints, train)), encoding="utf-8")
        answer.model = new_model.name
    after: Split = state.held
    if task.last == "show":
        tick("show")
        after = held.residuals(load_axis_model(new_model).parameters())
    answer.gap = gaps(first.held, after, floor, task.seed)
    answer.curves = _curves(held, first.held, after)
    _conclude(answer, train, state, first, task.seed, bool(randoms))
    close(answer, model, search, first, state, after, floor, [r for records in kept.values() for r in records], refused, tick)
    return answer


def writable(p: Array) -> Array:
    """Parameters as a file may hold them: cogging of negative sign is a ripple of the same order half a period on."""
    q = p.copy()
    if q[A.cogging_nm] < 0.0:
        if q[A.ripple_nm] == 0.0:
            q[A.ripple_nm], q[A.ripple_order], q[A.ripple_phase_rad], q[A.cogging_nm] = -q[A.cogging_nm], q[A.cogging_order], np.pi, 0.0
        else:
            q[A.cogging_nm] = 0.0
    return q


def _library(model: AxisModel, train: Bench, state: State, calibrated: bool) -> list[names.Candidate]:
    one = train.replicas[0]
    speed = np.gradient(one.measured["motor"]) * one.record.rate_hz
    current = one.measured["command"] if not one.tracking else one.measured["current"]
    reach = names.reaches(model, state.p, current, np.asarray(speed))
    orders = best_orders(train, state.fitted.residuals)
    lines = best_frequencies(train, state.fitted.residuals)
    known = [(e, h) for e, h in names.hypotheses(model, state.p) if h.name not in one.blind]
    return [names.candidate(model, e, h, state.p, reach, orders, lines, calibrated) for e, h in known]


def best_orders(bench: Bench, residuals: Split, count: int = 3) -> tuple[float, ...]:
    """Orders of the motor turn with the strongest lines in what is left: a free scan, not only orders that a library knows.

    Looked for in the whitened residual of the channel that follows the torque most quickly.
    """
    channel = next(c for c in ("force", "resolver", "current", "ruler") if c in residuals)
    one, use = bench.replicas[0], bench.use[0][channel]
    values = colour(residuals[channel]).apply(residuals[channel])[: int(use.sum())]
    motor = one.measured["motor"] if np.ptp(one.measured["motor"]) > 0 else one.measured["load"] / one.travel_per_rad
    grid = np.unique(np.concatenate([np.arange(0.1, 4.0, 0.02), np.arange(4.0, 26.0, 0.05), np.arange(1, 49) * 1.0, np.arange(1, 49) / 3.0]))
    every = max(1, len(values) // 6000)
    lines = order_lines(values[::every], motor[one.rows(channel)[use]][::every], grid)
    chosen: list[float] = []
    for k in np.argsort(-lines):
        if grid[k] > 0.25 and all(abs(grid[k] - c) > 0.15 for c in chosen):
            chosen.append(float(grid[k]))
        if len(chosen) == count:
            break
    return tuple(chosen)


def motion_of(bench: Bench) -> dict[str, Array]:
    """Basis of what the motion of a bench can do to each channel."""
    made: dict[str, list[Array]] = {}
    for one, use in zip(bench.replicas, bench.use, strict=True):
        every = features(one)
        for channel in one.channels:
            made.setdefault(channel, []).append(every[one.rows(channel)[use[channel]]])
    # records move in different ways (one may change the load, another not): each has columns of its own
    return {channel: basis(_blocks(parts)) for channel, parts in made.items()}


def _blocks(parts: Sequence[Array]) -> Array:
    """The parts along the diagonal."""
    rows, columns = np.cumsum([0, *(len(m) for m in parts)]), np.cumsum([0, *(m.shape[1] for m in parts)])
    out = np.zeros((rows[-1], columns[-1]))
    for k, part in enumerate(parts):
        out[rows[k] : rows[k + 1], columns[k] : columns[k + 1]] = part
    return out


def without_lost(bench: Bench, randoms: Sequence[Random]) -> Bench:
    """The bench without the samples that were lost: a reading that stays as it was while the axis moves says nothing."""
    if not any(r.name == "sensor_dropout" for r in randoms):
        return bench
    use = []
    for one, kept in zip(bench.replicas, bench.use, strict=True):
        mask = dict(kept)
        for r in randoms:
            if r.name == "sensor_dropout":
                channel, reading = ("ruler", "load") if r.parameter == "ruler_lost" else ("resolver", "motor")
                held = repeated(one.measured[reading])
                rows, every = one.rows(channel), 1
                near = np.convolve(held, np.ones(every + 1), "same") > 0.0
                mask[channel] = mask[channel] & ~near[rows]
        use.append(mask)
    return replace(bench, use=tuple(use))


def coarser(p: Array, randoms: Sequence[Random]) -> Array:
    """Parameters with the step of a resolver that has become coarser."""
    q = p.copy()
    for r in randoms:
        if r.parameter == "res_step_rad":
            q[A.res_step_rad] = r.value
    return q


CHANGES = ("zero_offset_m", "lead_slope")
"""Numbers without a drawing: what a commissioning log finds there is its own, and a name states the change since."""


def best_frequencies(bench: Bench, residuals: Split, count: int = 3) -> tuple[float, ...]:
    """Frequencies in Hz at which what is left of the ruler stands out of its neighbourhood: where a mode may be."""
    if "ruler" not in residuals:
        return ()
    one, n = bench.replicas[0], int(bench.use[0]["ruler"].sum())
    values = colour(residuals["ruler"]).apply(residuals["ruler"])[:n]
    spectrum = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2
    wide = max(1, len(spectrum) // 400)
    level = smooth(spectrum, wide)
    frequency = np.fft.rfftfreq(len(values), 1.0 / one.record.rate_hz)
    chosen: list[float] = []
    for k in np.argsort(-np.where((frequency > 5.0) & (frequency < 0.4 * one.record.rate_hz), level, 0.0)):
        if all(abs(frequency[k] / c - 1.0) > 0.1 for c in chosen):
            chosen.append(float(frequency[k]))
        if len(chosen) == count:
            break
    return tuple(chosen)


def _effect(model: AxisModel, named: Named, fitted: Fitted, reference: Array) -> NamedEffect:
    spread = deviations(fitted)
    keys = {q.name: (name, q) for name, q in effect_keys(named.candidate.effect).items()}
    values = {}
    for f in named.candidate.hypothesis.free:
        name, q = keys[f.name]
        i = model.index(f.name)
        since = float(reference[i] - model.parameters()[i]) if f.name in CHANGES else 0.0
        values[name] = Value(float(fitted.p[i]) - since, q.unit, spread.get(i))
    weights = {named.candidate.name: 1.0} | {n: float(np.exp(0.5 * max(d, -40.0))) for n, d in named.rivals.items()}
    total = sum(weights.values())
    members = tuple(sorted(((n, w / total) for n, w in weights.items()), key=lambda m: -m[1]))
    share = named.shares.get(named.channel)
    return NamedEffect(
        named.candidate.name, names.WHERE[named.candidate.effect.stage], named.candidate.effect.stage, values, members, named.evidence,
        named.channel, None if share is None else min(1.0, share), tuple(named.remarks), named.candidate.hypothesis.sentinel,
    )  # fmt: skip


def _random(r: Random) -> NamedEffect:
    return NamedEffect(
        r.name, "axis", "sensors", {r.parameter: Value(r.value, r.unit, None)}, ((r.name, 1.0),), 0.0, "resolver", None,
        (f"scatter {r.ratio:.2f} times that of the commissioning log; it is not simulated and does not enter the model",), False,
    )  # fmt: skip


def _notes(state: State, prints: dict[str, str], train: Bench) -> list[str]:
    lines = ["written by spsp-ctrl diagnose; data: " + ", ".join(f"{k} {v}" for k, v in prints.items())]
    for n in state.named:
        rivals = ", ".join(f"{k} ({v:+.1f})" for k, v in n.rivals.items()) or "none"
        lines.append(f"{n.candidate.name}: evidence {n.evidence:.1f}, channel {n.channel}, rivals {rivals}")
    rows = train.replicas[0].record.rows
    motor = train.replicas[0].measured["load"]
    lines.append(
        f"valid for travel {motor.min() * 1e3:.1f} to {motor.max() * 1e3:.1f} mm, load {rows['load_force_n'].min():.0f} to "
        f"{rows['load_force_n'].max():.0f} N, screw {rows['screw_c'].min():.1f} to {rows['screw_c'].max():.1f} degC"
    )
    return lines


def not_excited(model: AxisModel, train: Bench, held: Bench) -> list[str]:
    """What these logs say nothing about, whatever the answer."""
    p, out = model.parameters(), []
    rows = np.concatenate([r.record.rows for r in train.replicas])
    top = float(np.max(np.abs(rows["command_a"])))
    limit = float(p[A.current_limit_a])
    if top < 0.9 * limit:
        out.append(f"no command above {top:.3g} of {limit:.3g}: current saturation untested")
    if np.ptp(rows["load_force_n"]) == 0.0 and np.ptp(rows["load_mass_kg"]) == 0.0:
        out.append("the load never changed: friction under load, compliance and motor constant are weakly seen")
    if np.ptp(rows["screw_c"]) < 3.0:
        out.append("the temperature hardly changed: thermal expansion untested")
    for name, unit in (("load_force_n", "N"), ("screw_c", "degC")):
        there = np.concatenate([r.record.rows[name] for r in held.replicas])
        low, high = float(rows[name].min()), float(rows[name].max())
        if there.min() < low - 1e-9 or there.max() > high + 1e-9:
            out.append(f"held-out {name} reaches {there.min():.3g} to {there.max():.3g} {unit}, training only {low:.3g} to {high:.3g}")
    if not any(m.name in ("reversals", "repeat") for r in train.replicas for m in r.record.motions):
        speed = np.abs(np.gradient(train.replicas[0].measured["load"])) * train.replicas[0].record.rate_hz
        if np.quantile(speed, 0.95) < 3.0 * np.quantile(speed, 0.5):
            out.append("one speed only: the shape of friction over speed is not seen")
    return out


def _curves(held: Bench, before: Split, after: Split) -> list[Curve]:
    out = []
    for channel in before:
        t = np.concatenate([one.rows(channel)[use[channel]] / one.record.rate_hz for one, use in zip(held.replicas, held.use, strict=True)])
        if len(held.replicas) > 1:
            t = np.arange(len(before[channel])) * (t[1] - t[0])
        out.append(Curve(channel, UNITS[channel], t, before[channel], after[channel]))
    return out


def _conclude(answer: Diagnosis, train: Bench, state: State, first: State, seed: int, scattered: bool) -> None:
    """The verdict: from what training has left, name by name and channel by channel."""
    if any(e.sentinel for e in answer.effects):
        answer.verdict, answer.reason = "invalid", "an effect that cannot exist was named: the data or the model break an assumption of this program"
        return
    floor = train.floor
    start, end = first.fitted.residuals, state.fitted.residuals
    gap_channels = [c for c in start if robust_rms(start[c]) > OPEN * floor[c]]
    left = [c for c in end if robust_rms(end[c]) > OPEN * floor[c]]
    closed = {c: (robust_rms(start[c]) - robust_rms(end[c])) / (robust_rms(start[c]) - floor[c]) for c in gap_channels}
    remains = {f.channel: f for f in find(train, end, seed) if f.regime != "everywhere"}
    for c in left:
        regime = remains[c].regime if c in remains else "everywhere"
        answer.unexplained.append(Unexplained(c, regime, robust_rms(end[c]), UNITS[c]))
    if not answer.effects:
        answer.verdict = "unexplained" if left else "nothing-missing"
        answer.reason = "no name of the library closes the gap" if left else "every channel is at its floor after recalibration"
    elif left and any(closed.get(c, 1.0) < EXPLAINED for c in left):
        answer.verdict, answer.reason = "partly-explained", "names were found, but in " + ", ".join(left) + " more is left than they explain"
    elif left:
        answer.verdict, answer.reason = "partly-explained", "names explain most of it; " + ", ".join(left) + " is still above its floor"
    else:
        answer.verdict, answer.reason = "explained", "every channel is at its floor with the named effects"
    if scattered and not left:
        answer.verdict = "explained"
