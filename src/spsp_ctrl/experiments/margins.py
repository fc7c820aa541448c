"""Margins of the loops that a variant closes, from the plant model: one row per loop and axis, gain sets that variants share computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from spsp_ctrl.control.params import LawParams, law_ladder
from spsp_ctrl.experiments.cases import Case
from spsp_ctrl.plant.model import ModelFile, PlantModel
from spsp_ctrl.tuning.loops import AxisLoops, UnstableLoopError
from spsp_ctrl.tuning.plant_model import Axis, axis_plant

AXES: tuple[Axis, ...] = ("pitch", "roll")


@dataclass(frozen=True, slots=True)
class MarginRow:
    """One loop: broken where, of which axis, of which variant. None when the loop is not stable."""

    variant: str
    axis: str
    at: str
    margins: dict[str, float | None] | None


def margin_rows(cases: Sequence[Case]) -> list[MarginRow]:
    """For the first case of each variant and law."""
    seen: dict[tuple[LawParams, str, str], list[tuple[str, dict[str, float | None] | None]]] = {}
    rows, done = [], set()
    for case in cases:
        if (case.variant, case.law) in done:
            continue
        done.add((case.variant, case.law))
        law = law_ladder(case.config)[0]
        for axis in AXES:
            key = (law, case.model_text, axis)
            if key not in seen:
                seen[key] = _loops(law, PlantModel(ModelFile.model_validate(yaml.safe_load(case.model_text)), Path("model.yaml")), axis)
            rows += [MarginRow(case.variant, axis, at, found) for at, found in seen[key]]
    return rows


def _loops(law: LawParams, model: PlantModel, axis: Axis) -> list[tuple[str, dict[str, float | None] | None]]:
    loops = AxisLoops(law, axis_plant(model, axis), axis, "inertial", law.feedforward)
    try:
        found = loops.all_margins()
    except UnstableLoopError:
        return [(at, None) for at in loops.breaks()]
    return [(at, found[at].as_dict()) for at in loops.breaks()]
