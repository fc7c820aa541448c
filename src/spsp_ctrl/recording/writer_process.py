"""The process that writes the log: reads framed messages from standard input until it ends, so it outlives a killed controller.

``python -m spsp_ctrl.recording.writer_process FILE``. A frame is ``<BHQII``: kind, topic number, log time, sequence, length; then the payload.
"""

from __future__ import annotations

import json
import signal
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from spsp_ctrl import __version__
from spsp_ctrl.recording.schema import JSON_TOPICS, TOPICS, ros_name, ros_schema

FRAME = struct.Struct("<BHQII")
MESSAGE, ATTACHMENT, METADATA, FINISH = 0, 1, 2, 3
CHUNK_BYTES = 64 * 1024
CHUNK_NS = 50_000_000
TOPIC_NAMES = (*TOPICS, *JSON_TOPICS)


class McapLog:
    """An MCAP file whose chunks close at 64 KiB or after 50 ms of log time, whichever comes first."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        # the checksum over the data section also covers what stands between the chunks
        self._writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4, enable_data_crcs=True)
        self._writer.start(profile="ros2", library=f"spsp-ctrl {__version__}")
        self._channels = []
        for topic, codec in TOPICS.items():
            schema = self._writer.register_schema(ros_name(codec.cls), "ros2msg", ros_schema(codec.cls).encode())
            self._channels.append(self._writer.register_channel(topic, "cdr", schema))
        for topic, json_schema in JSON_TOPICS.items():
            name = str(json_schema["title"])
            schema = self._writer.register_schema(name, "jsonschema", json.dumps(json_schema).encode())
            self._channels.append(self._writer.register_channel(topic, "json", schema))
        self._chunk_start_ns = 0
        self.flush()

    def message(self, topic: int, log_time_ns: int, sequence: int, payload: bytes) -> None:
        """One message."""
        if log_time_ns - self._chunk_start_ns >= CHUNK_NS:
            self.flush()
            self._chunk_start_ns = log_time_ns
        self._writer.add_message(self._channels[topic], log_time_ns, payload, log_time_ns, sequence)

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
        self._stream.flush()


def serve(source: BinaryIO, path: Path, ready: Callable[[], None] = lambda: None) -> None:
    """Write everything that arrives until the source ends. ``ready`` is called once the file is open and has its schemas."""
    with path.open("wb") as stream:
        log = McapLog(stream)
        ready()
        head, body = FRAME.size, b""
        while block := source.read1(1 << 20):  # type: ignore[attr-defined]
            body += block
            at = 0
            while len(body) - at >= head:
                kind, topic, log_time, sequence, length = FRAME.unpack_from(body, at)
                end = at + head + length
                if end > len(body):
                    break
                payload = body[at + head : end]
                at = end
                if kind == MESSAGE:
                    log.message(topic, log_time, sequence, payload)
                elif kind == METADATA:
                    log.metadata(*json.loads(payload))
                else:
                    name, _, data = payload.partition(b"\0")
                    log.attachment(name.decode(), data)
            body = body[at:]
        log.finish()


def main() -> None:
    """Entry point: signals to the group are for the controller, this process ends when its input does."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    try:
        serve(sys.stdin.buffer, Path(sys.argv[1]), lambda: print("ready", flush=True))
    except OSError as error:
        print(f"the log cannot be written: {error}", file=sys.stderr)
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
