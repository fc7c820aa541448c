"""The fast way of a cycle into the log: the same messages, index and statistics as the library's own writer gives."""

from __future__ import annotations

import io
import os
from collections import deque
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import SeekingReader
from mcap.records import ChunkIndex
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from spsp_ctrl.messages import Control, Measurement, Timing, Truth
from spsp_ctrl.recording import frames
from spsp_ctrl.recording.ring import Ring, create
from spsp_ctrl.recording.schema import CYCLIC, TOPICS
from spsp_ctrl.recording.writer_process import CHUNK_BYTES, CHUNK_NS, McapLog, serve

COUNT = 200
PERIOD_NS = 1_000_000


def _message(cls: type, rng: np.random.Generator) -> object:
    codec = next(c for c in TOPICS.values() if c.cls is cls)
    values = []
    for name in codec.dtype.names or ():
        kind = codec.dtype[name].kind
        values.append(
            bool(rng.integers(2)) if kind == "b" else int(rng.integers(-(2**62), 2**62)) if kind == "i" else float(rng.normal())
        )
    return codec.build(tuple(values))


def _cycles() -> list[tuple[int, list[object]]]:
    rng = np.random.default_rng(5)
    return [
        (k * PERIOD_NS, [_message(cls, rng) for cls in ((Measurement, Control, Timing, Truth) if k % 7 else (Measurement, Control, Timing))])
        for k in range(COUNT)
    ]


def _frame(t: int, k: int, messages: list[object]) -> bytes:
    pack = frames.pack_with_truth if len(messages) == len(CYCLIC) else frames.pack_without_truth
    size = sum(frames.SIZES[: len(messages)])
    frame = bytearray(frames.FRAME.size + size)
    pack(frame, 0, t, k, (frames.CYCLE, len(messages), t, k, size), *messages)
    return bytes(frame)


def _serve(stream: list[bytes], path: Path, capacity: int = 1 << 20) -> None:
    """The frames through a ring and the writer, which asks for more whenever the ring is empty."""
    fd = create(capacity)
    ring, other = Ring(fd), Ring(fd)
    os.close(fd)
    waiting = deque(stream)

    def ended() -> bool:
        while waiting and ring.put(waiting[0]):
            waiting.popleft()
        return not waiting

    serve(other, path, ended)
    for end in (ring, other):
        end.close()


def _event(t: int, k: int) -> bytes:
    payload = b'{"stamp_ns": %d, "level": "info", "id": "x", "text": "y"}' % t
    return frames.FRAME.pack(frames.MESSAGE, frames.TOPIC_NAMES.index("/events"), t, k, len(payload)) + payload


@pytest.mark.parametrize("capacity", [1 << 20, 5000])
def test_log_equals_that_of_the_library(tmp_path: Path, capacity: int) -> None:
    path = tmp_path / "run.mcap"
    stream: list[bytes] = []
    plain = io.BytesIO()
    library = Writer(plain, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
    library.start()
    channels = [library.register_channel(topic, "", 0) for topic in frames.TOPIC_NAMES]
    for k, (t, messages) in enumerate(_cycles()):
        stream.append(_frame(t, k, messages))
        for channel, topic, message in zip(channels, CYCLIC, messages, strict=False):
            library.add_message(channel, t, TOPICS[topic].encode(message), t, k)  # type: ignore[arg-type]
        if k % 50 == 20:
            # an event may be older than the cycle it is reported in
            stream.append(_event(t - 3 * PERIOD_NS, k))
            library.add_message(channels[4], t - 3 * PERIOD_NS, _event(t - 3 * PERIOD_NS, k)[frames.FRAME.size :], t - 3 * PERIOD_NS, k)
    library.finish()

    _serve(stream, path, capacity)

    def content(data: io.BufferedReader | io.BytesIO) -> tuple[list[object], object]:
        reader = SeekingReader(data, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        s = summary.statistics
        found = [(c.topic, m.log_time, m.publish_time, m.sequence, m.data) for _, c, m in reader.iter_messages()]
        return found, (s.message_count, dict(s.channel_message_counts), s.message_start_time, s.message_end_time)

    plain.seek(0)
    with path.open("rb") as written:
        assert content(written) == content(plain)


def test_chunks_are_small_and_short(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    _serve([_frame(t, k, m) for k, (t, m) in enumerate(_cycles())], path)
    with path.open("rb") as stream:
        chunks = [r for r in StreamReader(stream).records if isinstance(r, ChunkIndex)]
    assert len(chunks) > COUNT * PERIOD_NS // CHUNK_NS
    assert max(c.uncompressed_size for c in chunks) <= CHUNK_BYTES
    assert max(c.message_end_time - c.message_start_time for c in chunks) < CHUNK_NS
    # each message is found by the index of its chunk
    assert all(set(c.message_index_offsets) >= {1, 2, 3} for c in chunks)


@given(st.integers(0, 2**62), st.integers(0, 2**32 - 1), st.integers(0, 1000))
def test_offsets_and_payloads(t: int, k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    messages = [_message(TOPICS[topic].cls, rng) for topic in CYCLIC]
    data = _frame(t, k, messages)[frames.FRAME.size :]
    assert len(data) == sum(frames.SIZES)
    for topic, offset, size, message in zip(CYCLIC, frames.OFFSETS, frames.SIZES, messages, strict=True):
        opcode, length, channel, sequence, log_time, publish_time = frames.RECORD.unpack_from(data, offset)
        assert (opcode, length, channel) == (5, size - 9, CYCLIC.index(topic) + 1)
        assert (sequence, log_time, publish_time) == (k, t, t)
        payload = data[offset + frames.RECORD.size : offset + size]
        assert payload == TOPICS[topic].encode(message)  # type: ignore[arg-type]


def test_channels_are_numbered_as_the_records_say() -> None:
    log = McapLog(io.BytesIO())
    assert log._channels[: len(CYCLIC)] == [CYCLIC.index(topic) + 1 for topic in CYCLIC]
