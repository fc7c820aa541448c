"""A lock-step run on buses leaves its bytes in the log; they decode to what was measured, and a changed one is found."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.sessions import ROOT, command, one_clear_line, run_short

from spsp_ctrl.config.loader import apply_overrides, load_rig, load_scenario
from spsp_ctrl.experiments import replaying_raw, session
from spsp_ctrl.experiments.session import Plan

HIL = ROOT / "hil"
INSIDE = ["rig.world=in_process", "rig.truth=null", "rig.can.can0.interface=spsp-lockstep"]
INSIDE += [f"rig.serial.{name}.port=spsp-lockstep" for name in ("imu", "stepper")]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("raw")
    config = apply_overrides(load_rig(HIL / "rig-hil.yaml"), INSIDE).model
    scenario = load_scenario(HIL / "swing-2dof.yaml").model.model_copy(update={"duration_s": 1.5})
    plan = Plan(config, scenario, HIL / "model.yaml", 1, False)
    result = session.run_session(plan, session.prepare(plan), folder)
    assert result.loop.ended == "completed"
    assert result.summary["log"]["lost"] == 0
    return folder / "run.mcap"


def test_bytes_decode_to_the_measurements(log: Path) -> None:
    result = command("replay", "--from", "raw", log)
    assert result.exit_code == 0, result.output
    assert "0 differences" in result.output


def test_a_changed_frame_is_found(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = replaying_raw._entries(log)
    at = next(i for i, e in enumerate(entries) if e.name == "can0" and not e.sent and e.identifier == 0x181 and e.stamp_ns > 10**9)
    changed = entries[at]._replace(data=entries[at].data[:2] + bytes((entries[at].data[2] ^ 1,)) + entries[at].data[3:])
    monkeypatch.setattr(replaying_raw, "_entries", lambda path: [*entries[:at], changed, *entries[at + 1 :]])
    result = command("replay", "--from", "raw", log)
    assert result.exit_code == 1
    assert "resolver_pitch.counts" in result.output


def test_a_run_without_buses_cannot_be_decoded(tmp_path: Path) -> None:
    run_short(tmp_path / "run", 0.2)
    one_clear_line(command("replay", "--from", "raw", tmp_path / "run" / "run.mcap"), 4, "devices.json")
