"""A commissioning log of the same motion is a baseline; another motion is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.discrepancy.benches import MODEL, samples_of, write

from spsp_ctrl.discrepancy.baseline import baselines, difference_floor, same_motion
from spsp_ctrl.discrepancy.features import basis, features
from spsp_ctrl.discrepancy.records import load_record
from spsp_ctrl.discrepancy.replica import replica
from spsp_ctrl.discrepancy.whitening import robust_rms
from spsp_ctrl.plant.axis_model import load_axis_model


def test_what_the_model_lacks_anyway_cancels_on_the_same_motion(tmp_path: Path) -> None:
    """The bench has 4 % more friction than the model in both logs and 3 um more play in the second: only the play is left."""
    model = load_axis_model(MODEL)
    p = model.parameters()
    friction = {"mf_coulomb_nm": 1.04 * p[model.index("mf_coulomb_nm")]}
    clean = load_record(write(tmp_path / "a.mcap", "axis-identify", samples_of("axis-identify", 1, friction)))[0]
    play = friction | {"gap_m": p[model.index("gap_m")] + 3e-6}
    worn = load_record(write(tmp_path / "b.mcap", "axis-identify", samples_of("axis-identify", 2, play)))[0]
    other = load_record(write(tmp_path / "c.mcap", "axis-check", samples_of("axis-check", 3, friction)))[0]
    assert same_motion(worn, clean)
    assert not same_motion(other, clean)
    assert not same_motion(replace(worn, rows=worn.rows[:-1]), clean)
    assert baselines([other], [replica(model, clean)], p) is None
    found = baselines([worn], [replica(model, clean)], p)
    assert found is not None
    now = replica(model, worn).residuals(p)
    left = {c: now[c] - found[0][c] for c in now}
    assert robust_rms(left["resolver"]) < 0.2 * robust_rms(now["resolver"]), "the friction is in both"
    assert 0.5e-6 < robust_rms(left["ruler"]) < 3e-6, "half of the play, either way"
    every = features(replica(model, worn))
    motion = {c: basis(every[replica(model, worn).rows(c)]) for c in left}
    floor = difference_floor(left, motion)
    assert robust_rms(left["ruler"]) > 3.0 * floor["ruler"]
    assert np.all([v > 0.0 for v in floor.values()])
