"""The blind exam: same seed same case, answers sealed before the run, points on hand-made diagnoses, a truth that is a machine of its own."""

from __future__ import annotations

import ast
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.recording.reader import read_log
from tools.blind_exam import catalogue, exam, logs, machine, sealing, subject, table
from tools.blind_exam.__main__ import main
from tools.blind_exam.case import SETS, Case, Item, build, draw, recalibration, simulate, visibility
from tools.blind_exam.ledger import Ledger
from tools.blind_exam.physics import STEPS, I, run
from tools.blind_exam.scoring import Share, quantile, score
from tools.blind_exam.sensing import Climate

ROOT = Path(__file__).resolve().parents[2]
NOMINAL = machine.nominal()


def _case(*items: tuple[str, float], controller: str = "cascade", resolver: bool = True, climate: Climate | None = None) -> Case:
    hidden = tuple(Item(name, severity, 7) for name, severity in items)
    return Case("case", "multiple", 5, hidden, climate or Climate(), "training", controller, resolver)


# the truth


def test_it_shares_no_code_with_the_plant() -> None:
    allowed = {"spsp_ctrl", "spsp_ctrl.messages", "spsp_ctrl.recording.axis_writer", "spsp_ctrl.cli.common"}
    for path in (ROOT / "tools" / "blind_exam").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names] if isinstance(node, ast.Import) else []
            assert {name for name in names if name.startswith("spsp_ctrl")} <= allowed, path.name


def test_half_the_step_gives_the_same_machine() -> None:
    case = _case()
    record = simulate(case, NOMINAL, NOMINAL, "held_out", 31)
    finer = run(NOMINAL, np.array(record.law), True, np.zeros(1), np.column_stack(record.motion.inputs), _noise(case), 0.0, 2 * STEPS)
    assert np.std(finer[:, 4] - record.rows[:, 4]) < 2e-7
    assert np.std(finer[:, 1] - record.rows[:, 1]) < 5e-3


def _noise(case: Case) -> Any:
    from tools.blind_exam import motions, sensing

    return sensing.draw(motions.CYCLES, case.climate, np.random.default_rng([case.seed, 31]))


def test_a_machine_at_rest_stays_there_and_a_load_within_friction_does_not_move_it() -> None:
    law = np.array(machine.cascade(NOMINAL))
    still = np.zeros((2000, 6))
    still[:, 4:] = 20.0
    still[500:, 2] = 10.0
    rows = run(NOMINAL, law, False, np.zeros(2000), still, np.zeros((2000, 6)), 0.0, STEPS)
    assert np.max(np.abs(rows[:500, 5])) < 1e-4  # the thermal offset and the small ripple lean on the bristles
    assert 1e-4 < np.max(np.abs(rows[:, 5])) < 0.05  # bristles give, the screw does not turn
    assert np.max(np.abs(rows[:, 4])) < NOMINAL[I.gap] + 2e-5


def test_current_at_steady_speed_pays_for_the_friction() -> None:
    p = NOMINAL.copy()
    p[[I.cogging, I.ripple, I.load_factor, I.tiny, I.viscous, I.guide_viscous]] = 0.0
    record = simulate(_case(), p, p, "poor", 31)
    speed = np.gradient(record.rows[:, 5]) * 500
    forth = (speed > 15) & (np.gradient(speed) ** 2 < 1e-2)
    ratio = p[I.lead] / (2 * np.pi * p[I.gear])
    expected = p[I.coulomb] + (p[I.static] - p[I.coulomb]) * np.exp(-((speed[forth] / p[I.stribeck_speed]) ** 2))
    expected += (p[I.guide_coulomb] + 40.0) * ratio  # 40 N stand against positive travel in this motion
    assert np.median(record.rows[forth, 1] * p[I.torque_constant]) == pytest.approx(np.median(expected), rel=0.03)


@pytest.mark.parametrize("name", [*catalogue.LIBRARY, *catalogue.OUTSIDE])
def test_every_effect_can_be_seen_when_it_is_large_and_weighs_more_the_larger_it_is(name: str) -> None:
    moved = []
    without, again = (_held_out(_case(), seed) for seed in (31, 32))
    floor = np.sqrt(np.mean((without - again) ** 2, axis=0) / 2)
    for severity in (0.03, 3.0):
        change = np.sqrt(np.mean((_held_out(_case((name, severity)), 31) - without) ** 2, axis=0))
        moved.append(np.max(change / floor))
    assert moved[1] >= 1.5
    assert moved[0] < moved[1]


@cache
def _held_out(case: Case, seed: int) -> Any:
    return simulate(case, build(case, NOMINAL)[0], NOMINAL, "held_out", seed).rows[:, [0, 1, 2, 3, 7]]


def test_visibility_is_what_taking_away_moves() -> None:
    shown = visibility(_case(("backlash", 1.0), ("guide_slope", 0.3)), NOMINAL)
    assert shown[1]["resolver"] == shown[1]["current_a"] == 0.0  # the ruler alone sees it
    assert shown[1]["load_m"] > 1.5
    assert shown[0]["load_m"] > 1.5


def test_what_is_always_on_stays_below_the_floor() -> None:
    case = _case()
    quiet = NOMINAL.copy()
    quiet[I.tiny] = 0.0
    a, b, again = (simulate(case, p, NOMINAL, "held_out", seed) for p, seed in ((NOMINAL, 31), (quiet, 31), (NOMINAL, 32)))
    for column in (0, 1):
        floor = np.sqrt(np.mean((a.rows[:, column] - again.rows[:, column]) ** 2) / 2)
        assert np.sqrt(np.mean((a.rows[:, column] - b.rows[:, column]) ** 2)) < 3 * floor


# the log


@pytest.mark.parametrize("resolver", [True, False])
def test_the_logged_controller_is_replayed_to_the_bit(tmp_path: Path, resolver: bool) -> None:
    case = _case(("backlash", 1.0), resolver=resolver)
    record = simulate(case, build(case, NOMINAL)[0], NOMINAL, "training", 21)
    logs.write(tmp_path / "run.mcap", record, "cascade")
    data = read_log(tmp_path / "run.mcap")
    rows = data.topics["/axis"]
    again = logs.replay(record.law, rows["resolver_counts"].astype(float), rows["load_m"], rows["reference_m"], rows["reference_m_s"])
    assert np.array_equal(again, rows["command_a"])
    assert np.ptp(rows["command_a"]) > 0.5
    assert "controller.yaml" in data.attachments
    assert [e["text"] for e in data.events if e["id"] == "motion"][-2:] == ["repeat", "repeat"]
    assert data.metadata["run"]["kind"] == "axis"


def test_the_training_motion_has_six_speeds_both_ways_and_equal_laps() -> None:
    record = simulate(_case(), NOMINAL, NOMINAL, "training", 21)
    rate, events = record.motion.inputs.reference_m_s, record.motion.events
    at = {name: cycle for cycle, name in reversed(events)}
    ladder = rate[at["ladder"] : at["reversals"]]
    for sign in (1, -1):
        flat = np.round(sign * ladder[1:][(np.abs(np.diff(ladder)) < 1e-9) & (sign * ladder[1:] > 1e-4)], 4)
        assert len(np.unique(flat)) >= 6
    laps = [cycle for cycle, name in events if name == "repeat"]
    size = laps[1] - laps[0]
    assert np.max(np.abs(rate[laps[0] : laps[1]] - rate[laps[1] : laps[1] + size])) < 1e-3


# the draw


@given(st.sampled_from(SETS), st.integers(0, 1000), st.integers(0, 400))
def test_same_seed_same_case(group: str, seed: int, index: int) -> None:
    assert draw(group, seed, index) == draw(group, seed, index)


def test_same_seed_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        exam.write_logs(draw("multiple", 3, 1), NOMINAL, tmp_path / name)
    assert all((tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in ("train.mcap", "commissioning.mcap", "held-out.mcap"))


def test_one_round_of_the_single_set_meets_every_effect_at_every_severity() -> None:
    grid = len(catalogue.LIBRARY) * len(catalogue.SEVERITIES)
    drawn = {(c.items[0].name, c.items[0].severity) for c in (draw("single", 4, i) for i in range(grid))}
    assert len(drawn) == grid


def test_a_case_says_when_it_is_mere_calibration() -> None:
    assert recalibration(_case(("coulomb_friction", 0.03)), machine.nominal(), 0) in (True, False)
    assert not recalibration(_case(("coulomb_friction", 3.0)), NOMINAL, 0)
    assert not recalibration(_case(("zero_offset", 0.03)), NOMINAL, 0)


# the seal


def test_an_answer_is_closed_until_the_diagnosis_is_there(tmp_path: Path) -> None:
    digest = sealing.seal(tmp_path, "c", {"hidden": ["backlash"]}, "salt")
    assert digest in (tmp_path / "published.jsonl").read_text()
    with pytest.raises(sealing.SealError, match="no diagnosis yet"):
        sealing.unseal(tmp_path, "c", tmp_path / "diagnosis.json")
    (tmp_path / "diagnosis.json").write_text("{}")
    assert sealing.unseal(tmp_path, "c", tmp_path / "diagnosis.json") == {"hidden": ["backlash"]}
    (tmp_path / "sealed" / "c.json").write_text((tmp_path / "sealed" / "c.json").read_text().replace("backlash", "presliding"))
    with pytest.raises(sealing.SealError, match="not the one"):
        sealing.unseal(tmp_path, "c", tmp_path / "diagnosis.json")


# the points

BACKLASH = {
    "effect": "backlash", "severity": 1.0, "stage": "transmission", "values": {"gap": 20e-6}, "floors": {"load_m": 9.0},
    "detectable": True, "recalibration": False,
}  # fmt: skip
OFFSET = {**BACKLASH, "effect": "torque_offset", "stage": "drive", "values": {"torque_offset": 3e-3}}
GAP = {"ruler": {"closed": 0.97}, "drive": {"closed": None}}
FAINT = {**OFFSET, "effect": "presliding", "detectable": False}


def _diagnosis(tmp_path: Path, *named: dict[str, Any], verdict: str = "explained", unexplained: int = 0) -> subject.Finding:
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps({"verdict": verdict, "effects": named, "unexplained": [{}] * unexplained, "gap": GAP}))
    return subject.read(path)


def _name(effect: str, stage: str = "transmission", members: tuple[str, ...] = (), **values: tuple[float, str, float]) -> dict[str, Any]:
    parameters = {name: {"value": v, "unit": unit, "sigma": sigma} for name, (v, unit, sigma) in values.items()}
    return {"name": effect, "class": [{"name": m, "weight": 0.5} for m in members], "stage": stage, "parameters": parameters}


def test_a_right_name_gets_its_points(tmp_path: Path) -> None:
    row = score({"group": "single", "hidden": [BACKLASH]}, _diagnosis(tmp_path, _name("backlash", gap=(21.0, "um", 0.6))))
    assert row["first_right"]
    assert row["where_right"]
    assert row["exact"]
    assert row["errors"] == pytest.approx([0.05])
    assert row["inside"] == [True]
    assert row["worst_closed"] == 0.97


def test_a_twin_is_right_and_a_stranger_is_not(tmp_path: Path) -> None:
    answer = {"group": "single", "hidden": [OFFSET]}
    assert score(answer, _diagnosis(tmp_path, _name("friction_asymmetry", "drive")))["first_right"]
    assert score(answer, _diagnosis(tmp_path, _name("cogging", members=("torque_offset",))))["first_right"]
    row = score(answer, _diagnosis(tmp_path, _name("backlash")))
    assert not row["first_right"]
    assert row["precision"] == [0, 1]
    assert not row["exact"]


def test_several_effects_are_counted_on_what_can_be_seen(tmp_path: Path) -> None:
    answer = {"group": "multiple", "hidden": [BACKLASH, OFFSET, FAINT]}
    row = score(answer, _diagnosis(tmp_path, _name("backlash"), _name("drive_lag")))
    assert row["recall"] == [1, 2]
    assert row["precision"] == [1, 2]
    assert not row["exact"]
    assert score(answer, _diagnosis(tmp_path, _name("backlash"), _name("torque_offset"), _name("presliding")))["exact"]


def test_nothing_outside_twins_and_poor(tmp_path: Path) -> None:
    assert score({"group": "nothing", "hidden": []}, _diagnosis(tmp_path, _name("backlash")))["any_name"]
    outside = {"group": "outside", "hidden": [{**OFFSET, "effect": "quadratic_drag"}]}
    assert score(outside, _diagnosis(tmp_path, _name("stribeck_friction")))["misnamed"]
    flagged = score(outside, _diagnosis(tmp_path, _name("stribeck_friction"), verdict="partly-explained"))
    assert (flagged["flagged"], flagged["misnamed"], flagged["attracted"]) == (True, False, True)
    assert score(outside, _diagnosis(tmp_path, unexplained=1))["flagged"]
    twins = {"group": "twins", "hidden": [OFFSET]}
    assert not score(twins, _diagnosis(tmp_path, _name("torque_offset", "drive")))["as_class"]
    assert score(twins, _diagnosis(tmp_path, _name("torque_offset", "drive", ("friction_asymmetry",))))["as_class"]
    poor = {"group": "poor", "hidden": [BACKLASH]}
    assert score(poor, _diagnosis(tmp_path))["poor_ok"]
    assert not score(poor, _diagnosis(tmp_path, _name("torque_offset")))["poor_ok"]


def test_wilson() -> None:
    low, high = Share(97, 97).interval
    assert low == pytest.approx(0.962, abs=5e-4)  # the printed interval of 97 of 97
    assert high == 1.0
    assert Share(0, 0).interval == (0.0, 1.0)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.floats(0, 1))
def test_quantile_is_one_of_the_values_and_grows(values: list[float], q: float) -> None:
    found = quantile(values, q)
    assert found in values
    assert min(values) <= found <= max(values)  # type: ignore[operator]
    assert quantile(values, 1.0) == max(values)


# the book and the command


def test_the_ledger_resumes_after_a_torn_line_and_pools_one_commit(tmp_path: Path) -> None:
    book = Ledger(tmp_path / "ledger.jsonl")
    for commit, case in (("a", "x"), ("b", "x"), ("a", "y"), ("a", "x")):
        book.append({"commit": commit, "case": case, "settings": "s", "n": len(book.rows)})
    with (tmp_path / "ledger.jsonl").open("a") as stream:
        stream.write('{"commit": "a", "ca')
    again = Ledger(tmp_path / "ledger.jsonl")
    again.append({"commit": "a", "case": "z", "settings": "s", "n": 9})
    again = Ledger(tmp_path / "ledger.jsonl")
    assert again.torn == 1
    assert [r["n"] for r in again.of("a", "s")] == [3, 2, 9]
    assert again.has("b", "x", "s")
    assert not again.has("b", "y", "s")


def test_the_answer_is_published_before_the_program_runs_and_a_crash_stays_in_the_share(tmp_path: Path) -> None:
    seen: list[bool] = []

    def crash(words: list[str]) -> subject.Ran:
        name = Path(words[4]).parent.name
        seen.append((tmp_path / "answers" / name / "published.jsonl").exists())
        assert all(Path(words[i]).exists() for i in (4, 6, 8))
        return subject.Ran(5, 1.0, "internal error")

    row = exam.run_case("single", 2, 0, exam.Settings(machine.MODEL, tmp_path), crash)
    assert seen == [True]
    assert row["failed"] == "internal error"
    assert not row["first_right"]
    assert not table.good(row)
    assert not list((tmp_path / "cases").rglob("*.mcap"))


def test_a_right_diagnosis_of_a_fixed_draw_is_scored_as_one(tmp_path: Path) -> None:
    """A program that knows the answer (read here from the draw, not from the seal) gets full marks."""

    def knows(words: list[str]) -> subject.Ran:
        group, seed, index = Path(words[4]).parent.name.split("-")
        nominal = machine.nominal(machine.MODEL)
        hidden = build(draw(group, int(seed), int(index)), nominal)[1]
        named = [_name(h.effect, h.stage, **{k: (v, "1", 1e-9) for k, v in h.values.items()}) for h in hidden]
        out = Path(words[words.index("--out") + 1])
        out.mkdir()
        (out / "diagnosis.json").write_text(json.dumps({"verdict": "explained", "effects": named, "unexplained": [], "gap": GAP}))
        return subject.Ran(0, 2.0, "")

    settings = exam.Settings(machine.MODEL, tmp_path)
    rows = [exam.run_case(group, 1, index, settings, knows) for group, index in (("single", 0), ("multiple", 0), ("nothing", 1))]
    assert all(table.good(row) for row in rows)
    text = table.text(rows)
    assert "single: first name right, of detectable" in text
    assert all(f"| {effect} " in text for effect in catalogue.LIBRARY)
    assert text.count("not drawn") == len(catalogue.LIBRARY) * len(catalogue.SEVERITIES) - 1


def test_the_command_refuses_a_model_that_is_not_there(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["--model", str(tmp_path / "no.yaml"), "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert "no.yaml: there is no such model file" in done.stderr
