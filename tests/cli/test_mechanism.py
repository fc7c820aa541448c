"""``spsp-ctrl mechanism``: what the commands print, write and refuse."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result

from spsp_ctrl.cli import cli

ROOT = Path(__file__).parents[2]
RIG, LARGE = str(ROOT / "config/rig.yaml"), str(ROOT / "config/mechanisms/large.yaml")


def call(*arguments: str) -> Result:
    return CliRunner().invoke(cli, ["mechanism", *arguments], catch_exceptions=False)


def result_of(*arguments: str) -> dict[str, Any]:
    done = call(*arguments, "--json")
    assert done.exit_code == 0, done.output
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_workspace_of_the_rig() -> None:
    found = result_of("workspace", "-c", RIG, "--at", "12", "-8")
    assert found["pitch_rod"]["needed_min_mm"] == pytest.approx(-34.123, abs=5e-4)
    assert found["roll_rod"]["needed_max_mm"] == pytest.approx(34.263, abs=5e-4)
    assert found["singular"]["pitch_deg"] == pytest.approx(69.361, abs=5e-4)
    assert found["pose"]["rod_travel_mm"] == pytest.approx([-20.7814, 13.6299], abs=5e-5)
    text = call("workspace", "-c", RIG).output
    assert "stroke_min_mm = −34.1 stops pitch at 19.986°" in text


def test_workspace_of_another_geometry() -> None:
    found = result_of("workspace", "-c", LARGE)
    assert found["mechanism"]["static_radius_mm"] == pytest.approx(300.0)
    assert 0.9 < found["reachable_part"] < 1.0
    assert "stops roll at 21.402°" in call("workspace", "-c", LARGE).output


def test_mobility() -> None:
    found = result_of("mobility", "-c", RIG, "--poses", "500")
    y, x = found["variants"]
    assert y["random_poses"]["mobility"] == {"2": 500}
    assert x["pose"]["mobility"] == 2
    assert x["random_poses"]["mobility"] == {"1": 500}
    assert found["kutzbach"] == 1
    assert found["redundant_wrench"]["couple_mm"] == pytest.approx(found["redundant_wrench"]["expected_couple_mm"], abs=1e-9)
    assert found == result_of("mobility", "-c", RIG, "--poses", "500")
    off = result_of("mobility", "-c", RIG, "--poses", "10", "--at", "12", "-8")
    assert [v["pose"]["mobility"] for v in off["variants"]] == [2, 1]
    text = call("mobility", "-c", RIG, "--poses", "10", "--at", "12", "-8").output
    assert "force (0.000, 1.000, 0.000) through A1" in text


def test_motion() -> None:
    found = result_of("motion", "-c", RIG, "--carrier", "--pitch", "6/4", "--roll", "15/8", "--axis-order", "pitch_roll", "--lock-azimuth")
    assert found["pitch_rod"]["speed_mm_s"] == pytest.approx(17.03, abs=5e-3)
    assert found["roll_rod"]["accel_mm_s2"] == pytest.approx(17.07, abs=5e-3)
    assert found["duration_s"] == 8.0
    assert found["beyond"] == []
    from_file = result_of("motion", "-c", RIG, "--scenario", str(ROOT / "config/experiments/swing-2dof.yaml"))
    assert from_file["roll_rod"]["max_mm"] == pytest.approx(25.9, abs=0.05)


def test_motion_beyond_the_travel_fails_and_says_where() -> None:
    done = call("motion", "-c", RIG, "--pitch", "15/4", "--roll", "20/8")
    assert done.exit_code == 1
    assert "roll rod: −34.123 mm is beyond stroke_min_mm = −34.1" in done.output
    done = call("motion", "-c", RIG, "--pitch", "22/4", "--json")
    assert done.exit_code == 1
    assert {b["field"] for b in json.loads(done.stdout)["beyond"]} == {"pitch_limit_deg", "stroke_min_mm", "stroke_max_mm"}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("workspace", "-c", "nowhere.yaml"), "nowhere.yaml: no such file"),
        (("workspace", "-c", RIG, "--at", "25", "0"), "rig.yaml:17:3: unreachable pose: pitch 25 deg is beyond pitch_limit_deg = 20"),
        (("mobility", "-c", RIG, "--at", "20", "0"), "beyond stroke_min_mm = -34.1"),
        (("workspace", "-c", RIG, "--at", "nan", "0"), "not a finite number"),
        (("workspace", "-c", RIG, "--set", "mechanism.column_height_mm=90"), "moving_radius_mm (100) must be smaller"),
        (("workspace", "-c", RIG, "--set", "mechanism.height=90"), "unknown key"),
        (("mobility", "-c", RIG, "--poses", "0"), "--poses"),
        (("motion", "-c", RIG), "no motion given"),
        (("motion", "-c", RIG, "--pitch", "15"), "give amplitude and period as DEG/S"),
        (("motion", "-c", RIG, "--pitch", "15/0.1"), "period_s"),
        (("motion", "-c", RIG, "--pitch", "nan/4"), "amplitude_deg"),
        (("motion", "-c", RIG, "--pitch", "1/4", "--duration", "nan"), "not a finite number"),
        (("motion", "-c", RIG, "--pitch", "1/4", "--lock-azimuth"), "add --carrier"),
        (("motion", "-c", RIG, "--pitch", "1/4", "--scenario", "x.yaml"), "brings its own motion"),
        (("motion", "-c", RIG, "--scenario", RIG), "this is a rig file, not a scenario file"),
    ],
)
def test_wrong_input_is_one_clear_line(arguments: tuple[str, ...], says: str) -> None:
    done = call(*arguments)
    assert done.exit_code == 2
    assert says in done.output
    assert "Traceback" not in done.output


@pytest.mark.parametrize("arguments", [("workspace",), ("mobility", "--poses", "10"), ("motion", "--roll", "8/8")])
def test_pictures(arguments: tuple[str, ...], tmp_path: Path) -> None:
    command, *rest = arguments
    first, second = tmp_path / "a" / "b", tmp_path / "c"
    for folder in (first, second):
        found = result_of(command, "-c", RIG, *rest, "--out", str(folder))
        assert found["picture"] == str(folder / f"{command}.svg")
    written = (first / f"{command}.svg").read_bytes()
    assert written == (second / f"{command}.svg").read_bytes()
    assert ElementTree.fromstring(written).tag == "{http://www.w3.org/2000/svg}svg"


def test_a_picture_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    done = call("workspace", "-c", RIG, "--out", str(blocked))
    assert done.exit_code == 2
    assert "Traceback" not in done.output


def test_without_matplotlib_the_answer_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("spsp_ctrl.report.plots.importlib.util.find_spec", lambda name: None)
    done = call("workspace", "-c", RIG, "--out", str(tmp_path))
    assert done.exit_code == 2
    assert "spsp-ctrl[design]" in done.output
    assert call("workspace", "-c", RIG).exit_code == 0


@pytest.mark.parametrize("command", ["workspace", "mobility", "motion"])
def test_help_has_an_example(command: str) -> None:
    assert f"spsp-ctrl mechanism {command} --config config/rig.yaml" in " ".join(call(command, "--help").output.split())


def test_help_imports_nothing_heavy() -> None:
    code = "import sys; from spsp_ctrl.cli import cli\ntry: cli(['mechanism', '--help'])\nexcept SystemExit: pass\nprint(sorted(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = run.stdout.rsplit("\n", 2)[-2]
    for heavy in ("'numpy'", "'pydantic'", "'matplotlib'", "'numba'"):
        assert heavy not in loaded
