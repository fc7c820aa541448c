"""The command ``diagnose``: what it refuses, and that nothing half-written is left."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from spsp_ctrl.cli import cli
from spsp_ctrl.discrepancy import records
from spsp_ctrl.messages import AxisSample
from spsp_ctrl.recording.axis_writer import AxisLog

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "config" / "axis.yaml"


def _log(path: Path, *, ruler: float = 1.0, bad: int = -1) -> Path:
    with AxisLog(path, rate_hz=500.0, controller="recorded") as log:
        for k in range(600):
            travel = 0.01 * float(np.sin(0.01 * k))
            counts = round(travel / 0.004 * 3.0 * 16384)
            current = 0.3 * float(np.cos(0.01 * k))
            load = float("nan") if k == bad else travel * ruler
            log.sample(AxisSample((k + 1) * 2_000_000, k, True, False, 0.0, 0.0, current, 0.0, current, 24.0, counts, load, 0.0, 0.0, 20.0, 20.0))
    return path


def _run(log: Path, out: Path, *more: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli, ["diagnose", str(log), "--model", str(MODEL), "--out", str(out), *more])
    return done.exit_code, done.output


WRONG = [({"ruler": 1000.0}, "a factor of 1000"), ({"ruler": -1.0}, "the sign is reversed"), ({"bad": 77}, "cycle 77")]


@pytest.mark.parametrize(("change", "text"), WRONG)
def test_a_log_that_is_not_understood_blames_no_plant(tmp_path: Path, change: dict[str, float], text: str) -> None:
    code, output = _run(_log(tmp_path / "a.mcap", **change), tmp_path / "out")
    assert code == 4
    assert text in output
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert answer["verdict"] == "not-understood"
    assert answer["effects"] == []
    assert answer["model"] is None


def test_wrong_input_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    log = _log(tmp_path / "a.mcap")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("mine")
    assert _run(log, tmp_path / "full")[0] == 2
    assert (tmp_path / "full" / "x").read_text() == "mine"
    assert _run(log, tmp_path / "out", "--held-out", str(log))[0] == 2
    assert _run(tmp_path / "none.mcap", tmp_path / "out")[0] == 4
    assert {p.name for p in tmp_path.iterdir()} == {"a.mcap", "full"}


def test_the_log_of_an_axis_is_refused_for_the_model_of_a_platform(tmp_path: Path) -> None:
    log = _log(tmp_path / "a.mcap")
    done = CliRunner().invoke(cli, ["diagnose", str(log), "--model", str(ROOT / "config" / "model.yaml"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 4
    assert "it is not the log of a rig" in done.output
    assert not (tmp_path / "out").exists()


def test_truth_is_never_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, ...]] = []
    real = records.read_log
    monkeypatch.setattr(records, "read_log", lambda path, topics: (asked.append(topics), real(path, topics))[1])
    records.load_record(_log(tmp_path / "a.mcap"))
    assert asked == [("/axis",)]
    source = (ROOT / "src" / "spsp_ctrl" / "discrepancy").glob("*.py")
    assert not any("/truth" in path.read_text(encoding="utf-8") for path in source)
