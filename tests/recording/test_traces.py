"""Bus traces: there and back through each format, read by python-can and by an independent CDR decoder; mistakes are said."""

from __future__ import annotations

import json
from pathlib import Path

import can
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from spsp_ctrl.cli import cli
from spsp_ctrl.recording.raw import EXTENDED, REMOTE, RawEntry, decode, encode, place, topic
from spsp_ctrl.recording.traces import FORMATS, export_trace, import_trace, raw_entries

CANDUMP = """(1700000000.000100) can0 080#
(1700000000.000350) can0 181#3702A86100000A00
(1700000000.000600) can0 201#0F00F401
(1700000000.001000) can0 1ABCDEF0#0102
(1700000000.002000) can0 701#R
(1700000000.002100) can0 701#05
"""
WANTED = [(0x80, ""), (0x181, "3702a86100000a00"), (0x201, "0f00f401"), (0x1ABCDEF0 | EXTENDED, "0102"), (0x701 | REMOTE, ""), (0x701, "05")]


NAMES = st.text("abcdefgh_0123", min_size=1, max_size=20)


@given(st.integers(0, 2**61), NAMES, st.booleans(), st.integers(0, 0x1FFFFFFF), st.booleans(), st.binary(max_size=8))
def test_frames_and_bytes_come_back(stamp: int, name: str, sent: bool, number: int, extended: bool, data: bytes) -> None:
    stamp %= 2**31 * 10**9
    frame = RawEntry(stamp, name, sent, number | EXTENDED if extended else number & 0x7FF, data)
    assert decode(name, sent, True, encode(frame)) == frame
    piece = RawEntry(stamp, name, sent, -1, data * 9)
    assert decode(name, sent, False, encode(piece)) == piece
    assert place(topic(name, sent)) == (name, sent)
    for cut in (3, 10, len(encode(frame)) - 1):
        with pytest.raises(ValueError, match=r".*"):
            decode(name, sent, True, encode(frame)[:cut])


@pytest.fixture
def imported(tmp_path: Path) -> Path:
    (tmp_path / "trace.log").write_text(CANDUMP)
    assert import_trace(tmp_path / "trace.log", None, tmp_path / "t.mcap") == {"can0": 6}
    return tmp_path / "t.mcap"


def test_a_candump_trace_becomes_raw_topics(imported: Path) -> None:
    entries = [e for e in raw_entries(imported) if isinstance(e, RawEntry)]
    assert [(e.identifier, e.data.hex()) for e in entries] == WANTED
    assert [e.stamp_ns for e in entries] == [0, 250_000, 500_000, 900_000, 1_900_000, 2_000_000]
    with imported.open("rb") as stream:  # an independent decoder of the schema and of the bytes
        messages = [m for *_, m in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()]
    assert [(m.id, m.dlc, bytes(m.data)[: m.dlc].hex()) for m in messages] == [(i & 0x1FFFFFFF, len(d) // 2, d) for i, d in WANTED]
    assert messages[3].is_extended
    assert messages[4].is_rtr
    assert messages[1].header.stamp.nanosec == 250_000


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_is_read_by_others_and_comes_back(imported: Path, tmp_path: Path, kind: str) -> None:
    out = tmp_path / f"out{FORMATS[kind]}"
    assert export_trace(imported, None, kind, out) == (6, "can0", "")
    with can.LogReader(out) as reader:
        read = list(reader)
    assert [(m.arbitration_id, bytes(m.data).hex()) for m in read] == [(i & 0x1FFFFFFF, d) for i, d in WANTED]
    assert [m.timestamp - read[0].timestamp for m in read] == pytest.approx([0, 0.00025, 0.0005, 0.0009, 0.0019, 0.002], abs=2e-6)
    assert import_trace(out, "can0", tmp_path / "back.mcap") == {"can0": 6}
    back = [e for e in raw_entries(tmp_path / "back.mcap") if isinstance(e, RawEntry)]
    assert [(e.identifier, e.data.hex()) for e in back] == WANTED


def test_candump_is_exported_as_it_was_imported(imported: Path, tmp_path: Path) -> None:
    export_trace(imported, "can0", "candump", tmp_path / "out.log")
    lines = [line.removesuffix(" R").removesuffix(" T") for line in (tmp_path / "out.log").read_text().splitlines()]
    assert lines == CANDUMP.splitlines()


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        (CANDUMP.replace("0.002100", "0.000050"), "t.log", "frame 6 is 1.950 ms earlier"),
        ("", "t.log", "holds no frames"),
        ("not a trace at all\n", "t.log", "is no log trace"),
        (CANDUMP, "t.txt", "--map"),
        ("(1.0) can0 181##00102030405060708090A\n", "t.log", "CAN FD"),
    ],
)
def test_a_wrong_trace_is_refused_with_the_reason(tmp_path: Path, text: str, name: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    done = CliRunner().invoke(cli, ["log", "import", str(tmp_path / name), "--out", str(tmp_path / "o.mcap")])
    assert done.exit_code in (2, 4)
    assert said in done.output
    assert sorted(p.name for p in tmp_path.iterdir()) == [name]


def test_the_command_line_writes_and_refuses(imported: Path, tmp_path: Path) -> None:
    def run(*words: str) -> tuple[int, str]:
        done = CliRunner().invoke(cli, ["log", "export", str(imported), *words])
        return done.exit_code, done.output

    assert run("--to", "candump", "--out", str(tmp_path / "a.log")) == (0, f"{tmp_path / 'a.log'}: 6 frames of can0\n")
    assert "exists" in run("--to", "candump", "--out", str(tmp_path / "a.log"))[1]
    code, text = run("--to", "candump", "--bus", "can7", "--out", str(tmp_path / "b.log"))
    assert (code, "there are can0" in text) == (4, True)
    assert run("--to", "blf", "--out", str(tmp_path / "b.log"))[0] == 2
    assert run("/imu", "--to", "blf", "--out", str(tmp_path / "b.blf"))[0] == 2


def test_a_log_without_raw_frames_says_so(tmp_path: Path) -> None:
    fixture = next((Path(__file__).parents[1] / "fixtures").glob("*.mcap"))
    done = CliRunner().invoke(cli, ["log", "export", str(fixture), "--to", "asc", "--out", str(tmp_path / "x.asc")])
    assert done.exit_code == 4
    assert "no raw frames" in done.output


def test_raw_topics_are_printed_and_a_wrong_one_named(imported: Path) -> None:
    def cat(*words: str) -> tuple[int, list[str]]:
        done = CliRunner().invoke(cli, ["log", "cat", str(imported), *words])
        return done.exit_code, done.output.splitlines()

    code, lines = cat("/raw/can0", "--start", "0.0004", "--limit", "2")
    assert code == 0
    assert [json.loads(line) for line in lines] == [
        {"stamp_ns": 500_000, "sent": False, "id": "201", "data": "0f00f401"},
        {"stamp_ns": 900_000, "sent": False, "id": "1ABCDEF0", "data": "0102"},
    ]
    assert len(cat("/raw/can0/rx")[1]) == 6
    code, lines = cat("/raw/can1")
    assert (code, "/raw/can0/rx" in lines[-1]) == (4, True)
    assert cat("/raw/can0/rx", "-f", "id")[0] == 4
