"""The committed JSON Schemas are the generated ones, take every shipped file and refuse wrong ones as the loader does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from spsp_ctrl.config.loader import _construct
from tools import make_schemas

CONFIG = Path(__file__).parents[2] / "config"
KIND = {name: f"{name}.schema.json" for name in ("rig", "scenario", "model", "axis", "axis-scenario", "import-map", "served")}
"""Schema by the kind of file; a model file of ``kind: axis`` has its own."""
FILES = [
    path
    for path in sorted([*CONFIG.rglob("*.yaml"), *(CONFIG.parent / "hil").glob("*.yaml")])
    if (schema := yaml.safe_load(path.read_text(encoding="utf-8"))["schema"]).split("/")[1] in KIND and schema.startswith("spsp-ctrl/")
]


def data(path: Path, text: str | None = None) -> Any:
    return _construct(path, text if text is not None else path.read_text(encoding="utf-8"))[0]


def schema_of(path: Path) -> str:
    content = data(path)
    return KIND["axis" if content.get("kind") == "axis" else content["schema"].split("/")[1]]


def validator(path: Path) -> jsonschema.Draft202012Validator:
    name = schema_of(path)
    return jsonschema.Draft202012Validator(json.loads((CONFIG / "schema" / name).read_text(encoding="utf-8")))


@pytest.mark.parametrize("name", sorted(KIND.values()))
def test_committed_schema_is_the_generated_one(name: str) -> None:
    text = (CONFIG / "schema" / name).read_text(encoding="utf-8")
    assert text == make_schemas.schemas()[name], "run `python -m tools.make_schemas`"
    jsonschema.Draft202012Validator.check_schema(json.loads(text))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_shipped_file_is_valid_and_names_its_schema(path: Path) -> None:
    errors = list(validator(path).iter_errors(data(path)))
    assert not errors, errors[0].message
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("# yaml-language-server: $schema=")
    named = path.parent / first.split("=", 1)[1]
    assert named.resolve() == (CONFIG / "schema" / schema_of(path)).resolve()


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("rig.yaml", "rod_speed_mm_s:", "rod_sped_mm_s:"),
        ("rig.yaml", "rate_hz: 1000 ", "rate_hz: 20 "),
        ("rig.yaml", "law: stabiliser", "law: pid"),
        ("rig.yaml", "current_a: 6.0", 'current_a: "6.0"'),
        ("rig.yaml", "\nroll_actuator: *actuator", ""),
        ("model.yaml", "{value: 4.0, unit: mm,", "{value: 4.0, unit: N,"),
        ("model.yaml", "{value: 24.0, unit: V,", "{value: -24.0, unit: V,"),
        ("model.yaml", "- effect: cogging", "- effect: coging"),
        ("model.yaml", "      gap: {", "      gapp: {"),
        ("model.yaml", "  bus_voltage:", "  buss_voltage:"),
        ("experiments/swing-2dof.yaml", "duration_s: 40.0", "duration_s: -1.0"),
        ("experiments/swing-2dof.yaml", "kind: inertial", "kind: inertia"),
        ("import/emps.yaml", "kind: cascade", "kind: pid"),
        ("import/emps.yaml", "unit: s,", "unit: h,"),
        ("import/emps.yaml", "{source: vir,", "{sorce: vir,"),
    ],
)
def test_what_the_loader_refuses_the_schema_refuses(file: str, old: str, new: str) -> None:
    path = CONFIG / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    assert list(validator(path).iter_errors(data(path, text.replace(old, new, 1))))


def test_every_key_is_described_or_says_its_unit() -> None:
    """An editor has something to show for each section and each quantity of a model."""
    for name, text in make_schemas.schemas().items():
        schema = json.loads(text)
        for title, node in schema.get("$defs", {}).items():
            assert node.get("description"), f"{name}: {title}"
    model = json.loads(make_schemas.schemas()["model.schema.json"])
    for section in ("actuator", "rig"):
        for quantity in model["properties"][section]["properties"].values():
            assert quantity["description"].endswith("]")
