"""The log of a single axis: read back bit for bit, by other readers too; the rig's own log does not change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from spsp_ctrl.messages import AxisSample
from spsp_ctrl.recording.axis_writer import AxisLog
from spsp_ctrl.recording.frames import TOPIC_NAMES
from spsp_ctrl.recording.logtools import info
from spsp_ctrl.recording.reader import digest_topics, messages, read_log
from spsp_ctrl.recording.schema import CYCLIC, TOPICS

RATE = 500


def samples(n: int, seed: int = 3) -> list[AxisSample]:
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(n):
        values = [float(v) for v in rng.normal(size=11)]
        head = (k * 1_000_000_000 // RATE, k, bool(k % 5), bool(k % 3), *values[:6], int(rng.integers(-(2**40), 2**40)), *values[6:])
        rows.append(AxisSample._make(head))
    return rows


def write(path: Path, rows: list[AxisSample]) -> Path:
    with AxisLog(path, rate_hz=RATE, controller="cascade", attachments={"controller.yaml": "kp_1_s: 160.18\n"}, run={"seed": "3"}) as log:
        log.motion(0, "ladder")
        log.samples(rows[:200])
        log.motion(rows[200].stamp_ns, "sine")
        log.samples(rows[200:])
    return path


def test_samples_motions_and_facts_come_back(tmp_path: Path) -> None:
    rows = samples(500)
    data = read_log(write(tmp_path / "axis.mcap", rows))
    assert data.complete, data.problem
    assert set(data.topics) == {"/axis"}
    assert list(messages(data.topics["/axis"], AxisSample)) == rows
    assert data.log_times["/axis"].tolist() == [row.stamp_ns for row in rows]
    assert [(e["stamp_ns"], e["id"], e["text"]) for e in data.events] == [(0, "motion", "ladder"), (400_000_000, "motion", "sine")]
    assert data.attachments == {"controller.yaml": b"kp_1_s: 160.18\n"}
    assert data.metadata["run"] == {"kind": "axis", "rate_hz": "500", "controller": "cascade", "seed": "3"}


def test_another_reader_sees_the_same(tmp_path: Path) -> None:
    rows = samples(60)
    with AxisLog(tmp_path / "a.mcap", rate_hz=RATE, controller="none") as log:
        log.samples(rows)
    with (tmp_path / "a.mcap").open("rb") as stream:
        found = [d for *_, d in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/axis"])]
    assert [tuple(getattr(d, name) for name in AxisSample._fields) for d in found] == rows


def test_same_samples_same_bytes(tmp_path: Path) -> None:
    a, b = (write(tmp_path / name, samples(300)) for name in ("a.mcap", "b.mcap"))
    assert a.read_bytes() == b.read_bytes()
    assert digest_topics(write(tmp_path / "c.mcap", samples(300, seed=4)))["/axis"] != digest_topics(a)["/axis"]


def test_an_unfinished_log_keeps_its_closed_chunks(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.mcap", samples(500))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    data = read_log(cut)
    assert not data.complete
    kept = data.topics["/axis"]
    assert 100 < len(kept) < 500
    assert kept.tobytes() == read_log(whole).topics["/axis"][: len(kept)].tobytes()


def test_info_counts_missing_cycles(tmp_path: Path) -> None:
    rows = samples(100)
    with AxisLog(tmp_path / "a.mcap", rate_hz=RATE, controller="none") as log:
        log.samples(row for row in rows if row.cycle not in (40, 41))
    found = info(tmp_path / "a.mcap")
    assert found.missing_cycles == 2
    assert found.topics["/axis"]["messages"] == 98


def test_unknown_controller_is_refused_before_a_file_is_made(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'pid' is none of none, recorded, cascade"):
        AxisLog(tmp_path / "x.mcap", rate_hz=500, controller="pid")
    assert not (tmp_path / "x.mcap").exists()


def test_the_log_of_a_rig_has_no_axis() -> None:
    assert list(TOPICS) == [*CYCLIC, "/axis"]
    assert TOPIC_NAMES == ("/measurement", "/control", "/timing", "/truth", "/events", "/operator")
