"""The committed logs through today's law. After a deliberate change of the law: ``python -m tools.make_fixtures``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.records import Channel, Message

from spsp_ctrl.experiments.replaying import replay_log
from spsp_ctrl.messages import Mode
from spsp_ctrl.recording.reader import LogData, digest_topics, read_log, records
from spsp_ctrl.recording.schema import TOPICS
from spsp_ctrl.runtime.identity import law_digest
from spsp_ctrl.safety.faults import BY_ID
from tools import make_fixtures

FIXTURES = Path(__file__).parents[1] / "fixtures"
NAMES = [fixture.name for fixture in make_fixtures.MADE]


def load(name: str) -> LogData:
    return read_log(FIXTURES / f"{name}.mcap")


def test_there_is_a_log_of_each_fixture_and_no_other() -> None:
    assert sorted(path.name for path in FIXTURES.glob("*.mcap")) == sorted(f"{name}.mcap" for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_todays_law_gives_the_recorded_commands(name: str) -> None:
    """Bit for bit when the law has not changed at all, to 1e-9 when only its source text has."""
    data = load(name)
    result = replay_log(FIXTURES / f"{name}.mcap", None, (), lambda done, total: None)
    assert result.exact is (data.metadata["run"]["law_digest"] == law_digest())
    assert result.first is None, f"{result.first}; after a deliberate change of the law run `python -m tools.make_fixtures`"
    assert (result.differing_cycles, result.log_problem) == (0, "")
    assert result.cycles == len(data.topics["/control"])
    assert result.active_cycles > 200
    assert (FIXTURES / f"{name}.mcap").stat().st_size <= 300_000


@pytest.mark.parametrize("name", NAMES)
def test_logs_begin_before_arming_and_end_without_power(name: str) -> None:
    control = load(name).topics["/control"]
    changes = control["mode"][np.flatnonzero(np.diff(control["mode"], prepend=-1))].tolist()
    assert changes[:4] == [Mode.DISARMED, Mode.READY, Mode.ALIGNING, Mode.ACTIVE]
    assert not control["command.enable"][0]
    assert not control["command.enable"][-1]
    assert np.abs(control["command.pitch_current_a"][control["mode"] == Mode.ACTIVE]).max() > 0.1


def test_heading_request_turns_the_azimuth() -> None:
    data = load("heading")
    (request,) = [row for row in data.operator if row["verb"] == "heading"]
    control = data.topics["/control"]
    rate = control["command.azimuth_rate_rad_s"]
    after = control["stamp_ns"] >= request["stamp_ns"]
    assert request["value"] == make_fixtures.HEADING_RAD
    assert rate[after].max() > 0.1 > 5.0 * np.abs(rate[~after]).max()


def test_imu_dropout_is_braked_and_latched() -> None:
    data = load("imu-dropout")
    control = data.topics["/control"]
    changes = control["mode"][np.flatnonzero(np.diff(control["mode"], prepend=-1))].tolist()
    assert changes[3:] == [Mode.ACTIVE, Mode.STOPPING, Mode.FAULT]
    assert set(control["fault"][control["mode"] == Mode.STOPPING]) == {BY_ID["imu-stale"].number}
    assert control["fault"][-1] == BY_ID["imu-stale"].number
    assert [event["id"] for event in data.events][-2:] == ["imu-stale", "imu-stale"]


def test_the_tool_makes_the_same_log_again_and_says_what_changed(tmp_path: Path) -> None:
    fixture = make_fixtures.MADE[0]
    assert make_fixtures.update(fixture, tmp_path)[0].startswith("new")
    path = tmp_path / f"{fixture.name}.mcap"
    first = path.read_bytes()
    again = make_fixtures.update(fixture, tmp_path)
    assert path.read_bytes() == first
    assert all(line.endswith("unchanged") for line in again[1:]), again
    make_fixtures.make(fixture, tmp_path / "shorter.mcap", 1.1)
    said = "\n".join(make_fixtures.compare(path, tmp_path / "shorter.mcap"))
    assert "/control " in said
    assert "->" in said
    assert "command.pitch_current_a: largest change" in said
    assert digest_topics(path) != digest_topics(tmp_path / "shorter.mcap")


@pytest.mark.parametrize("name", NAMES)
def test_every_payload_is_what_the_codec_writes(name: str) -> None:
    """Header and padding too: two runs of the tool give the same bytes, and another CDR reader accepts them."""
    topics = {}
    seen = 0
    for record in records(FIXTURES / f"{name}.mcap"):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message) and topics[record.channel_id] in TOPICS:
            codec = TOPICS[topics[record.channel_id]]
            assert codec.encode(codec.decode(record.data)) == record.data
            seen += 1
    assert seen > 500
