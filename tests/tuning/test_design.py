"""The shipped gains are the designed ones, and their margins hold."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.control.params import law_params
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning import design as designing
from spsp_ctrl.tuning.design import LAWS, Design, DesignSpec, attitude_gains, differences, rounded, shortfalls, speed_gains, with_law
from spsp_ctrl.tuning.loops import AxisLoops
from spsp_ctrl.tuning.plant_model import axis_plant
from tools import design_gains

ROOT = Path(__file__).parents[2]


def test_rig_file_has_the_designed_gains(rig: RigConfig, designed: Design) -> None:
    assert differences(rig.control, designed.control) == []


def test_a_changed_gain_is_found(rig: RigConfig, designed: Design) -> None:
    cascade = rig.control.cascade
    speed = cascade.speed.model_copy(update={"ki_a_rad": 1.52})
    control = rig.control.model_copy(update={"cascade": cascade.model_copy(update={"speed": speed})})
    assert differences(control, designed.control) == ["control.cascade.speed.ki_a_rad: 1.52 in the file, 1.5 by design"]


def test_every_loop_of_every_law_is_judged(designed: Design) -> None:
    nominal = {(r.law, r.kind, r.axis, r.at) for r in designed.rows if r.nominal}
    assert len(nominal) == len(LAWS) * 2 * (3 + 2)
    assert len(designed.rows) == 5 * len(nominal)
    assert all(r.margins for r in designed.rows if r.law != "performance")


def disk(designed: Design, law: str, nominal: bool, at: set[str]) -> float:
    return min(
        r.margins.disk
        for r in designed.rows
        if r.law == law and r.nominal == nominal and r.at in at and r.kind == "inertial" and r.margins is not None
    )


def test_disk_margins_are_what_is_asked_for(designed: Design) -> None:
    """Every loop: 0.5 with the nominal plant and 0.35 in every corner; the performance gains, which need an identified motor, nominal alone."""
    assert shortfalls(designed.rows) == []
    everywhere, both = {"current", "imu", "resolver"}, {"current", "imu"}
    assert disk(designed, "cascade", True, both) == pytest.approx(0.70, abs=0.01)
    assert disk(designed, "cascade", False, everywhere) == pytest.approx(0.38, abs=0.01)
    assert disk(designed, "stabiliser", True, everywhere) == pytest.approx(0.57, abs=0.01)
    assert disk(designed, "stabiliser", False, both) == pytest.approx(0.50, abs=0.01)
    assert disk(designed, "stabiliser", False, {"resolver"}) == pytest.approx(0.36, abs=0.01)
    assert disk(designed, "performance", True, everywhere) == pytest.approx(0.51, abs=0.02)
    # a motor gain 1.86 times too large is more than the performance gains stand with friction and play
    assert disk(designed, "performance", False, everywhere) < 0.2


def test_margins_that_fall_short_are_named(designed: Design) -> None:
    row = next(r for r in designed.rows if r.nominal and r.at == "imu" and r.margins)
    assert row.margins is not None
    low = replace(row, margins=replace(row.margins, disk=0.31, disk_hz=9.0))
    assert shortfalls([low]) == ["cascade, pitch, inertial loop at imu, nominal plant: disk margin 0.31 at 9 Hz, needs 0.5"]
    assert "unstable" in shortfalls([replace(row, torque_constant=1.3, margins=None)])[0]


def test_loops_cross_where_they_were_asked_to(rig: RigConfig, model: PlantModel) -> None:
    """Rounded to two digits: crossover within 2 %, phase margin within 1 deg of the specification."""
    plant = axis_plant(model)
    p = law_params(with_law(rig, "cascade"))
    p = replace(p, **speed_gains(p, plant, 24.0, 67.0))
    f = np.array([24.0])
    loop = -AxisLoops(p, plant, kind="joint").transfer("command", "command", f, cut=("command", "motor_est"))[0]
    assert abs(loop) == pytest.approx(1.0, abs=0.02)
    assert np.degrees(np.angle(-loop)) == pytest.approx(67.0, abs=1.0)
    p = replace(p, **attitude_gains(p, plant, 6.0, 52.0))
    found = AxisLoops(p, plant).all_margins()["imu"]
    assert found.crossover_hz == pytest.approx(6.0, rel=0.02)
    assert found.phase_deg == pytest.approx(52.0, abs=1.0)


def test_stabiliser_isolates_better_than_the_cascade(designed: Design) -> None:
    """At 0.5 Hz and below by at least 10 dB, before the swing's frequency is learnt."""
    cascade, stabiliser = designed.isolation_db["cascade"], designed.isolation_db["stabiliser"]
    assert all(s < c - 10.0 for c, s in zip(cascade[:3], stabiliser[:3], strict=True))
    assert stabiliser[0] < -75.0


def test_impossible_specification_is_refused(rig: RigConfig, model: PlantModel) -> None:
    with pytest.raises(ValueError, match="attitude loop: crossover and phase margin do not go together"):
        designing.design(rig, model, replace(DesignSpec(), cascade_attitude_deg=110.0))


def test_rounding_is_to_significant_digits() -> None:
    assert [rounded(v) for v in (0.050349, 351.234, 91959.0, 0.0, 22.44)] == [0.05, 350.0, 92000.0, 0.0, 22.0]
    assert rounded(0.074232, 3) == 0.0742


def run(*args: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(design_gains.main, args)
    return result.exit_code, result.stdout, result.stderr


def test_tool_prints_writes_and_checks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, designed: Design) -> None:
    monkeypatch.setattr(designing, "design", lambda *_: designed)
    monkeypatch.chdir(ROOT)
    fragment = tmp_path / "gains.yaml"
    code, out, err = run("--write", str(fragment), "--check")
    assert code == 0
    assert set(err.splitlines()) == {f"margin falls short: {line}" for line in shortfalls(designed.rows)}
    assert "Isolation" in out
    assert "corners" in out
    assert yaml.safe_load(fragment.read_text())["control"] == designed.control
    code, _, err = run("--write", str(fragment))
    assert code == 2
    assert "exists already" in err
    code, out, _ = run("--json")
    data = json.loads(out)
    assert data["differences"] == []
    assert {row["at"] for row in data["loops"]} == {"current", "imu", "resolver"}


def test_tool_writes_no_gains_of_an_unstable_loop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, designed: Design) -> None:
    bad = replace(designed, rows=[replace(designed.rows[0], margins=None), *designed.rows[1:]])
    monkeypatch.setattr(designing, "design", lambda *_: bad)
    monkeypatch.chdir(ROOT)
    fragment = tmp_path / "gains.yaml"
    code, _, err = run("--write", str(fragment))
    assert code == 1
    assert "margin falls short: cascade, pitch, inertial loop at current, nominal plant: unstable" in err
    assert not fragment.exists()


def test_strict_tool_writes_no_gains_that_fall_short(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, designed: Design) -> None:
    monkeypatch.chdir(ROOT)
    fragment = tmp_path / "gains.yaml"
    row = next(r for r in designed.rows if r.nominal and r.margins)
    assert row.margins is not None
    low = replace(designed, rows=[replace(row, margins=replace(row.margins, disk=0.31)), *designed.rows])
    monkeypatch.setattr(designing, "design", lambda *_: low)
    assert run("--strict", "--write", str(fragment))[0] == 1
    assert not fragment.exists()
    monkeypatch.setattr(designing, "design", lambda *_: designed)
    assert run("--strict", "--write", str(fragment))[0] == 0
    assert fragment.exists()


def test_check_fails_on_another_gain(monkeypatch: pytest.MonkeyPatch, designed: Design) -> None:
    other = replace(designed, control=designed.control | {"observer": {"l_angle": 0.6}})
    monkeypatch.setattr(designing, "design", lambda *_: other)
    monkeypatch.chdir(ROOT)
    code, _, err = run("--check")
    assert code == 1
    assert "control.observer.l_angle: 0.7 in the file, 0.6 by design" in err


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (("--spec", "cascade_speed_hx=20"), "known are"),
        (("--spec", "cascade_speed_hz=fast"), "not a number"),
        (("--spec", "cascade_speed_hz=-1"), "positive"),
        (("--config", "nowhere.yaml"), "nowhere.yaml"),
        (("--spec", "cascade_attitude_deg=110"), "do not go together"),
    ],
)
def test_tool_judges_its_input(monkeypatch: pytest.MonkeyPatch, args: tuple[str, ...], text: str) -> None:
    monkeypatch.chdir(ROOT)
    code, out, err = run(*args)
    assert code == 2
    assert text in err
    assert "Traceback" not in out + err


@pytest.mark.parametrize("command", [["-m", "tools.design_gains"], ["tools/design_gains.py"]])
def test_tool_runs_as_module_and_as_file(command: list[str]) -> None:
    done = subprocess.run([sys.executable, *command, "--help"], cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0
    assert "Example: python tools/design_gains.py" in done.stdout


def test_documented_margins_are_the_designed_ones(designed: Design) -> None:
    text = (ROOT / "docs" / "tuning.md").read_text(encoding="utf-8").split("## Margins by the model")[1]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]
    disks = {tuple(cells[:6]): cells[10] for cells in rows if len(cells) == len(design_gains.COLUMNS)}
    seen = 0
    for row in designed.rows:
        key = tuple(design_gains._row(row)[:6])
        if key in disks:
            seen += 1
            assert (float(disks[key]) if disks[key] else None) == (pytest.approx(row.margins.disk, abs=0.011) if row.margins else None), key
    assert seen == len(disks) - 1  # the head
