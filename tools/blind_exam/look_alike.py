"""How far two names can be parted, by the truth alone: the twin is sized to stand for what is hidden, and what still differs is counted in floors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tools.blind_exam import machine
from tools.blind_exam.case import CHANNELS, Case, build, drive, simulate
from tools.blind_exam.catalogue import SIZES, look_alike_of
from tools.blind_exam.motions import KINDS, Motion
from tools.blind_exam.physics import Array, I, Law

COLUMNS = [CHANNELS[name] for name in ("command_a", "current_a", "resolver", "load_m")]
ROUNDS = 7


class Likeness(NamedTuple):
    """The twin of a case, sized."""

    name: str
    p: Array
    """The machine without what is hidden, with the twin instead."""
    apart: float
    """Floors by which it can still be told, in the channel that tells most, on training or held-out motion."""


def likeness(case: Case, nominal: Array) -> Likeness | None:
    """None where what is hidden has no look-alike."""
    if len(case.items) != 1 or (twin := look_alike_of(case.items[0].name)) is None:
        return None
    truth, clean = build(case, nominal)[0], build(case, nominal, clean=True)[0]
    wanted, level = _rows(case, truth, nominal, case.training), _floor(case, clean, nominal, case.training)

    def missed(size: float) -> float:
        return float(np.max(np.sqrt(np.mean((_rows(case, sized(clean, twin, size), nominal, case.training) - wanted) ** 2, axis=0)) / level))

    size = _least(missed, SIZES[twin][1] * case.items[0].severity)
    p = sized(clean, twin, size)
    apart = max(missed(size), parted(case, truth, p, KINDS[case.held_out](case.seed), machine.cascade(nominal, resolver=case.resolver), clean))
    return Likeness(twin, p, apart)


def sized(clean: Array, name: str, size: float) -> Array:
    """The clean machine with so much of an effect."""
    p = clean.copy()
    for field in SIZES[name][0]:
        p[getattr(I, field)] += size
    return p


def parted(case: Case, truth: Array, other: Array, motion: Motion, law: Law, clean: Array) -> float:
    """Floors between two machines on a motion, in the channel that tells most; the zeros of resolver and ruler belong to the session."""
    a, b, c, d = (drive(case, p, motion, law, seed).rows[:, COLUMNS] for p, seed in ((truth, 41), (other, 41), (clean, 41), (clean, 42)))
    level = np.sqrt(np.mean((c - d) ** 2, axis=0) / 2.0)
    return float(np.max(np.sqrt(np.mean((a - b) ** 2, axis=0)) / level))


def _rows(case: Case, p: Array, nominal: Array, kind: str) -> Array:
    return np.asarray(simulate(case, p, nominal, kind, 21).rows[:, COLUMNS])


def _floor(case: Case, p: Array, nominal: Array, kind: str) -> Array:
    again = np.asarray(simulate(case, p, nominal, kind, 22).rows[:, COLUMNS])
    return np.asarray(np.sqrt(np.mean((_rows(case, p, nominal, kind) - again) ** 2, axis=0) / 2.0))


def _least(missed, moderate: float) -> float:  # type: ignore[no-untyped-def]
    """Size at which least is missed: a coarse look at both signs, then golden section between the neighbours of the best."""
    grid = [moderate * f for f in (-3.0, -2.0, -1.4, -1.0, -0.7, -0.4, -0.1, 0.1, 0.4, 0.7, 1.0, 1.4, 2.0, 3.0)]
    found = [missed(size) if size > 0.0 or moderate > 0.0 else np.inf for size in grid]
    k = int(np.argmin(found))
    low, high = grid[max(0, k - 1)], grid[min(len(grid) - 1, k + 1)]
    golden = 0.618034
    a, b = high - golden * (high - low), low + golden * (high - low)
    fa, fb = missed(a), missed(b)
    for _ in range(ROUNDS):
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - golden * (high - low)
            fa = missed(a)
        else:
            low, a, fa = a, b, fb
            b = low + golden * (high - low)
            fb = missed(b)
    return a if fa < fb else b
