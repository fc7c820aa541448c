"""Control time of a rig on wires: that of its SYNCs. SYNC k stands at k periods, and what arrives is stamped by when the SYNCs really went out."""

from __future__ import annotations


class ControlTime:
    """Where the SYNCs stand on the clock of the transports, followed slowly: one late SYNC moves nothing."""

    FOLLOW = 0.02
    """Part of a deviation that is taken over per SYNC; about 50 SYNCs of memory."""
    COMPUTE = 0.2
    """Part of a period that a cycle is taken to need, until its SYNCs have told."""
    OUTLIER = 0.25
    """Deviations beyond this part of a period count as this much (a late SYNC), unless they last."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._offset_ns: float | None = None
        self.sync_ns = 0
        """Control time of the newest SYNC."""
        self.sync_seq = -1
        """Its number."""

    def exact(self, now_ns: int, cycle: int) -> None:
        """A SYNC of a rig in lock-step."""
        self.sync_ns, self.sync_seq = now_ns, cycle

    def start(self, clock_ns: int, now_ns: int) -> None:
        """Cycle ``now_ns`` begins at ``clock_ns``: its SYNC, the next one, goes out a part of the period later."""
        self._offset_ns = clock_ns + self.COMPUTE * self._period_ns - (now_ns + self._period_ns)

    def sync(self, clock_ns: int, cycle: int) -> None:
        """SYNC number ``cycle`` goes out at ``clock_ns`` of the transports' clock."""
        nominal = cycle * self._period_ns
        seen = float(clock_ns - nominal)
        if self._offset_ns is None or abs(seen - self._offset_ns) > 20.0 * self._period_ns:
            self._offset_ns = seen
        else:
            bound = self.OUTLIER * self._period_ns
            self._offset_ns += self.FOLLOW * min(max(seen - self._offset_ns, -bound), bound)
        self.sync_ns, self.sync_seq = nominal, cycle

    def control_ns(self, clock_ns: int, now_ns: int) -> int:
        """Control time of an instant of the transports' clock, not after ``now_ns``."""
        if self._offset_ns is None:
            return now_ns
        return min(round(clock_ns - self._offset_ns), now_ns)
