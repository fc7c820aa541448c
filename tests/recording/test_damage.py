"""Damaged logs: what is whole is read, what is wrong is said, nothing else is raised; and what becomes of a log whose writer fails."""

from __future__ import annotations

import csv
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.sessions import RIG, command, one_clear_line, run_short

from spsp_ctrl.messages import Measurement
from spsp_ctrl.recording import writer
from spsp_ctrl.recording.reader import LogData, LogError, digest_topics, read_log
from spsp_ctrl.recording.schema import CYCLIC, TOPICS
from spsp_ctrl.recording.writer import Recorder, RecorderError
from spsp_ctrl.recording.writer_process import McapLog
from spsp_ctrl.rig.simulated import SimulatedRig

FUZZ = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """0.2 s of a run: all topics, events, attachments, metadata, several chunks."""
    return run_short(tmp_path_factory.mktemp("damage") / "run", 0.2).folder / "run.mcap"


@pytest.fixture(scope="module")
def whole(log: Path) -> LogData:
    return read_log(log)


def rows(data: LogData, topic: str) -> list[bytes]:
    return [row.tobytes() for row in data.topics.get(topic, [])]


def is_part_of(part: LogData, whole: LogData, *, prefix: bool) -> None:
    for topic in TOPICS:
        some, everything = rows(part, topic), rows(whole, topic)
        if prefix:
            assert some == everything[: len(some)]
        else:
            rest = iter(everything)
            assert all(any(row == other for other in rest) for row in some), f"{topic} holds what was never written"


def read_every_way(path: Path, scratch: Path) -> tuple[LogData | None, str]:
    """Each command on the damaged log: nothing but its documented exits (``command`` raises everything else)."""
    codes = {
        "info": command("log", "info", path, "--json").exit_code,
        "cat": command("log", "cat", path, "/events").exit_code,
        "export": command("log", "export", path, "/timing", "--out", scratch / "out.csv", "--force").exit_code,
        "repair": command("log", "repair", path, "--out", scratch / "repaired.mcap", "--force").exit_code,
        "replay": command("replay", path).exit_code,
    }
    assert set(codes.values()) <= {0, 4}, codes
    try:
        data = read_log(path)
    except LogError as error:
        return None, str(error)
    assert codes["info"] == 0
    return data, data.problem


@FUZZ
@given(share=st.floats(0.0, 1.0, exclude_max=True))
def test_cut_anywhere(log: Path, whole: LogData, tmp_path: Path, share: float) -> None:
    content = log.read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[: int(len(content) * share)])
    data, problem = read_every_way(path, tmp_path)
    assert problem, "a cut log passed for a whole one"
    if data is not None:
        assert not data.complete
        is_part_of(data, whole, prefix=True)


def test_cut_at_each_of_the_last_bytes_and_the_first(log: Path, whole: LogData, tmp_path: Path) -> None:
    content = log.read_bytes()
    path = tmp_path / "cut.mcap"
    for size in [*range(12), *range(len(content) - 12, len(content))]:
        path.write_bytes(content[:size])
        try:
            data = read_log(path)
        except LogError:
            assert size < 100
            continue
        assert not data.complete
        is_part_of(data, whole, prefix=True)
        assert size < 100 or len(data.topics["/control"]) == len(whole.topics["/control"])


@FUZZ
@given(flips=st.lists(st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.integers(1, 255)), min_size=1, max_size=4))
def test_flipped_bytes(log: Path, whole: LogData, tmp_path: Path, flips: list[tuple[float, int]]) -> None:
    content = bytearray(log.read_bytes())
    for share, mask in flips:
        content[int(len(content) * share)] ^= mask
    path = tmp_path / "flipped.mcap"
    path.write_bytes(content)
    data, problem = read_every_way(path, tmp_path)
    if data is not None:
        is_part_of(data, whole, prefix=False)
        same = all(rows(data, topic) == rows(whole, topic) for topic in TOPICS) and data.attachments == whole.attachments
        same = same and (data.events, data.operator, data.metadata) == (whole.events, whole.operator, whole.metadata)
        assert problem or same, "something is missing or changed and nothing was said"


def test_repair_gives_a_finished_file_with_the_same_messages(log: Path, whole: LogData, tmp_path: Path) -> None:
    result = command("log", "repair", log, "--out", tmp_path / "copy.mcap")
    assert result.exit_code == 0
    assert "the input was complete" in result.stdout
    assert digest_topics(tmp_path / "copy.mcap") == digest_topics(log)
    copy = read_log(tmp_path / "copy.mcap")
    assert (copy.complete, copy.attachments, copy.metadata) == (True, whole.attachments, whole.metadata)

    cut, out = tmp_path / "cut.mcap", tmp_path / "repaired.mcap"
    cut.write_bytes(log.read_bytes()[: int(log.stat().st_size * 0.6)])
    result = command("log", "repair", cut, "--out", out)
    assert result.exit_code == 0
    assert "the input was damaged" in result.stdout
    assert digest_topics(out) == digest_topics(cut)
    assert read_log(out).complete
    kept = read_log(out)
    assert 20 < len(kept.topics["/control"]) < len(whole.topics["/control"])
    assert str(sum(map(len, kept.topics.values())) + len(kept.events)) in result.stdout
    assert not list(tmp_path.glob("*.part"))


def test_info_says_what_is_wrong_in_words(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: int(log.stat().st_size * 0.6)])
    lines = command("log", "info", cut).stdout.splitlines()
    assert lines[1].startswith("UNFINISHED")
    assert "log repair" in lines[1]
    assert command("log", "info", log).stdout.splitlines()[1] == "complete"
    info = json.loads(command("log", "info", log, "--json").stdout)
    assert info["topics"]["/control"]["rate_hz"] == pytest.approx(1000.0)
    assert (info["complete"], info["missing_cycles"]) == (True, 0)


def test_cat_and_export(log: Path, whole: LogData, tmp_path: Path) -> None:
    result = command("log", "cat", log, "/control", "-f", "cycle", "-f", "estimate.rod_pitch_m", "--start", "0.1", "--end", "0.15", "--limit", "20")
    found = [json.loads(line) for line in result.stdout.splitlines()]
    assert [row["cycle"] for row in found] == [*range(100, 120)]
    assert found[3]["estimate.rod_pitch_m"] == whole.topics["/control"]["estimate.rod_pitch_m"][103]
    out = tmp_path / "control.csv"
    assert command("log", "export", log, "/control", "-o", out).exit_code == 0
    table = [*csv.DictReader(out.open())]
    assert len(table) == len(whole.topics["/control"])
    assert set(table[0]) == set(whole.topics["/control"].dtype.names or ())
    for k in (0, 77, -1):
        assert float(table[k]["pitch.u_a"]) == whole.topics["/control"]["pitch.u_a"][k], "a CSV keeps every bit"


def test_mistakes_of_the_user_get_one_clear_line(log: Path, tmp_path: Path) -> None:
    one_clear_line(command("log", "cat", log, "/contrl"), 4, "/contrl", "did you mean '/control'?")
    one_clear_line(command("log", "cat", log, "control"), 4, "did you mean '/control'?")
    one_clear_line(command("log", "cat", log, "/control", "-f", "pitch.u"), 4, "pitch.u", "did you mean 'pitch.u_a'?")
    one_clear_line(command("log", "export", log, "/events", "-o", tmp_path / "e.csv"), 4, "/events", "log cat")
    one_clear_line(command("log", "info", tmp_path / "none.mcap"), 4, "no such file")
    kept = tmp_path / "kept"
    kept.write_text("precious")
    for action in (("export", log, "/control"), ("repair", log)):
        one_clear_line(command("log", *action, "--out", kept), 2, "exists", "--force")
        assert kept.read_text() == "precious"
        one_clear_line(command("log", *action, "--out", tmp_path / "no" / "folder"), 2, "no/folder")
    before = log.read_bytes()
    one_clear_line(command("log", "repair", log, "--out", log, "--force"), 2, "the log itself")
    link = tmp_path / "link.mcap"
    link.symlink_to(log)
    one_clear_line(command("log", "repair", log, "--out", link, "--force"), 2, "itself")
    one_clear_line(command("log", "export", log, "/control", "--out", log, "--force"), 2, "log itself")
    assert log.read_bytes() == before
    assert command("log", "export", log, "/control", "--out", kept, "--force").exit_code == 0
    assert kept.read_text().startswith("stamp_ns,")


def test_json_that_is_not_an_event_is_a_problem_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        copy = McapLog(stream)
        for payload in (b"[1, 2]", b"{}", b"not json"):
            copy.message(len(CYCLIC), 0, 0, payload)
        copy.finish()
    assert "/events" in read_log(path).problem
    assert command("log", "cat", path, "/events").exit_code == 0


def writer_pid() -> int:
    """The one child of this process that writes a log."""
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    (pid,) = [int(p) for p in children if b"writer_process" in Path(f"/proc/{p}/cmdline").read_bytes()]
    return pid


@pytest.mark.parametrize("real_time", [False, True], ids=["lock-step", "real-time"])
def test_a_dead_writer_does_not_disturb_the_run_and_the_loss_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_time: bool
) -> None:
    read: Callable[[SimulatedRig, int], Measurement] = SimulatedRig.read
    killed: list[int] = []

    def killing(self: SimulatedRig, now_ns: int) -> Measurement:
        if now_ns >= 600_000_000 and not killed:
            killed.append(writer_pid())
            os.kill(killed[0], signal.SIGKILL)
        return read(self, now_ns)

    monkeypatch.setattr(SimulatedRig, "read", killing)
    result = run_short(tmp_path / "run", 1.0, real_time=real_time)
    assert killed
    assert result.loop.ended == "completed"
    figures: dict[str, Any] = json.loads((tmp_path / "run" / "summary.json").read_text())["log"]
    data = read_log(tmp_path / "run" / "run.mcap")
    kept = sum(map(len, data.topics.values())) + len(data.events) + len(data.operator)
    handed = 4 * result.loop.cycles + len(result.loop.events) + len(result.loop.skipped_stamps_ns) + 1
    assert figures["records"] == kept
    assert figures["lost"] - (handed - kept) in (0, 1), "and the request to arm, where there was one"
    assert figures["lost"] > 1000
    assert "writer" in figures["problem"]


def test_a_log_that_cannot_be_opened_is_refused_before_the_clock_starts(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    (folder / "run.mcap").mkdir(parents=True)
    with pytest.raises(RecorderError, match=r"the log cannot be written: .*Is a directory"):
        Recorder(folder / "run.mcap", real_time=False)


LIMIT = 300_000


def when_running(monkeypatch: pytest.MonkeyPatch, now_ns: int, do: Callable[[int], object]) -> None:
    """``do(pid of the writer)`` once, at the first cycle from ``now_ns`` on."""
    read: Callable[[SimulatedRig, int], Measurement] = SimulatedRig.read
    done: list[int] = []

    def doing(self: SimulatedRig, at_ns: int) -> Measurement:
        if at_ns >= now_ns and not done:
            done.append(writer_pid())
            do(done[0])
        return read(self, at_ns)

    monkeypatch.setattr(SimulatedRig, "read", doing)


@pytest.mark.parametrize("clock", [("--fast",), ()], ids=["lock-step", "real-time"])
def test_a_full_file_system_is_reported_and_the_run_ends_cleanly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: tuple[str, ...]) -> None:
    folder = tmp_path / "run"
    when_running(monkeypatch, 0, lambda pid: resource.prlimit(pid, resource.RLIMIT_FSIZE, (LIMIT, LIMIT)))
    run = command("run", "-c", RIG, *clock, "--duration", "1", "--out", folder, "--json")
    assert run.exit_code == 4, run.output
    assert "File too large" in run.stderr
    assert "records lost" in run.stderr
    summary = json.loads(run.stdout)
    assert summary["ended"] == "completed", "control goes on"
    assert summary["log"]["lost"] > 0
    data = read_log(folder / "run.mcap")
    assert not data.complete
    assert (folder / "run.mcap").stat().st_size <= LIMIT
    assert len(data.topics["/control"]) > 50


def test_a_limit_on_files_that_leaves_no_shared_memory_is_refused_in_one_line(tmp_path: Path) -> None:
    """``ulimit -f`` holds for the memory of the ring as well: said before anything moves."""
    arguments = ["run", "-c", str(RIG), "--fast", "--duration", "1", "--out", str(tmp_path / "run"), "--json"]
    run = subprocess.run(
        [sys.executable, "-c", "from spsp_ctrl.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT)),
    )
    assert run.returncode == 2
    assert len(run.stderr.strip().splitlines()) == 1
    assert "ulimit -f" in run.stderr


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MiB."""
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)], capture_output=True).returncode:
        pytest.skip("only root may mount a small file system")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_a_disk_that_fills_up_costs_the_rest_of_the_log_and_nothing_else(small_disk: Path) -> None:
    run = command("run", "-c", RIG, "--fast", "--duration", "3", "--out", small_disk / "run", "--json")
    assert run.exit_code == 4, run.output
    assert json.loads(run.stdout)["ended"] == "completed"
    assert "No space left on device" in run.stderr
    assert "summary.json: cannot be written" in run.stderr
    assert sorted(p.name for p in (small_disk / "run").iterdir()) == ["model.yaml", "rig.yaml", "run.mcap", "scenario.yaml"]
    data = read_log(small_disk / "run" / "run.mcap")
    assert len(data.topics["/control"]) > 500
    assert "/truth" in data.topics


def test_a_read_only_file_system_is_refused_before_anything_moves(small_disk: Path) -> None:
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    run = command("run", "-c", RIG, "--fast", "--duration", "1", "--out", small_disk / "run", "--json")
    one_clear_line(run, 2, "read-only file system", "run")


@pytest.mark.parametrize("real_time", [False, True], ids=["lock-step", "real-time"])
def test_a_writer_that_stands_still_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_time: bool) -> None:
    """SIGSTOP, as a dead network disk looks like: lost in real time when the ring is full, waited for in lock-step, but not for ever."""
    monkeypatch.setattr(writer, "STALL_S", 0.3)
    monkeypatch.setattr(writer, "CLOSE_TIMEOUT_S", 0.5)
    monkeypatch.setattr(writer.Recorder.__init__, "__kwdefaults__", {"attachments": None, "metadata": None, "ring_bytes": 200_000})
    when_running(monkeypatch, 400_000_000, lambda pid: os.kill(pid, signal.SIGSTOP))
    result = run_short(tmp_path / "run", 0.9, real_time=real_time)
    assert result.loop.ended == "completed"
    figures = result.summary["log"]
    assert figures["lost"] > 1000
    assert figures["problem"] == ("the log writer is too slow, its ring is full" if real_time else "the log writer has stood still for 0.3 s")
    assert 200 < len(result.log.topics["/control"]) < 600
    handed = 4 * result.loop.cycles + len(result.loop.events) + len(result.loop.skipped_stamps_ns)
    assert figures["records"] + figures["lost"] - handed in (1, 2), "and the last event, and the request to arm"
