"""The first real proof: from a bare mass, a published recording names its friction and the force error falls on laps that were not fitted."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from spsp_ctrl.discrepancy.pipeline import Task, diagnose
from spsp_ctrl.discrepancy.records import Motion, Record
from spsp_ctrl.plant.axis_model import load_axis_model
from spsp_ctrl.recording.schema import TOPICS

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SPSP_CTRL_DATA", ROOT.parent / "shared" / "data")) / "emps" / "DATA_EMPS.mat"
LAP = 6240


def _record(raw: dict[str, np.ndarray], name: str, start: int, stop: int) -> Record:
    rows = np.zeros(stop - start, TOPICS["/axis"].dtype)
    part = {k: raw[k].ravel()[start:stop] for k in ("qg", "qm", "vir")}
    rows["cycle"] = np.arange(len(rows))
    rows["stamp_ns"] = (rows["cycle"] + 1) * 1_000_000
    rows["enabled"], rows["screw_c"] = True, 20.0
    rows["reference_m"], rows["load_m"], rows["command_a"] = part["qg"], part["qm"], part["vir"]
    return Record(Path(name), rows, 1000.0, "cascade", (Motion("lap", 0, len(rows)),), {})


@pytest.mark.skipif(not DATA.exists(), reason=f"the EMPS recording is not there ({DATA})")
def test_a_bare_mass_finds_the_friction_of_a_measured_axis(tmp_path: Path) -> None:
    loadmat = pytest.importorskip("scipy.io").loadmat
    raw = loadmat(DATA)
    train, held = _record(raw, "laps-1-2", 0, 2 * LAP), _record(raw, "laps-3-4", 2 * LAP, 24841)
    model = load_axis_model(ROOT / "config" / "axis-bare.yaml")
    answer = diagnose(Task(model, (train,), (), (held,), 1), tmp_path / "model.yaml")
    assert [e.name for e in answer.effects][:3] == ["coulomb_friction", "viscous_friction", "friction_asymmetry"]
    assert answer.verdict == "partly-explained"
    gap = answer.gap["force"]
    force = float(np.sqrt(np.mean((held.rows["command_a"] * 35.15) ** 2)))
    assert gap.before / force > 0.65, "the bare mass must miss most of it, or this proves nothing"
    assert gap.after / force <= 0.035
    assert gap.closed is not None
    assert gap.closed > 0.9
    assert 0.3 < gap.floor < 0.6, "laps repeat to 0.37 N"
