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
from tools.blind_exam import bench, catalogue, exam, logs, machine, sealing, subject, table
from tools.blind_exam.__main__ import main
from tools.blind_exam.case import SETS, Case, Item, build, draw, recalibration, simulate, visibility
from tools.blind_exam.ledger import Ledger
from tools.blind_exam.look_alike import likeness
from tools.blind_exam.physics import STEPS, I, run
from tools.blind_exam.scoring import Share, error, quantile, resolved, score
from tools.blind_exam.sensing import Climate

ROOT = Path(__file__).resolve().parents[2]
NOMINAL = machine.nominal()


def _case(*items: tuple[str, float], controller: str = "cascade", resolver: bool = True, climate: Climate | None = None) -> Case:
    hidden = tuple(Item(name, severity, 7) for name, severity in items)
    return Case("case", "multiple", 5, hidden, climate or Climate(), "training", controller, resolver)


# the truth


def test_it_shares_no_code_with_the_plant() -> None:
    axis = {"spsp_ctrl", "spsp_ctrl.messages", "spsp_ctrl.recording.axis_writer", "spsp_ctrl.cli.common"}
    # the whole rig is run by the real law in a real session: everything but the plant
    rig = axis | {"spsp_ctrl.config.loader", "spsp_ctrl.config.rig", "spsp_ctrl.config.scenario", "spsp_ctrl.experiments", "spsp_ctrl.rig.base"}
    for path in (ROOT / "tools" / "blind_exam").glob("*.py"):
        allowed = rig if path.name in ("platform.py", "platform_rig.py") else axis
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names] if isinstance(node, ast.Import) else []
            assert {name for name in names if name.startswith("spsp_ctrl")} <= allowed | {"spsp_ctrl.recording.reader"}, path.name


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
    rows = run(NOMINAL, law, False, np.zeros(2000), still, np.zeros((2000, 7)), 0.0, STEPS)
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


# the machine of every case


@pytest.mark.parametrize("group", SETS)
def test_numbers_are_off_by_a_few_per_cent_and_small_faults_are_always_on(group: str) -> None:
    off = []
    for index in range(6):
        p = build(draw(group, 3, index), NOMINAL, clean=True)[0]
        assert p[I.tiny] == 1.0
        share = np.array([p[getattr(I, name)] / NOMINAL[getattr(I, name)] - 1.0 for name in machine.JITTERED if NOMINAL[getattr(I, name)] != 0.0])
        assert np.max(np.abs(share)) <= 0.0501
        off.append(np.sqrt(np.mean(share**2)))
    assert 0.02 < np.mean(off) < 0.05


def test_nothing_hidden_meets_lost_cycles_held_readings_and_jitter(tmp_path: Path) -> None:
    climates = [draw("nothing", 1, index).climate for index in range(8)]
    assert len(set(climates)) == 8
    case = next(draw("nothing", 1, i) for i, c in enumerate(climates) if c.lost and c.held)
    record = simulate(case, build(case, NOMINAL)[0], NOMINAL, "held_out", 31)
    logs.write(tmp_path / "run.mcap", record, "cascade")
    rows = read_log(tmp_path / "run.mcap").topics["/axis"]
    assert 0.002 < 1.0 - len(rows) / len(record.rows) < 0.01
    assert (np.diff(rows["cycle"]) > 1).any()
    shaky = next(draw("nothing", 1, i) for i, c in enumerate(climates) if c.jitter and not c.lost)
    logs.write(tmp_path / "shaky.mcap", simulate(shaky, build(shaky, NOMINAL)[0], NOMINAL, "held_out", 31), "cascade")
    spread = np.std(np.diff(read_log(tmp_path / "shaky.mcap").topics["/axis"]["stamp_ns"])) / 2e6
    assert 0.02 < spread < 0.08


# twins and their bench


def test_look_alikes_are_checked_from_the_truth_alone() -> None:
    """A small lag is a delay to this loop; a warm screw is a shifted zero; an offset is not a coarse friction."""
    small = likeness(_twin("drive_lag", 0.3), NOMINAL)
    assert small is not None
    assert small.name == "command_delay"
    assert small.apart < 1.5
    assert likeness(_twin("backlash", 1.0), NOMINAL) is None


def _twin(name: str, severity: float) -> Case:
    return _case((name, severity))._replace(group="twins", training="plain", held_out="plain_held_out")


def test_the_bench_runs_a_motion_file_as_the_program_means_it(tmp_path: Path) -> None:
    from spsp_ctrl.plant.axis_scenario import course, load_axis_scenario  # the test may know both sides, the exam does not

    for name in ("axis-identify", "axis-check"):
        path = ROOT / "config" / "motions" / f"{name}.yaml"
        motion, law = bench.read(path, NOMINAL)
        u = course(load_axis_scenario(path)).inputs
        wanted = motion.inputs
        for column, mine in ((2, wanted.reference_m), (3, wanted.reference_m_s), (6, wanted.load_force_n), (8, wanted.screw_c)):
            assert np.max(np.abs(u[:, column] - mine)) < 1e-12
        assert law.kp_1_s == 21.991
    far = tmp_path / "far.yaml"
    far.write_text((ROOT / "config" / "motions" / "axis-check.yaml").read_text().replace("to_mm: 21.0", "to_mm: 60.0"))
    with pytest.raises(bench.BenchError, match="beyond the stroke"):
        bench.read(far, NOMINAL)


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
GAP = {
    "ruler": {"closed": 0.97, "floor": 1e-7, "before": 1e-6},
    "drive": {"closed": None, "floor": 5e-3, "before": 5e-3},
    "current": {"closed": -3.0, "floor": 5e-3, "before": 5.9e-3},  # no gap: 1.18 floors
}
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
    twins = {"group": "twins", "hidden": [OFFSET], "twin": {"name": "friction_asymmetry", "apart": 0.7}}
    parted = twins | {"twin": {"name": "friction_asymmetry", "apart": 7.0}}
    alone = _diagnosis(tmp_path, _name("torque_offset", "drive"))
    assert not score(twins, alone)["twin_ok"]
    assert score(parted, alone)["twin_ok"], "the truth itself parts them, so the right one may stand alone"
    assert resolved(twins, alone)
    both = _diagnosis(tmp_path, _name("torque_offset", "drive", ("friction_asymmetry",)))
    assert score(twins, both)["as_class"]
    assert score(twins, both)["twin_ok"]
    assert not resolved(twins, both)
    wrong = _diagnosis(tmp_path, _name("friction_asymmetry", "drive"))
    assert not score(parted, wrong)["twin_ok"]
    assert not resolved(twins, wrong)
    poor = {"group": "poor", "hidden": [BACKLASH]}
    assert score(poor, _diagnosis(tmp_path))["poor_ok"]
    assert not score(poor, _diagnosis(tmp_path, _name("torque_offset")))["poor_ok"]


def test_a_sign_that_is_a_convention_costs_nothing(tmp_path: Path) -> None:
    named = _diagnosis(tmp_path, _name("cogging", "drive", cogging=(-2.0e-3, "N m", 1e-5), gap=(-2.0, "um", 0.1))).named[0]
    assert error({"cogging": 2.0e-3}, named) == pytest.approx(0.0)
    assert error({"gap": 2.0e-6}, named) == pytest.approx(2.0)


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
    # no row left out: 5 severities of every effect, and of the line of all of them; one was drawn
    assert text.count("not drawn") == (len(catalogue.LIBRARY) + 1) * len(catalogue.SEVERITIES) - 2
    assert "1/1 [0.21, 1.00]" in text


def test_the_command_refuses_a_model_that_is_not_there(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["--model", str(tmp_path / "no.yaml"), "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert "no.yaml: there is no such model file" in done.stderr


def test_a_fixed_draw_goes_through_the_whole_program(tmp_path: Path) -> None:
    """The exam as it is, small: one strong effect and one machine with nothing hidden, diagnosed by the command."""
    settings = exam.Settings(machine.MODEL, tmp_path)
    hidden = exam.run_case("single", 1, 1, settings)
    assert hidden["hidden"][0]["effect"] == "periodic_lead_error"
    assert "failed" not in hidden, hidden
    assert hidden["first_right"], hidden["named"]
    clean = exam.run_case("nothing", 1, 1, settings)
    assert "failed" not in clean, clean
    assert not clean["any_name"], clean["named"]
