"""One case: what is hidden in which machine, drawn by a seed; its logs; whether the truth alone says that it can be seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tools.blind_exam import catalogue, machine, motions, sensing
from tools.blind_exam.catalogue import LIBRARY, OUTSIDE, SEVERITIES, Hidden, Kind
from tools.blind_exam.motions import Motion
from tools.blind_exam.physics import NAMES, STEPS, Array, I, Law, run

SETS = ("single", "multiple", "nothing", "outside", "twins", "poor")
DETECTABLE = 1.5
"""Times its floor that a logged channel must move on held-out motion when the effect is taken away."""
CHANNELS = {"command_a": 0, "current_a": 1, "resolver": 2, "load_m": 3, "screw_c": 7}
_EASY = [s for s in SEVERITIES if s >= 0.3]


class Item(NamedTuple):
    """One hidden thing of a case."""

    name: str
    severity: float
    seed: int

    @property
    def kind(self) -> Kind:
        return LIBRARY.get(self.name) or OUTSIDE[self.name]


class Case(NamedTuple):
    """Everything that decides the logs of a case."""

    name: str
    group: str
    seed: int
    items: tuple[Item, ...]
    climate: sensing.Climate
    training: str
    controller: str
    resolver: bool
    held_out: str = "held_out"


class Record(NamedTuple):
    """A simulated log before it is written."""

    motion: Motion
    rows: Array
    law: Law
    lost: Array
    """1 for the cycles that the log does not have."""
    when: Array
    """When each cycle was sampled, as a share of the period after its nominal time."""


def _picks(group: str, seed: int, index: int, rng: np.random.Generator) -> list[tuple[str, float]]:
    names = list(LIBRARY)
    if group == "single":
        # every effect x severity once per round, in an order that the seed shuffles: a short exam is a fair sample of the whole
        grid = [(name, severity) for name in names for severity in SEVERITIES]
        order = np.random.default_rng([seed, 11, index // len(grid)]).permutation(len(grid))
        return [grid[order[index % len(grid)]]]
    if group == "multiple":
        many = 2 + index % 3
        return [(str(name), float(rng.choice(_EASY))) for name in rng.choice(names, size=many, replace=False)]
    if group == "outside":
        kinds = list(OUTSIDE)
        order = np.random.default_rng([seed, 12, index // len(kinds)]).permutation(len(kinds))
        return [(kinds[order[index % len(kinds)]], float(rng.choice(_EASY)))]
    if group == "twins":
        pair = catalogue.LOOK_ALIKE[index % len(catalogue.LOOK_ALIKE)]
        return [(pair.names[int(rng.integers(2))], float(rng.choice(pair.severities)))]
    if group == "poor":
        return [(str(rng.choice(names)), float(rng.choice(_EASY)))]
    return []


def draw(group: str, seed: int, index: int) -> Case:
    """Case ``index`` of a set: the same seed gives the same case."""
    rng = np.random.default_rng([seed, 10, SETS.index(group), index])
    items = tuple(Item(name, severity, int(rng.integers(1 << 31))) for name, severity in _picks(group, seed, index, rng))
    climate = sensing.Climate()
    if group == "nothing":
        climate = (
            sensing.Climate(),
            sensing.Climate(colour=0.7),
            sensing.Climate(outliers=0.003),
            sensing.Climate(gain=1.5),
            sensing.Climate(colour=0.9, outliers=0.002),
            sensing.Climate(lost=0.004, held=0.01),
            sensing.Climate(jitter=0.03),
            sensing.Climate(colour=0.5, lost=0.002, jitter=0.02),
        )[index % 8]
    elif rng.random() < 0.3:
        climate = sensing.Climate(colour=float(rng.uniform(0.3, 0.8)))
    controller = "recorded" if rng.random() < 0.25 else "cascade"
    return Case(
        f"{group}-{seed}-{index:04d}",
        group,
        int(rng.integers(1 << 31)),
        items,
        climate,
        {"poor": "poor", "twins": "plain"}.get(group, "training"),
        controller,
        bool(rng.random() < 0.75),
        "plain_held_out" if group == "twins" else "held_out",
    )


def build(case: Case, nominal: Array, without: int | None = None, clean: bool = False) -> tuple[Array, list[Hidden]]:
    """The machine of a case: as it is, without one of the hidden things, or ``clean`` of all of them."""
    p = machine.jittered(nominal, np.random.default_rng([case.seed, 1]))
    hidden = []
    for i, item in enumerate(case.items):
        if not clean and i != without:
            values = item.kind.apply(p, item.severity, np.random.default_rng([item.seed, 2]))
            hidden.append(Hidden(item.name, item.kind.stage, values))
    return p, hidden


def simulate(case: Case, p: Array, nominal: Array, kind: str, noise_seed: int) -> Record:
    """Drive the machine through one kind of motion."""
    return drive(case, p, motions.KINDS[kind](case.seed), machine.cascade(nominal, resolver=case.resolver), noise_seed)


def drive(case: Case, p: Array, motion: Motion, law: Law, noise_seed: int) -> Record:
    """Drive the machine through a motion under a law."""
    cycles = len(motion.inputs.reference_m)
    noise = sensing.draw(cycles, case.climate, np.random.default_rng([case.seed, noise_seed]))
    if case.climate.held > 0.0:
        p = p.copy()
        p[I.dropout] = max(p[I.dropout], case.climate.held)
    rows = run(p, np.array(law), True, np.zeros(1), np.column_stack(motion.inputs), noise, float(motion.inputs.reference_m[0]), STEPS)
    gone = sensing.lost(cycles, case.climate, np.random.default_rng([case.seed, noise_seed, 7]))
    return Record(motion, rows, law, gone, noise[:, 6])


def visibility(case: Case, nominal: Array) -> list[dict[str, float]]:
    """For every hidden thing: by how many floors each channel moves on held-out motion when it alone is taken away.

    The floor of a channel is what the machine without it does again on the same motion with other noise: rms of the difference of two runs, per run.
    """
    kind = case.held_out
    with_it = simulate(case, build(case, nominal)[0], nominal, kind, 31).rows
    shown = []
    for i in range(len(case.items)):
        machine_without, _ = build(case, nominal, without=i)
        without, again = (simulate(case, machine_without, nominal, kind, seed).rows for seed in (31, 32))
        ratio = {}
        for name, c in CHANNELS.items():
            floor = float(np.sqrt(np.mean((without[:, c] - again[:, c]) ** 2) / 2.0))
            ratio[name] = float(np.sqrt(np.mean((with_it[:, c] - without[:, c]) ** 2))) / floor if floor > 0 else 0.0
        shown.append(ratio)
    return shown


def recalibration(case: Case, nominal: Array, index: int) -> bool:
    """Whether the hidden thing leaves every number within the tolerance of the drawing, so that it may honestly pass for calibration."""
    p, q = build(case, nominal)[0], build(case, nominal, without=index)[0]
    changed = [i for i in range(len(p)) if p[i] != q[i]]
    tolerance = 1.25 * machine.JITTER
    if changed == [I.extra_compliance]:  # in series with a stiffness that has its tolerance
        return bool(p[I.extra_compliance] * nominal[I.stiffness] <= tolerance)
    return all(NAMES[i] in machine.JITTERED and abs(p[i] - nominal[i]) <= tolerance * abs(nominal[i]) for i in changed)
