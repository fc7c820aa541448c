"""The process that writes the log: takes frames from a ring in shared memory until its standard input ends, so it outlives a killed controller.

``python -m spsp_ctrl.recording.writer_process FILE FD`` where FD is the memory file of the ring; the frames are those of ``recording.frames``.
"""

from __future__ import annotations

import json
import os
import select
import signal
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MessageIndex
from mcap.writer import CompressionType, Writer

from spsp_ctrl import __version__
from spsp_ctrl.recording.frames import CYCLE, MESSAGE, METADATA, OFFSETS, RAW
from spsp_ctrl.recording.raw import BYTES_NAME, BYTES_SCHEMA, FRAME_NAME, FRAME_SCHEMA, encode, unpack
from spsp_ctrl.recording.raw import topic as raw_topic
from spsp_ctrl.recording.ring import Ring
from spsp_ctrl.recording.schema import CYCLIC, JSON_TOPICS, TOPICS, ros_name, ros_schema

CHUNK_BYTES = 64 * 1024
CHUNK_NS = 50_000_000
POLL_MS = 5
"""How long the writer sleeps when the ring is empty: this much of the log, and an open chunk, is lost when both processes are killed."""


class _Index(MessageIndex):
    """The library's index of one channel in a chunk, written with one ``struct`` call instead of two for each message."""

    def write(self, stream: RecordBuilder) -> None:
        stream.start_record(Opcode.MESSAGE_INDEX)
        flat = [number for entry in self.records for number in entry]
        stream.write(struct.pack(f"<HI{len(flat)}Q", self.channel_id, 8 * len(flat), *flat))
        stream.finish_record()


class _ChunkIndices:
    """The library's list of chunk indices (for the end of the file) in a nameless file: a chunk 20 times a second would make memory grow for ever."""

    def __init__(self, folder: Path | None) -> None:
        self._file: BinaryIO = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - lives as long as the log

    def append(self, index: ChunkIndex) -> None:
        record = RecordBuilder()
        index.write(record)
        self._file.write(record.end())

    def __iter__(self) -> Iterator[_ChunkIndices]:
        return iter((self,))

    def write(self, stream: RecordBuilder) -> None:
        """All of them, as the library writes one."""
        self._file.seek(0)
        while block := self._file.read(1 << 20):
            stream.write(block)

    def close(self) -> None:
        self._file.close()


class McapLog:
    """An MCAP file whose chunks close at 64 KiB or after 50 ms of log time, whichever comes first."""

    def __init__(self, stream: BinaryIO, topics: tuple[str, ...] = CYCLIC) -> None:
        """Channels: the cyclic ``topics``, then the JSON topics, numbered from 1."""
        self._stream = stream
        # the checksum over the data section also covers what stands between the chunks
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4, enable_data_crcs=True)
        self._writer.start(profile="ros2", library=f"spsp-ctrl {__version__}")
        self._channels = []
        for topic in topics:
            codec = TOPICS[topic]
            schema = self._writer.register_schema(ros_name(codec.cls), "ros2msg", ros_schema(codec.cls).encode())
            self._channels.append(self._writer.register_channel(topic, "cdr", schema))
        for topic, json_schema in JSON_TOPICS.items():
            name = str(json_schema["title"])
            schema = self._writer.register_schema(name, "jsonschema", json.dumps(json_schema).encode())
            self._channels.append(self._writer.register_channel(topic, "json", schema))
        # the library adds messages one by one; whole cycles go straight into its open chunk
        library: Any = self._writer
        self._chunk, self._statistics = library._Writer__chunk_builder, library._Writer__statistics
        file = getattr(stream, "name", None)
        self._chunks = _ChunkIndices(Path(file).parent if isinstance(file, str | os.PathLike) else None)
        library._Writer__chunk_indices = self._chunks
        self._places = tuple(zip(self._channels, OFFSETS, strict=False))
        self._raw_channels: dict[tuple[str, bool], int] = {}
        self._chunk_start_ns = 0
        self.flush()

    def cycle(self, topics: int, log_time_ns: int, records: bytes) -> None:
        """The messages of one cycle on the first ``topics`` channels, as the records that ``frames`` lays out."""
        chunk, statistics = self._chunk, self._statistics
        if log_time_ns - self._chunk_start_ns >= CHUNK_NS or chunk.count + len(records) > CHUNK_BYTES:
            self.flush()
            self._chunk_start_ns = log_time_ns
        # cycles come in the order of time, but an event among them may carry an earlier or a later one
        for span, messages in ((chunk, chunk.num_messages), (statistics, statistics.message_count)):
            if messages == 0 or log_time_ns < span.message_start_time:
                span.message_start_time = log_time_ns
            if log_time_ns > span.message_end_time:
                span.message_end_time = log_time_ns
        chunk.num_messages += topics
        statistics.message_count += topics
        at, indices, counts = chunk.count, chunk.message_indices, statistics.channel_message_counts
        for channel, offset in self._places[:topics]:
            if channel not in indices:
                indices[channel] = _Index(channel, [])
            indices[channel].records.append((log_time_ns, at + offset))
            counts[channel] += 1
        chunk.record_writer.write(records)

    def message(self, topic: int, log_time_ns: int, sequence: int, payload: bytes) -> None:
        """One message."""
        if log_time_ns - self._chunk_start_ns >= CHUNK_NS:
            self.flush()
            self._chunk_start_ns = log_time_ns
        self._writer.add_message(self._channels[topic], log_time_ns, payload, log_time_ns, sequence)

    def raw(self, log_time_ns: int, block: bytes) -> None:
        """What went over buses and lines in a cycle; each bus and direction has its topic. The sequence is the poll it came with."""
        if log_time_ns - self._chunk_start_ns >= CHUNK_NS:
            self.flush()
            self._chunk_start_ns = log_time_ns
        for entry, poll in unpack(block):
            key = (entry.name, entry.sent)
            if key not in self._raw_channels:
                name, text = (BYTES_NAME, BYTES_SCHEMA) if entry.identifier < 0 else (FRAME_NAME, FRAME_SCHEMA)
                schema = self._writer.register_schema(name, "ros2msg", text.encode())
                self._raw_channels[key] = self._writer.register_channel(raw_topic(*key), "cdr", schema)
            self._writer.add_message(self._raw_channels[key], log_time_ns, encode(entry), log_time_ns, poll)

    def attachment(self, name: str, data: bytes) -> None:
        """A file of the session."""
        media = "application/yaml" if name.endswith(".yaml") else "application/octet-stream"
        self._writer.add_attachment(0, 0, name, media, data)
        self.flush()

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """Facts about the session."""
        self._writer.add_metadata(name, values)
        self.flush()

    def flush(self) -> None:
        """Everything so far is in the file."""
        self._writer.flush()
        self._stream.flush()

    def finish(self) -> None:
        """Index and footer."""
        self._writer.finish()
        self._chunks.close()
        self._stream.flush()


def serve(ring: Ring, path: Path, ended: Callable[[], bool], ready: Callable[[], None] = lambda: None) -> None:
    """Write everything that comes through the ring until ``ended()`` and nothing is left in it.

    ``ready`` is called once the file is open and has its schemas; ``ended`` is called when the ring is empty and may wait a few milliseconds.
    """
    with path.open("wb") as stream:
        log = McapLog(stream)
        ready()

        def take(kind: int, number: int, log_time: int, sequence: int, payload: bytes) -> int:
            if kind == CYCLE:
                log.cycle(number, log_time, payload)
                return number
            if kind == MESSAGE:
                log.message(number, log_time, sequence, payload)
                return 1
            if kind == RAW:
                log.raw(log_time, payload)
                return sequence
            if kind == METADATA:
                log.metadata(*json.loads(payload))
            else:
                name, _, data = payload.partition(b"\0")
                log.attachment(name.decode(), data)
            return 0

        last = False
        while True:
            if not ring.drain(take):
                if last:
                    break
                # what was put in before the end became known is still to be fetched
                last = ended()
        log.finish()


def main() -> None:
    """Entry point: signals to the group are for the controller, this process ends when its input (which carries nothing) does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    life = select.poll()
    life.register(sys.stdin.fileno(), select.POLLIN | select.POLLHUP)
    try:
        serve(Ring(int(sys.argv[2])), Path(sys.argv[1]), lambda: bool(life.poll(POLL_MS)), lambda: print("ready", flush=True))
    except OSError as error:
        print(f"the log cannot be written: {error}", file=sys.stderr)
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
