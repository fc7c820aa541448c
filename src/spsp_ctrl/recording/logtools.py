"""What ``spsp-ctrl log`` does: look into a log, export a topic, repair an unfinished file."""

from __future__ import annotations

import csv
import difflib
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spsp_ctrl.recording.reader import LogError, read_log, records
from spsp_ctrl.recording.schema import JSON_TOPICS


@dataclass(frozen=True, slots=True)
class LogInfo:
    """Contents of a log in short."""

    path: str
    bytes: int
    complete: bool
    problem: str
    start_s: float
    end_s: float
    duration_s: float
    topics: dict[str, dict[str, float]]
    missing_cycles: int
    attachments: list[str]
    metadata: dict[str, dict[str, str]]

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return asdict(self)

    def lines(self) -> Iterator[str]:
        """For a person."""
        yield f"{self.path}: {self.bytes / 1e6:.2f} MB, {self.duration_s:.3f} s"
        if self.complete:
            yield "complete"
        else:
            yield f"UNFINISHED ({self.problem}); everything up to {self.end_s:.3f} s was recovered. `spsp-ctrl log repair` makes a finished copy."
        if self.missing_cycles:
            yield f"{self.missing_cycles} cycles are missing"
        for topic, facts in self.topics.items():
            yield f"  {topic:<14} {int(facts['messages']):>9} messages {facts['rate_hz']:9.1f} Hz"
        for name, values in self.metadata.items():
            yield f"{name}: " + ", ".join(f"{key}={value}" for key, value in sorted(values.items()))
        yield "attachments: " + (", ".join(self.attachments) or "none")


def info(path: Path) -> LogInfo:
    """Summarise a log, finished or not."""
    data = read_log(path)
    starts, ends, topics = [], [], {}
    for topic, times in data.log_times.items():
        rate = (len(times) - 1) / max(float(times[-1] - times[0]) * 1e-9, 1e-9) if len(times) > 1 else 0.0
        topics[topic] = {"messages": float(len(times)), "rate_hz": rate}
        if len(times):
            starts.append(float(times[0]) * 1e-9)
            ends.append(float(times[-1]) * 1e-9)
    for topic, rows in (("/events", data.events), ("/operator", data.operator)):
        topics[topic] = {"messages": float(len(rows)), "rate_hz": 0.0}
    seconds = max(ends, default=0.0) - min(starts, default=0.0)
    for topic, count in data.others.items():
        topics[topic] = {"messages": float(count), "rate_hz": count / seconds if seconds > 0.0 else 0.0}
    counted = next((topic for topic in ("/measurement", "/axis") if topic in data.topics), None)
    cycles = data.topics[counted]["cycle"] if counted else np.zeros(0, np.int64)
    missing = int((np.diff(cycles) - 1).clip(0).sum()) if len(cycles) > 1 else 0
    start, end = min(starts, default=0.0), max(ends, default=0.0)
    return LogInfo(
        str(path),
        path.stat().st_size,
        data.complete,
        data.problem,
        start,
        end,
        end - start,
        topics,
        missing,
        sorted(data.attachments),
        data.metadata,
    )


def cat(path: Path, topic: str, fields: tuple[str, ...], start_s: float, end_s: float, limit: int) -> Iterator[dict[str, Any]]:
    """Messages of one topic as flat dictionaries; of a bus or line (``/raw/NAME`` or one direction of it) its frames and bytes."""
    if topic.startswith("/raw/"):
        yield from _raw(path, topic, fields, start_s, end_s, limit)
        return
    data = read_log(path)
    count = 0
    if topic in JSON_TOPICS:
        for row in data.events if topic == "/events" else data.operator:
            if start_s <= row["stamp_ns"] * 1e-9 <= end_s and count < limit:
                count += 1
                yield row
        return
    rows = _rows(data.topics, topic, path)
    names = _names(rows.dtype.names or (), fields, topic, path)
    times = data.log_times[topic] * 1e-9
    for row in rows[(times >= start_s) & (times <= end_s)][:limit]:
        yield {name: row[name].item() for name in names}


def _raw(path: Path, topic: str, fields: tuple[str, ...], start_s: float, end_s: float, limit: int) -> Iterator[dict[str, Any]]:
    """Frames as identifier and data in hex, in file order."""
    from spsp_ctrl.recording.raw import RawEntry
    from spsp_ctrl.recording.traces import raw_entries

    if fields:
        raise LogError(f"{path}: {topic} has no fields to choose from")
    count, seen = 0, set()
    for entry in raw_entries(path):
        if not isinstance(entry, RawEntry):
            continue
        place = f"/raw/{entry.name}"
        direction = f"{place}/{'tx' if entry.sent else 'rx'}"
        seen.add(direction)
        if topic not in (place, direction) or not start_s <= entry.stamp_ns * 1e-9 <= end_s or count >= limit:
            continue
        count += 1
        row: dict[str, Any] = {"stamp_ns": entry.stamp_ns, "sent": entry.sent}
        if entry.identifier >= 0:
            row["id"] = f"{entry.identifier & 0x1FFFFFFF:03X}"
        yield row | {"data": entry.data.hex()}
    if not any(name == topic or name.startswith(topic + "/") for name in seen):
        raise LogError(f"{path}: no topic {topic!r}; this log has {', '.join(sorted(seen)) or 'no raw topics'}")


def export_csv(path: Path, topic: str, out: Path, fields: tuple[str, ...] = (), *, force: bool = False) -> int:
    """One topic as CSV, one column a field with its unit in the name; written whole or not at all. Returns the number of rows."""
    _free(out, path, force)
    data = read_log(path)
    rows = _rows(data.topics, topic, path)
    names = _names(rows.dtype.names or (), fields, topic, path)
    part = out.with_name(out.name + ".part")
    try:
        with part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(names)
            writer.writerows(zip(*(rows[name].tolist() for name in names), strict=True))
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)
    return len(rows)


def repair(path: Path, out: Path, *, force: bool = False) -> tuple[int, str]:
    """A finished copy with everything that was readable, never over the input. Returns messages kept and what was wrong with the input."""
    from mcap.records import Attachment, Channel, Message, Metadata, Schema
    from mcap.writer import CompressionType, Writer

    _free(out, path, force)
    part = out.with_name(out.name + ".part")
    kept, problem = 0, ""
    try:
        with part.open("wb") as stream:
            writer = Writer(stream, chunk_size=64 * 1024, compression=CompressionType.LZ4, enable_data_crcs=True)
            writer.start(profile="ros2", library="spsp-ctrl repair")
            schemas: dict[int, int] = {0: 0}
            channels: dict[int, int] = {}
            seen: set[str] = set()
            for record in records(path):
                if isinstance(record, Schema) and record.id not in schemas:
                    schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                elif isinstance(record, Channel) and record.id not in channels and record.schema_id in schemas:
                    channels[record.id] = writer.register_channel(record.topic, record.message_encoding, schemas[record.schema_id])
                elif isinstance(record, Message) and record.channel_id not in channels:
                    problem = f"messages on an unknown channel {record.channel_id} were left out"
                elif isinstance(record, Message):
                    writer.add_message(channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence)
                    kept += 1
                elif isinstance(record, Attachment):
                    writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
                elif isinstance(record, Metadata) and record.name not in seen:
                    seen.add(record.name)
                    writer.add_metadata(record.name, dict(record.metadata))
                elif isinstance(record, str):
                    problem = problem or record
            writer.finish()
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)
    return kept, problem


def _free(out: Path, path: Path, force: bool) -> None:
    if out.resolve() == path.resolve():
        raise FileExistsError(f"{out} is the log itself; give another name")
    if out.exists() and not force:
        raise FileExistsError(f"{out} exists; give another name or --force")


def _rows(topics: dict[str, Any], topic: str, path: Path) -> Any:
    if topic in JSON_TOPICS:
        raise LogError(f"{path}: {topic} is text, not a table; see it with `spsp-ctrl log cat`")
    if topic not in topics:
        known = [*topics, *JSON_TOPICS]
        near = difflib.get_close_matches(topic, known, n=1, cutoff=0.4)
        raise LogError(f"{path}: no topic {topic!r}; this log has {', '.join(known)}" + (f"; did you mean {near[0]!r}?" if near else ""))
    return topics[topic]


def _names(known: tuple[str, ...], wanted: tuple[str, ...], topic: str, path: Path) -> list[str]:
    for name in wanted:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
            raise LogError(f"{path}: {topic} has no field {name!r}" + (f"; did you mean {near[0]!r}?" if near else ""))
    return list(wanted or known)
