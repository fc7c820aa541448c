"""Control time of a rig on wires: that of its SYNCs. SYNC k stands at k periods, and what arrives is stamped by when the SYNCs really went out."""

from __future__ import annotations

from collections import deque


class ControlTime:
    """Where the SYNCs stand on the clock of the transports, followed slowly: one late SYNC moves nothing."""

    FOLLOW = 0.02
    """Part of a deviation that is taken over per SYNC; about 50 SYNCs of memory."""
    PHASE = 0.4
    """Part of a period after the beginning of a cycle at which its SYNC goes out: its commands are ready by then, the answers of the devices are
    there when the next cycle begins, and the instants of SYNC do not depend on how long a cycle computes."""
    OUTLIER = 0.25
    """Deviations beyond this part of a period count as this much (a late SYNC), unless they last."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._guard_ns = period_ns // 16
        """A SYNC in time stands this much before its cycle. One that is later than that is stamped in the future of its cycle, where it was."""
        self._offset_ns: float | None = None
        self._begin_ns: float | None = None
        self.sync_ns = 0
        """Control time of the newest SYNC."""
        self.sync_seq = -1
        """Its number."""

    def exact(self, now_ns: int, cycle: int) -> None:
        """A SYNC of a rig in lock-step."""
        self.sync_ns, self.sync_seq = now_ns, cycle

    def begin(self, clock_ns: int, now_ns: int) -> None:
        """Cycle ``now_ns`` begins at ``clock_ns``. The earliest beginning counts, and slowly the others: a late one is late."""
        seen = clock_ns - now_ns
        if self._begin_ns is None or abs(seen - self._begin_ns) > 20 * self._period_ns:
            self._begin_ns, self._offset_ns = float(seen), None
        elif seen < self._begin_ns:
            self._begin_ns += 0.2 * (seen - self._begin_ns)
        else:
            self._begin_ns += 1e-4 * (seen - self._begin_ns)
        if self._offset_ns is None:
            self._offset_ns = self._begin_ns + self.PHASE * self._period_ns - self._period_ns + self._guard_ns

    def sync_due_ns(self, now_ns: int) -> int:
        """When the SYNC that closes cycle ``now_ns`` is due, on the transports' clock."""
        return round((self._begin_ns or 0.0) + now_ns + self.PHASE * self._period_ns)

    def sent(self, clock_ns: int, cycle: int) -> None:
        """SYNC number ``cycle`` has gone out at ``clock_ns`` of the transports' clock. Its own control time is that of ``sync_ns``."""
        nominal = cycle * self._period_ns
        seen = float(clock_ns - nominal)
        if self._offset_ns is None or abs(seen - self._offset_ns) > 20.0 * self._period_ns:
            self._offset_ns = seen + self._guard_ns
        deviation = seen + self._guard_ns - self._offset_ns
        bound = self.OUTLIER * self._period_ns
        self._offset_ns += self.FOLLOW * min(max(deviation, -bound), bound)
        self.sync_ns = nominal + min(round(deviation) - self._guard_ns, self._period_ns // 2)
        self.sync_seq = cycle

    def control_ns(self, clock_ns: int, now_ns: int) -> int:
        """Control time of an instant of the transports' clock, not after ``now_ns``."""
        if self._offset_ns is None:
            return now_ns
        return min(round(clock_ns - self._offset_ns), now_ns)


class Answers:
    """Which SYNC an answer of a node belongs to: the oldest unanswered one. A lost answer shows in all later ones being a period late."""

    WATCHED = 50
    """Answers over which that is judged."""
    MOST = 10
    """Periods after which a SYNC will not be answered any more."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._open: deque[tuple[int, int]] = deque()
        self._least_ns = 1 << 62
        self._seen = 0
        self.lost = 0
        """SYNCs without an answer."""

    def sync(self, sync_ns: int, seq: int) -> None:
        """A SYNC goes out."""
        self._open.append((sync_ns, seq))
        while sync_ns - self._open[0][0] > self.MOST * self._period_ns:
            self._open.popleft()
            self.lost += 1

    def match(self, arrived_ns: int) -> tuple[int, int] | None:
        """Time and number of the SYNC of an answer; None when none is open."""
        if not self._open:
            return None
        found = self._open.popleft()
        self._least_ns = min(self._least_ns, arrived_ns - found[0])
        self._seen += 1
        if self._seen == self.WATCHED:
            if self._least_ns > 0.95 * self._period_ns and self._open:
                found = self._open.popleft()
                self.lost += 1
            self._least_ns, self._seen = 1 << 62, 0
        return found
