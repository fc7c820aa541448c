"""The recorder at the loop: packs a cycle into a ring in shared memory that the writer process empties. In real time it never waits."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
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
from spsp_ctrl.recording.ring import Ring, create

RING_BYTES = 8 << 20
"""What may wait for the writer, about 5 s at 1 kHz: beyond it records are lost in real time, and the loop waits in lock-step."""
LOOK_EVERY = 50
"""Cycles between two looks at whether the writer still lives (a system call of about a microsecond)."""
WAIT_S = 1e-3
STALL_S = 20.0
"""A writer that takes nothing for so long is given up in lock-step, so that nothing hangs on a dead disk."""
CLOSE_TIMEOUT_S = 60.0
_ALL, _BYTES = len(SIZES), sum(SIZES)
_BYTES_WITHOUT_TRUTH = sum(SIZES[:-1])
_FRAME, _FRAME_WITHOUT_TRUTH = FRAME.size + _BYTES, FRAME.size + _BYTES_WITHOUT_TRUTH


class RecorderStats(NamedTuple):
    """What became of the records."""

    records: int
    lost: int
    problem: str


class RecorderError(Exception):
    """The log cannot be started."""


class Recorder:
    """Writes ``path`` through a process of its own; once constructed, the file is open (else ``RecorderError``).

    Later problems are counted and reported (``problem``, and at the end), never raised into the loop.
    """

    def __init__(
        self,
        path: Path,
        *,
        real_time: bool,
        attachments: Mapping[str, str] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        ring_bytes: int = RING_BYTES,
    ) -> None:
        try:
            fd = create(ring_bytes)
        except OSError as error:
            text = f"no shared memory of {ring_bytes} bytes for the log: {error.strerror}; look at `ulimit -f` and at the memory limit of the session"
            raise RecorderError(text) from None
        command = [sys.executable, "-m", "spsp_ctrl.recording.writer_process", str(path), str(fd)]
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, pass_fds=(fd,)
            )
            self._ring = Ring(fd)
        except OSError as error:
            raise RecorderError(f"the log writer cannot be started: {error}") from None
        finally:
            os.close(fd)
        assert self._process.stdout is not None
        with self._process.stdout as answer:
            ready = answer.readline()
        if not ready:
            complaint = self._process.communicate()[1].decode(errors="replace").strip().splitlines()
            self._ring.close()
            raise RecorderError(complaint[-1] if complaint else f"the log writer ended with {self._process.returncode}")
        if real_time:
            self._ring.touch()
        self._real_time = False  # before the clock starts there is time to wait
        self._cycles = 0
        self._sequence = dict.fromkeys(TOPIC_NAMES, 0)
        self.records = 0
        self.lost = 0
        self.problem = ""
        """What is wrong with the log, in words; empty while all is well."""
        self._closed = False
        self._dead = False
        for name, text in (attachments or {}).items():
            self._frame(ATTACHMENT, name.encode() + b"\0" + text.encode())
        for name, values in (metadata or {}).items():
            self.metadata(name, values)
        self._real_time = real_time

    @property
    def pid(self) -> int:
        """The writer process."""
        return self._process.pid

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        """One cycle: three or four messages of one log time."""
        t = measurement.stamp_ns
        k = self._cycles
        self._cycles = k + 1
        if not k % LOOK_EVERY:
            self._look()
        size, messages = (_FRAME, _ALL) if truth is not None else (_FRAME_WITHOUT_TRUTH, _ALL - 1)
        ring = self._ring
        at = -1 if self._dead else ring.place(size)
        if at < 0:
            at = self._wait(size, messages)
            if at < 0:
                return
        if truth is not None:
            pack_with_truth(ring.data, at, t, k, (CYCLE, _ALL, t, k, _BYTES), measurement, control, timing, truth)
        else:
            pack_without_truth(ring.data, at, t, k, (CYCLE, _ALL - 1, t, k, _BYTES_WITHOUT_TRUTH), measurement, control, timing)
        ring.publish(size)
        self.records += messages

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
            self._put(FRAME.pack(RAW, 0, max(log_time_ns, 0), len(entries), len(block)) + block, len(entries))

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Facts about the session."""
        self._frame(METADATA, json.dumps([name, dict(values)]).encode())

    def counts(self) -> tuple[int, int]:
        """Messages handed over and lost so far."""
        return self.records, self.lost

    def close(self) -> RecorderStats:
        """Wait for the writer to write what is left, and say what became of the records."""
        if self._closed:
            return RecorderStats(self.records, self.lost, self.problem)
        self._closed = True
        self._real_time = False
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            self.problem = self.problem or "the log writer did not finish in time"
        self._look()
        self._ring.close()
        return RecorderStats(self.records, self.lost, self.problem)

    def _json(self, topic: str, stamp_ns: int, value: Mapping[str, object]) -> None:
        payload = json.dumps(value).encode()
        sequence = self._sequence[topic]
        self._sequence[topic] = sequence + 1
        self._put(FRAME.pack(MESSAGE, TOPIC_NAMES.index(topic), max(stamp_ns, 0), sequence, len(payload)) + payload, 1)

    def _frame(self, kind: int, payload: bytes) -> None:
        self._put(FRAME.pack(kind, 0, 0, 0, len(payload)) + payload, 0)

    def _put(self, frame: bytes, messages: int) -> None:
        if len(frame) > self._ring.capacity:
            self.problem = self.problem or f"a record of {len(frame)} bytes is larger than the ring to the log writer"
            self.lost += messages
            return
        if (not self._dead and self._ring.put(frame)) or (self._wait(len(frame), messages) >= 0 and self._ring.put(frame)):
            self.records += messages

    def _wait(self, size: int, messages: int) -> int:
        """The ring is full: lose the record in real time or when the writer is dead, else wait for room. Returns the place, or -1."""
        at = -1
        if not self._real_time:
            patience, backlog = STALL_S, self._ring.backlog()
            while at < 0 and self._look():
                time.sleep(WAIT_S)
                at = self._ring.place(size)
                patience -= WAIT_S
                if self._ring.backlog() != backlog:
                    patience, backlog = STALL_S, self._ring.backlog()
                elif patience <= 0.0 and at < 0:
                    self.problem = self.problem or f"the log writer has stood still for {STALL_S:g} s"
                    self._process.kill()
                    self._process.wait()
        if at < 0:
            self.lost += messages
            self.problem = self.problem or "the log writer is too slow, its ring is full"
        return at

    def _look(self) -> bool:
        """Whether the writer lives. When it has died, what it left in the ring is lost; what it said of it is the problem."""
        code = self._process.poll()
        if code is None:
            return True
        stderr = self._process.stderr
        if not self._dead and stderr is not None:
            self._dead = True
            complaint = stderr.read().decode(errors="replace").strip().splitlines()
            stderr.close()
            left = self.records - self._ring.taken()
            if code or not self._closed:
                # what the writer says itself beats what the loop saw of it
                self.problem = complaint[-1] if complaint else self.problem or f"the log writer has died ({_ending(code)})"
            self.records -= left
            self.lost += left
        return False


def _ending(code: int) -> str:
    return f"killed by signal {-code}" if code < 0 else f"exit {code}"
