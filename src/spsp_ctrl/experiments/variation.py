"""A plant model with some parameters changed: the corners, draws and variants of experiments. The original is not touched."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from spsp_ctrl.config.scenario import ModelChange
from spsp_ctrl.plant.effects import BY_NAME
from spsp_ctrl.plant.model import ModelFile, PlantModel, check, effect_keys

AXES = ("both", "pitch", "roll")


class VariationError(Exception):
    """A change that cannot be made; the text says why."""


def vary(model: PlantModel, changes: Mapping[str, ModelChange]) -> PlantModel:
    """``model`` with ``changes`` by dotted name.

    ``actuator.NAME`` (both legs; ``pitch_actuator.NAME``, ``roll_actuator.NAME`` for one), ``rig.NAME``, ``effects.EFFECT.NAME`` (wherever the effect
    is listed) or ``effects.EFFECT.pitch.NAME`` for one leg. A factor needs the parameter to be there; a value adds a missing effect or parameter.
    Raises ``VariationError``.
    """
    data: dict[str, Any] = model.file.model_dump(by_alias=True)
    data["effects"] = list(data["effects"])
    for name, change in changes.items():
        for place in _places(data, name, change):
            _apply(place, name.rsplit(".", 1)[1], name, change)
    file = ModelFile.model_validate(data)
    problems = [text for _, text in check(file)]
    if problems:
        raise VariationError("; ".join(problems))
    return PlantModel(file, model.path)


def _places(data: dict[str, Any], name: str, change: ModelChange) -> list[dict[str, Any]]:
    """The mappings that hold the parameter."""
    head, _, rest = name.partition(".")
    parts = rest.split(".")
    if head in ("actuator", "rig") and len(parts) == 1:
        if parts[0] not in data[head]:
            raise VariationError(f"{name}: no such parameter" + _near(parts[0], data[head]))
        legs = (data["pitch_actuator"], data["roll_actuator"]) if head == "actuator" else ()
        return [data[head], *(leg for leg in legs if parts[0] in leg)]
    if head in ("pitch_actuator", "roll_actuator") and len(parts) == 1:
        if parts[0] not in data["actuator"]:
            raise VariationError(f"{name}: no such parameter" + _near(parts[0], data["actuator"]))
        data[head].setdefault(parts[0], dict(data["actuator"][parts[0]]))
        return [data[head]]
    if head == "effects" and len(parts) in (2, 3):
        return _effect_places(data, name, parts, change)
    raise VariationError(f"{name}: not a parameter name; write actuator.NAME, rig.NAME or effects.EFFECT.NAME")


def _effect_places(data: dict[str, Any], name: str, parts: list[str], change: ModelChange) -> list[dict[str, Any]]:
    effect, axis = parts[0], parts[1] if len(parts) == 3 else ""
    if effect not in BY_NAME:
        raise VariationError(f"{name}: unknown effect {effect!r}" + _near(effect, BY_NAME))
    if axis and axis not in AXES:
        raise VariationError(f"{name}: {axis!r} is not one of pitch, roll, both")
    keys = effect_keys(BY_NAME[effect])
    if parts[-1] not in keys:
        raise VariationError(f"{name}: no such parameter" + _near(parts[-1], keys))
    entries = [e for e in data["effects"] if e["effect"] == effect and (not axis or e["axis"] == axis)]
    if not entries and change.value is not None:
        entries = [{"effect": effect, "axis": axis or "both", "parameters": {}}]
        data["effects"] += entries
    if not entries:
        raise VariationError(f"{name}: the model does not list this effect, so it has no value to multiply; give value and unit")
    return [entry["parameters"] for entry in entries]


def _apply(place: dict[str, Any], key: str, name: str, change: ModelChange) -> None:
    old = place.get(key)
    if change.factor is not None:
        if old is None:
            raise VariationError(f"{name}: the model gives no value to multiply; give value and unit")
        place[key] = old | {"value": old["value"] * change.factor, "source": f"varied: {old['value']:g} times {change.factor:g}"}
    else:
        place[key] = {"value": change.value, "unit": change.unit, "source": "varied by the scenario"}


def _near(word: str, known: Mapping[str, Any]) -> str:
    match = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {match[0]!r}?" if match else f"; known: {', '.join(known)}"
