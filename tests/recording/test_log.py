"""What is written is what is read: by our reader and by independent ones."""

from __future__ import annotations

import dataclasses
import json
import math
import struct
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from tests.sessions import run_short

from spsp_ctrl import messages as m
from spsp_ctrl.recording.reader import LogError, digest_topics, messages, read_log
from spsp_ctrl.recording.schema import CYCLIC, JSON_TOPICS, TOPICS, Codec, _codec, ros_name, ros_schema
from spsp_ctrl.runtime.identity import law_digest

CLASSES = [
    c for c in vars(m).values() if isinstance(c, type) and issubclass(c, tuple) and hasattr(c, "_fields") and c is not m.OperatorRequest
]
"""Every message; an operator request holds text and travels as JSON."""
LEAF: dict[Any, st.SearchStrategy[Any]] = {
    float: st.floats(width=64),
    int: st.integers(-(2**63), 2**63 - 1),
    bool: st.booleans(),
}


def strategy(cls: Any) -> st.SearchStrategy[Any]:
    return st.tuples(*(LEAF[k] if k in LEAF else strategy(k) for k in get_type_hints(cls).values())).map(cls._make)


def leaves(message: Any) -> list[Any]:
    return [leaf for item in message for leaf in (leaves(item) if isinstance(item, tuple) else [item])]


def bits(value: Any) -> bytes:
    return struct.pack("<d", value) if isinstance(value, float) else repr(value).encode()


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_codec_round_trip_is_bit_for_bit(cls: Any) -> None:
    codec = next((c for c in TOPICS.values() if c.cls is cls), None) or _codec(cls)

    @settings(max_examples=15, deadline=None)
    @given(strategy(cls))
    def check(message: Any) -> None:
        payload = codec.encode(message)
        back = codec.decode(payload)
        assert type(back) is cls
        assert [*map(bits, leaves(back))] == [*map(bits, leaves(message))]
        assert [*map(type, leaves(back))] == [*map(type, leaves(message))]
        row = np.frombuffer(payload, codec.dtype)[0]
        assert [*map(bits, row.tolist())] == [*map(bits, leaves(message))]

    check()


def test_array_and_message_views_agree_on_one_topic() -> None:
    codec = TOPICS["/timing"]
    rows = [m.Timing(*range(k, k + len(m.Timing._fields))) for k in range(5)]
    array = np.frombuffer(b"".join(map(codec.encode, rows)), codec.dtype)
    assert [*messages(array, m.Timing)] == rows
    assert array["lateness_ns"].tolist() == [r.lateness_ns for r in rows]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_short(tmp_path_factory.mktemp("log") / "run", 0.4).folder / "run.mcap"


def flat(message: Any, names: tuple[str, ...]) -> list[Any]:
    values = []
    for name in names:
        value = message
        for part in name.split("."):
            value = getattr(value, part)
        values.append(value)
    return values


def test_independent_readers_see_the_same_numbers(log: Path) -> None:
    ours = read_log(log)
    assert ours.complete, ours.problem
    seen: dict[str, int] = dict.fromkeys(CYCLIC, 0)
    with log.open("rb") as stream:
        for _, channel, message, decoded in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=[*CYCLIC]):
            k = seen[channel.topic]
            seen[channel.topic] += 1
            row = ours.topics[channel.topic][k]
            names = row.dtype.names
            assert [*map(bits, flat(decoded, names))] == [*map(bits, row.tolist())]
            assert message.log_time == message.publish_time == row["stamp_ns"] == ours.log_times[channel.topic][k]
            assert message.sequence == k
    assert seen == {topic: len(rows) for topic, rows in ours.topics.items()}
    assert seen["/control"] > 400


def test_topics_schemas_attachments_and_metadata_are_as_documented(log: Path) -> None:
    with log.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        header, summary = reader.get_header(), reader.get_summary()
        attachments = {a.name: a for a in reader.iter_attachments()}
        events = [json.loads(message.data) for _, _, message in reader.iter_messages(topics=["/events"])]
    assert header.profile == "ros2"
    assert summary is not None
    assert summary.statistics is not None
    channels = {c.topic: (c.message_encoding, summary.schemas[c.schema_id]) for c in summary.channels.values()}
    assert set(channels) == {*CYCLIC, *JSON_TOPICS}
    for topic in CYCLIC:
        codec = TOPICS[topic]
        encoding, schema = channels[topic]
        assert (encoding, schema.encoding, schema.name) == ("cdr", "ros2msg", ros_name(codec.cls))
        assert schema.data.decode() == ros_schema(codec.cls)
    for topic, json_schema in JSON_TOPICS.items():
        encoding, schema = channels[topic]
        assert (encoding, schema.encoding, json.loads(schema.data)) == ("json", "jsonschema", json_schema)
    assert {i.compression for i in summary.chunk_indexes} == {"lz4"}
    assert max(i.message_end_time - i.message_start_time for i in summary.chunk_indexes) <= 50_000_000
    for name in ("rig.yaml", "scenario.yaml", "model.yaml"):
        assert attachments[name].data == (log.parent / name).read_bytes()
        assert attachments[name].media_type == "application/yaml"
    data = read_log(log)
    run = data.metadata["run"]
    assert (run["seed"], run["mode"], run["rate_hz"], run["law_digest"]) == ("1", "lock-step", "1000", law_digest())
    assert {"spsp_ctrl", "python"} <= data.metadata["versions"].keys()
    assert "realtime_granted" in data.metadata["result"]
    assert "clock" not in data.metadata, "wall-clock times belong to a run in real time only"
    assert data.events == events
    assert [e["text"] for e in events][:2] == ["DISARMED", "DISARMED -> READY"]


def test_read_log_of_some_topics(log: Path) -> None:
    some, everything = read_log(log, ("/control",)), read_log(log)
    assert set(some.topics) == {"/control"}
    assert some.topics["/control"].tobytes() == everything.topics["/control"].tobytes()
    assert some.events == everything.events


def test_digests_tell_topics_apart(log: Path, tmp_path: Path) -> None:
    digests = digest_topics(log)
    assert set(digests) == {*CYCLIC, *JSON_TOPICS}
    assert len(set(digests.values())) == len(digests)
    other = run_short(tmp_path / "other", 0.4, seed=2).folder / "run.mcap"
    assert digest_topics(other)["/measurement"] != digests["/measurement"]


def test_a_log_of_another_layout_is_refused_with_the_place(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    codec: Codec = TOPICS["/timing"]
    monkeypatch.setitem(TOPICS, "/timing", dataclasses.replace(codec, cls=m.Command))
    with pytest.raises(LogError, match=r"/timing has another layout.*line 2 .*int64 cycle.*int64 seq"):
        read_log(log)


def test_values_in_a_log_are_finite(log: Path) -> None:
    rows = read_log(log).topics["/control"]
    assert all(math.isfinite(v) for v in rows[-1].tolist())
