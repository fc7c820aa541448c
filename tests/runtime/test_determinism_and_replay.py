"""Same seed, same bytes; a replay proves the law; what cannot be replayed says so in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer
from tests.sessions import RIG, command, one_clear_line, run_short

from spsp_ctrl.messages import Control, Measurement
from spsp_ctrl.recording.frames import TOPIC_NAMES
from spsp_ctrl.recording.reader import digest_topics, messages, read_log
from spsp_ctrl.recording.schema import CYCLIC, JSON_TOPICS, TOPICS
from spsp_ctrl.recording.writer_process import McapLog


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """1.2 s from the start, through the command."""
    folder = tmp_path_factory.mktemp("replay") / "run"
    result = command("run", "-c", RIG, "--fast", "--duration", "1.2", "--seed", "3", "--out", folder, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["ended"] == "completed"
    return folder / "run.mcap"


def rewritten(log: Path, out: Path, *, attachments: tuple[str, ...] = ("rig.yaml", "scenario.yaml"), without: range = range(0)) -> Path:
    """The log again, without some attachments or cycles."""
    data = read_log(log)
    with out.open("wb") as stream:
        copy = McapLog(stream)
        for name in attachments:
            copy.attachment(name, data.attachments[name])
        copy.metadata("run", data.metadata["run"])
        for k, row in enumerate(data.topics["/control"]["stamp_ns"].tolist()):
            if k not in without:
                for topic in CYCLIC:
                    copy.message(TOPIC_NAMES.index(topic), row, k, data.topics[topic][k : k + 1].tobytes()[: TOPICS[topic].layout.size])
        copy.finish()
    return out


def test_same_seed_same_bytes_except_timing(log: Path, tmp_path: Path) -> None:
    again = run_short(tmp_path / "again", 1.2, seed=3).folder / "run.mcap"
    a, b = digest_topics(log), digest_topics(again)
    assert set(a) == {*CYCLIC, *JSON_TOPICS}
    assert {topic for topic in a if a[topic] != b[topic]} <= {"/timing"}
    assert read_log(log).attachments == read_log(again).attachments


def test_replay_of_a_run_has_no_difference(log: Path) -> None:
    result = command("replay", log, "--json")
    found = json.loads(result.stdout)
    assert result.exit_code == 0
    assert found["exact"] is True
    assert (found["differing_cycles"], found["first"], found["log_problem"]) == (0, None, "")
    assert found["cycles"] == len(read_log(log).topics["/control"])
    assert found["active_cycles"] > 300
    text = command("replay", log)
    assert text.exit_code == 0
    assert "bit for bit" in text.stdout
    assert "0 differences" in text.stdout


def test_one_changed_gain_is_named_with_time_signal_and_both_values(log: Path, tmp_path: Path) -> None:
    change = ("--set", "control.stabiliser.rod_kp_1_s=55")
    result = command("replay", log, *change, "--json")
    found = json.loads(result.stdout)
    assert result.exit_code == 1
    assert found["differing_cycles"] > 100
    first = found["first"]
    control = read_log(log).topics["/control"]
    row = control[control["cycle"] == first["cycle"]][0]
    assert first["recorded"] == row[first["signal"]] != first["replayed"]
    assert first["time_s"] == pytest.approx(row["stamp_ns"] * 1e-9)
    before = rewritten(log, tmp_path / "before.mcap", without=range(first["cycle"], len(control)))
    assert json.loads(command("replay", before, *change, "--json").stdout)["differing_cycles"] == 0, "not the first difference"
    line = command("replay", log, *change).stdout.splitlines()[-1]
    for part in (f"{first['time_s']:.3f} s", first["signal"], repr(first["recorded"]), repr(first["replayed"])):
        assert part in line


def test_replay_with_a_wrong_override_is_the_users_mistake(log: Path) -> None:
    one_clear_line(command("replay", log, "--set", "control.stabiliser.rod_kp=55"), 2, "rod_kp_1_s")


def test_a_single_flipped_bit_of_an_input_is_found(log: Path, tmp_path: Path) -> None:
    """A replay that cannot fail would pass this too."""
    data = read_log(log)
    at = 900
    rows = data.topics["/measurement"].copy()
    rows["resolver_pitch.counts"][at] += 1
    out = tmp_path / "changed.mcap"
    with out.open("wb") as stream:
        copy = McapLog(stream)
        for name in ("rig.yaml", "scenario.yaml"):
            copy.attachment(name, data.attachments[name])
        copy.metadata("run", data.metadata["run"])
        for k, (m, c) in enumerate(zip(messages(rows, Measurement), messages(data.topics["/control"], Control), strict=True)):
            copy.message(0, m.stamp_ns, k, TOPICS["/measurement"].encode(m))
            copy.message(1, c.stamp_ns, k, TOPICS["/control"].encode(c))
        copy.finish()
    found = json.loads(command("replay", out, "--json").stdout)
    assert at <= found["first"]["cycle"] <= at + 1


def test_run_that_was_never_active_proves_nothing(tmp_path: Path) -> None:
    log = run_short(tmp_path / "run", 0.3).folder / "run.mcap"
    result = command("replay", log)
    assert "0 differences" in result.stdout
    one_clear_line(result, 4, "never ACTIVE")


def test_unfinished_log_is_replayed_as_far_as_it_goes(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: int(log.stat().st_size * 0.8)])
    result = command("replay", cut)
    assert "0 differences" in result.stdout
    one_clear_line(result, 4, str(cut), "not complete")


def test_logs_that_cannot_be_replayed_say_so_in_one_line(log: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.mcap"
    whole = bytearray(log.read_bytes())
    whole[100:300] = bytes(200)
    broken.write_bytes(whole)
    one_clear_line(command("replay", broken), 4, str(broken))
    for name, content in {"empty.mcap": b"", "text.mcap": b"hello world, this is not a log", "magic.mcap": log.read_bytes()[:8]}.items():
        path = tmp_path / name
        path.write_bytes(content)
        one_clear_line(command("replay", path), 4, str(path))
    one_clear_line(command("replay", tmp_path / "none.mcap"), 4, "no such file")
    one_clear_line(command("replay", tmp_path), 4, "is a folder")

    foreign = tmp_path / "foreign.mcap"
    with foreign.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
        writer.add_message(writer.register_channel("/other", "cdr", schema), 0, bytes(12), 0)
        writer.finish()
    one_clear_line(command("replay", foreign), 4, "rig.yaml", "scenario.yaml")
    assert json.loads(command("log", "info", foreign, "--json").stdout)["topics"]["/other"]["messages"] == 1

    one_clear_line(command("replay", rewritten(log, tmp_path / "a.mcap", attachments=("scenario.yaml",))), 4, "no attachment rig.yaml")
    one_clear_line(command("replay", rewritten(log, tmp_path / "b.mcap", without=range(0, 5000))), 4, "no messages on /measurement")
    one_clear_line(command("replay", rewritten(log, tmp_path / "c.mcap", without=range(700, 710))), 4, "lost between cycles 699 and 710")


def test_recorded_files_that_are_not_understood_are_the_logs_fault(log: Path, tmp_path: Path) -> None:
    data = read_log(log)
    path = tmp_path / "other-version.mcap"
    with path.open("wb") as stream:
        copy = McapLog(stream)
        copy.attachment("rig.yaml", data.attachments["rig.yaml"].replace(b"rate_hz", b"rate_khz"))
        copy.attachment("scenario.yaml", data.attachments["scenario.yaml"])
        for topic in ("/measurement", "/control"):
            copy.message(TOPIC_NAMES.index(topic), 0, 0, data.topics[topic][:1].tobytes())
        copy.finish()
    one_clear_line(command("replay", path), 4, str(path), "attachment rig.yaml:", "rate_")
