"""``spsp-ctrl run``: the folder it leaves, what it prints, its exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from spsp_ctrl.cli import cli
from spsp_ctrl.recording.reader import digest_topics

CONFIG = Path(__file__).parents[2] / "config"


def run(*arguments: object) -> Result:
    result = CliRunner().invoke(cli, ["run", "--config", str(CONFIG / "rig.yaml"), "--fast", *map(str, arguments)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of the swing; one row that holds, one that cannot."""
    path = tmp_path_factory.mktemp("scenario") / "short.yaml"
    path.write_text(
        "schema: spsp-ctrl/scenario/1\nname: short\nduration_s: 1.0\nsettle_s: 0.6\nacceptance:\n"
        "  - {name: pitch, value: error_arcmin.pitch.true_max, limit: 60.0, unit: arcmin}\n"
        "  - {name: perfect, value: error_arcmin.pitch.imu_max, limit: 0.0, unit: arcmin}\n",
        encoding="utf-8",
    )
    return path


def test_leaves_a_folder_that_explains_the_run(scenario: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("--scenario", scenario)
    assert result.exit_code == 0
    folders = list((tmp_path / "runs").iterdir())
    assert len(folders) == 1
    assert {path.name for path in folders[0].iterdir()} == {"run.mcap", "rig.yaml", "scenario.yaml", "model.yaml", "summary.json", "report.html"}
    assert "short: completed" in result.stdout
    assert str(Path("runs") / folders[0].name) in result.stdout
    # its own files give the same run again
    again = CliRunner().invoke(cli, ["run", "--config", str(folders[0] / "rig.yaml"), "--fast", "--out", "again"])
    assert again.exit_code == 0
    first, second = (digest_topics(folder / "run.mcap") for folder in (folders[0], Path("again")))
    assert {topic for topic in first if first[topic] != second[topic]} == {"/timing"}


def test_json_is_the_summary_and_nothing_else(scenario: Path, tmp_path: Path) -> None:
    result = run("--scenario", scenario, "--json", "--out", tmp_path / "run", "--seed", "7")
    assert result.exit_code == 0
    assert result.stderr == ""
    summary = json.loads(result.stdout)
    assert summary == json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert summary["seed"] == 7
    assert {"duration_s", "rate_hz", "seed", "error_arcmin", "azimuth_error_deg"} <= summary.keys()
    assert {"acceptance", "timing_us", "log", "realtime_granted"} <= summary.keys()
    assert set(summary["error_arcmin"]["pitch"]) == {"true_max", "true_rms", "imu_max", "imu_rms"}
    assert set(summary["timing_us"]["lateness"]) == {"p50", "p99", "p99_9", "max"}
    assert [row["pass"] for row in summary["acceptance"]] == [True, False]
    assert summary["log"]["lost"] == 0


def test_strict_makes_a_failed_row_exit_code_1(scenario: Path, tmp_path: Path) -> None:
    assert run("--scenario", scenario, "--strict", "--out", tmp_path / "run").exit_code == 1


def test_a_folder_with_a_run_is_not_written_over(scenario: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert run("--scenario", scenario, "--out", out).exit_code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    result = run("--scenario", scenario, "--out", out)
    assert result.exit_code == 2
    assert "already holds a run (run.mcap); choose another folder" in result.stderr
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_shorter_than_its_settling_time_has_no_figures_and_no_invented_verdict(tmp_path: Path) -> None:
    result = run("--duration", "0.5", "--json", "--out", tmp_path / "run")
    assert result.exit_code == 0
    summary = json.loads(result.stdout)
    assert summary["samples"] == 0
    assert all(row["value"] is None and not row["pass"] for row in summary["acceptance"])
