"""From an experiment to its runs: variant by law by repeat, each a checked rig, scenario and model of its own."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from spsp_ctrl.config.loader import ConfigError, ConfigProblem, Loaded, Location, dump_resolved, validate_data
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import ModelChange, Scenario
from spsp_ctrl.experiments.variation import VariationError, vary
from spsp_ctrl.plant.model import PlantModel

PHASE_STEP_DEG = {"pitch": 222.5, "roll": 137.5}
"""Golden angle for roll and its complement for pitch: repeats fill the circle evenly and never meet again."""
_EXPERIMENT_KEYS = ("laws", "rig", "model", "repeats", "variants", "acceptance", "position", "paper", "note")


@dataclass(frozen=True, slots=True)
class Case:
    """One run."""

    variant: str
    """Empty when the experiment has no variants."""
    law: str
    repeat: int
    seed: int
    config: RigConfig
    scenario: Scenario
    model_text: str

    @property
    def key(self) -> str:
        """Name for people and for the folder: ``variant/law-1``."""
        slug = re.sub(r"[^A-Za-z0-9.+-]+", "-", self.variant).strip("-")
        return f"{slug + '/' if slug else ''}{self.law}-{self.repeat + 1}"

    @property
    def work_s(self) -> float:
        """Simulated seconds."""
        bench = self.scenario.bench
        if bench is None:
            return self.scenario.duration_s
        return 2.0 * abs(bench.to_mm - bench.from_mm) / bench.step_mm * (bench.move_s + bench.dwell_s)


def expand(
    scenario: Loaded[Scenario], rig: Loaded[RigConfig], model: PlantModel, seed: int | None = None, repeats: int | None = None
) -> list[Case]:
    """Every run of an experiment. Raises ``ConfigError`` that names the line of the overlay at fault."""
    plan = scenario.model
    count = plan.repeats.count if repeats is None else repeats
    first = seed if seed is not None else plan.repeats.first_seed if plan.repeats.first_seed is not None else rig.model.rig.seed
    variants: list[tuple[str, Location, Any]] = [(v.name, ("variants", i), v) for i, v in enumerate(plan.variants)] or [("", (), None)]
    base_model = _vary(scenario, ("model",), model, plan.model)
    cases = []
    for name, place, variant in variants:
        session = _session(scenario, place, variant.scenario if variant else {})
        varied = _vary(scenario, (*place, "model"), base_model, variant.model) if variant else base_model
        text = dump_resolved(varied.file)
        laws = (variant.laws if variant else ()) or plan.laws or (rig.model.control.law,)
        for law in laws:
            config = _config(scenario, rig, plan.rig, place, variant.rig if variant else {}, law)
            for k in range(count):
                shifted = _shifted(session, k) if plan.repeats.spread_phases else session
                cases.append(Case(name, law, k, first + k, config, shifted, text))
    return cases


def merged(below: Any, above: Any) -> Any:
    """``above`` laid over ``below``: mappings key by key, everything else replaced."""
    if isinstance(below, Mapping) and isinstance(above, Mapping):
        return {**below, **{k: merged(below.get(k), v) for k, v in above.items()}}
    return copy.deepcopy(above)


def _marks(loaded: Loaded[Scenario], place: Location) -> dict[Location, tuple[int, int]]:
    """Places of the keys below ``place``, as if they stood at the top."""
    found = {key[len(place) :]: mark for key, mark in loaded.marks.items() if key[: len(place)] == place}
    return {(): loaded.locate(place), **found}


def _session(loaded: Loaded[Scenario], place: Location, overlay: Mapping[str, Any]) -> Scenario:
    """The scenario of a run: the file's own with the overlay, without what belongs to the experiment."""
    data = merged({k: v for k, v in loaded.data.items() if k not in _EXPERIMENT_KEYS}, overlay)
    inside = sorted(set(data) & set(_EXPERIMENT_KEYS))
    if inside:
        line, column = loaded.locate((*place, "scenario", inside[0]))
        text = f"a variant cannot change {inside[0]!r} of the experiment; write it beside `scenario:`"
        raise ConfigError([ConfigProblem(loaded.path, line, column, text)])
    marks = loaded.marks | _marks(loaded, (*place, "scenario")) if overlay else loaded.marks
    return validate_data(loaded.path, data, marks, Scenario).model


def _config(
    loaded: Loaded[Scenario], rig: Loaded[RigConfig], common: Mapping[str, Any], place: Location, overlay: Mapping[str, Any], law: str
) -> RigConfig:
    data = merged(merged(merged(rig.data, common), overlay), {"control": {"law": law}})
    marks = _marks(loaded, ("rig",)) | (_marks(loaded, (*place, "rig")) if overlay else {})
    return validate_data(loaded.path, data, marks, RigConfig).model


def _vary(loaded: Loaded[Scenario], place: Location, model: PlantModel, changes: Mapping[str, ModelChange]) -> PlantModel:
    problems = []
    for name in changes:
        try:
            model = vary(model, {name: changes[name]})
        except VariationError as error:
            problems.append(ConfigProblem(loaded.path, *loaded.locate((*place, name)), str(error)))
    if problems:
        raise ConfigError(problems)
    return model


def _shifted(session: Scenario, k: int) -> Scenario:
    """The same motion ``k`` steps on in phase, of the table and of the reference."""
    if k == 0:
        return session
    changed = {}
    for part in ("base", "reference"):
        plan = getattr(session, part)
        axes = {
            axis: tuple(
                s.model_copy(update={"phase_deg": (s.phase_deg + k * step + 180.0) % 360.0 - 180.0}) for s in getattr(plan, axis)
            )
            for axis, step in PHASE_STEP_DEG.items()
        }
        changed[part] = plan.model_copy(update=axes)
    return session.model_copy(update=changed)
