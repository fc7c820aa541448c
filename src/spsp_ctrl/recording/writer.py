"""The recorder at the loop: packs a cycle and hands batches to the writer process. In real time it never waits."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import subprocess
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from spsp_ctrl.messages import Control, Measurement, OperatorRequest, Timing, Truth
from spsp_ctrl.recording import raw
from spsp_ctrl.recording.frames import (
    ATTACHMENT,
    CYCLE,
    FRAME,
    MESSAGE,
    METADATA,
    RAW,
    SIZES,
    TOPIC_NAMES,
    pack_with_truth,
    pack_without_truth,
)

BATCH_REAL_TIME = 10
"""Cycles per hand-over: 10 ms of log are lost at the most when the controller is killed, on top of an open chunk of 50 ms."""
BATCH_LOCK_STEP = 64
BACKLOG_BYTES = 8 << 20
"""What may wait for the writer (which takes a while to start): beyond it records are lost in real time, and the loop waits in lock-step."""
PIPE_BYTES = 1 << 20
CLOSE_TIMEOUT_S = 60.0
_ALL, _BYTES = len(SIZES), sum(SIZES)
_BYTES_WITHOUT_TRUTH = sum(SIZES[:-1])


class RecorderStats(NamedTuple):
    """What became of the records."""

    records: int
    lost: int
    problem: str


class RecorderError(Exception):
    """The log cannot be started."""


class Recorder:
    """Writes ``path`` through a process of its own; once constructed, the file is open (else ``RecorderError``).

    Later problems are counted and reported at the end, never raised into the loop.
    """

    def __init__(
        self,
        path: Path,
        *,
        real_time: bool,
        attachments: Mapping[str, str] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        command = [sys.executable, "-m", "spsp_ctrl.recording.writer_process", str(path)]
        try:
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        except OSError as error:
            raise RecorderError(f"the log writer cannot be started: {error}") from None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with self._process.stdout as answer:
            ready = answer.readline()
        if not ready:
            complaint = self._process.communicate()[1].decode(errors="replace").strip().splitlines()
            raise RecorderError(complaint[-1] if complaint else f"the log writer ended with {self._process.returncode}")
        self._fd = self._process.stdin.fileno()
        with contextlib.suppress(OSError, AttributeError):
            fcntl.fcntl(self._fd, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        os.set_blocking(self._fd, False)
        self._real_time = real_time
        self._every = BATCH_REAL_TIME if real_time else BATCH_LOCK_STEP
        self._batch: list[bytes] = []
        self._batched = 0
        self._backlog: deque[tuple[bytes, int]] = deque()
        self._backlog_bytes = 0
        self._cycles = 0
        self._sequence = dict.fromkeys(TOPIC_NAMES, 0)
        self.records = 0
        self.lost = 0
        self._problem = ""
        self._closed = False
        for name, text in (attachments or {}).items():
            self._frame(ATTACHMENT, name.encode() + b"\0" + text.encode())
        for name, values in (metadata or {}).items():
            self.metadata(name, values)
        self._hand_over()

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        """One cycle: three or four messages of one log time."""
        t = measurement.stamp_ns
        k = self._cycles
        self._cycles = k + 1
        if truth is None:
            head = (CYCLE, _ALL - 1, t, k, _BYTES_WITHOUT_TRUTH)
            self._batch.append(pack_without_truth(t, k, head, measurement, control, timing))
            self._batched += _ALL - 1
        else:
            head = (CYCLE, _ALL, t, k, _BYTES)
            self._batch.append(pack_with_truth(t, k, head, measurement, control, timing, truth))
            self._batched += _ALL
        if self._cycles % self._every == 0:
            self._hand_over()

    def event(self, stamp_ns: int, level: str, id: str, text: str) -> None:
        """Something happened."""
        self._json("/events", stamp_ns, {"stamp_ns": stamp_ns, "level": level, "id": id, "text": text})

    def operator(self, request: OperatorRequest) -> None:
        """The operator asked for something."""
        self._json("/operator", request.stamp_ns, request._asdict())

    def raw(self, log_time_ns: int, entries: Sequence[Any]) -> None:
        """What went over buses and lines in this cycle (``rig.raw``)."""
        if entries:
            block = raw.pack(entries)
            self._batch.append(FRAME.pack(RAW, 0, max(log_time_ns, 0), len(entries), len(block)) + block)
            self._batched += len(entries)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Facts about the session."""
        self._frame(METADATA, json.dumps([name, dict(values)]).encode())

    def counts(self) -> tuple[int, int]:
        """Messages handed over and lost so far."""
        return self.records, self.lost

    def close(self) -> RecorderStats:
        """Hand over the rest, wait for the writer, and say what became of the records."""
        if self._closed:
            return RecorderStats(self.records, self.lost, self._problem)
        self._closed = True
        with contextlib.suppress(OSError):
            os.set_blocking(self._fd, True)
        self._real_time = False
        self._hand_over()
        stream = self._process.stdin
        assert stream is not None
        with contextlib.suppress(OSError):
            stream.close()
        try:
            self._process.wait(CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._problem = self._problem or "the log writer did not finish in time"
        complaint = self._process.stderr.read().decode(errors="replace").strip() if self._process.stderr else ""
        if self._process.stderr:
            self._process.stderr.close()
        if self._process.returncode:
            # what the writer says itself beats what the loop saw of it (a broken pipe)
            self._problem = complaint.splitlines()[-1] if complaint else f"the log writer ended with {self._process.returncode}"
        return RecorderStats(self.records, self.lost, self._problem)

    def _json(self, topic: str, stamp_ns: int, value: Mapping[str, object]) -> None:
        payload = json.dumps(value).encode()
        sequence = self._sequence[topic]
        self._sequence[topic] = sequence + 1
        number = TOPIC_NAMES.index(topic)
        self._batch.append(FRAME.pack(MESSAGE, number, max(stamp_ns, 0), sequence, len(payload)) + payload)
        self._batched += 1

    def _frame(self, kind: int, payload: bytes) -> None:
        self._batch.append(FRAME.pack(kind, 0, 0, 0, len(payload)) + payload)

    def _hand_over(self) -> None:
        if self._batch:
            block = b"".join(self._batch)
            full = self._backlog_bytes + len(block) > BACKLOG_BYTES
            if self._problem or (full and self._real_time):
                self.lost += self._batched
            else:
                self._backlog.append((block, self._batched))
                self._backlog_bytes += len(block)
            self._batch.clear()
            self._batched = 0
        while self._backlog:
            block, count = self._backlog[0]
            try:
                written = os.write(self._fd, block)
            except BlockingIOError:
                if self._real_time or self._backlog_bytes <= BACKLOG_BYTES:
                    return
                select.select((), (self._fd,), ())
            except OSError as error:
                self._problem = f"the log writer has died ({error.strerror})"
                self.lost += sum(n for _, n in self._backlog)
                self._backlog.clear()
                self._backlog_bytes = 0
                return
            self._backlog_bytes -= written
            if written == len(block):
                self._backlog.popleft()
                self.records += count
            else:
                self._backlog[0] = (block[written:], count)
                if self._real_time:
                    return
