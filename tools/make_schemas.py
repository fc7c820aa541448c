"""JSON Schemas of the YAML files, for editors: keys, units, bounds and descriptions while one types.

``python -m tools.make_schemas`` writes ``config/schema/*.schema.json``; with ``--check`` it writes nothing and exits 1 when a file is out of date.
They come from the classes that the loader checks with and, for model files, from the registry of parameters and effects.
"""

from __future__ import annotations

import argparse
import inspect
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from spsp_ctrl.config.import_map import ImportMap
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.config.served import ServedFile
from spsp_ctrl.config.units import UNITS, spellings
from spsp_ctrl.plant.axis_model import ACTUATOR_KEYS, AXIS_EFFECTS, AXIS_KEYS, BARE_ACTUATOR_KEYS, AxisFile
from spsp_ctrl.plant.axis_scenario import AxisScenario
from spsp_ctrl.plant.effects import EFFECTS, Effect, Parameter
from spsp_ctrl.plant.layout import AXIS_BASE, GLOBAL_BASE
from spsp_ctrl.plant.model import ModelFile, effect_keys, key

FOLDER = Path(__file__).parents[1] / "config" / "schema"
DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]


def model_class_schema(cls: type[BaseModel]) -> Schema:
    """Schema of a config class; descriptions are its docstrings."""
    schema = cls.model_json_schema(by_alias=True)
    for node in (schema, *schema.get("$defs", {}).values()):
        if "description" in node:
            node["description"] = inspect.cleandoc(node["description"]).replace("``", "`")
    return {"$schema": DIALECT, **schema}


def _quantity(parameter: Parameter) -> Schema:
    """One number of a model file: bounds hold for the unit that is given."""
    by_unit = []
    for unit in spellings(parameter.unit):
        factor = UNITS[unit][1]
        # a hair wider than the loader's own bounds: the factor is not exact in every unit
        slack = 1e-9 * max(abs(parameter.low), abs(parameter.high)) / factor
        by_unit.append(
            {
                "properties": {
                    "unit": {"const": unit},
                    "value": {"minimum": parameter.low / factor - slack, "maximum": parameter.high / factor + slack},
                }
            }
        )
    return {"description": f"{parameter.doc} [{parameter.unit}]", "allOf": [{"$ref": "#/$defs/Quantity"}], "anyOf": by_unit}


def _section(parameters: Iterable[tuple[str, Parameter]], doc: str, *, complete: bool) -> Schema:
    properties = {name: _quantity(parameter) for name, parameter in parameters}
    section: Schema = {"type": "object", "description": doc, "properties": properties, "additionalProperties": False}
    if complete:
        section["required"] = list(properties)
    return section


def _effect(effect: Effect) -> Schema:
    where = "per actuator" if effect.per_axis else "whole rig"
    return {
        "if": {"properties": {"effect": {"const": effect.name}}},
        "then": {
            "description": f"{effect.doc} (stage {effect.stage}, {where})",
            "properties": {"parameters": _section(effect_keys(effect).items(), effect.doc, complete=False)},
        },
    }


def plant_model_schema() -> Schema:
    """Schema of a model file, with every parameter and effect of the registry."""
    schema = model_class_schema(ModelFile)
    properties = schema["properties"]
    axis = [(key(q), q) for q in AXIS_BASE]
    rig = [(key(q), q) for q in GLOBAL_BASE]
    properties["actuator"] = _section(axis, properties["actuator"]["description"], complete=True)
    for side in ("pitch_actuator", "roll_actuator"):
        properties[side] = _section(axis, properties[side]["description"], complete=False)
    properties["rig"] = _section(rig, properties["rig"]["description"], complete=True)
    _list_effects(schema["$defs"]["EffectEntry"], [effect for effect in EFFECTS if effect.kind != "axis"])
    return schema


def axis_model_schema() -> Schema:
    """Schema of the model file of a single axis."""
    schema = model_class_schema(AxisFile)
    properties = schema["properties"]
    drive = properties["actuator"]["description"]
    full = _section(ACTUATOR_KEYS.items(), drive, complete=True)
    bare = _section(BARE_ACTUATOR_KEYS.items(), drive, complete=False) | {"required": ["force_per_command"]}
    properties["actuator"] = {"description": drive, "anyOf": [full, bare]}
    properties["axis"] = _section(AXIS_KEYS.items(), properties["axis"]["description"], complete=False) | {"required": ["moving_mass"]}
    _list_effects(schema["$defs"]["AxisEffect"], AXIS_EFFECTS)
    return schema


def _list_effects(entry: Schema, effects: Iterable[Effect]) -> None:
    listed = tuple(effects)
    entry["properties"]["effect"] = {
        "description": "Standard name of the effect.",
        "oneOf": [{"const": effect.name, "description": effect.doc} for effect in listed],
    }
    entry["allOf"] = [_effect(effect) for effect in listed]


def schemas() -> dict[str, str]:
    """File name to text."""
    found = {
        "rig.schema.json": model_class_schema(RigConfig),
        "scenario.schema.json": model_class_schema(Scenario),
        "model.schema.json": plant_model_schema(),
        "axis.schema.json": axis_model_schema(),
        "axis-scenario.schema.json": model_class_schema(AxisScenario),
        "import-map.schema.json": model_class_schema(ImportMap),
        "served.schema.json": model_class_schema(ServedFile),
    }
    return {name: json.dumps(schema, indent=1, ensure_ascii=False) + "\n" for name, schema in found.items()}


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog="Example: python -m tools.make_schemas --check")
    parser.add_argument("--check", action="store_true", help="only say what is out of date")
    check = parser.parse_args().check
    old = False
    FOLDER.mkdir(exist_ok=True)
    for name, text in schemas().items():
        path = FOLDER / name
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        old = True
        if not check:
            path.write_text(text, encoding="utf-8")
        print(f"{path.relative_to(FOLDER.parents[1])}: {'out of date' if check else 'written'}")
    raise SystemExit(1 if check and old else 0)


if __name__ == "__main__":
    main()
