"""ODrive CANSimple, the drive's side. The motor is outside: set what is measured, read ``command``."""

from __future__ import annotations

import struct
from typing import NamedTuple

from spsp_ctrl.devices import odrive_table as T

Frame = tuple[int, bytes]
HEARTBEAT_NS = 100_000_000


class AxisCommand(NamedTuple):
    """What the power stage shall do."""

    enabled: bool
    control: int
    torque_nm: float
    turns_s: float


class Axis:
    """One axis. ``receive`` a frame, ``tick`` with the time; both return the frames to send.

    ``estimates_ns`` is the period of the encoder estimates, ``watchdog_ns`` the time without a command after which the axis stops (0: never).
    """

    def __init__(self, node: int, *, estimates_ns: int = 10_000_000, watchdog_ns: int = 0) -> None:
        self._node, self._every, self._watchdog_ns = node, estimates_ns, watchdog_ns
        self._heartbeat_ns: int | None = None
        self._estimates_ns: int | None = None
        self._fed_ns = 0
        self._control = T.VELOCITY_CONTROL
        self._torque_nm = self._turns_s = 0.0
        self.state, self.errors, self.disarm_reason = T.IDLE, 0, 0
        self.turns = self.speed_turns_s = self.current_a = self.current_set_a = self.torque_nm = 0.0
        self.bus_voltage_v, self.bus_current_a, self.inverter_c, self.motor_c = 24.0, 0.0, 25.0, 25.0

    @property
    def command(self) -> AxisCommand:
        """Nothing unless the axis is in closed loop."""
        if self.state != T.CLOSED_LOOP:
            return AxisCommand(False, self._control, 0.0, 0.0)
        return AxisCommand(True, self._control, self._torque_nm, self._turns_s if self._control == T.VELOCITY_CONTROL else 0.0)

    def fail(self, error: int) -> None:
        """An error: power off."""
        self.errors |= error
        self.disarm_reason = error
        self._off()

    def tick(self, now_ns: int) -> list[Frame]:
        """What is due."""
        if self._watchdog_ns and self.state == T.CLOSED_LOOP and now_ns - self._fed_ns > self._watchdog_ns:
            self.fail(T.WATCHDOG)
        out = []
        if self._heartbeat_ns is None or now_ns - self._heartbeat_ns >= HEARTBEAT_NS:
            self._heartbeat_ns = now_ns
            out.append(self._frame(T.HEARTBEAT, struct.pack(T.HEARTBEAT_LAYOUT, self.errors, self.state, 0, 1)))
        if self._every and (self._estimates_ns is None or now_ns - self._estimates_ns >= self._every):
            self._estimates_ns = now_ns
            out += self._answer(T.ESTIMATES)
        return out

    def receive(self, frame: Frame, now_ns: int = 0) -> list[Frame]:
        """React to one frame."""
        number, data = frame[0] & ~T.REMOTE, frame[1]
        if number >> T.COMMAND_BITS != self._node:
            return []
        command = number & (1 << T.COMMAND_BITS) - 1
        if not data and command in T.QUERIES:
            return self._answer(command)
        if command == T.ESTOP:
            self.fail(T.ESTOP_REQUESTED)
        elif command == T.CLEAR_ERRORS:
            self.errors = self.disarm_reason = 0
        elif command == T.SET_STATE and len(data) >= 4:
            self._set_state(struct.unpack_from(T.ONE_WORD, data)[0], now_ns)
        elif command == T.SET_MODE and len(data) == 8:
            control, kind = struct.unpack(T.TWO_WORDS, data)
            if control in (T.TORQUE_CONTROL, T.VELOCITY_CONTROL) and kind == T.PASSTHROUGH:
                self._control = control
        elif command == T.INPUT_TORQUE and len(data) >= 4:
            self._feed(now_ns, struct.unpack_from(T.ONE_FLOAT, data)[0], 0.0)
        elif command == T.INPUT_VELOCITY and len(data) == 8:
            turns_s, torque_nm = struct.unpack(T.TWO_FLOATS, data)
            self._feed(now_ns, torque_nm, turns_s)
        return []

    def _feed(self, now_ns: int, torque_nm: float, turns_s: float) -> None:
        if torque_nm - torque_nm != 0.0 or turns_s - turns_s != 0.0:  # NaN or infinite
            self.fail(T.MISSING_INPUT)
            return
        self._fed_ns, self._torque_nm, self._turns_s = now_ns, torque_nm, turns_s

    def _set_state(self, state: int, now_ns: int) -> None:
        if state == T.IDLE:
            self._off()
        elif state == T.CLOSED_LOOP and not self.errors:
            self.state, self._fed_ns = T.CLOSED_LOOP, now_ns

    def _off(self) -> None:
        self.state = T.IDLE
        self._torque_nm = self._turns_s = 0.0

    def _frame(self, command: int, data: bytes) -> Frame:
        return self._node << T.COMMAND_BITS | command, data

    def _answer(self, command: int) -> list[Frame]:
        if command == T.VERSION:
            return [self._frame(command, struct.pack(T.VERSION_LAYOUT, 2, 4, 4, 58, 0, 6, 10, 0))]
        if command == T.ERRORS:
            return [self._frame(command, struct.pack(T.TWO_WORDS, self.errors, self.disarm_reason))]
        pair = {
            T.ESTIMATES: (self.turns, self.speed_turns_s),
            T.CURRENTS: (self.current_set_a, self.current_a),
            T.TEMPERATURES: (self.inverter_c, self.motor_c),
            T.BUS: (self.bus_voltage_v, self.bus_current_a),
            T.TORQUES: (self._torque_nm, self.torque_nm),
        }[command]
        return [self._frame(command, struct.pack(T.TWO_FLOATS, *pair))]
