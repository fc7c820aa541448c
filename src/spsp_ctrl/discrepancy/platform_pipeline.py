"""The whole diagnosis of a platform in closed loop: gate, floor, refit, find, name, add, show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, cast

import numpy as np

from spsp_ctrl.discrepancy import floor as floors
from spsp_ctrl.discrepancy import platform_library as names
from spsp_ctrl.discrepancy.find import Machine, find
from spsp_ctrl.discrepancy.fitting import Bench, Split, robust_rms
from spsp_ctrl.discrepancy.gate import Gate
from spsp_ctrl.discrepancy.library import NOMINAL_SIGMA, Candidate
from spsp_ctrl.discrepancy.masks import order_lines
from spsp_ctrl.discrepancy.model_writing import deviations, text
from spsp_ctrl.discrepancy.platform_gate import judge_attitude, judge_law, judge_values, replayed
from spsp_ctrl.discrepancy.platform_masks import platform_regimes
from spsp_ctrl.discrepancy.platform_noise import flat, spectrum, whitener
from spsp_ctrl.discrepancy.platform_records import PlatformRecord, load_platform
from spsp_ctrl.discrepancy.platform_replica import AXES, STAGES, UNITS, WHERE, PlatformReplica, platform_replica
from spsp_ctrl.discrepancy.platform_search import Fit, Name, PlatformSearch
from spsp_ctrl.discrepancy.platform_writing import platform_document, writable
from spsp_ctrl.discrepancy.result import Curve, Diagnosis, NamedEffect, Unexplained, Value
from spsp_ctrl.discrepancy.show import OPEN, gaps
from spsp_ctrl.discrepancy.statistics import rms
from spsp_ctrl.discrepancy.whitening import colour
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, A, G
from spsp_ctrl.plant.model import PlantModel, effect_keys, load_model

COMMISSIONED_SIGMA = 0.005
"""Tolerance of a number that a commissioning log has calibrated: what a machine may change by itself until the next log."""
HELD_PART = 0.4
"""Part of the time that is kept back where no log is given for it."""
EXPLAINED = 0.5
LATE_S = 4e-4
"""Least delay of the IMU frames beyond the model that gets a name."""
SAME_RAD, SAME_S = 2e-4, 0.1
"""Two logs show the same motion when the carrier moves alike to this, and the drives came on at the same time to that."""
PLATFORM = Machine(platform_regimes, lambda c: STAGES[c.split(".")[0]], lambda c: WHERE[c], UNITS)


@dataclass(frozen=True)
class PlatformTask:
    """What to diagnose."""

    model: PlantModel
    logs: tuple[PlatformRecord, ...]
    commissioning: tuple[PlatformRecord, ...]
    held_out: tuple[PlatformRecord, ...]
    seed: int
    last: str = "show"
    """Last stage to run."""
    jobs: int = 1


def label(record: PlatformRecord) -> str:
    """What a log is called in the answer: every run folder holds a ``run.mcap``."""
    return record.path.name if record.path.name != "run.mcap" else f"{record.path.absolute().parent.name}/{record.path.name}"


def _replay_of(path: Path) -> tuple[float, int, bool]:
    return replayed(load_platform(path))


def _gates(task: PlatformTask, model: PlantModel, tick: Callable[[str], None]) -> tuple[dict[str, Gate], dict[Path, PlatformReplica]]:
    """Every log judged; the replicas of those that may be used."""
    gates: dict[str, Gate] = {}
    replicas: dict[Path, PlatformReplica] = {}
    records = [*task.logs, *task.commissioning, *task.held_out]
    for record in records:
        gates[label(record)] = judge_values(record)
    if any(g.problems for g in gates.values()):
        return gates, replicas
    results: Sequence[tuple[float, int, bool]]
    if task.jobs > 1 and len(records) > 1:
        with ProcessPoolExecutor(task.jobs, mp_context=get_context("spawn")) as pool:
            results = list(pool.map(_replay_of, [r.path for r in records]))
    else:
        results = []
        for r in records:
            tick("gate")
            results.append(replayed(r))
    for record, gate, result in zip(records, gates.values(), results, strict=True):
        judge_law(gate, result)
        if gate.passed:
            replicas[record.path] = one = platform_replica(model, record)
            judge_attitude(gate, one, one.residuals(model.parameters()))
    return gates, replicas


def _bench(
    replicas: Sequence[PlatformReplica], floor: dict[str, float], parts: Sequence[np.ndarray] | None = None, baseline: tuple[Split, ...] = ()
) -> Bench:
    use = []
    for k, one in enumerate(replicas):
        use.append({c: np.ones(len(one.rows(c)), bool) if parts is None else parts[k][one.rows(c)] for c in one.channels})
    return Bench(cast("Any", tuple(replicas)), tuple(use), floor, baseline)


def same_motion(one: PlatformReplica, other: PlatformReplica) -> bool:
    """Whether two logs show the same motion of the carrier under the same orders, so that their residuals may be compared one by one."""
    a, b = one.record, other.record
    if a.rate_hz != b.rate_hz or a.scenario.reference != b.scenario.reference or a.scenario.load != b.scenario.load:
        return False
    shift = int(a.measured["cycle"][0]) - int(b.measured["cycle"][0])
    if abs(shift) > SAME_S * a.rate_hz or abs(len(a.measured) - len(b.measured)) > 2 * SAME_S * a.rate_hz:
        return False
    common, i, j = np.intersect1d(a.measured["cycle"], b.measured["cycle"], return_indices=True)
    apart = (rms(a.column(f"base.{c}_rad")[i] - b.column(f"base.{c}_rad")[j]) for c in ("pitch", "roll", "yaw"))
    return len(common) > 0 and max(apart) < SAME_RAD


def baselines(trained: Sequence[PlatformReplica], commissioned: Sequence[PlatformReplica], p: Array) -> tuple[Split, ...] | None:
    """For each training log what the model leaves of the commissioning log of the same motion, cycle by cycle; None unless each has such a log."""
    found = []
    for one in trained:
        other = next((c for c in commissioned if same_motion(one, c)), None)
        if other is None:
            return None
        left = other.residuals(p)
        zero, there = int(one.record.measured["cycle"][0]), int(other.record.measured["cycle"][0])
        found.append({c: np.interp(one.rows(c) + zero, other.rows(c) + there, left[c]) for c in left})
    return tuple(found)


def random_floor(p: Array, seconds: float) -> dict[str, float]:
    """Slow wander that the model states for the IMU, rms over a record: no commissioning log repeats it."""
    time = max(1e-9, float(p[G.imu_drift_time_s]))
    drift = float(p[G.imu_drift_rad]) * min(1.0, (seconds / time) ** 0.5)
    walk = float(p[G.imu_yaw_walk_rad_sqrt_s]) * (seconds / 2.0) ** 0.5
    return {"imu.pitch": drift, "imu.roll": drift, "imu.heading": walk}


def diagnose_platform(task: PlatformTask, new_model: Path, tick: Callable[[str], None] = lambda text: None) -> Diagnosis:
    """Run the stages. The new model file is written to ``new_model`` and read back for the last one."""
    model = task.model
    tick("gate")
    gates, replicas = _gates(task, model, tick)
    bad = next(((name, g) for name, g in gates.items() if not g.passed), None)
    if bad is not None:
        return Diagnosis("not-understood", f"{bad[0]}: {bad[1].problems[0]}", "weak", gates)
    logs, commissioning, held_out = ([replicas[r.path] for r in group] for group in (task.logs, task.commissioning, task.held_out))
    prints = {label(r): r.fingerprint() for r in (*task.logs, *task.commissioning, *task.held_out)}
    p = model.parameters()
    reference, sigma = p, NOMINAL_SIGMA
    quality: floors.Quality = "weak"
    base: tuple[Split, ...] | None = None
    rates = logs[0].rates()
    if commissioning:
        tick("floor")
        bench = _bench(commissioning, {})
        noise = {c: flat(r, rates[c]) for c, r in bench.residuals(p).items()}
        for _ in range(2):  # whitened by a guess, then by what that leaves
            left = bench.residuals(p)
            white = whitener(left, rates, noise, p, 1.0)
            one = PlatformSearch(bench, bench, white, white, lambda p, z: [], names.nominal_variables(p, reference, sigma), task.jobs, tick)
            p = one.fit(p, one.nominal, 1, last=False).p
            tick("floor")
            left = bench.residuals(p)
            noise = {c: spectrum(r, rates[c]) for c, r in left.items()}
        floor, quality = floors.from_commissioning(left), "measured"
        reference = p
        sigma = COMMISSIONED_SIGMA
        base = baselines(logs, commissioning, p)
    else:
        left = _bench(logs, {}).residuals(p)
        noise = {c: flat(r, rates[c]) for c, r in left.items()}
        floor = floors.guessed(left)
    random = random_floor(p, max(r.seconds for r in task.logs))
    floor = {c: float(np.hypot(v, random.get(c, 0.0))) for c, v in floor.items()}
    calibrated = base is not None
    copies = 2.0 if calibrated else 1.0
    if held_out:
        train, held = _bench(logs, floor, None, base or ()), _bench(held_out, floor)
    else:
        parts = [np.arange(len(one.inputs)) < (1.0 - HELD_PART) * len(one.inputs) for one in logs]
        train, held = _bench(logs, floor, parts, base or ()), _bench(logs, floor, [~a for a in parts], base or ())
    if calibrated:
        train = replace(train, floor={c: 2.0**0.5 * v for c, v in floor.items()})
    search = PlatformSearch(
        train, held, whitener(train.residuals(p), rates, noise, p, copies), whitener(held.residuals(p), rates, noise, p, 1.0 if held_out else copies),
        lambda q, z: library(train, q, calibrated), () if calibrated else names.nominal_variables(p, reference, sigma), task.jobs, tick,
    )  # fmt: skip
    first_p = p
    tick("find")
    start = train.residuals(first_p)
    found = find(train, start, task.seed, PLATFORM)
    answer = Diagnosis("nothing-missing", "", quality, gates, found=found, fingerprints=prints)
    answer.not_excited = not_excited(logs, p)
    if task.last == "find":
        answer.verdict = "unexplained" if found else "nothing-missing"
        answer.reason = "only `find` was asked for"
        return answer
    first, state, named = search.run(p)
    answer.screening = search.trace
    answer.effects = [named_effect(n, state) for n in named]
    late = imu_delay(logs, commissioning, p)
    if late is not None:
        answer.effects.append(late)
        state.p[G.imu_added_delay_s] = next(iter(late.parameters.values())).value
    if task.last != "name":
        tick("add")
        source = "I: identified from " + ", ".join(f"{k} ({v})" for k, v in prints.items())
        raw = platform_document(model, writable(state.p), spread_of(state), source)
        new_model.write_text(text(raw, notes(named, prints, task)), encoding="utf-8")
        answer.model = new_model.name
    before = held.residuals(first.p)
    after = held.residuals(load_model(new_model).parameters() if task.last == "show" else state.p)
    answer.gap = gaps(before, after, floor, task.seed, UNITS)
    answer.curves = _curves(held, before, after)
    conclude(answer, train, search, first, state, task.seed)
    return answer


def spread_of(fit: Fit) -> dict[int, float]:
    """Standard deviation of each parameter that was fitted; of amplitude and phase from their cosine and sine."""
    return deviations(cast("Any", fit))


def imu_delay(logs: Sequence[PlatformReplica], commissioning: Sequence[PlatformReplica], p: Array) -> NamedEffect | None:
    """Frames that arrive later after their stamps than the model says: read off, since the log holds both times."""
    late = np.concatenate([one.measured["latency"] for one in logs])
    known = np.concatenate([one.measured["latency"] for one in commissioning]) if commissioning else np.array([p[G.imu_delay_s]])
    extra = float(np.median(late) - np.median(known))
    spread = max(float(np.std(late)), float(np.std(known)), 1e-5)
    if extra < max(LATE_S, 3.0 * spread):
        return None
    sigma = spread / len(late) ** 0.5
    return NamedEffect(
        "imu_delay", "imu", "sensors", {"imu_added_delay": Value(extra, "s", sigma)}, (("imu_delay", 1.0),), 0.5 * (extra / spread) ** 2,
        "arrival of IMU frames", None, ("from the stamps of the log: arrival after measurement",), False,
    )  # fmt: skip


def library(train: Bench, p: Array, calibrated: bool) -> list[Candidate]:
    """Every name at every place, with what the records reach and the orders that stand out in what is left."""
    one, left = cast("Any", train.replicas[0]), train.residuals(p)
    reach, orders = [], []
    for k, axis in enumerate(AXES):
        motor = one.targets[:, 2 * k + 1]
        reach.append(names.reaches(p, k, one.measured[f"current_{axis}"], motor))
        orders.append(best_orders(one, train.use[0], left, axis))
    return names.candidates(p, reach, orders, calibrated)


def best_orders(one: PlatformReplica, use: dict[str, Array], residuals: Split, axis: str, count: int = 3) -> tuple[float, ...]:
    """Orders of the motor turn with the strongest lines in what is left of a leg's motor angle."""
    channel = f"resolver.{axis}"
    kept = use[channel]
    values = residuals[channel][: int(kept.sum())]
    values = colour(values).apply(values)
    motor = one.measured[f"motor_{axis}"][one.rows(channel)[kept]]
    grid = np.unique(np.concatenate([np.arange(0.1, 4.0, 0.02), np.arange(4.0, 26.0, 0.05), np.arange(1, 49) * 1.0, np.arange(1, 49) / 3.0]))
    every = max(1, len(values) // 6000)
    lines = order_lines(values[::every], motor[::every], grid)
    chosen: list[float] = []
    for k in np.argsort(-lines):
        if grid[k] > 0.25 and all(abs(grid[k] - c) > 0.15 for c in chosen):
            chosen.append(float(grid[k]))
        if len(chosen) == count:
            break
    return tuple(chosen)


def named_effect(named: Name, fitted: Fit) -> NamedEffect:
    """A name as it stands in the answer."""
    spread = spread_of(fitted)
    c = named.candidate
    name, where = names.split(c.name)
    view = names.View(AXES.index(where) if where in AXES else -1)
    keys = {q.name: (short, q) for short, q in effect_keys(c.effect).items()}
    values = {}
    for f in c.hypothesis.free:
        short, q = keys[f.name]
        i = view.index(f.name)
        values[short] = Value(float(fitted.p[i]), q.unit, spread.get(i))
    weights = {c.name: 1.0} | {n: float(np.exp(0.5 * max(d, -40.0))) for n, d in named.rivals.items()}
    total = sum(weights.values())
    members = tuple(sorted(((_told(n, where), w / total) for n, w in weights.items()), key=lambda m: -m[1]))
    return NamedEffect(
        name, where, c.effect.stage, values, members, named.evidence, named.channel, None if named.closed is None else min(1.0, named.closed),
        tuple(named.remarks), c.hypothesis.sentinel,
    )  # fmt: skip


def _told(name: str, where: str) -> str:
    """A name of a class: with its place where that is another one."""
    head, place = names.split(name)
    return head if place == where else name


def notes(named: Sequence[Name], prints: dict[str, str], task: PlatformTask) -> list[str]:
    """What is said on top of the model file."""
    lines = ["written by spsp-ctrl diagnose; data: " + ", ".join(f"{k} {v}" for k, v in prints.items())]
    for n in named:
        rivals = ", ".join(f"{k} ({v:+.1f})" for k, v in n.rivals.items()) or "none"
        lines.append(f"{n.candidate.name}: evidence {n.evidence:.1f}, channel {n.channel}, rivals {rivals}")
    base = {c: np.concatenate([r.column(f"base.{c}_rad") for r in task.logs]) for c in ("pitch", "roll", "yaw")}
    warm = np.concatenate([r.column("temperature.screw_pitch_c") for r in task.logs])
    ranges = ", ".join(f"{c} {np.degrees(v.min()):.1f} to {np.degrees(v.max()):.1f} deg" for c, v in base.items())
    lines.append(f"valid for a carrier that moves in {ranges}; screws {warm.min():.1f} to {warm.max():.1f} degC")
    return lines


def not_excited(logs: Sequence[PlatformReplica], p: Array) -> list[str]:
    """What these logs say nothing about, whatever the answer."""
    out = []
    for k, axis in enumerate(AXES):
        limit = float(p[k * N_AXIS_PARAMETERS + A.current_limit_a])
        top = max(float(np.max(np.abs(one.measured[f"command_{axis}"]))) for one in logs)
        if top < 0.9 * limit:
            out.append(f"{axis}: no command above {top:.3g} of {limit:.3g} A: current saturation untested")
        way = max(float(np.ptp(one.measured[f"motor_{axis}"])) for one in logs) / float(p[k * N_AXIS_PARAMETERS + A.gear_ratio])
        if way < 4.0 * np.pi:
            out.append(f"{axis}: the screw made less than two turns: errors of lead, friction and backlash are weakly seen")
    steps = max(float(np.ptp(one.targets[:, 4])) for one in logs) / float(p[G.az_gear_ratio])
    if steps < 0.02:
        out.append("the azimuth hardly turned: its play and friction are weakly seen")
    warm = [np.concatenate([one.targets[:, 5 + k] for one in logs]) for k in range(2)]
    if max(float(np.ptp(w)) for w in warm) < 3.0:
        out.append("the temperature hardly changed: thermal expansion cannot be told from a zero offset")
    if len({one.record.scenario.load.mass_kg for one in logs}) < 2:
        out.append("the load never changed: motor constant and friction under load are weakly seen")
    return out


def _curves(held: Bench, before: Split, after: Split) -> list[Curve]:
    out = []
    for channel in before:
        pieces = zip(held.replicas, held.use, strict=True)
        t = np.concatenate([one.rows(channel)[use[channel]] / one.record.rate_hz for one, use in pieces])
        if len(held.replicas) > 1:
            t = np.arange(len(before[channel])) * (t[1] - t[0])
        out.append(Curve(channel, UNITS[channel], t, before[channel], after[channel]))
    return out


def conclude(answer: Diagnosis, train: Bench, search: PlatformSearch, first: Fit, state: Fit, seed: int) -> None:
    """The verdict: from what training has left above the noise, channel by channel."""
    if any(e.sentinel for e in answer.effects):
        answer.verdict, answer.reason = "invalid", "an effect that cannot exist was named: the data or the model break an assumption of this program"
        return
    start, end = search.excess(first.z), search.excess(state.z)
    residuals = train.residuals(state.p)
    left = [c for c in end if end[c] > OPEN**2 - 1.0]
    remains = {f.channel: f for f in find(train, residuals, seed, PLATFORM) if f.regime != "everywhere"}
    for c in left:
        regime = remains[c].regime if c in remains else "everywhere"
        answer.unexplained.append(Unexplained(c, regime, robust_rms(residuals[c]), UNITS[c]))
    poor = [c for c in left if (start[c] - end[c]) < EXPLAINED * start[c]]
    if not answer.effects:
        answer.verdict = "unexplained" if left else "nothing-missing"
        answer.reason = "no name of the library closes the gap" if left else "every channel is at its floor after recalibration"
    elif poor:
        answer.verdict, answer.reason = "partly-explained", "names were found, but in " + ", ".join(poor) + " more is left than they explain"
    elif left:
        answer.verdict, answer.reason = "partly-explained", "names explain most of it; " + ", ".join(left) + " is still above its floor"
    else:
        answer.verdict, answer.reason = "explained", "every channel is at its floor with the named effects"
