"""The platform half of a diagnosis: on logs of short sessions of the real law, with the virtual rig of which one thing was changed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.sessions import CONFIG, RIG, scenario

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.discrepancy import platform_library as names
from spsp_ctrl.discrepancy import platform_noise as noise
from spsp_ctrl.discrepancy import platform_pipeline as pipeline
from spsp_ctrl.discrepancy.platform_gate import judge_law, judge_values, replayed
from spsp_ctrl.discrepancy.platform_records import TOPICS, load_platform
from spsp_ctrl.discrepancy.platform_replica import UNITS, derivatives, platform_replica
from spsp_ctrl.discrepancy.platform_writing import platform_document, writable
from spsp_ctrl.experiments import session
from spsp_ctrl.experiments.session import Plan
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, A, G
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.recording.reader import LogError

MODEL = CONFIG / "model.yaml"
LIKELY = ("zero_offset@pitch", "zero_offset@roll", "backlash@pitch", "backlash@roll", "coulomb_friction@roll", "torque_offset@roll", "imu_scale@imu")


def run(folder: Path, model: Path, seed: int) -> Path:
    """Ten seconds of a brisk swing."""
    folder.mkdir(parents=True)
    base = {"pitch": [{"amplitude_deg": 6.0, "period_s": 3.0}], "roll": [{"amplitude_deg": 8.0, "period_s": 4.0}], "start_s": 0.5, "ramp_s": 1.0}
    plan = Plan(load_rig(RIG).model, scenario(duration_s=10.0, base=base), model, seed, False)
    return session.run_session(plan, session.prepare(plan), folder).folder / session.LOG_NAME


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A log of the rig as designed, and one with far more play in the roll screw."""
    folder = tmp_path_factory.mktemp("platform")
    raw = yaml.safe_load(MODEL.read_text(encoding="utf-8"))
    at = next(i for i, e in enumerate(raw["effects"]) if e["effect"] == "backlash")
    gap = {"pitch": 12.0, "roll": 45.0}
    raw["effects"][at : at + 1] = [{"effect": "backlash", "axis": a, "parameters": {"gap": {"value": v, "unit": "um"}}} for a, v in gap.items()]
    loose = folder / "loose.yaml"
    loose.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
    return run(folder / "designed", MODEL, 3), run(folder / "loose", loose, 4)


def test_the_model_that_made_a_log_leaves_only_noise(logs: tuple[Path, Path]) -> None:
    one = platform_replica(load_model(MODEL), load_platform(logs[0]))
    left = one.residuals(load_model(MODEL).parameters())
    assert left.keys() == UNITS.keys()
    assert all(len(v) == len(one.rows(c)) for c, v in left.items())
    arcmin = np.pi / 10800
    for leg in ("pitch", "roll"):
        assert np.std(left[f"imu.{leg}"]) < 0.15 * arcmin
        assert np.std(left[f"current.{leg}"]) < 5e-3


def test_the_law_replays_and_a_wrong_unit_is_not_blamed_on_the_plant(logs: tuple[Path, Path]) -> None:
    record = load_platform(logs[0])
    gate = judge_values(record)
    assert gate.passed
    share, active, same = replayed(record)
    judge_law(gate, (share, active, same))
    assert (share, same, gate.passed) == (0.0, True, True)
    assert active > 1000
    rows = record.data.topics["/measurement"].copy()
    rows["imu.pitch_rad"] *= 180.0 / np.pi
    record.data.topics["/measurement"] = rows
    judge_law(gate, replayed(record))
    assert "the law does not give the recorded commands" in gate.problems[0]


def test_not_a_number_is_said_with_its_cycle(logs: tuple[Path, Path]) -> None:
    record = load_platform(logs[0])
    rows = record.data.topics["/measurement"].copy()
    rows["drive_roll.current_a"][700] = np.nan
    record.data.topics["/measurement"] = rows
    assert judge_values(record).problems == [f"drive_roll.current_a is not a number in 1 cycles, first in cycle {int(rows['cycle'][700])}"]


def test_play_of_one_screw_is_named_where_it_is_and_the_new_file_closes_the_gap(
    logs: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = pipeline.library
    monkeypatch.setattr(pipeline, "library", lambda *a: [c for c in whole(*a) if c.name in LIKELY])
    monkeypatch.setattr(names, "nominal_variables", lambda *a: ())
    task = pipeline.PlatformTask(load_model(MODEL), (load_platform(logs[1]),), (load_platform(logs[0]),), (), 1, jobs=2)
    answer = pipeline.diagnose_platform(task, tmp_path / "model.yaml")
    assert [(e.name, e.where) for e in answer.effects] == [("backlash", "roll")]
    gap = answer.effects[0].parameters["gap"]
    assert gap.value == pytest.approx(45e-6, rel=0.1)
    assert answer.verdict == "explained"
    assert (answer.gap["imu.roll"].closed or 0.0) > 0.8
    found = load_model(tmp_path / "model.yaml").parameters()
    assert found[A.gap_m] == pytest.approx(12e-6)
    assert found[N_AXIS_PARAMETERS + A.gap_m] == pytest.approx(gap.value)


def test_truth_is_never_opened() -> None:
    assert not any("truth" in t for t in TOPICS)


def test_a_log_of_an_axis_or_a_cut_one_is_refused(tmp_path: Path, logs: tuple[Path, Path]) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(logs[0].read_bytes()[:200_000])
    with pytest.raises(LogError, match="not complete"):
        load_platform(cut)


def test_every_name_at_every_place_once() -> None:
    p = load_model(MODEL).parameters()
    made = names.candidates(p, [{}, {}], [(1.0, 2.0, 3.0)] * 2, True)
    assert len({c.name for c in made}) == len(made)
    for name in ("backlash@pitch", "backlash@roll", "azimuth_backlash@azimuth", "imu_bias@imu", "geometric_error@base", "hinge_friction@roll"):
        assert name in {c.name for c in made}
    roll = next(c for c in made if c.name == "backlash@roll")
    assert [v.index for v in roll.variables] == [N_AXIS_PARAMETERS + A.gap_m]


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=60))
def test_cosine_transform_keeps_the_length_of_a_vector(values: list[float]) -> None:
    x = np.array(values)
    assert np.linalg.norm(noise.cosine_transform(x)) == pytest.approx(np.linalg.norm(x), abs=1e-6, rel=1e-9)


def test_noise_like_that_of_the_commissioning_log_is_white_with_variance_one() -> None:
    rng = np.random.default_rng(1)

    def coloured() -> Any:
        return {"imu.pitch": np.convolve(rng.standard_normal(8000), [1.0, 0.8, 0.5], "same")}

    p = np.zeros_like(load_model(MODEL).parameters())
    rates = {"imu.pitch": 200.0}
    first, other = coloured(), coloured()
    white = noise.whitener(other, rates, {"imu.pitch": noise.spectrum(first["imu.pitch"], 200.0)}, p, 1.0)
    lines = white.apply(other)
    for part in np.array_split(lines, 4):
        assert np.mean(part**2) == pytest.approx(1.0, abs=0.15)


def test_a_single_bad_reading_is_bridged_and_a_step_is_not() -> None:
    values = np.concatenate([np.zeros(50), np.ones(50)]) + 1e-3 * np.random.default_rng(2).standard_normal(100)
    values[20] = 40.0
    bad = noise.spikes(values)
    assert list(np.flatnonzero(bad)) == [20]
    assert abs(noise.bridged(values, bad)[20]) < 0.01


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-2.0, 2.0)] * 4))
def test_derivatives_of_a_cubic_are_exact_inside(c: tuple[float, float, float, float]) -> None:
    t = np.arange(400) / 200.0
    _, rate, acceleration = derivatives(c[0] + c[1] * t + c[2] * t**2 + c[3] * t**3, 200.0)
    inside = slice(20, -20)
    assert np.allclose(rate[inside], (c[1] + 2 * c[2] * t + 3 * c[3] * t**2)[inside], atol=1e-6)
    assert np.allclose(acceleration[inside], (2 * c[2] + 6 * c[3] * t)[inside], atol=1e-4)


def test_what_is_written_is_read_back_number_by_number(tmp_path: Path) -> None:
    model = load_model(MODEL)
    p = model.parameters()
    p[N_AXIS_PARAMETERS + A.rotor_inertia_kg_m2] *= 1.03
    p[A.mf_coulomb_nm] = 0.017
    p[N_AXIS_PARAMETERS + A.torque_offset_nm] = 0.004
    p[A.cogging_nm] = -0.001
    p[G.az_gap_rad], p[G.imu_pitch_scale], p[G.plate_ixx_kg_m2] = 2e-3, 0.01, 0.09
    before = MODEL.read_text(encoding="utf-8")
    path = tmp_path / "model.yaml"
    path.write_text(yaml.safe_dump(platform_document(model, writable(p), {A.mf_coulomb_nm: 1e-4}, "test"), sort_keys=False), encoding="utf-8")
    assert np.allclose(load_model(path).parameters(), writable(p), rtol=1e-12, atol=0.0)
    assert MODEL.read_text(encoding="utf-8") == before
    (tmp_path / "run").mkdir()
    plan = Plan(load_rig(RIG).model, scenario(duration_s=1.2), path, 5, False)
    assert session.run_session(plan, session.prepare(plan), tmp_path / "run").loop.ended == "completed"
