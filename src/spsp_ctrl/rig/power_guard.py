"""Between a rig and a bus: frames that would switch power on do not get through. What else is sent is kept, to be printed."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import odrive_table as O
from spsp_ctrl.devices.transport.base import Arrived, CanTransport, Fault
from spsp_ctrl.rig.base import RigError

Frame = tuple[int, bytes]
Judge = Callable[[Frame], bool]
_SWITCHED_ON = 0x07
"""Bits 0 to 2 of the controlword: switch on, voltage, no quick stop. Without bit 0 the power stage stays off whatever else is set."""


def _cia402(node: int) -> Judge:
    def powers(frame: Frame) -> bool:
        identifier, data = frame
        if identifier == C.RPDO1 + node and len(data) >= 2:
            return data[0] & _SWITCHED_ON == _SWITCHED_ON
        if identifier == C.SDO_REQUEST + node and len(data) == 8 and int.from_bytes(data[1:3], "little") == C.CONTROLWORD:
            return data[4] & _SWITCHED_ON == _SWITCHED_ON
        return False

    return powers


def _odrive(node: int) -> Judge:
    states = (O.IDLE.to_bytes(4, "little"),)

    def powers(frame: Frame) -> bool:
        return frame[0] == node << O.COMMAND_BITS | O.SET_STATE and frame[1] not in states

    return powers


JUDGES: dict[str, Callable[[int], Judge]] = {"cia402": _cia402, "odrive": _odrive}


class NoPower:
    """A CAN bus on which the drives of a rig cannot be switched on."""

    def __init__(self, bus: CanTransport, judges: Iterable[Judge], keep: int = 0) -> None:
        self._bus, self._judges, self._keep = bus, tuple(judges), keep
        self.immediate = bus.immediate
        self.seen: list[tuple[Frame, bool]] = []
        """The first ``keep`` frames and whether each was held back because it would have switched power on."""
        self.held_back = 0
        """How many were."""

    @property
    def fault(self) -> Fault:
        """That of the bus."""
        return self._bus.fault

    def poll(self, now_ns: int) -> list[Arrived]:
        """See ``CanTransport``."""
        return self._bus.poll(now_ns)

    def send(self, frames: Iterable[Frame]) -> bool:
        """See ``CanTransport``. Frames that switch power on are left out, the others go."""
        through = []
        for frame in frames:
            held = any(powers(frame) for powers in self._judges)
            self.held_back += held
            if len(self.seen) < self._keep:
                self.seen.append((frame, held))
            if not held:
                through.append(frame)
        return self._bus.send(through)

    def close(self) -> None:
        """See ``CanTransport``."""
        self._bus.close()


def no_power(driver: BusDriver, name: str, bus: CanTransport, keep: int = 0) -> NoPower:
    """The bus ``name`` of a rig file, guarded. Raises ``RigError`` for a drive family that it does not know: then nothing can be promised."""
    judges = []
    for place, node in (("drive_pitch", driver.devices.drive_pitch), ("drive_roll", driver.devices.drive_roll)):
        if node.bus != name:
            continue
        if node.family not in JUDGES:
            raise RigError(f"rig.devices.{place}: which frames of the family {node.family!r} switch power on is not known, so it cannot be kept off")
        judges.append(JUDGES[node.family](node.node))
    return NoPower(bus, judges, keep)
