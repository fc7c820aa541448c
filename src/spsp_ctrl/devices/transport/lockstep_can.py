"""The wire inside this process as a python-can interface: ``can.Bus(interface="spsp-lockstep", channel="rig")``."""

from __future__ import annotations

from collections import deque
from typing import Any

import can

from spsp_ctrl.devices.transport.lockstep import medium


class LockstepBus(can.BusABC):
    """A python-can bus on the wire of that channel. ``recv`` never waits: in lock-step nothing comes later."""

    def __init__(self, channel: str = "rig", **kwargs: Any) -> None:
        self.channel_info = f"spsp-lockstep {channel}"
        self._wire = medium(channel)
        self._heard: deque[can.Message] = deque()
        self._wire.join(self._hear)
        super().__init__(channel=channel, **kwargs)

    def _hear(self, identifier: int, data: bytes) -> None:
        stamp = self._wire.now_ns * 1e-9
        self._heard.append(can.Message(timestamp=stamp, arbitration_id=identifier, data=data, is_extended_id=False, is_rx=True))

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand a frame to everybody else on the wire."""
        self._wire.transmit(self._hear, msg.arbitration_id, bytes(msg.data))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return (self._heard.popleft() if self._heard else None), False

    def shutdown(self) -> None:
        """Leave the wire."""
        self._wire.leave(self._hear)
        super().shutdown()
