"""ODrive CANSimple, the host's side: commands, readings, and the walk to closed loop."""

from __future__ import annotations

import struct
from math import isfinite
from typing import NamedTuple

from spsp_ctrl.devices import odrive_table as T

Frame = tuple[int, bytes]
_HEARTBEAT, _TWO = struct.Struct(T.HEARTBEAT_LAYOUT), struct.Struct(T.TWO_FLOATS)
_LARGEST = 3.4028234663852886e38


class Heartbeat(NamedTuple):
    """State of an axis."""

    errors: int
    state: int
    procedure_result: int
    trajectory_done: bool

    @property
    def text(self) -> str:
        """The errors in words; empty for none."""
        return ", ".join(word for bit, word in T.ERROR_TEXT.items() if self.errors & bit) or (f"0x{self.errors:08X}" if self.errors else "")


class Pair(NamedTuple):
    """Two numbers of one frame: position (turns) and speed (turns/s); current set and measured (A); bus voltage (V) and current (A)."""

    first: float
    second: float


def identifier(node: int, command: int) -> int:
    """CAN identifier."""
    return node << T.COMMAND_BITS | command


def read_heartbeat(frame: Frame, node: int) -> Heartbeat | None:
    """Heartbeat of a node, None for any other frame."""
    if frame[0] != identifier(node, T.HEARTBEAT) or len(frame[1]) != _HEARTBEAT.size:
        return None
    errors, state, result, done = _HEARTBEAT.unpack(frame[1])
    return Heartbeat(errors, state, result, bool(done & 1))


def read_pair(frame: Frame, node: int, command: int) -> Pair | None:
    """``ESTIMATES``, ``CURRENTS``, ``BUS``, ``TEMPERATURES`` or ``TORQUES`` of a node; None for any other frame and for numbers that are none."""
    if frame[0] != identifier(node, command) or len(frame[1]) != _TWO.size:
        return None
    pair = Pair(*_TWO.unpack(frame[1]))
    return pair if isfinite(pair.first) and isfinite(pair.second) else None


def query(node: int, command: int) -> Frame:
    """Ask for one of ``QUERIES``; on a real bus this is a remote frame."""
    return identifier(node, command), b""


def set_state(node: int, state: int) -> Frame:
    """Ask for an axis state."""
    return identifier(node, T.SET_STATE), struct.pack(T.ONE_WORD, state)


def set_mode(node: int, control: int) -> Frame:
    """Torque or velocity control; the input is the set-point."""
    return identifier(node, T.SET_MODE), struct.pack(T.TWO_WORDS, control, T.PASSTHROUGH)


def clear_errors(node: int) -> Frame:
    """Acknowledge errors."""
    return identifier(node, T.CLEAR_ERRORS), b"\0"


def estop(node: int) -> Frame:
    """Power off at once."""
    return identifier(node, T.ESTOP), b""


def _number(value: float) -> float:
    """A number that a single float holds; one that is none becomes 0, which moves nothing."""
    return 0.0 if value != value else min(max(value, -_LARGEST), _LARGEST)


def torque(node: int, torque_nm: float) -> Frame:
    """Torque command."""
    return identifier(node, T.INPUT_TORQUE), struct.pack(T.ONE_FLOAT, _number(torque_nm))


def velocity(node: int, turns_s: float, torque_nm: float = 0.0) -> Frame:
    """Speed command with a torque feed-forward."""
    return identifier(node, T.INPUT_VELOCITY), struct.pack(T.TWO_FLOATS, _number(turns_s), _number(torque_nm))


class Walker:
    """What to send so that the axis is on or off. Errors are cleared only by ``reset``."""

    def __init__(self, node: int, control: int) -> None:
        self._node, self._control = node, control
        self._reset = False

    def reset(self) -> None:
        """Acknowledge errors with the next step."""
        self._reset = True

    def step(self, heard: Heartbeat | None, wanted: bool) -> list[Frame]:
        """Frames for the newest heartbeat; nothing while none was heard or the axis is where it shall be."""
        if heard is None:
            return []
        if heard.errors:
            reset, self._reset = self._reset, False
            return [clear_errors(self._node)] if reset else []
        self._reset = False
        if wanted and heard.state == T.IDLE:
            return [set_mode(self._node, self._control), set_state(self._node, T.CLOSED_LOOP)]
        if not wanted and heard.state != T.IDLE:
            return [set_state(self._node, T.IDLE)]
        return []
