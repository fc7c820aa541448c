"""Named faults at the seam: any rig, with what a scenario's ``faults:`` do to its signals. Deterministic for a seed."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from random import Random
from typing import Any

from spsp_ctrl.config.injection import Injection
from spsp_ctrl.messages import Command, Measurement, Truth
from spsp_ctrl.rig.base import Rig, RigIdentity
from spsp_ctrl.rig.signals import BY_NAME, Signal

GARBAGE = (float("nan"), float("inf"), -1e30, 3.4e38, 77.7, -12345.678)
"""What a disturbed line makes of a number."""
GARBAGE_COUNTS = (2**31 - 1, -(2**31), 0x5A5A5A5A, -77777, 0x7FFF)
HISTORY = 8192


class Fault:
    """One injection at work: values go in, values come out."""

    def __init__(self, injection: Injection, seed: int) -> None:
        self.injection = injection
        self.signal: Signal = BY_NAME[injection.signal]
        self._random = Random(f"{seed}/{injection.signal}/{injection.kind}/{injection.at_s}")
        s = self.signal
        size = injection.size
        self._offset = (s.wrong if size is None else size) * s.factor
        self._rms = (s.noisy if size is None else size) * s.factor
        self._every = injection.every or s.every
        self._delay_ns = round((injection.delay_ms or s.delay_ms) * 1e6)
        self._begin_ns = round(injection.at_s * 1e9)
        self._end_ns = self._begin_ns + round(injection.duration_s * 1e9)
        self._past: deque[tuple[int, Any]] = deque(maxlen=HISTORY)
        self._held: Any = None
        self._seen_seq: int | None = None
        self._out: Any = None
        self._count = 0

    def active(self, now_ns: int) -> bool:
        """Whether it acts at ``now_ns``."""
        return self._begin_ns <= now_ns < self._end_ns

    def _is_off(self, now_ns: int) -> bool:
        period_ns = round((self.injection.off_ms + self.injection.on_ms) * 1e6)
        return (now_ns - self._begin_ns) % period_ns < self.injection.off_ms * 1e6

    def _delayed(self, now_ns: int) -> Any:
        found = self._past[0][1]
        for stamp, value in self._past:
            if stamp > now_ns - self._delay_ns:
                break
            found = value
        return found

    def _changed(self, value: Any) -> Any:
        """``garbage``, ``wrong`` and ``noisy`` of one number."""
        kind, random = self.injection.kind, self._random
        if isinstance(value, bool):
            return (not value) if kind == "wrong" else random.random() < 0.5
        if isinstance(value, int):
            if kind == "garbage":
                return random.choice(GARBAGE_COUNTS)
            return value + round(self._offset if kind == "wrong" else random.gauss(0.0, self._rms))
        if kind == "garbage":
            return random.choice(GARBAGE)
        return value + (self._offset if kind == "wrong" else random.gauss(0.0, self._rms))

    def frame(self, sample: Any, now_ns: int) -> Any:
        """A sample with its stamp and sequence; ``sample`` as the rig has it now."""
        if self.signal.frame:
            return self._frame(sample, now_ns)
        # a channel: a new value only with a new frame
        if sample.seq != self._seen_seq:
            self._seen_seq = sample.seq
            row = list(sample)
            for place, value in zip(self.signal.values, self._channel([sample[i] for i in self.signal.values], now_ns), strict=True):
                row[place] = value
            self._out = type(sample)(*row)
        return self._out

    def _frame(self, sample: Any, now_ns: int) -> Any:
        kind = self.injection.kind
        new = sample.seq != self._seen_seq
        if new:
            self._seen_seq = sample.seq
            self._past.append((now_ns, sample))
        if not self.active(now_ns):
            self._held = self._out = sample
            return sample
        if self._held is None:
            self._held = self._out = sample
        if kind == "delayed":
            return self._delayed(now_ns)
        if not new or kind == "off" or (kind == "intermittent" and self._is_off(now_ns)):
            return self._out
        if kind == "slow":
            self._count += 1
            if self._count % self._every:
                return self._out
        elif kind == "stuck":
            # a unit that repeats its last frame with a running counter
            fresh = {name: getattr(sample, name) for name in ("stamp_ns", "received_ns", "seq") if hasattr(sample, name)}
            sample = self._held._replace(**fresh)
        elif kind in ("garbage", "wrong", "noisy"):
            row = list(sample)
            for place in self.signal.values:
                row[place] = self._changed(row[place])
            sample = type(sample)(*row)
        self._out = sample
        return sample

    def _channel(self, values: list[Any], now_ns: int) -> list[Any]:
        kind = self.injection.kind
        self._past.append((now_ns, values))
        if not self.active(now_ns):
            self._held = values
            return values
        if self._held is None:
            self._held = values
        nothing = [type(value)(0) for value in values]
        if kind == "off" or (kind == "intermittent" and self._is_off(now_ns)):
            return nothing
        if kind == "stuck":
            return list(self._held)
        if kind == "slow":
            self._count += 1
            if self._count % self._every == 0:
                self._held = values
            return list(self._held)
        if kind == "delayed":
            return list(self._delayed(now_ns))
        if kind in ("garbage", "wrong", "noisy"):
            return [self._changed(value) for value in values]
        return values

    def command(self, command: Command, now_ns: int) -> Command:
        """What arrives of a command."""
        places = self.signal.values
        row: list[Any] = list(command)
        for place, value in zip(places, self._channel([row[i] for i in places], now_ns), strict=True):
            row[place] = value
        return Command(*row)


class InjectedRig:
    """A rig with faults. The controller cannot tell that they are made."""

    def __init__(self, rig: Rig, injections: Sequence[Injection], seed: int) -> None:
        self._rig = rig
        faults = [Fault(injection, seed) for injection in injections]
        self._inputs = [f for f in faults if f.signal.sample >= 0]
        self._outputs = [f for f in faults if f.signal.sample < 0]
        self._last: Measurement | None = None

    @property
    def rig(self) -> Rig:
        """The rig itself."""
        return self._rig

    def open(self) -> RigIdentity:
        """That of the rig."""
        return self._rig.open()

    def read(self, now_ns: int) -> Measurement:
        """The rig's measurement, as the faults let it through."""
        if self._last is not None and self._last.stamp_ns == now_ns:
            return self._last
        m = self._rig.read(now_ns)
        if self._inputs:
            row: list[Any] = list(m)
            for fault in self._inputs:
                row[fault.signal.sample] = fault.frame(row[fault.signal.sample], now_ns)
            m = Measurement(*row)
        self._last = m
        return m

    def write(self, command: Command, now_ns: int) -> Command:
        """Hand over what arrives; the caller is told what it sent itself, unless the rig refused it."""
        arrives = command
        for fault in self._outputs:
            arrives = fault.command(arrives, now_ns)
        sent = self._rig.write(arrives, now_ns)
        return command if sent == arrives else sent

    def stop(self) -> None:
        """That of the rig."""
        self._rig.stop()

    def close(self) -> None:
        """That of the rig."""
        self._rig.close()

    def truth(self) -> Truth | None:
        """That of the rig."""
        return self._rig.truth()
