"""A rig whose buses and lines are those of a log: recorded frames and bytes go through the same decoders in the same calls."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from spsp_ctrl.config.rig import BusDriver, RigConfig
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices.transport.base import ALL_WELL, Arrived, Bytes
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.bus import BusRig
from spsp_ctrl.rig.control_time import ControlTime
from spsp_ctrl.rig.raw import RawEntry


class _Recorded:
    """A bus or line that hands over what came with the same call in the recording."""

    def __init__(self, entries: Mapping[int, list[tuple[int, int, bytes]]], immediate: bool) -> None:
        self.immediate = immediate
        self.fault = ALL_WELL
        self._entries = entries
        self._polls = 0

    def _next(self) -> list[tuple[int, int, bytes]]:
        self._polls += 1
        return self._entries.get(self._polls, [])

    def close(self) -> None:
        """Nothing to let go of."""


class RecordedCan(_Recorded):
    """See ``CanTransport``. What is sent goes nowhere."""

    def poll(self, now_ns: int) -> list[Arrived]:
        """Frames of the next call."""
        return self._next()

    def send(self, frames: Iterable[tuple[int, bytes]]) -> bool:
        """Goes nowhere."""
        return True


class RecordedLine(_Recorded):
    """See ``SerialTransport``."""

    def poll(self, now_ns: int) -> list[Bytes]:
        """Bytes of the next call."""
        return [(stamp, data) for stamp, _, data in self._next()]

    def send(self, data: bytes) -> bool:
        """Goes nowhere."""
        return True


class _RecordedTime(ControlTime):
    """Control time as it was: arrivals are stamped already, and each SYNC tells its own."""

    def __init__(self, period_ns: int, syncs: list[int]) -> None:
        super().__init__(period_ns)
        self._syncs = iter(syncs)

    def begin(self, clock_ns: int, now_ns: int) -> None:
        """Known."""

    def sync_due_ns(self, now_ns: int) -> int:
        """Nothing is waited for."""
        return 0

    def sent(self, clock_ns: int, cycle: int) -> None:
        """The next SYNC of the recording."""
        self.sync_ns = next(self._syncs, self.sync_ns)
        self.sync_seq = cycle

    def control_ns(self, clock_ns: int, now_ns: int) -> int:
        """Stamps of the recording are those of control time."""
        return clock_ns


class ReplayRig(BusRig):
    """A ``BusRig`` on recorded buses."""

    def __init__(self, config: RigConfig, facts: Mapping[str, Any], entries: Iterable[RawEntry]) -> None:
        driver = config.rig
        if not isinstance(driver, BusDriver):
            raise RigError("the log comes from a rig without buses: there is nothing to decode")
        immediate = driver.world == "in_process"
        arrived: dict[str, dict[int, list[tuple[int, int, bytes]]]] = defaultdict(lambda: defaultdict(list))
        syncs: dict[str, list[int]] = defaultdict(list)
        for entry in entries:
            if not entry.sent:
                arrived[entry.name][entry.poll].append((entry.stamp_ns, entry.identifier, entry.data))
            elif entry.identifier == C.SYNC:
                syncs[entry.name].append(entry.stamp_ns)
        can = {name: RecordedCan(arrived[name], immediate) for name in driver.can}
        serial = {name: RecordedLine(arrived[name], immediate) for name in driver.serial}
        super().__init__(config, can, serial)
        if not immediate:
            self._time = _RecordedTime(self._period_ns, next(iter(syncs.values()), []))
        self.restore(facts)
