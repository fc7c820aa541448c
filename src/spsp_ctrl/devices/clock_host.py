"""When a sample was taken, on the control clock: from the device's own stamp and the time at which the packet arrived."""

from __future__ import annotations


class DeviceClock:
    """Offset between a device's clock and ours, by the packets that came through fastest.

    A packet is delayed by the line and by the operating system, never early: so the smallest difference of arrival and stamp in a while is
    the offset plus the shortest delay. Two windows take turns, so that a clock that drifts is followed within their length.
    """

    WINDOW_NS = 500_000_000

    def __init__(self, shortest_delay_ns: int = 0) -> None:
        self._delay = shortest_delay_ns
        self._last_device_ns = -1
        self._last_ns = -1
        self._begun_ns = 0
        self._older: int | None = None
        self._newer: int | None = None
        self.restarts = 0
        """Times that the device's clock went back: it was reset."""

    def stamp(self, device_ns: int, received_ns: int) -> int:
        """Control time of a sample. Never after its arrival, and later than the sample before unless that one had arrived by then."""
        if device_ns < 0:
            return received_ns
        if device_ns < self._last_device_ns:
            self.restarts += 1
            self._older = self._newer = None
        self._last_device_ns = device_ns
        difference = received_ns - device_ns
        if self._newer is None or received_ns - self._begun_ns >= self.WINDOW_NS:
            self._older, self._newer, self._begun_ns = self._newer, difference, received_ns
        self._newer = min(self._newer, difference)
        offset = self._newer if self._older is None else min(self._older, self._newer)
        found = min(device_ns + offset - self._delay, received_ns)
        self._last_ns = min(max(found, self._last_ns + 1), received_ns)
        return self._last_ns
