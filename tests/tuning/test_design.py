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
from tools import design_gains

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.control.params import law_params
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning import design as designing
from spsp_ctrl.tuning.design import Design, DesignSpec, attitude_gains, differences, rounded, shortfalls, speed_gains, with_law
from spsp_ctrl.tuning.loops import AxisLoops
from spsp_ctrl.tuning.plant_model import axis_plant

ROOT = Path(__file__).parents[2]


def test_rig_file_has_the_designed_gains(rig: RigConfig, designed: Design) -> None:
    assert differences(rig.control, designed.control) == []


def test_a_changed_gain_is_found(rig: RigConfig, designed: Design) -> None:
    speed = rig.control.speed.model_copy(update={"ki_a_rad": 1.52})
    lines = differences(rig.control.model_copy(update={"speed": speed}), designed.control)
    assert lines == ["control.speed.ki_a_rad: 1.52 in the file, 1.51 by design"]


def test_every_loop_of_both_laws_has_its_disk_margin(designed: Design) -> None:
    assert shortfalls(designed.rows) == []
    nominal = {(r.law, r.kind, r.axis, r.at) for r in designed.rows if r.nominal}
    assert len(nominal) == 2 * (3 + 2) + 2 * 3
    assert len(designed.rows) == 5 * len(nominal)
    assert min(r.margins.disk for r in designed.rows if r.nominal and r.margins) >= 0.5
    assert min(r.margins.disk for r in designed.rows if r.margins) >= 0.35


def test_margins_that_fall_short_are_named(designed: Design) -> None:
    row = next(r for r in designed.rows if r.nominal and r.at == "imu" and r.margins)
    assert row.margins is not None
    low = replace(row, margins=replace(row.margins, disk=0.31, disk_hz=9.0))
    assert shortfalls([low]) == ["cascade, pitch, inertial loop at imu, nominal plant: disk margin 0.31 at 9 Hz, needs 0.5"]
    assert "unstable" in shortfalls([replace(row, torque_constant=1.3, margins=None)])[0]


def test_loops_cross_where_they_were_asked_to(rig: RigConfig, model: PlantModel) -> None:
    """Before rounding matters: crossover within 1 %, phase margin within 1 deg of the specification."""
    spec, plant = DesignSpec(), axis_plant(model)
    p = law_params(with_law(rig, "cascade"))
    p = p._replace(**speed_gains(p, plant, spec))
    f = np.array([spec.speed_crossover_hz])
    loop = -AxisLoops(p, plant, kind="joint").transfer("command", "command", f, cut=("command", "motor_est"))[0]
    assert abs(loop) == pytest.approx(1.0, abs=0.01)
    assert np.degrees(np.angle(-loop)) == pytest.approx(spec.speed_phase_deg, abs=1.0)
    p = p._replace(**attitude_gains(p, plant, 6.0, 52.0))
    found = AxisLoops(p, plant).all_margins()["imu"]
    assert found.crossover_hz == pytest.approx(6.0, rel=0.01)
    assert found.phase_deg == pytest.approx(52.0, abs=1.0)


def test_feed_forward_isolates_better_than_the_cascade(designed: Design) -> None:
    """At 1 Hz and below by at least 6 dB, in the order of the study's C1 and C3 (control-limits.md, section 6)."""
    cascade, stabiliser = designed.isolation_db["cascade"], designed.isolation_db["stabiliser"]
    assert all(s < c - 6.0 for c, s in zip(cascade[:4], stabiliser[:4], strict=True))
    assert stabiliser[0] < -90.0


def test_impossible_specification_is_refused(rig: RigConfig, model: PlantModel) -> None:
    with pytest.raises(ValueError, match="attitude loop: crossover and phase margin do not go together"):
        designing.design(rig, model, replace(DesignSpec(), cascade_phase_deg=110.0))


def test_rounding_is_to_significant_digits() -> None:
    assert [rounded(v) for v in (0.050349, 351.234, 91959.0, 0.0, 22.44)] == [0.0503, 351.0, 92000.0, 0.0, 22.4]


def run(*args: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(design_gains.main, args)
    return result.exit_code, result.stdout, result.stderr


def test_tool_prints_writes_and_checks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, designed: Design) -> None:
    monkeypatch.setattr(designing, "design", lambda *_: designed)
    monkeypatch.chdir(ROOT)
    fragment = tmp_path / "gains.yaml"
    code, out, err = run("--write", str(fragment), "--check")
    assert (code, err) == (0, "")
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


def test_tool_refuses_gains_that_fall_short(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, designed: Design) -> None:
    row = designed.rows[0]
    bad = replace(designed, rows=[replace(row, margins=None), *designed.rows[1:]])
    monkeypatch.setattr(designing, "design", lambda *_: bad)
    monkeypatch.chdir(ROOT)
    fragment = tmp_path / "gains.yaml"
    code, _, err = run("--write", str(fragment))
    assert code == 1
    assert "margin falls short: cascade, pitch" in err
    assert not fragment.exists()


@pytest.mark.parametrize(
    ("args", "text"),
    [
        (("--spec", "speed_crosover_hz=20"), "known are"),
        (("--spec", "speed_crossover_hz=fast"), "not a number"),
        (("--spec", "speed_crossover_hz=-1"), "positive"),
        (("--config", "nowhere.yaml"), "nowhere.yaml"),
        (("--spec", "cascade_phase_deg=110"), "do not go together"),
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
