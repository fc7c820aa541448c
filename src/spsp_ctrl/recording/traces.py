"""Bus traces: the raw frames of a log as candump, ASC or BLF file for the tools of the field, and such a file as a log."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from spsp_ctrl import __version__
from spsp_ctrl.recording.raw import EXTENDED, FRAME_NAME, FRAME_SCHEMA, REMOTE, RawEntry, decode, encode, place, topic
from spsp_ctrl.recording.reader import LogError, records

FORMATS = {"candump": ".log", "asc": ".asc", "blf": ".blf"}


def raw_entries(path: Path) -> Iterator[RawEntry | str | int]:
    """Raw frames and bytes in file order; an int is where control time 0 lies on the wall clock (ns), a string says what is wrong with the file."""
    names: dict[int, str] = {}
    channels: dict[int, tuple[str, bool, bool]] = {}
    for record in records(path):
        if isinstance(record, str):
            yield record
        elif isinstance(record, Schema):
            names[record.id] = record.name
        elif isinstance(record, Channel):
            found = place(record.topic)
            if found is not None:
                channels[record.id] = (*found, names.get(record.schema_id) == FRAME_NAME)
        elif isinstance(record, Metadata) and record.name == "clock" and record.metadata.get("utc_ns", "").isdigit():
            yield int(record.metadata["utc_ns"])
        elif isinstance(record, Message) and record.channel_id in channels:
            try:
                yield decode(*channels[record.channel_id], record.data)
            except ValueError as error:
                raise LogError(f"{path}: a raw message cannot be read ({error})") from None


def _writer(kind: str, path: Path) -> Any:
    import can

    if kind == "candump":
        return can.CanutilsLogWriter(path)
    return can.ASCWriter(path) if kind == "asc" else can.BLFWriter(path)


def export_trace(path: Path, bus: str | None, kind: str, out: Path, *, force: bool = False) -> tuple[int, str, str]:
    """Frames of one bus of a log, in order of time. Returns their number, the bus, and what was wrong with the log.

    Stamps are wall-clock time where the log knows it, else control time (from the first frame, when that lies before the run).
    """
    import can

    if out.exists() and not force:
        raise FileExistsError(f"{out} exists; give another name or --force")
    if kind not in FORMATS:
        raise LogError(f"no trace format {kind!r}; there are {', '.join(FORMATS)}")
    if out.suffix != FORMATS[kind]:
        raise FileExistsError(f"{out}: a {kind} file is called *{FORMATS[kind]}, other tools go by it")
    frames: list[RawEntry] = []
    origin_ns, problem = 0, ""
    for entry in raw_entries(path):
        if isinstance(entry, int):
            origin_ns = entry
        elif isinstance(entry, str):
            problem = entry
        elif entry.identifier >= 0:
            frames.append(entry)
    buses = sorted({f.name for f in frames})
    if not buses:
        raise LogError(f"{path}: holds no raw frames; only a run of a rig on buses has them")
    if bus is None and len(buses) > 1:
        raise LogError(f"{path}: frames of several buses ({', '.join(buses)}); choose one with --bus")
    bus = bus or buses[0]
    if bus not in buses:
        raise LogError(f"{path}: no frames of a bus {bus!r}; there are {', '.join(buses)}")
    chosen = sorted((f for f in frames if f.name == bus), key=lambda f: f.stamp_ns)
    if chosen[0].stamp_ns + origin_ns < 0:  # start-up comes before time 0 of the run, and a trace has no negative times
        origin_ns = -chosen[0].stamp_ns
    part = out.with_name(f".part-{out.name}")
    try:
        writer = _writer(kind, part)
        for f in chosen:
            writer.on_message_received(
                can.Message(
                    timestamp=(f.stamp_ns + origin_ns) * 1e-9, arbitration_id=f.identifier & 0x1FFFFFFF, data=f.data, dlc=len(f.data),
                    is_extended_id=bool(f.identifier & EXTENDED), is_remote_frame=bool(f.identifier & REMOTE), is_rx=not f.sent,
                    channel=bus if kind == "candump" else 1,
                )
            )  # fmt: skip
        writer.stop()
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)
    return len(chosen), bus, problem


def import_trace(path: Path, bus: str | None, out: Path, *, force: bool = False) -> dict[str, int]:
    """A candump, ASC or BLF file as a log with raw topics: number of frames by bus. A trace does not always say who sent: then all are received.

    Raises ``LogError``: also for times that go back, and for frames that no classic bus carries.
    """
    import can

    if out.exists() and not force:
        raise FileExistsError(f"{out} exists; give another name or --force")
    if not path.is_file():
        raise FileNotFoundError(2, "no such file", str(path))
    counts: dict[str, int] = {}
    part = out.with_name(f".part-{out.name}")
    try:
        with part.open("wb") as stream:
            writer = Writer(stream, chunk_size=64 * 1024, compression=CompressionType.LZ4, enable_data_crcs=True)
            writer.start(profile="ros2", library=f"spsp-ctrl {__version__}")
            schema = writer.register_schema(FRAME_NAME, "ros2msg", FRAME_SCHEMA.encode())
            channels: dict[tuple[str, bool], int] = {}
            first_ns: int | None = None
            last_ns = 0
            for number, message in enumerate(_messages(can, path)):
                if message.is_error_frame:
                    continue
                if message.is_fd or len(message.data) > 8:
                    raise LogError(f"{path}: frame {number + 1} is a CAN FD frame; only classic CAN is understood")
                stamp_ns = round(message.timestamp * 1e6) * 1000  # a float of seconds holds no more than microseconds since 1970
                if first_ns is None:
                    first_ns = last_ns = stamp_ns
                if stamp_ns < last_ns:
                    back = f"{(last_ns - stamp_ns) * 1e-6:.3f} ms earlier than the one before"
                    raise LogError(f"{path}: frame {number + 1} is {back}; sort the trace by time")
                last_ns = stamp_ns
                name = bus or _bus_name(message.channel)
                sent = not message.is_rx
                flags = (EXTENDED if message.is_extended_id else 0) | (REMOTE if message.is_remote_frame else 0)
                entry = RawEntry(stamp_ns - first_ns, name, sent, message.arbitration_id | flags, bytes(message.data))
                if (name, sent) not in channels:
                    channels[name, sent] = writer.register_channel(topic(name, sent), "cdr", schema)
                writer.add_message(channels[name, sent], entry.stamp_ns, encode(entry), entry.stamp_ns, counts.get(name, 0))
                counts[name] = counts.get(name, 0) + 1
            if not counts:
                raise LogError(f"{path}: holds no frames")
            writer.add_metadata("clock", {"utc_ns": str(first_ns)})
            writer.add_metadata("run", {"kind": "trace", "source": path.name})
            writer.finish()
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)
    return counts


def _bus_name(channel: object) -> str:
    text = str(channel if channel is not None else "can0").lower()
    return f"can{text}" if text.isdigit() else "".join(c if c.isalnum() or c == "_" else "_" for c in text)[:20] or "can0"


def _messages(can: Any, path: Path) -> Iterator[Any]:
    """Frames of a trace by the ending of its name."""
    if path.suffix.lower() not in FORMATS.values():
        raise LogError(f"{path}: a trace is called {', '.join('*' + s for s in FORMATS.values())}")
    try:
        with can.LogReader(path) as reader:
            yield from reader
    except LogError:
        raise
    except Exception as error:  # each reader has its own kinds for what it does not understand
        raise LogError(f"{path}: is no {path.suffix[1:]} trace that python-can reads: {str(error) or type(error).__name__}") from None
