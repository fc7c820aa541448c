"""The model file: what the plant is made of, with unit and source of every number, and the list of effects that act.

Keys are parameter names of ``plant.layout`` without their unit suffix (and, inside an effect, without the effect's prefix), since each entry
states its own unit. An effect that is not listed has all its parameters at zero and does nothing.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from spsp_ctrl.config.loader import ConfigError, ConfigProblem, Loaded, load_yaml_model
from spsp_ctrl.config.scenario import Strict
from spsp_ctrl.config.units import SUFFIX, UNITS, spellings
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects import BY_NAME, EFFECTS, Effect, Parameter
from spsp_ctrl.plant.layout import AXIS_BASE, AXIS_PARAMETERS, GLOBAL_BASE, GLOBAL_PARAMETERS, N_AXIS_PARAMETERS, N_PARAMETERS

MODEL_SCHEMA = "spsp-ctrl/model/1"
Location = tuple[str | int, ...]


class Quantity(Strict):
    """A number with its unit and where it comes from."""

    value: float
    """The number."""
    unit: str
    """Its unit, any of the same dimension."""
    source: str = ""
    """Where it comes from."""
    std: float | None = Field(default=None, ge=0.0)
    """Standard deviation in the same unit, once identified."""


class EffectEntry(Strict):
    """One effect that acts."""

    effect: str
    """Standard name."""
    axis: Literal["both", "pitch", "roll"] = "both"
    """Which actuator it acts on; ignored by effects of the whole rig."""
    parameters: dict[str, Quantity]
    """Its parameters; what is not given is zero."""


class ModelFile(Strict):
    """A plant model as written in a file."""

    schema_: Literal["spsp-ctrl/model/1"] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=80)
    """Name of the model."""
    kind: Literal["platform"] = "platform"
    """What is modelled."""
    actuator: dict[str, Quantity]
    """Both actuators."""
    pitch_actuator: dict[str, Quantity] = Field(default_factory=dict)
    """Overrides for the pitch leg."""
    roll_actuator: dict[str, Quantity] = Field(default_factory=dict)
    """Overrides for the roll leg."""
    rig: dict[str, Quantity]
    """Mechanism, azimuth drive, temperatures, IMU."""
    effects: tuple[EffectEntry, ...] = ()
    """What acts beside the ideal plant."""


def key(parameter: Parameter, prefix: str = "") -> str:
    """Name of a parameter in a model file."""
    return parameter.name.removesuffix(SUFFIX[parameter.unit]).removeprefix(prefix)


@dataclass(frozen=True, slots=True)
class PlantModel:
    """A checked model."""

    file: ModelFile
    path: Path

    def parameters(self) -> Array:
        """The flat parameter array of ``plant.layout``, in SI."""
        values = np.zeros(N_PARAMETERS)
        for index, _, quantity in _assignments(self.file):
            values[index] = quantity.value * UNITS[quantity.unit][1]
        return values

    def without(self, *names: str) -> PlantModel:
        """The same plant without the named effects."""
        for name in names:
            if name not in BY_NAME:
                raise KeyError(f"no effect {name!r}; known: {', '.join(BY_NAME)}")
        kept = tuple(entry for entry in self.file.effects if entry.effect not in names)
        return PlantModel(self.file.model_copy(update={"effects": kept}), self.path)


_AXIS_INDEX = {q.name: i for i, q in enumerate(AXIS_PARAMETERS)}
_GLOBAL_INDEX = {q.name: 2 * N_AXIS_PARAMETERS + i for i, q in enumerate(GLOBAL_PARAMETERS)}
_AXIS_KEYS = {key(q): q for q in AXIS_BASE}
_GLOBAL_KEYS = {key(q): q for q in GLOBAL_BASE}


def _slots(parameter: Parameter, per_axis: bool, axis: str) -> tuple[int, ...]:
    if not per_axis:
        return (_GLOBAL_INDEX[parameter.name],)
    first = _AXIS_INDEX[parameter.name]
    both = (first, first + N_AXIS_PARAMETERS)
    return both if axis == "both" else (both[0 if axis == "pitch" else 1],)


def _entries(file: ModelFile) -> Iterator[tuple[Location, dict[str, Parameter], bool, str, str, Quantity]]:
    """Every quantity with its place, the keys allowed there, and which actuators it belongs to."""
    for section, axis in (("actuator", "both"), ("pitch_actuator", "pitch"), ("roll_actuator", "roll")):
        for name, quantity in getattr(file, section).items():
            yield (section, name), _AXIS_KEYS, True, axis, name, quantity
    for name, quantity in file.rig.items():
        yield ("rig", name), _GLOBAL_KEYS, False, "both", name, quantity
    for i, entry in enumerate(file.effects):
        effect = BY_NAME.get(entry.effect)
        if effect is not None and effect.kind != "axis":
            keys = effect_keys(effect)
            for name, quantity in entry.parameters.items():
                yield ("effects", i, "parameters", name), keys, effect.per_axis, entry.axis, name, quantity


def effect_keys(effect: Effect) -> dict[str, Parameter]:
    """Parameters of an effect by their name in a model file."""
    return {key(q, effect.prefix): q for q in effect.parameters}


def _assignments(file: ModelFile) -> Iterator[tuple[int, Parameter, Quantity]]:
    for _, keys, per_axis, axis, name, quantity in _entries(file):
        for index in _slots(keys[name], per_axis, axis):
            yield index, keys[name], quantity


def nearest(word: str, known: list[str]) -> str:
    """The end of a complaint about an unknown name: the nearest right one, or all."""
    match = difflib.get_close_matches(word, known, n=1)
    return f"; did you mean {match[0]!r}?" if match else f"; known here: {', '.join(known)}"


def wrong_quantity(parameter: Parameter, name: str, quantity: Quantity) -> tuple[str, str] | None:
    """What is wrong with a number of a model file: the key that holds it (``unit`` or ``value``) and the text; None when nothing is."""
    unit = UNITS.get(quantity.unit)
    if unit is None or unit[0] != parameter.unit:
        return "unit", f"{name}: unit {quantity.unit!r} does not fit, give one of {', '.join(spellings(parameter.unit))}"
    if not parameter.low <= quantity.value * unit[1] <= parameter.high:
        low, high = parameter.low / unit[1], parameter.high / unit[1]
        return "value", f"{name}: {quantity.value:g} {quantity.unit} is outside {low:g} to {high:g} {quantity.unit}"
    return None


def check(file: ModelFile) -> Iterator[tuple[Location, str]]:
    """Everything that is wrong with a model beyond its form: place and text."""
    for i, entry in enumerate(file.effects):
        if entry.effect not in BY_NAME:
            yield ("effects", i, "effect"), f"unknown effect {entry.effect!r}" + nearest(entry.effect, list(BY_NAME))
        elif BY_NAME[entry.effect].kind == "axis":
            yield ("effects", i, "effect"), f"effect {entry.effect!r} acts on a single axis, not on a platform"
    seen: dict[int, Location] = {}
    for place, keys, per_axis, axis, name, quantity in _entries(file):
        if name not in keys:
            yield place, f"unknown parameter {name!r}" + nearest(name, list(keys))
            continue
        parameter = keys[name]
        wrong = wrong_quantity(parameter, name, quantity)
        if wrong is not None:
            yield (*place, wrong[0]), wrong[1]
            if wrong[0] == "unit":
                continue
        if place[0] == "effects":
            for index in _slots(parameter, per_axis, axis):
                if index in seen:
                    yield place, f"{name}: given twice for the same actuator (also in entry {seen[index][1]} of effects)"
                seen[index] = place
    for section, given, keys in (("actuator", file.actuator, _AXIS_KEYS), ("rig", file.rig, _GLOBAL_KEYS)):
        for missing in keys.keys() - given.keys():
            yield (section,), f"parameter {missing!r} is missing: {keys[missing].doc} [{keys[missing].unit}]"
    yield from _impossible(file)


def _impossible(file: ModelFile) -> Iterator[tuple[Location, str]]:
    radius, height = file.rig.get("hinge_radius"), file.rig.get("column_height")
    if radius and height and radius.unit in UNITS and height.unit in UNITS:
        r, h = radius.value * UNITS[radius.unit][1], height.value * UNITS[height.unit][1]
        if r >= h:
            yield ("rig", "hinge_radius"), f"impossible geometry: hinge_radius ({r:g} m) must be smaller than column_height ({h:g} m)"


def load_model(path: Path) -> PlantModel:
    """Read and check a model file. Raises ``ConfigError`` with one line per problem."""
    loaded: Loaded[ModelFile] = load_yaml_model(path, ModelFile, MODEL_SCHEMA)
    problems = {}
    for place, text in check(loaded.model):
        line, column = loaded.locate(place)
        problem = ConfigProblem(path=path, line=line, column=column, message=f"{text} ({'.'.join(map(str, place))})")
        problems[str(problem)] = problem  # said once, also where it concerns both actuators
    if problems:
        raise ConfigError(tuple(sorted(problems.values(), key=lambda problem: (problem.line, problem.column, problem.message))))
    return PlantModel(loaded.model, path)


ALL_EFFECT_NAMES = tuple(effect.name for effect in EFFECTS)
