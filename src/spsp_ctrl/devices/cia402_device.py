"""CiA 402 drive, the device's side: the state machine and the objects of a drive in torque or velocity mode. The motor is outside."""

from __future__ import annotations

from typing import NamedTuple

from spsp_ctrl.devices import canopen_table as T
from spsp_ctrl.devices.canopen_device import Frame, Key, Node, Object, communication_objects, guard_mappings


class DriveCommand(NamedTuple):
    """What the power stage shall do until the next SYNC."""

    enabled: bool
    mode: int
    torque_permille: int
    """Target torque in torque mode, its feed-forward in velocity mode."""
    velocity_counts_s: int


class MotorReading(NamedTuple):
    """What the drive measures at SYNC."""

    counts: int
    torque_permille: int
    velocity_counts_s: int = 0
    bus_voltage_v: float = 24.0


def _profile() -> dict[Key, Object]:
    """Objects of the profile."""
    return {
        (T.COMM_LOSS_REACTION, 0): Object("Abort connection option code", 16, 1, signed=True, writable=True, low=0, high=3),
        (T.ERROR_CODE, 0): Object("Error code", 16, mappable=True),
        (T.CONTROLWORD, 0): Object("Controlword", 16, writable=True, mappable=True),
        (T.STATUSWORD, 0): Object("Statusword", 16, mappable=True),
        (T.MODE, 0): Object("Modes of operation", 8, signed=True, writable=True, mappable=True),
        (T.MODE_DISPLAY, 0): Object("Modes of operation display", 8, signed=True, mappable=True),
        (T.POSITION, 0): Object("Position actual value", 32, signed=True, mappable=True),
        (T.VELOCITY, 0): Object("Velocity actual value", 32, signed=True, mappable=True),
        (T.TARGET_TORQUE, 0): Object("Target torque", 16, signed=True, writable=True, mappable=True),
        (T.RATED_CURRENT, 0): Object("Motor rated current", 32),
        (T.RATED_TORQUE, 0): Object("Motor rated torque", 32),
        (T.TORQUE, 0): Object("Torque actual value", 16, signed=True, mappable=True),
        (T.BUS_VOLTAGE, 0): Object("DC link circuit voltage", 32, mappable=True),
        (T.TORQUE_OFFSET, 0): Object("Torque offset", 16, signed=True, writable=True, mappable=True),
        (T.INTERPOLATION_PERIOD, 0): Object("Interpolation time period count", 8, 2),
        (T.INTERPOLATION_PERIOD, 1): Object("Interpolation time period value", 8, 2, writable=True, low=1),
        (T.INTERPOLATION_PERIOD, 2): Object("Interpolation time index", 8, -3, signed=True, writable=True, low=-6, high=0),
        (T.TARGET_VELOCITY, 0): Object("Target velocity", 32, signed=True, writable=True, mappable=True),
        (T.SUPPORTED_MODES, 0): Object("Supported drive modes", 32, T.MODE_BITS),
        (T.TEMPERATURES, 0): Object("Temperature inputs count", 8, 2),
        (T.TEMPERATURES, 1): Object("Temperature input 1", 16, signed=True),
        (T.TEMPERATURES, 2): Object("Temperature input 2", 16, signed=True),
    }


_REGISTER = {0x2: 2, 0x3: 4, 0x4: 8, 0x8: 16}
"""Bit of the error register by the first digit of the error code."""


class Drive:
    """A drive on a CANopen bus. Set ``motor`` before each SYNC (or in ``node.on_sync``), read ``command`` after it.

    Inputs are latched at SYNC: the status that answers SYNC k is that of k, the command received before it acts from k on.
    """

    def __init__(self, number: int, *, rated_current_ma: int, rated_torque_mnm: int = 0, identity: tuple[int, int, int, int] = (0, 1, 1, 1)) -> None:
        pdos = {"rpdo1": T.TORQUE_PDO, "tpdo1": T.STATUS_PDO, "tpdo2": T.SLOW_PDO}
        objects = communication_objects(number, "Simulated CiA 402 drive", T.DEVICE_TYPE_SERVO, identity, pdos) | _profile()
        guard_mappings(objects)
        objects[T.RATED_CURRENT, 0].value = rated_current_ma
        objects[T.RATED_TORQUE, 0].value = rated_torque_mnm
        objects[T.CONTROLWORD, 0].written = self._control
        objects[T.MODE, 0].written = self._set_mode
        self.node = Node(number, objects)
        self.node.on_sync = self._latch
        self.node.on_loss = self._lost
        self._motor = MotorReading(0, 0)
        self.state = T.SWITCH_ON_DISABLED
        self._word = 0
        self._show()

    @property
    def command(self) -> DriveCommand:
        """What the power stage does now: nothing unless the operation is enabled and the bus is operational."""
        value = {index: self.node.objects[index, 0].value for index in (T.MODE_DISPLAY, T.TARGET_TORQUE, T.TORQUE_OFFSET, T.TARGET_VELOCITY)}
        mode = value[T.MODE_DISPLAY]
        if self.state is not T.OPERATION_ENABLED or self.node.state != T.OPERATIONAL or mode not in (T.CST, T.CSV):
            return DriveCommand(False, mode, 0, 0)
        if mode == T.CST:
            return DriveCommand(True, mode, value[T.TARGET_TORQUE], 0)
        return DriveCommand(True, mode, value[T.TORQUE_OFFSET], value[T.TARGET_VELOCITY])

    @property
    def motor(self) -> MotorReading:
        """What the sensors of the drive read."""
        return self._motor

    @motor.setter
    def motor(self, reading: MotorReading) -> None:
        self._motor = reading
        if self.node.state != T.OPERATIONAL:  # no SYNC counts yet: objects show what is
            self._latch()

    def warm(self, first_c: float, second_c: float) -> None:
        """Set the temperature inputs."""
        for subindex, value in ((1, first_c), (2, second_c)):
            self.node.objects[T.TEMPERATURES, subindex].value = min(max(round(value * 16.0), -32768), 32767)

    def receive(self, frame: Frame, now_ns: int = 0) -> list[Frame]:
        """React to one frame of the bus."""
        was = self.node.state
        out = self.node.receive(frame, now_ns)
        if was == T.OPERATIONAL and self.node.state != T.OPERATIONAL and self.state is T.OPERATION_ENABLED:
            self._go(T.SWITCH_ON_DISABLED)
        return out

    def tick(self, now_ns: int) -> list[Frame]:
        """Heartbeats, and the watch over the master's."""
        return self.node.tick(now_ns)

    def fail(self, code: int) -> list[Frame]:
        """A fault: power off, an emergency on the bus. Left only by a reset of the master."""
        self.node.objects[T.ERROR_CODE, 0].value = code
        self._go(T.FAULT)
        return [self.node.emergency(code, 1 | _REGISTER.get(code >> 12, 0))]

    def _lost(self) -> list[Frame]:
        reaction = self.node.objects[T.COMM_LOSS_REACTION, 0].value
        if reaction == 1:
            return self.fail(T.EMCY_HEARTBEAT)
        if reaction == 2:
            self._go(T.SWITCH_ON_DISABLED)
        elif reaction == 3 and self.state is T.OPERATION_ENABLED:
            self._go(T.QUICK_STOP_ACTIVE)
        return [self.node.emergency(T.EMCY_HEARTBEAT, 1 | 16)]

    def _latch(self) -> None:
        objects, motor = self.node.objects, self.motor
        objects[T.POSITION, 0].value = motor.counts
        objects[T.VELOCITY, 0].value = motor.velocity_counts_s
        objects[T.TORQUE, 0].value = max(-32768, min(32767, motor.torque_permille))
        objects[T.BUS_VOLTAGE, 0].value = max(0, round(motor.bus_voltage_v * 1e3))
        self._show()

    def _set_mode(self, mode: int) -> int:
        if mode not in (0, T.CST, T.CSV):
            return T.OUT_OF_RANGE
        if mode != self.node.objects[T.MODE_DISPLAY, 0].value:
            for index in (T.TARGET_TORQUE, T.TORQUE_OFFSET, T.TARGET_VELOCITY):
                self.node.objects[index, 0].value = 0
        self.node.objects[T.MODE_DISPLAY, 0].value = mode
        return 0

    def _control(self, word: int) -> int:
        """Transitions of CiA 402 by number."""
        rising = word & ~self._word & T.FAULT_RESET
        self._word = word
        state = self.state
        if state is T.FAULT:
            if rising:  # 15
                self.node.objects[T.ERROR_CODE, 0].value = 0
                self.node.objects[T.ERROR_REGISTER, 0].value = self.node.error_register = 0
                self._go(T.SWITCH_ON_DISABLED)
            return 0
        if not word & 0x02:  # disable voltage: 7, 9, 10, 12
            self._go(T.SWITCH_ON_DISABLED)
        elif not word & 0x04:  # quick stop: 7, 10, 11
            self._go(T.QUICK_STOP_ACTIVE if state in (T.OPERATION_ENABLED, T.QUICK_STOP_ACTIVE) else T.SWITCH_ON_DISABLED)
        elif state is T.QUICK_STOP_ACTIVE:
            if word & 0x0F == T.ENABLE:  # 16
                self._go(T.OPERATION_ENABLED)
        elif not word & 0x01:  # shutdown: 2, 6, 8
            self._go(T.READY_TO_SWITCH_ON)
        elif state is T.READY_TO_SWITCH_ON:  # 3 (a drive may go on to 4 in the same step)
            self._go(T.SWITCHED_ON)
        elif state in (T.SWITCHED_ON, T.OPERATION_ENABLED):  # 4, 5
            self._go(T.OPERATION_ENABLED if word & 0x08 else T.SWITCHED_ON)
        return 0

    def _go(self, state: T.State) -> None:
        if state is not T.OPERATION_ENABLED:
            for index in (T.TARGET_TORQUE, T.TORQUE_OFFSET, T.TARGET_VELOCITY):
                self.node.objects[index, 0].value = 0
        self.state = state
        self._show()

    def _show(self) -> None:
        word = self.state.bits | T.REMOTE
        if self.state in (T.SWITCHED_ON, T.OPERATION_ENABLED, T.QUICK_STOP_ACTIVE):
            word |= T.VOLTAGE_ENABLED
        self.node.objects[T.STATUSWORD, 0].value = word
