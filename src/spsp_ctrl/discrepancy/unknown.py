"""What no name explains: a name that closes too little is refused, and what is left is drawn over the variable that orders it best."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from spsp_ctrl.discrepancy.fitting import Bench, Split, fit, robust_rms
from spsp_ctrl.discrepancy.naming import Named, Search, State, taken_out
from spsp_ctrl.discrepancy.replica import UNITS, Replica, smooth
from spsp_ctrl.discrepancy.show import OPEN
from spsp_ctrl.discrepancy.statistics import correlation_length, rms
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import A

REFUSED = 0.5
"""A name is refused when its channel, with all names in place, lost less than this share of its excess."""
BINS = 32
CONTRAST = 0.05
"""Share of the variance that the order must explain for the mean to be drawn; else the size is drawn."""


@dataclass(frozen=True, slots=True)
class Sketch:
    """The shape of what is left in one channel."""

    channel: str
    unit: str
    over: str
    over_unit: str
    kind: str
    """``mean``: mean residual in each bin; ``rms``: its size, where no variable orders its sign."""
    explained: float
    """Share of the variance that these bins explain."""
    curves: tuple[tuple[str, Array, Array, Array], ...]
    """Name, place, value, standard error; one curve, or one for each direction of travel."""

    @property
    def peak(self) -> tuple[str, float, float, float]:
        """Curve, place, value and standard error where it is largest."""
        name, x, y, e = max(self.curves, key=lambda c: float(np.max(np.abs(c[2]))) if len(c[2]) else 0.0)
        k = int(np.argmax(np.abs(y)))
        return name, float(x[k]), float(y[k]), float(e[k])

    @property
    def sides(self) -> str:
        """How the two directions of travel compare; empty for one curve."""
        return "" if len(self.curves) == 1 else _sides(self.curves)


def _sides(curves: tuple[tuple[str, Array, Array, Array], ...]) -> str:
    (_, xa, a, _), (_, xb, b, _) = curves[0], curves[1]
    other = np.interp(xa, xb, b)
    top = float(np.linalg.norm(a) * np.linalg.norm(other))
    likeness = float(a @ other) / top if top > 0.0 else 0.0
    return "the same both ways" if likeness > 0.5 else "its sign follows the direction" if likeness < -0.5 else "other in each direction"


def refuse(search: Search, first: State, state: State, single: dict[str, float]) -> tuple[State, list[Named]]:
    """The state without the names whose channel stays mostly unexplained, and those names. ``single`` is the floor of one record.

    Where training is a difference of two records, what is left of it below the floor of one is nothing that a name must answer for.
    """
    start, end = first.fitted.residuals, state.fitted.residuals
    floor = {c: max(search.train.floor.get(c, 0.0), single.get(c, 0.0)) for c in start}
    poor = set()
    for c in start:
        level = floor.get(c, 0.0)
        before, after = robust_rms(start[c]), robust_rms(end[c])
        if before > OPEN * level and after > OPEN * level and (before - after) < REFUSED * (before - level):
            poor.add(c)
    out = [n for n in state.named if n.channel in poor and not n.candidate.hypothesis.sentinel]
    if not out:
        return state, []
    rest = [n for n in state.named if n not in out]
    p = state.p
    for n in out:
        p = taken_out(p, first.p, n, rest)
    fitted = fit(search.train, p, search.variables(p, rest), steps=3)
    return State(fitted.p, fitted, search.held.residuals(fitted.p), rest), out


def sketch(bench: Bench, residuals: Split, channel: str) -> Sketch | None:
    """The residual of a channel over the variable that explains most of it, by direction where that says more."""
    values = residuals[channel]
    parts: dict[str, list[Array]] = {}
    units: dict[str, str] = {}
    ways: list[Array] = []
    for one, use in zip(bench.replicas, bench.use, strict=True):
        rows = one.rows(channel)[use[channel]]
        for name, unit, x in variables(one):
            parts.setdefault(name, []).append(x[rows])
            units[name] = unit
        ways.append(direction(one)[rows])
    way = np.concatenate(ways)
    length = correlation_length(values)
    best: tuple[float, Sketch] | None = None
    for size in (False, True):
        shown = np.abs(values) if size else values
        for name, pieces in parts.items():
            if len(pieces) < len(bench.replicas):
                continue
            x = np.concatenate(pieces)
            if np.ptp(x) <= 0.0:
                continue
            for split in (False, True):
                made = _binned(channel, name, units[name], x, shown, way if split else None, length, "rms" if size else "mean")
                if made is not None:
                    price = 1.0 if not split else 0.8  # a second curve must say more
                    worth = made.explained * price * (0.3 if size else 1.0)
                    if best is None or worth > best[0]:
                        best = worth, made
        if best is not None and best[1].explained >= CONTRAST:
            break
    return None if best is None else best[1]


def _binned(channel: str, name: str, unit: str, x: Array, y: Array, way: Array | None, length: float, kind: str) -> Sketch | None:
    masks = [("all", np.ones(len(x), bool))] if way is None else [("forward", way > 0), ("backward", way < 0)]
    curves, left, used = [], y - (y.mean() if kind == "rms" else 0.0), 0
    fitted = np.full(len(y), float(y.mean()) if kind == "rms" else 0.0)
    for label, mask in masks:
        if mask.sum() < 4 * BINS:
            return None
        # where the samples are, and evenly: a rest must not leave one wide bin for all the rest
        dense, even = np.quantile(x[mask], np.linspace(0.0, 1.0, BINS // 2 + 1)), np.linspace(x[mask].min(), x[mask].max(), BINS // 2 + 1)
        edges = np.unique(np.concatenate([dense, even]))
        if len(edges) < 3:
            return None
        place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
        xs, ys, es = [], [], []
        for k in range(len(edges) - 1):
            here = mask & (place == k)
            n = int(here.sum())
            if n < 4:
                continue
            mean = float(y[here].mean())
            fitted[here] = mean
            xs.append(float(x[here].mean()))
            ys.append(mean)
            es.append(float(y[here].std()) / max(1.0, n / length) ** 0.5)
            used += 1
        curves.append((label, np.array(xs), np.array(ys), np.array(es)))
    power = float(left @ left)
    share = 1.0 - float(np.sum((y - fitted) ** 2)) / power if power > 0.0 else 0.0
    # adjusted for the number of bins among the independent samples
    free = len(y) / length
    share = 1.0 - (1.0 - share) * (free - 1.0) / (free - used - 1.0) if free > 2.0 * used else 0.5 * share
    return Sketch(channel, UNITS[channel], name, unit, kind, max(0.0, share), tuple(curves))


def direction(one: Replica) -> Array:
    """+1, -1, 0 by the travel."""
    speed = _speed(one)
    return np.where(np.abs(speed) > 0.02 * max(float(np.max(np.abs(speed))), 1e-12), np.sign(speed), 0.0)


def _travel(one: Replica) -> Array:
    motor = one.measured["motor"]
    return motor * one.travel_per_rad if np.ptp(motor) > 0 else one.measured["load"]


def _speed(one: Replica) -> Array:
    return np.asarray(np.gradient(smooth(_travel(one), max(1, round(0.01 * one.record.rate_hz)))) * one.record.rate_hz)


def variables(one: Replica) -> Iterator[tuple[str, str, Array]]:
    """What a residual may depend on: name, unit, value at every cycle of the record."""
    rate, rows, p = one.record.rate_hz, one.record.rows, one.model.parameters()
    travel, speed, way = _travel(one), _speed(one), direction(one)
    yield "position", "mm", one.measured["load"] * 1e3
    yield "speed", "mm/s", speed * 1e3
    if np.ptp(one.measured["motor"]) > 0:
        turn = one.measured["motor"] / (2.0 * np.pi)
        yield "motor phase", "turn", turn % 1.0
        if p[A.gear_ratio] != 1.0:
            yield "screw phase", "turn", turn / p[A.gear_ratio] % 1.0
    since, passed = np.zeros(len(travel)), np.zeros(len(travel))
    last, place, sign = 0, float(travel[0]), 0.0
    for k, w in enumerate(way.tolist()):
        if w != 0.0 and w != sign:
            last, place, sign = k, float(travel[k]), w
        since[k], passed[k] = k - last, abs(float(travel[k]) - place)
    yield "time since reversal", "s", np.minimum(since / rate, 2.0)
    yield "travel since reversal", "mm", passed * 1e3
    acceleration = np.gradient(smooth(speed, max(1, round(0.01 * rate)))) * rate
    yield "acceleration", "mm/s²", np.asarray(acceleration) * 1e3
    yield "command", "A", np.asarray(rows["command_a"], np.float64)
    for name, unit, key in (("load", "N", "load_force_n"), ("added mass", "kg", "load_mass_kg"), ("screw temperature", "degC", "screw_c")):
        yield name, unit, np.asarray(rows[key], np.float64)
    yield "time", "s", np.arange(len(travel)) / rate


def regime_sizes(bench: Bench, residuals: Split) -> dict[str, dict[str, float]]:
    """rms of each channel in each regime."""
    from spsp_ctrl.discrepancy.masks import regimes

    out: dict[str, dict[str, float]] = {}
    for channel, values in residuals.items():
        masks: dict[str, list[np.ndarray]] = {}
        for one, use in zip(bench.replicas, bench.use, strict=True):
            rows = one.rows(channel)[use[channel]]
            for name, mask in regimes(one).items():
                masks.setdefault(name, []).append(mask[rows])
        out[channel] = {"everywhere": rms(values)}
        for name, pieces in masks.items():
            mask = np.concatenate(pieces)
            if len(mask) == len(values) and mask.sum() >= 20:
                out[channel][name] = rms(values[mask])
    return out
