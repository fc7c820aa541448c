"""Reading a log: finished, unfinished or cut anywhere. What is whole is returned, what is not is said."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, DataEnd, Footer, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from spsp_ctrl.recording.schema import JSON_TOPICS, TOPICS, Codec, ros_schema

MAGIC = b"\x89MCAP0\r\n"


class LogError(Exception):
    """A log that cannot be read or understood; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class LogData:
    """A log in memory: cyclic topics as structured arrays with dotted field names and ``log_time``."""

    path: Path
    topics: dict[str, NDArray[Any]]
    log_times: dict[str, NDArray[np.int64]]
    events: list[dict[str, Any]]
    operator: list[dict[str, Any]]
    attachments: dict[str, bytes]
    metadata: dict[str, dict[str, str]]
    complete: bool
    problem: str
    others: dict[str, int] = field(default_factory=dict)
    """Messages on topics that are not ours."""


def records(path: Path) -> Iterator[Any]:
    """Every whole record of a file, in file order; ends with a string when the file does not end properly."""
    if not path.exists():
        raise LogError(f"{path}: no such file")
    if path.is_dir():
        raise LogError(f"{path}: is a folder; give the .mcap file in it")
    try:
        stream = path.open("rb")
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    with stream:
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            what = "is empty" if not magic else "is not an MCAP log"
            raise LogError(f"{path}: {what}; a log of spsp-ctrl is called run.mcap")
        stream.seek(0)
        finished = in_summary = False
        try:
            for record in StreamReader(stream, emit_chunks=False, validate_crcs=True).records:
                finished = finished or isinstance(record, Footer)
                in_summary = in_summary or isinstance(record, DataEnd)
                # the summary repeats what stood before the messages and has no checksum of its own here
                if not (in_summary and isinstance(record, Schema | Channel)):
                    yield record
        except Exception as error:  # the parsers below have no common base for what damaged bytes make them raise
            yield f"{type(error).__name__}: {error}".rstrip(": ").splitlines()[0]
            return
        if not finished:
            yield "the file ends before its index"


def read_log(path: Path, topics: tuple[str, ...] | None = None) -> LogData:
    """Read a log, finished or not. Raises ``LogError`` for what is not a log at all or has our topics in another layout."""
    path = Path(path)
    payloads: dict[str, list[bytes]] = {}
    times: dict[str, list[int]] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, str] = {}
    texts: dict[str, list[dict[str, Any]]] = {name: [] for name in JSON_TOPICS}
    attachments: dict[str, bytes] = {}
    metadata: dict[str, dict[str, str]] = {}
    others: dict[str, int] = {}
    problem = ""
    for record in records(path):
        if isinstance(record, Message):
            topic = channels.get(record.channel_id, "?")
            if topic in payloads:
                payloads[topic].append(record.data)
                times[topic].append(record.log_time)
            elif topic in texts:
                row = _json_row(record.data, JSON_TOPICS[topic]["required"])
                if row is None:
                    problem = problem or f"a message on {topic} is not JSON of its schema"
                else:
                    texts[topic].append(row)
            else:
                others[topic] = others.get(topic, 0) + 1
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record.topic
            if record.topic in TOPICS and record.topic not in payloads and (topics is None or record.topic in topics):
                _same_layout(path, record.topic, TOPICS[record.topic], schemas.get(record.schema_id))
                payloads[record.topic] = []
                times[record.topic] = []
        elif isinstance(record, Attachment):
            attachments[record.name] = record.data
        elif isinstance(record, Metadata):
            metadata[record.name] = dict(record.metadata)
        elif isinstance(record, str):
            problem = problem or record
    arrays = {}
    for topic, items in payloads.items():
        dtype = TOPICS[topic].dtype
        if any(len(item) != dtype.itemsize for item in items):
            raise LogError(f"{path}: messages on {topic} are not {dtype.itemsize} bytes long (see docs/log-format.md)")
        arrays[topic] = np.frombuffer(b"".join(items), dtype)
    return LogData(
        path,
        arrays,
        {topic: np.array(values, np.int64) for topic, values in times.items()},
        texts["/events"],
        texts["/operator"],
        attachments,
        metadata,
        not problem,
        problem,
        others,
    )


def _json_row(data: bytes, required: list[str]) -> dict[str, Any] | None:
    try:
        row = json.loads(data)
    except ValueError:
        return None
    return row if isinstance(row, dict) and set(required) <= row.keys() else None


def _same_layout(path: Path, topic: str, codec: Codec, schema: Schema | None) -> None:
    if schema is None or schema.encoding != "ros2msg":
        encoding = schema.encoding if schema else "none"
        raise LogError(f"{path}: {topic} has schema encoding {encoding!r}, expected 'ros2msg' (see docs/log-format.md)")
    ours, theirs = ros_schema(codec.cls).splitlines(), schema.data.decode("utf-8", "replace").splitlines()
    for line in range(max(len(ours), len(theirs))):
        expected = ours[line] if line < len(ours) else "nothing"
        found = theirs[line] if line < len(theirs) else "nothing"
        if expected != found:
            raise LogError(
                f"{path}: {topic} has another layout than this version of spsp-ctrl: "
                f"line {line + 1} of its schema is {found!r}, expected {expected!r}"
            )


def messages(rows: NDArray[Any], cls: type) -> Iterator[Any]:
    """Rows of a topic as messages of ``messages.py``, bit for bit."""
    codec = next(c for c in TOPICS.values() if c.cls is cls)
    size = codec.dtype.itemsize
    data = rows.tobytes()
    for at in range(0, len(data), size):
        yield codec.decode(data[at : at + size])


def digest_topics(path: Path) -> dict[str, str]:
    """Digest of each topic over log time, sequence and payload: equal digests mean equal bytes."""
    channels: dict[int, str] = {}
    digests: dict[str, Any] = {}
    for record in records(path):
        if isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            digest = digests.setdefault(channels.get(record.channel_id, "?"), hashlib.sha256())
            digest.update(struct.pack("<QII", record.log_time, record.sequence, len(record.data)))
            digest.update(record.data)
    return {topic: digest.hexdigest() for topic, digest in sorted(digests.items())}
