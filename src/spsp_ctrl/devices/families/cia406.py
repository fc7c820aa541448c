"""CiA 406 nodes as the rig uses them: a multi-turn position without wraps, and the fault bits of the converter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from spsp_ctrl.devices import canopen_host as host
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import cia406_host as node_host
from spsp_ctrl.devices import cia406_table as T
from spsp_ctrl.devices.canopen_host import Frame, SdoDialogue
from spsp_ctrl.devices.families.base import NOBODY, Identity
from spsp_ctrl.messages import NO_RESOLVER, ResolverSample

if TYPE_CHECKING:
    from spsp_ctrl.config.devices import AngleNode


class Cia406Angle:
    """One encoder or resolver node."""

    def __init__(self, node: AngleNode) -> None:
        self._node = node.node
        self._expect = node.counts_per_turn
        self._sign = -1 if node.reversed else 1
        self._offset = node.offset_counts
        self._dialogue = SdoDialogue(self._node, node_host.start_up(self._node, node.heartbeat_ms))
        self._span = 1 << 32
        self._counter: host.Counter | None = None
        self._tpdo = C.TPDO1 + self._node
        self.counts_per_turn = 0
        self.done = False
        self.problem = ""
        self.identity = NOBODY
        self.shaft: ResolverSample = NO_RESOLVER

    def start_up(self, now_ns: int, frames: list[Frame]) -> list[Frame]:
        """See ``AngleFamily``."""
        out = self._dialogue.step(now_ns, frames)
        self.problem = self._dialogue.problem
        if self._dialogue.done and not self.done and not self.problem:
            v = self._dialogue.values
            if not node_host.is_encoder(v[C.DEVICE_TYPE, 0]):
                self.problem = f"node {self._node} is no CiA 406 encoder (device type 0x{v[C.DEVICE_TYPE, 0]:08X})"
            else:
                words = [f"0x{v[C.IDENTITY, sub]:08X}" for sub in (1, 2, 4, 3)]
                self.restore({"units_per_turn": v[T.UNITS_PER_TURN, 0], "span": v[T.TOTAL_RANGE, 0], "identity": words})
        return out

    def facts(self) -> dict[str, Any]:
        """See ``Dialogue``."""
        return {"units_per_turn": self.counts_per_turn, "span": self._span, "identity": list(self.identity)}

    def restore(self, facts: dict[str, Any]) -> None:
        """See ``Dialogue``."""
        self.counts_per_turn, self._span = int(facts["units_per_turn"]), int(facts["span"]) or 1 << 32
        self.identity = Identity(*facts["identity"])
        self.done = True
        if self._expect is not None and self._expect != self.counts_per_turn:
            self.problem = f"node {self._node} counts {self.counts_per_turn} units per turn, the rig file says {self._expect}"

    def operate(self) -> list[Frame]:
        """See ``AngleFamily``."""
        return [host.nmt(C.NMT_START, self._node)]

    def receive(self, frame: Frame, stamp_ns: int, seq: int) -> None:
        """See ``AngleFamily``."""
        if frame[0] != self._tpdo:
            return
        reading = node_host.read_angle(frame, self._node)
        if reading is None:
            return
        position = reading.position
        if self._counter is None:
            self._counter = host.Counter(self._span)
            if position >= self._span // 2:
                position -= self._span  # just below zero
        counts = self._sign * (self._counter.step(position) - self._offset)
        self.shaft = ResolverSample(stamp_ns, seq, counts, reading.status)

    def leave(self) -> list[Frame]:
        """See ``AngleFamily``."""
        return [host.nmt(C.NMT_RESET_COMMUNICATION, self._node)]
