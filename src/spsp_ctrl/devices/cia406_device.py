"""CiA 406 encoder or resolver node, the device's side. The shaft is outside: set ``counts``, ``speed`` and ``faults`` before each SYNC."""

from __future__ import annotations

from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import cia406_table as T
from spsp_ctrl.devices.canopen_device import Frame, Node, Object, communication_objects, guard_mappings


class Encoder:
    """A node that answers each SYNC with its position; a fault of the converter shows in the status word and as an emergency."""

    def __init__(
        self, number: int, *, units_per_turn: int = 36_000, turns: int = 4096, identity: tuple[int, int, int, int] = (0, 1, 1, 1)
    ) -> None:
        span = units_per_turn * turns
        if not 0 < span < 1 << 32:
            raise ValueError(f"units per turn ({units_per_turn}) times turns ({turns}) must fit into 32 bits")
        objects = communication_objects(number, "Simulated CiA 406 resolver", T.DEVICE_TYPE, identity, {"tpdo1": T.ANGLE_PDO}) | {
            (T.OPERATING, 0): Object("Operating parameters", 16, 4),
            (T.UNITS_PER_TURN, 0): Object("Measuring units per revolution", 32, units_per_turn),
            (T.TOTAL_RANGE, 0): Object("Total measuring range in units", 32, span),
            (T.PRESET, 0): Object("Preset value", 32, writable=True, low=0, high=span - 1),
            (T.POSITION, 0): Object("Position value", 32, mappable=True),
            (T.SPEED, 0): Object("Speed value count", 8, 1),
            (T.SPEED, 1): Object("Speed value channel 1", 16, signed=True, mappable=True),
            (T.OPERATING_STATUS, 0): Object("Operating status", 16, 4),
            (T.SINGLE_TURN, 0): Object("Single-turn resolution", 32, units_per_turn),
            (T.TURNS, 0): Object("Number of distinguishable revolutions", 16, turns & 0xFFFF),
            (T.OFFSET, 0): Object("Offset value", 32, signed=True),
            (T.CONVERTER_STATUS, 0): Object("Converter status", 16, mappable=True),
        }
        guard_mappings(objects)
        objects[T.PRESET, 0].written = self._preset
        self.node = Node(number, objects)
        self.node.on_sync = self._latch
        self._span = span
        self._offset = 0
        self._told = 0
        self.counts = 0
        """Position of the shaft, multi-turn, without wraps."""
        self.speed = 0
        """In the unit that the node reports, clipped to 16 bits."""
        self.faults = 0
        """Bits of the converter."""

    def receive(self, frame: Frame, now_ns: int = 0) -> list[Frame]:
        """React to one frame of the bus."""
        return self.node.receive(frame, now_ns)

    def tick(self, now_ns: int) -> list[Frame]:
        """Heartbeats, and an emergency when the faults have changed."""
        faults = self.faults & T.CONVERTER_FAULTS
        out = self.node.tick(now_ns)
        if faults != self._told:
            self._told = faults
            out.append(self.node.emergency(C.EMCY_RESOLVER, 1 | 128, bytes((faults,))) if faults else self.node.emergency(C.EMCY_NONE, 0))
        return out

    def _latch(self) -> None:
        objects = self.node.objects
        objects[T.POSITION, 0].value = (self.counts + self._offset) % self._span
        objects[T.SPEED, 1].value = max(-32768, min(32767, self.speed))
        objects[T.CONVERTER_STATUS, 0].value = self.faults & T.CONVERTER_FAULTS

    def _preset(self, value: int) -> int:
        """The shaft is at ``value`` now."""
        self._offset = (value - self.counts) % self._span
        signed = self._offset if self._offset < 1 << 31 else self._offset - (1 << 32)
        self.node.objects[T.OFFSET, 0].value = signed
        self._latch()
        return 0
