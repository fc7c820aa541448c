"""Beside the names: what is written, shown and asked for next. One effect is hidden in the virtual bench, the model that comes out is run again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from tests.discrepancy.benches import MODEL, MOTIONS, ROOT, samples_of, write

from spsp_ctrl.cli import cli
from spsp_ctrl.discrepancy import next_experiment
from spsp_ctrl.discrepancy.fitting import Bench
from spsp_ctrl.discrepancy.motion_menu import menu, reach_of
from spsp_ctrl.discrepancy.next_experiment import Pair, Plan, imagined, part
from spsp_ctrl.discrepancy.pipeline import Task, diagnose
from spsp_ctrl.discrepancy.records import Record, load_record
from spsp_ctrl.discrepancy.replica import replica
from spsp_ctrl.discrepancy.result import Diagnosis
from spsp_ctrl.discrepancy.unknown import sketch
from spsp_ctrl.discrepancy.variables import Variable
from spsp_ctrl.plant.axis_model import load_axis_model
from spsp_ctrl.plant.axis_scenario import course, load_axis_scenario
from spsp_ctrl.recording.axis_writer import AxisLog

TRUTH = {"command_delay_s": 3e-3}
SECONDS = 10.0


def _record(folder: Path, name: str, motion: str, seed: int, changes: dict[str, float], seconds: float = SECONDS) -> Record:
    return load_record(write(folder / f"{name}.mcap", motion, samples_of(motion, seed, changes, seconds)))[0]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A diagnosis of a hidden delay by the command."""
    folder = tmp_path_factory.mktemp("hidden")
    for name, motion, seed, changes in (("train", "axis-identify", 2, TRUTH), ("clean", "axis-identify", 1, {}), ("held", "axis-check", 3, TRUTH)):
        _record(folder, name, motion, seed, changes)
    words = ["--commissioning", str(folder / "clean.mcap"), "--held-out", str(folder / "held.mcap")]
    words += ["--model", str(MODEL), "--out", str(folder / "out")]
    done = CliRunner().invoke(cli, ["diagnose", str(folder / "train.mcap"), *words])
    assert done.exit_code == 0, done.output
    answer = json.loads((folder / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    return SimpleNamespace(folder=folder, out=folder / "out", answer=answer, text=done.output)


def test_a_hidden_effect_is_named_sized_and_closed(found: SimpleNamespace) -> None:
    first = found.answer["effects"][0]
    assert "command_delay" in {m["name"] for m in first["class"]}
    assert first["parameters"]["command_delay"]["value"] == pytest.approx(3e-3, rel=0.05)
    assert found.answer["gap"]["resolver"]["closed"] > 0.9
    assert "command delay" in found.text
    assert len(found.text.splitlines()) <= 40, "one screen"


def test_the_answer_shows_where_the_gap_went(found: SimpleNamespace) -> None:
    steps = found.answer["waterfall"]
    assert [s["name"] for s in steps] == ["recalibrated model", *(e["name"] for e in found.answer["effects"] if e["gap_closed"] is not None)]
    for channel, gap in found.answer["gap"].items():
        assert steps[0]["floors"][channel] == pytest.approx(gap["before"] / gap["floor"], rel=1e-3)
        assert steps[-1]["floors"][channel] == pytest.approx(gap["after"] / gap["floor"], rel=1e-3)
    everywhere = {r["channel"]: r for r in found.answer["regimes"] if r["regime"] == "everywhere"}
    assert everywhere["resolver"]["before"] == pytest.approx(steps[0]["floors"]["resolver"], rel=1e-3)
    names, matrix = found.answer["correlation"]["parameters"], np.array(found.answer["correlation"]["matrix"])
    assert "command_delay_s" in names
    assert np.allclose(np.diag(matrix), 1.0)
    assert np.allclose(matrix, matrix.T)
    page = (found.out / "report.html").read_text(encoding="utf-8")
    for heading in ("Where the gap went", "Before and after, against the floor", "Map of regimes", "Not excited", "Correlation of"):
        assert heading in page
    assert "http" not in page.replace("http://www.w3.org/2000/svg", ""), "the page stands alone"


def test_the_new_model_runs_on_the_bench_and_a_fresh_log_finds_nothing_missing(found: SimpleNamespace, tmp_path: Path) -> None:
    model = found.out / "model.yaml"
    done = CliRunner().invoke(cli, ["experiment", str(MOTIONS / "axis-check.yaml"), "--model", str(model), "--out", str(tmp_path / "run"), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["within_limits"]
    assert load_record(tmp_path / "run" / "axis.mcap")[0].seconds == pytest.approx(14.0, abs=0.01)
    fresh = (_record(tmp_path, "fresh", "axis-identify", 12, TRUTH),)
    floor = (_record(tmp_path, "floor", "axis-identify", 11, TRUTH),)
    held = (_record(tmp_path, "held", "axis-check", 13, TRUTH),)
    again = diagnose(Task(load_axis_model(model), fresh, floor, held, 1), tmp_path / "again.yaml")
    assert again.verdict == "nothing-missing", again.reason
    assert again.effects == []


# the next experiment


def _pair(name: str, rival: str, changes: dict[str, float], rivals: dict[str, float]) -> Pair:
    model = load_axis_model(MODEL)
    p, q = model.parameters(), model.parameters()
    for key, value in changes.items():
        p[model.index(key)] += value
    for key, value in rivals.items():
        q[model.index(key)] += value
    index = model.index(next(iter(rivals)))
    variables = (Variable(next(iter(rivals)), index, -1.0, 1.0, 0.1 * abs(next(iter(rivals.values())))),)
    return Pair(name, rival, p, q, variables)


FLOOR = {"current": 5e-3, "drive": 6e-3, "resolver": 5e-3, "ruler": 5e-7}


def test_the_motion_that_parts_twins_is_the_one_that_physics_asks_for(tmp_path: Path) -> None:
    """A zero that is off and a screw that is warm look alike at one temperature; the same laps cold and warm part them."""
    model = load_axis_model(MODEL)
    record = _record(tmp_path, "log", "axis-check", 1, {}, 6.0)
    reach = reach_of(model, [record])
    pair = _pair("zero_offset", "thermal_expansion", {"zero_offset_m": 30e-6}, {"screw_expansion_1_k": 8e-6})
    pair = replace(pair, at_hand=_at_hand(model, pair, record))
    held = {s.name: part(model, s, pair, FLOOR).most for s in menu(reach)}
    assert max(held, key=lambda name: held[name]) == "laps-cold-and-warm"
    assert held["laps-cold-and-warm"] > 10.0


def _at_hand(model: Any, pair: Pair, record: Record) -> Any:
    one = replica(model, record)
    bench = Bench((one,), ({c: np.ones(len(one.rows(c)), bool) for c in one.channels},), FLOOR)
    return next_experiment.difference(bench, pair, FLOOR)


def test_every_motion_keeps_to_what_the_logs_have_shown(tmp_path: Path) -> None:
    model = load_axis_model(MODEL)
    record = _record(tmp_path, "log", "axis-check", 1, {}, 6.0)
    reach = reach_of(model, [record])
    assert reach.controller.kind == "cascade"
    motions = list(menu(reach))
    assert len(motions) >= 8
    for scenario in motions:
        u = course(scenario).inputs
        assert u[:, 2].min() >= record.rows["load_m"].min() - 1e-4
        assert u[:, 2].max() <= record.rows["load_m"].max() + 1e-4
        assert np.abs(u[:, 3]).max() <= 1.05 * np.abs(record.rows["reference_m_s"]).max()


def test_next_yaml_is_read_back_as_it_was_and_runs(tmp_path: Path) -> None:
    model = load_axis_model(MODEL)
    record = _record(tmp_path, "log", "axis-check", 1, {}, 6.0)
    scenario = next(s for s in menu(reach_of(model, [record])) if s.name == "small-reversals")
    path = tmp_path / "next.yaml"
    path.write_text(next_experiment.text(Plan(scenario, (), (), ())), encoding="utf-8")
    assert load_axis_scenario(path) == scenario
    done = CliRunner().invoke(cli, ["experiment", str(path), "--model", str(MODEL), "--out", str(tmp_path / "run"), "--strict"])
    assert done.exit_code == 0, done.output
    back = load_record(tmp_path / "run" / "axis.mcap")[0]
    alike = imagined(model, scenario, model.parameters(), course(scenario).inputs)
    assert np.max(np.abs(back.rows["load_m"] - alike.rows["load_m"])) < 5e-5


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("travel_mm: [-30, 30]->travel_mm: [-3, 3]", "beyond its limits -3 to 3 mm"),
        ("speed_mm_s: 60,->speed_mm_s: 20,", "beyond its limit of 20 mm/s"),
        ("rate_hz: 500->rate_hz: -1", "rate_hz"),
        ("rest_s: 0.2}->rest_s: 0.2, move: {to_mm: 1, speed_mm_s: 1}}", "a segment is one of move, wave, rest_s"),
        ("axis-scenario/1->scenario/1", "a scenario file, not a motion file of a single axis"),
    ],
)
def test_a_wrong_motion_file_is_refused_with_its_place(tmp_path: Path, change: str, text: str) -> None:
    old, new = change.split("->")
    source = (MOTIONS / "axis-check.yaml").read_text(encoding="utf-8")
    assert old in source
    path = tmp_path / "motion.yaml"
    path.write_text(source.replace(old, new), encoding="utf-8")
    from spsp_ctrl.config.loader import ConfigError

    with pytest.raises(ConfigError) as caught:
        load_axis_scenario(path)
    assert text in str(caught.value)


# the unknown


def test_what_is_left_is_drawn_over_what_orders_it(tmp_path: Path) -> None:
    model = load_axis_model(MODEL)
    one = replica(model, _record(tmp_path, "log", "axis-check", 1, {}, 8.0))
    bench = Bench((one,), ({c: np.ones(len(one.rows(c)), bool) for c in one.channels},), FLOOR)
    place = one.measured["load"][one.rows("ruler")]
    rng = np.random.default_rng(3)
    bump = 8e-6 * np.exp(-(((place - 6e-3) / 2e-3) ** 2)) + 1e-7 * rng.standard_normal(len(place))
    made = sketch(bench, {"ruler": bump}, "ruler")
    assert made is not None
    assert (made.over, made.kind) == ("position", "mean")
    _, at, value, sigma = made.peak
    assert at == pytest.approx(6.0, abs=1.5)
    assert 3e-6 < value < 9e-6
    assert sigma < value
    assert made.explained > 0.3


# velocity mode


def _velocity(path: Path, seed: int, changes: dict[str, float], current: bool = True) -> Record:
    """The bench in velocity mode: the drive's own loop follows a speed, nobody logs a torque."""
    from spsp_ctrl.plant.axis import IN
    from spsp_ctrl.plant.axis_bench import bench_samples

    model = load_axis_model(MODEL)
    u = course(load_axis_scenario(MOTIONS / "axis-identify.yaml")).inputs[:5000].copy()
    u[:, IN.velocity_mode], u[:, IN.command_rad_s] = 1.0, u[:, IN.reference_m_s] / model.travel_per_rad
    p = model.parameters()
    for name, value in changes.items():
        p[model.index(name)] = value
    with AxisLog(path, rate_hz=500.0, controller="none") as log:
        for s in bench_samples(model, u, seed, p=p):
            log.sample(s if current else s._replace(current_a=0.0))
    return load_record(path)[0]


def test_velocity_mode_is_judged_without_a_torque_command(tmp_path: Path) -> None:
    model, changes = load_axis_model(MODEL), {"torque_offset_nm": 8e-3}
    train, clean = _velocity(tmp_path / "t.mcap", 2, changes), _velocity(tmp_path / "c.mcap", 1, {})
    answer: Diagnosis = diagnose(Task(model, (train,), (clean,), (), 1), tmp_path / "m.yaml")
    assert {n for n, _ in answer.effects[0].members} & {"torque_offset", "friction_asymmetry"}
    assert (answer.gap["current"].closed or 0.0) > 0.9
    assert "drive" not in answer.gap
    same = diagnose(Task(model, (_velocity(tmp_path / "s.mcap", 3, {}),), (clean,), (), 1, "find"), tmp_path / "m.yaml")
    assert same.verdict == "nothing-missing"
    assert replica(model, _velocity(tmp_path / "n.mcap", 1, {}, current=False)).channels == ("ruler",)


def test_no_module_of_the_diagnosis_opens_the_truth() -> None:
    for path in (ROOT / "src" / "spsp_ctrl" / "discrepancy").glob("*.py"):
        assert "/truth" not in path.read_text(encoding="utf-8")
