"""From an experiment to its runs: variant by law by repeat, each a checked rig, scenario and model of its own."""

from __future__ import annotations

import copy
import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from spsp_ctrl.config.drawn import Drawn
from spsp_ctrl.config.loader import ConfigError, ConfigProblem, Loaded, Location, dump_resolved, validate_data
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Identified, ModelChange, Motion, Scenario, Variant
from spsp_ctrl.experiments.draws import DrawError, commit_seed, draw
from spsp_ctrl.experiments.variation import VariationError, vary
from spsp_ctrl.plant.model import PlantModel

PHASE_STEP_DEG = {"pitch": 222.5, "roll": 137.5}
"""Golden angle for roll and its complement for pitch: repeats fill the circle evenly and never meet again."""
_EXPERIMENT_KEYS = ("laws", "rig", "model", "repeats", "variants", "motions", "acceptance", "position", "paper", "note")


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
    motion: str = ""
    """Empty when the experiment names no motions."""
    drawn: dict[str, Any] = field(default_factory=dict)
    """What was drawn from the seed."""
    identified: Mapping[str, Identified] = field(default_factory=dict)
    """Keys of the rig file that take figures of other runs (``settle``)."""

    @property
    def key(self) -> str:
        """Name for people and for the folder: ``variant/motion/law-1``."""
        slugs = (re.sub(r"[^A-Za-z0-9.+-]+", "-", name).strip("-") for name in (self.variant, self.motion))
        return f"{''.join(slug + '/' for slug in slugs if slug)}{self.law}-{self.repeat + 1}"

    @property
    def work_s(self) -> float:
        """Simulated seconds."""
        bench = self.scenario.bench
        if bench is None:
            return self.scenario.duration_s
        return 2.0 * abs(bench.to_mm - bench.from_mm) / bench.step_mm * (bench.move_s + bench.dwell_s)


def first_seed(plan: Scenario, rig: RigConfig, seed: int | None = None) -> tuple[int, str]:
    """Seed of the first repeat and, in words, where it comes from."""
    if seed is not None:
        return seed, "the command line"
    if plan.repeats.first_seed == "commit":
        return commit_seed()
    if plan.repeats.first_seed is not None:
        return plan.repeats.first_seed, "the scenario"
    return rig.rig.seed, "the rig file"


def expand(
    scenario: Loaded[Scenario],
    rig: Loaded[RigConfig],
    model: PlantModel,
    seed: int | None = None,
    repeats: int | None = None,
    only: Sequence[str] = (),
) -> list[Case]:
    """Every run of an experiment, or of the variants named by ``only`` and those whose figures they need.

    Raises ``ConfigError`` that names the line of the overlay at fault.
    """
    plan = scenario.model
    first, _ = first_seed(plan, rig.model, seed)
    variants: list[tuple[str, Location, Variant]] = [(v.name, ("variants", i), v) for i, v in enumerate(plan.variants)]
    variants = _chosen(scenario, variants, only) or [("", (), Variant(name="plain"))]
    motions: list[tuple[str, Location]] = [(m.name, ("motions", i)) for i, m in enumerate(plan.motions)] or [("", ())]
    base_model = _vary(scenario, ("model",), model, plan.model)
    cases = []
    for name, place, variant in variants:
        varied = _vary(scenario, (*place, "model"), base_model, variant.model) if place else base_model
        text = dump_resolved(varied.file)
        count = variant.repeats or (plan.repeats.count if repeats is None else repeats)
        for motion, motion_place in motions:
            session = _session(scenario, motion_place, place)
            for law in variant.laws or plan.laws or (rig.model.control.law,):
                config = _config(scenario, rig, plan.rig, place, variant.rig, law)
                for k in range(count):
                    shifted = _shifted(session, k) if plan.repeats.spread_phases else session
                    case = Case(name, law, k, first + k, config, shifted, text, motion, identified=variant.identified)
                    cases.append(_drawn(scenario, place, variant.drawn, case, varied))
    return cases


def _chosen(loaded: Loaded[Scenario], variants: list[tuple[str, Location, Variant]], only: Sequence[str]) -> list[tuple[str, Location, Variant]]:
    names = [name for name, _, _ in variants]
    for name in only:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(names) or 'none'}"
            raise ConfigError([ConfigProblem(loaded.path, 0, 0, f"no variant {name!r}; {hint}")])
    if not only:
        return variants
    needed = {i.variant for name, _, v in variants if name in only for i in v.identified.values()}
    return [entry for entry in variants if entry[0] in only or entry[0] in needed]


def _drawn(loaded: Loaded[Scenario], place: Location, drawn: Drawn, case: Case, model: PlantModel) -> Case:
    if drawn.motion is None and drawn.plant is None:
        return case
    try:
        scenario, changes, about = draw(drawn, case.variant, case.seed, case.scenario, case.config, model)
        text = dump_resolved(vary(model, changes).file) if changes else case.model_text
    except (DrawError, VariationError) as error:
        line, column = loaded.locate((*place, "drawn"))
        raise ConfigError([ConfigProblem(loaded.path, line, column, f"{case.variant}, seed {case.seed}: {error}")]) from None
    return replace(case, scenario=scenario, model_text=text, drawn=about)


def settle(case: Case, figures: Mapping[str, float]) -> Case:
    """``case`` with the identified keys of its rig file set to ``figures``. Raises ``ConfigError`` for a key or value that does not fit."""
    data = case.config.model_dump(by_alias=True)
    for key, value in figures.items():
        overlay: Any = value
        for part in reversed(key.split(".")):
            overlay = {part: overlay}
        data = merged(data, overlay)
    return replace(case, config=validate_data(Path(f"{case.variant}: identified"), data, {}, RigConfig).model, identified={})


def merged(below: Any, above: Any) -> Any:
    """``above`` laid over ``below``: mappings key by key, everything else replaced."""
    if isinstance(below, Mapping) and isinstance(above, Mapping):
        return {**below, **{k: merged(below.get(k), v) for k, v in above.items()}}
    return copy.deepcopy(above)


def _marks(loaded: Loaded[Scenario], place: Location) -> dict[Location, tuple[int, int]]:
    """Places of the keys below ``place``, as if they stood at the top."""
    found = {key[len(place) :]: mark for key, mark in loaded.marks.items() if key[: len(place)] == place}
    return {(): loaded.locate(place), **found}


def _overlay(loaded: Loaded[Scenario], place: Location) -> Mapping[str, Any]:
    plan = loaded.model
    entries: Sequence[Variant | Motion] = plan.variants if place[0] == "variants" else plan.motions
    return entries[int(place[1])].scenario


def _session(loaded: Loaded[Scenario], *places: Location) -> Scenario:
    """The scenario of a run: the file's own with the overlays at ``places`` (a motion's, a variant's), without what belongs to the experiment."""
    data: Any = {k: v for k, v in loaded.data.items() if k not in _EXPERIMENT_KEYS}
    marks = loaded.marks
    for place in places:
        if not place:
            continue
        overlay = _overlay(loaded, place)
        inside = sorted(set(overlay) & set(_EXPERIMENT_KEYS))
        if inside:
            line, column = loaded.locate((*place, "scenario", inside[0]))
            text = f"a {str(place[0])[:-1]} cannot change {inside[0]!r} of the experiment; write it beside `scenario:`"
            raise ConfigError([ConfigProblem(loaded.path, line, column, text)])
        data = merged(data, overlay)
        if overlay:
            marks = marks | _marks(loaded, (*place, "scenario"))
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
