"""What a diagnosis shows beside its names: the gap name by name, the map of regimes, the shape of what is left, the next motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from spsp_ctrl.discrepancy.fitting import Bench, Fitted, Split
from spsp_ctrl.discrepancy.naming import Named, Search, State, taken_out
from spsp_ctrl.discrepancy.next_experiment import plan
from spsp_ctrl.discrepancy.records import Record
from spsp_ctrl.discrepancy.result import Correlation, Diagnosis, Refused, RegimeCell, Step
from spsp_ctrl.discrepancy.statistics import rms
from spsp_ctrl.discrepancy.unknown import regime_sizes, sketch
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis_model import AxisModel

TIED = 0.5
"""A number that was only recalibrated is listed when it hangs together with a named one by this much."""


def close(
    answer: Diagnosis,
    model: AxisModel,
    search: Search,
    first: State,
    state: State,
    after: Split,
    floor: dict[str, float],
    records: Sequence[Record],
    refused: Sequence[Named] = (),
    tick: Callable[[str], None] = lambda text: None,
) -> None:
    """Fill in what the page, the screen and ``next.yaml`` are made of. ``after``: held-out residuals of the file read back."""
    answer.refused = [Refused(n.candidate.name, n.channel, n.evidence) for n in refused]
    answer.waterfall = waterfall(search.held, first, state, after, floor)
    answer.regimes = regime_map(search.held, first.held, after, floor)
    answer.correlation = correlation(state.fitted, state.named)
    left = {u.channel for u in answer.unexplained}
    answer.sketches = [s for c in left if (s := sketch(search.train, state.fitted.residuals, c)) is not None]
    answer.sketches.sort(key=lambda s: list(state.fitted.residuals).index(s.channel))
    if state.named:
        answer.plan = plan(model, search, first, state, floor, records, tick)
        if answer.plan is not None and answer.plan.scenario is not None:
            answer.next_experiment = "next.yaml"


def waterfall(held: Bench, first: State, state: State, after: Split, floor: dict[str, float]) -> list[Step]:
    """Held-out residual over floor, by channel: recalibrated only, then with each name put in, in the order of naming.

    The numbers that were recalibrated with the names move together with the first one; the last step is the file read back.
    """
    steps = [Step("recalibrated model", _over(first.held, floor))]
    for k, named in enumerate(state.named):
        later = state.named[k + 1 :]
        p = state.p
        for n in later:
            p = taken_out(p, first.p, n, state.named[: k + 1])
        steps.append(Step(named.candidate.name, _over(held.residuals(p) if later else after, floor)))
    return steps


def _over(residuals: Split, floor: dict[str, float]) -> dict[str, float]:
    return {c: rms(r) / floor[c] for c, r in residuals.items() if floor.get(c, 0.0) > 0.0}


def regime_map(held: Bench, before: Split, after: Split, floor: dict[str, float]) -> list[RegimeCell]:
    """Held-out residual over floor in each regime, before and after."""
    a, b = regime_sizes(held, before), regime_sizes(held, after)
    return [RegimeCell(c, r, a[c][r] / floor[c], b[c][r] / floor[c]) for c in a if floor.get(c, 0.0) > 0.0 for r in a[c] if r in b[c]]


def correlation(fitted: Fitted, named: Sequence[Named]) -> Correlation | None:
    """Correlation of the fitted numbers: every one of a name, and what hangs together with one."""
    if not named or not len(fitted.variables):
        return None
    spread = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        matrix = np.nan_to_num(fitted.covariance / np.outer(spread, spread))
    own = {v.name for n in named for v in n.candidate.variables}
    mine = [k for k, v in enumerate(fitted.variables) if v.name in own]
    if not mine:
        return None
    tied = [k for k, v in enumerate(fitted.variables) if v.name not in own and np.max(np.abs(matrix[k, mine])) >= TIED]
    keep = [*mine, *tied]
    block: Array = np.clip(matrix[np.ix_(keep, keep)], -1.0, 1.0)
    return Correlation(tuple(fitted.variables[k].name for k in keep), block)
