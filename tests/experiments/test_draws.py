"""What an experiment draws: the same from a seed whatever else is run, within its ranges and within the rig, and nothing that must not move."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.cli import cli
from spsp_ctrl.config.drawn import DrawnPlant, DrawnSea
from spsp_ctrl.config.loader import ConfigError, load_rig, load_scenario
from spsp_ctrl.config.scenario import Dropout, Scenario
from spsp_ctrl.experiments import catalogue, draws, runner
from spsp_ctrl.experiments.cases import Case, expand
from spsp_ctrl.experiments.margins import margin_rows
from spsp_ctrl.experiments.summary import look_up
from spsp_ctrl.experiments.variation import vary
from spsp_ctrl.plant.effects import BY_NAME
from spsp_ctrl.plant.model import load_model

CONFIG = Path(__file__).parents[2] / "config"
RIG_FILE = CONFIG / "rig.yaml"
RIG = load_rig(RIG_FILE)
MODEL = load_model(CONFIG / "model.yaml")
UNSEEN = load_scenario(CONFIG / "experiments" / "unseen.yaml")


def cases_of(name: str, seed: int | None = None, repeats: int | None = None, only: tuple[str, ...] = ()) -> list[Case]:
    return list(runner.load(catalogue.find(name, RIG_FILE), RIG, seed, repeats, only).cases)


def test_the_seed_of_the_unseen_motions_is_made_from_the_commit_and_can_be_given() -> None:
    seed, source = draws.commit_seed()
    assert draws.commit_seed() == (seed, source)
    experiment = runner.load(catalogue.find("unseen", RIG_FILE), RIG)
    assert (experiment.seed, experiment.seed_from) == (seed, source)
    assert {c.seed for c in experiment.cases} == {seed}
    assert {c.seed for c in cases_of("unseen", seed=7)} == {7}


def test_outside_a_repository_the_seed_comes_from_the_law(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(draws, "ROOT", tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    seed, source = draws.commit_seed()
    assert source.startswith("version")
    assert 0 <= seed < 2**31


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 2**31 - 1))
def test_unseen_motions_are_within_their_ranges_and_the_rig(seed: int) -> None:
    for variant in UNSEEN.model.variants:
        scenario, changes, _ = draws.draw(variant.drawn, variant.name, seed, UNSEEN.model, RIG.model, MODEL)
        plan = variant.drawn.motion
        assert plan is not None
        assert not changes
        assert scenario.base.axis_order in plan.axis_order
        for axis in ("pitch", "roll"):
            for sine, span in zip(getattr(scenario.base, axis), getattr(plan, axis), strict=True):
                assert span.amplitude_deg[0] <= sine.amplitude_deg <= span.amplitude_deg[1]
                assert span.period_s[0] <= sine.period_s <= span.period_s[1]
        table_seed = int(np.random.SeedSequence(seed).spawn(2)[0].generate_state(1)[0])
        assert draws.beyond(scenario.base, scenario, RIG.model, table_seed) == ""


def test_at_least_one_unseen_motion_is_fast_and_six_are_played() -> None:
    cases = cases_of("unseen", seed=3)
    assert len(cases) >= 6
    periods = [s.period_s for c in cases for axis in (c.scenario.base.pitch, c.scenario.base.roll) for s in axis]
    assert min(periods) <= 3.0
    assert {c.scenario.base.axis_order for c in cases} == {"roll_pitch", "pitch_roll"}
    assert any(c.scenario.base.sea.roll for c in cases)


def test_a_motion_that_the_rig_cannot_follow_is_refused_with_the_line(tmp_path: Path) -> None:
    path = tmp_path / "wild.yaml"
    path.write_text(
        "schema: spsp-ctrl/scenario/1\nname: wild\nvariants:\n  - name: a\n"
        "    drawn: {motion: {roll: [{amplitude_deg: [18, 20], period_s: [0.5, 0.6]}]}}\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match=r"wild.yaml:5:5: a, seed 1: none of 300 drawn motions fits the rig; the last: "):
        expand(load_scenario(path), RIG, MODEL)


def test_a_range_the_wrong_way_round_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(
        "schema: spsp-ctrl/scenario/1\nname: wrong\nvariants:\n  - name: a\n"
        "    drawn: {motion: {roll: [{amplitude_deg: [9, 4], period_s: [5, 6]}]}}\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match="the first number of a range \\(9\\) must not be above the second"):
        load_scenario(path)


def test_every_number_of_the_model_is_drawn_or_has_its_reason() -> None:
    factors, phases = draws.drawable(MODEL)
    drawn = {*factors, *phases}
    for section in ("actuator", "rig"):
        for key, quantity in getattr(MODEL.file, section).items():
            name = f"{section}.{key}"
            assert (name in drawn) + (name in draws.NEVER_DRAWN) + (quantity.value == 0.0) == 1, name
    for entry in MODEL.file.effects:
        for key, quantity in entry.parameters.items():
            named = {f"effects.{entry.effect}.{key}", f"effects.{entry.effect}.{entry.axis}.{key}"}
            assert bool(named & drawn) + bool(named & draws.NEVER_DRAWN.keys()) + (quantity.value == 0.0) == 1, named
    assert all(name.split(".")[0] in ("actuator", "rig") or name.split(".")[1] in BY_NAME for name in draws.NEVER_DRAWN)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31 - 1), st.sampled_from([10.0, 30.0]))
def test_a_drawn_plant_stays_within_its_tolerance(seed: int, percent: float) -> None:
    plan = DrawnPlant(within_percent=percent, keep=("actuator.torque_constant",))
    changes = draws.draw_plant(plan, MODEL, draws.generator(seed, "x"))
    before, after = MODEL.parameters(), vary(MODEL, changes).parameters()
    ratio = after[before != 0.0] / before[before != 0.0]
    phases = [c for c in changes.values() if c.value is not None]
    outside = np.abs(ratio - 1.0) > 0.01 * percent + 1e-9
    # a phase of the actuators stands in the list once for each leg
    assert outside.sum() <= 2 * len(phases)
    assert (after[before == 0.0] == 0.0).all()
    assert "actuator.torque_constant" not in changes
    with pytest.raises(draws.DrawError, match="az_teeth"):
        draws.draw_plant(DrawnPlant(within_percent=percent, keep=("rig.az_teeth",)), MODEL, draws.generator(seed, "x"))


def test_a_draw_does_not_depend_on_what_else_is_run() -> None:
    many = cases_of("monte-carlo", seed=5, repeats=4)
    assert sum(c.variant == "within 30 percent" for c in many) == 4
    assert sum(c.variant.startswith("within 10 percent") for c in many) == 6
    third = next(c for c in many if c.variant == "within 30 percent" and c.repeat == 2)
    (alone,) = cases_of("monte-carlo", seed=third.seed, repeats=1, only=("within 30 percent",))
    assert (alone.model_text, alone.scenario, alone.drawn) == (third.model_text, third.scenario, third.drawn)
    assert len({c.model_text for c in many}) == len(many)


def test_what_stands_out_is_found_again_in_draws_with_one_cause() -> None:
    rng = np.random.Generator(np.random.PCG64(1))
    many = [{"factors": {n: float(rng.uniform(0.7, 1.3)) for n in "abcde"}} for _ in range(40)]
    errors = [0.5 + 2.0 * abs(one["factors"]["c"] - 0.7) for one in many]
    worst = int(np.argmax(errors))
    name, factor, adds = draws.standing_out(many[worst], many, errors)[0]
    assert name == "c"
    assert factor == many[worst]["factors"]["c"]
    assert adds > 0.3
    few = draws.standing_out(many[0], many[:3], errors[:3], count=1)
    assert few[0][0] == max(many[0]["factors"], key=lambda n: abs(np.log(many[0]["factors"][n])))


def test_silences_begin_at_forty_phases_of_the_swing() -> None:
    cases = [c for c in cases_of("robustness") if c.variant.startswith("50 ms without IMU")]
    period = 8.0
    starts = [start for c in cases for d in c.scenario.dropouts for start, _ in d.spans_s]
    ends = [end for c in cases for d in c.scenario.dropouts for _, end in d.spans_s]
    assert len({round((start % period) / (period / 40), 3) for start in starts}) == len(starts) == 40
    assert all(end < c.scenario.duration_s for c in cases for d in c.scenario.dropouts for _, end in d.spans_s)
    assert max(np.array(ends) - np.array(starts)) == pytest.approx(0.05)
    with pytest.raises(ValueError, match="every_s"):
        Dropout(at_s=1.0, duration_s=0.5, count=2, every_s=0.5)


def test_a_drawn_sea_is_not_the_same_twice_and_has_its_rms() -> None:
    plan = DrawnSea(rms_deg=(2.0, 4.0), period_s=(6.0, 9.0))
    a, b = (draws._sea(plan, draws.generator(seed, "sea")) for seed in (1, 2))
    assert a != b
    assert all(2.0 <= s.rms_deg <= 4.0 and len(s.lines) == plan.lines for s in (a, b))


def test_the_ladder_has_every_rung_on_every_motion_and_its_margins() -> None:
    cases = cases_of("ladder")
    rungs, motions = {c.variant for c in cases}, {c.motion for c in cases}
    assert len(cases) == len(rungs) * len(motions) == 48
    rows = margin_rows([c for c in cases if c.variant[0] in "067"])
    assert {(r.axis, r.at) for r in rows} == {(axis, at) for axis in ("pitch", "roll") for at in ("current", "imu", "resolver")}
    found = {r.variant[0]: r.margins for r in rows if (r.axis, r.at) == ("roll", "imu")}
    assert all(m is not None and m["phase_deg"] is not None and m["phase_deg"] > 20.0 for m in found.values())
    assert found["0"] != found["6"]


STUDY = """schema: spsp-ctrl/scenario/1
name: study
duration_s: 4.0
settle_s: 3.0
laws: [stabiliser]
motions:
  - {name: still}
  - {name: swing, scenario: {base: {roll: [{amplitude_deg: 3.0, period_s: 4.0}]}}}
variants:
  - {name: source, drawn: {plant: {within_percent: 10}}, repeats: 1}
  - {name: taker, identified: {imu.delay_ms: {variant: source, value: settle_s}}}
figures: [draws, ladder]
acceptance:
  - {name: swing only, value: error_arcmin.roll.imu_max, motion: swing, limit: 100.0}
"""


def test_motions_draws_and_identified_values_in_one_run_whatever_the_number_of_jobs(tmp_path: Path) -> None:
    file = tmp_path / "study.yaml"
    file.write_text(STUDY, encoding="utf-8")
    found = []
    for jobs in ("1", "2"):
        out = tmp_path / jobs
        more = ["--out", str(out), "-j", jobs, "--json", "--no-logs", "--seed", "9"]
        done = CliRunner().invoke(cli, ["experiment", str(file), "-c", str(RIG_FILE), *more])
        assert done.exit_code == 0, done.output
        found.append(json.loads(done.stdout))
    one, two = found
    drop = ("timing_us", "realtime_granted")
    for a, b in zip(one["runs"], two["runs"], strict=True):
        for key in drop:
            a["figures"].pop(key), b["figures"].pop(key)
        assert a == b
    assert [r["key"] for r in one["runs"]] == [f"{v}/{m}/stabiliser-1" for v in ("source", "taker") for m in ("still", "swing")]
    assert one["runs"][2]["identified"] == {"imu.delay_ms": 3.0}
    assert one["acceptance"][0]["by_law"]["stabiliser"]["at"].split("/")[1] == "swing"
    page = (tmp_path / "1" / "report.html").read_text(encoding="utf-8")
    assert "Margins" in page
    assert "10.0" not in str(look_up(one["runs"][0]["drawn"], "factors"))


def test_a_variant_that_does_not_exist_and_a_source_that_does_not_are_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(cli, ["experiment", "monte-carlo", "-c", str(RIG_FILE), "--variant", "within 30 percnt", "--out", str(tmp_path / "o")])
    assert done.exit_code == 2
    assert "did you mean 'within 30 percent'?" in done.output
    taker = {"name": "a", "identified": {"imu.delay_ms": {"variant": "b", "value": "settle_s"}}}
    with pytest.raises(ValueError, match="no variant with given values"):
        Scenario.model_validate({"schema": "spsp-ctrl/scenario/1", "name": "x", "variants": [taker]})


def test_one_unseen_motion_and_one_drawn_plant_are_held(tmp_path: Path) -> None:
    (fast,) = cases_of("unseen", seed=11, only=("fast roll",))
    (plant,) = cases_of("monte-carlo", seed=11, repeats=1, only=("within 30 percent",))
    for case, most in ((fast, 1.5), (plant, 1.2)):
        short = replace(case, scenario=case.scenario.model_copy(update={"duration_s": 14.0}))
        result = runner.run_case(short, tmp_path / case.key, keep_log=False)
        assert result.ended == "completed"
        error = look_up(result.figures, "error_arcmin.worst.imu_max")
        assert error is not None
        assert 0.1 < error <= most
