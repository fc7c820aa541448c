"""Clocks: who says when a cycle begins. One loop runs on either."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

_new = tuple.__new__


class Tick(NamedTuple):
    """Begin of a cycle: its number, its SYNC on the control clock, how late it began, and how many cycles were skipped before it."""

    cycle: int
    now_ns: int
    lateness_ns: int
    skipped: int


class Clock(Protocol):
    """Paces the loop."""

    real_time: bool

    def start(self) -> None:
        """Cycle 0 begins now."""
        ...

    def tick(self) -> Tick:
        """Wait for the next cycle."""
        ...


class LockStepClock:
    """Simulated time: the next cycle begins as soon as the last one is done."""

    real_time = False

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._cycle = -1

    def start(self) -> None:
        """Nothing to wait for."""

    def tick(self) -> Tick:
        """The next cycle, never late."""
        self._cycle += 1
        return _new(Tick, (self._cycle, self._cycle * self._period_ns, 0, 0))


class MonotonicClock:
    """Absolute deadlines on the monotonic clock. A cycle that cannot begin within its own period is skipped and counted.

    The last ``spin_ns`` before a deadline are spent looking at the clock instead of sleeping: that takes away the wake-up time of the timer, and
    costs that share of a core. Keep it well below half of the period: the kernel throttles a real-time task that never sleeps.
    """

    real_time = True

    def __init__(self, period_ns: int, started: Callable[[int], None] = lambda origin_ns: None, spin_ns: int = 0) -> None:
        """``started`` is told once where time 0 of the control clock lies on the monotonic clock, in ns."""
        self._period_ns = period_ns
        self._spin_ns = spin_ns
        self._started = started
        self._next = 0
        self._origin_ns = 0

    def start(self) -> None:
        """Cycle 0 is due now."""
        self._origin_ns = time.monotonic_ns()
        self._started(self._origin_ns)

    def tick(self) -> Tick:
        """Sleep until the next deadline that has not yet passed by a whole period."""
        due = self._origin_ns + self._next * self._period_ns
        clock, until = time.monotonic_ns, due - self._spin_ns
        now = clock()
        while now < until:
            time.sleep((until - now) * 1e-9)
            now = clock()
        while now < due:
            now = clock()
        skipped = (now - due) // self._period_ns
        cycle = self._next + skipped
        self._next = cycle + 1
        return _new(Tick, (cycle, cycle * self._period_ns, now - due - skipped * self._period_ns, skipped))
