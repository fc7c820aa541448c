"""The loader: YAML without its traps, places of keys, overrides, and no input that gets past it with anything but a ``ConfigError``."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import Field

from spsp_ctrl.config.loader import ConfigError, Loaded, apply_overrides, dump_resolved, load_rig, load_scenario, load_yaml_model
from spsp_ctrl.config.rig import RIG_SCHEMA, RigConfig
from spsp_ctrl.config.scenario import SCENARIO_SCHEMA, Scenario, Strict
from spsp_ctrl.plant.axis_model import load_axis_model
from spsp_ctrl.plant.model import load_model

CONFIG = Path(__file__).parents[2] / "config"
RIG = CONFIG / "rig.yaml"
SCENARIOS = sorted(CONFIG.glob("experiments/**/*.yaml"))


class Anything(Strict):
    """One free value."""

    schema_: str = Field(alias="schema")
    value: Any = None


def value(text: str, tmp_path: Path) -> Any:
    path = tmp_path / "file.yaml"
    path.write_text(f"schema: test\nvalue: {text}\n", encoding="utf-8")
    return load_yaml_model(path, Anything, "test").model.value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2e-5", 2e-5),  # text by YAML 1.1
        ("1_000", "1_000"),
        ("010", 10),  # octal by YAML 1.1
        ("12:30", "12:30"),  # 750 by YAML 1.1
        ("on", "on"),  # true by YAML 1.1
        ("no", "no"),
        ("2026-01-01", "2026-01-01"),
        ("true", True),
        ("~", None),
        ("-3", -3),
        (".5", 0.5),
        ("[1, 2.0]", [1, 2.0]),
    ],
)
def test_yaml_without_its_traps(text: str, expected: Any, tmp_path: Path) -> None:
    found = value(text, tmp_path)
    assert found == expected
    assert type(found) is type(expected)


def test_shipped_files_load_and_resolve_to_themselves(tmp_path: Path) -> None:
    path = tmp_path / "resolved.yaml"
    loaded: list[tuple[Any, str]] = [(load_rig(RIG).model, RIG_SCHEMA)]
    loaded += [(load_scenario(scenario).model, SCENARIO_SCHEMA) for scenario in SCENARIOS]
    for model, schema in loaded:
        path.write_text(dump_resolved(model), encoding="utf-8")
        assert load_yaml_model(path, type(model), schema).model == model
    for model_file in CONFIG.glob("*.yaml"):
        text = model_file.read_text(encoding="utf-8")
        if "spsp-ctrl/model/1" in text:
            (load_axis_model if "kind: axis" in text else load_model)(model_file)


def test_places_point_at_keys_also_through_an_anchor() -> None:
    loaded = load_rig(RIG)
    lines = RIG.read_text(encoding="utf-8").splitlines()
    for place in (("limits", "current_a"), ("control", "stabiliser", "attitude"), ("rig", "model")):
        line, column = loaded.locate(place)
        assert lines[line - 1][column - 1 :].startswith(place[-1])
    # the roll actuator is an alias: its keys stand where the anchor's do
    assert loaded.locate(("roll_actuator", "gear_ratio")) == loaded.locate(("pitch_actuator", "gear_ratio"))
    # a key that is not there is looked for in the mapping around it
    assert loaded.locate(("limits", "nothing")) == loaded.locate(("limits",))


def test_overrides_change_the_value_and_nothing_else() -> None:
    loaded = load_rig(RIG)
    changed = apply_overrides(loaded, ["limits.current_a=3", "pitch_actuator.gear_ratio=2.5", "control.law=cascade"])
    assert changed.model.limits.current_a == 3.0
    assert changed.model.pitch_actuator.gear_ratio == 2.5
    assert changed.model.roll_actuator.gear_ratio == 3.0  # shares an anchor with the pitch actuator
    assert changed.model.control.law == "cascade"
    back = changed.model.model_copy(
        update={"limits": loaded.model.limits, "pitch_actuator": loaded.model.pitch_actuator, "control": loaded.model.control}
    )
    assert back == loaded.model
    assert loaded.model.limits.current_a == 6.0
    assert loaded.data["limits"]["current_a"] == 6.0


def judge(path: Path) -> Loaded[RigConfig] | None:
    """Load it, or find a problem in one line for each thing that is wrong; anything else raises."""
    try:
        return load_rig(path)
    except ConfigError as error:
        problems = error.problems
    assert problems
    assert all(problem.path == path and "\n" not in str(problem) for problem in problems)
    return None


FILE = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@FILE
@given(data=st.binary(max_size=200))
def test_any_bytes_are_judged(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_bytes(data)
    assert judge(path) is None


@FILE
@given(at=st.integers(0, 6000), cut=st.integers(0, 20), text=st.text(max_size=8))
def test_any_edit_of_the_rig_file_is_judged(at: int, cut: int, text: str, tmp_path: Path) -> None:
    whole = RIG.read_text(encoding="utf-8")
    path = tmp_path / "rig.yaml"
    with contextlib.suppress(UnicodeEncodeError):
        path.write_bytes((whole[:at] + text + whole[at + cut :]).encode("utf-8"))
        judge(path)


@FILE
@given(key=st.text(max_size=12), raw=st.text(max_size=12))
def test_any_override_is_judged(key: str, raw: str) -> None:
    loaded = load_rig(RIG)
    with contextlib.suppress(ConfigError):
        apply_overrides(loaded, [f"{key}={raw}"])
    with contextlib.suppress(ConfigError):
        apply_overrides(loaded, [f"limits.current_a={raw}"])


@settings(max_examples=60, deadline=None)
@given(
    amplitude=st.floats(-45.0, 45.0),
    period=st.floats(0.5, 3600.0),
    duration=st.floats(0.1, 86_400.0),
)
def test_resolved_text_keeps_every_bit_of_a_number(
    amplitude: float, period: float, duration: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    scenario = Scenario.model_validate(
        {
            "schema": SCENARIO_SCHEMA,
            "name": "x",
            "duration_s": duration,
            "base": {"pitch": [{"amplitude_deg": amplitude, "period_s": period}]},
        }
    )
    path = tmp_path_factory.mktemp("resolved") / "scenario.yaml"
    path.write_text(dump_resolved(scenario), encoding="utf-8")
    assert load_scenario(path).model == scenario
