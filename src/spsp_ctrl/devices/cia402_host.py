"""CiA 402 drive, the master's side: cyclic commands and status in torque (CST) and velocity mode (CSV), state machine, start-up."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

from spsp_ctrl.devices import canopen_table as T
from spsp_ctrl.devices.canopen_host import Frame, Setting, map_pdo

_STATUS, _SLOW = struct.Struct(T.STATUS_LAYOUT), struct.Struct(T.SLOW_LAYOUT)
_TORQUE, _VELOCITY = struct.Struct(T.TORQUE_LAYOUT), struct.Struct(T.VELOCITY_LAYOUT)
_I16, _I32 = 1 << 15, 1 << 31


class Status(NamedTuple):
    """What a drive reports after each SYNC."""

    word: int
    counts: int
    """Position of the motor shaft, counts of a 32-bit counter that wraps round."""
    torque_permille: int
    """Measured torque in thousandths of the rated torque."""


class SlowStatus(NamedTuple):
    """What it reports now and then."""

    bus_voltage_v: float
    error_code: int
    mode: int


def read_status(frame: Frame, node: int) -> Status | None:
    """Cyclic status of a drive, None for any other frame."""
    identifier, data = frame
    return Status(*_STATUS.unpack(data)) if identifier == T.TPDO1 + node and len(data) == _STATUS.size else None


def read_slow(frame: Frame, node: int) -> SlowStatus | None:
    """Slow status of a drive, None for any other frame."""
    identifier, data = frame
    if identifier != T.TPDO2 + node or len(data) != _SLOW.size:
        return None
    millivolt, code, mode = _SLOW.unpack(data)
    return SlowStatus(millivolt * 1e-3, code, mode)


def _clip(value: float, bound: int) -> int:
    """Nearest whole number that fits; a number that is none becomes 0, which moves nothing."""
    return 0 if value != value else round(min(max(value, -bound), bound - 1))


def torque_command(node: int, controlword: int, torque_permille: float) -> Frame:
    """RPDO of the torque mode; torque in thousandths of the rated torque, clipped to what 16 bits hold."""
    return T.RPDO1 + node, _TORQUE.pack(controlword, _clip(torque_permille, _I16))


def velocity_command(node: int, controlword: int, counts_s: float, torque_permille: float = 0.0) -> Frame:
    """RPDO of the velocity mode with a torque feed-forward."""
    return T.RPDO1 + node, _VELOCITY.pack(controlword, _clip(counts_s, _I32), _clip(torque_permille, _I16))


def state_of(word: int) -> T.State:
    """State that a statusword shows; one that shows none counts as not ready."""
    return next((state for state in T.STATES if word & state.mask == state.bits), T.NOT_READY)


_TOWARDS = {
    T.SWITCH_ON_DISABLED: T.SHUTDOWN,
    T.READY_TO_SWITCH_ON: T.SWITCH_ON,
    T.SWITCHED_ON: T.ENABLE,
    T.OPERATION_ENABLED: T.ENABLE,
    T.QUICK_STOP_ACTIVE: T.DISABLE_VOLTAGE,
}


class Walker:
    """The controlword of each cycle. ``wanted`` is whether the power stage shall be on; a fault is left only by ``reset``."""

    def __init__(self) -> None:
        self._reset = 0

    def reset(self) -> None:
        """Acknowledge a fault: bit 7 goes low, then high, in the next cycles (the drive wants the edge)."""
        self._reset = 2

    def step(self, word: int, wanted: bool) -> int:
        """Next controlword for the statusword of this cycle."""
        state = state_of(word)
        if state is T.FAULT:
            if self._reset:
                self._reset -= 1
                return T.FAULT_RESET if self._reset == 0 else T.DISABLE_VOLTAGE
            return T.DISABLE_VOLTAGE
        self._reset = 0
        if wanted:
            return _TOWARDS.get(state, T.DISABLE_VOLTAGE)
        return T.QUICK_STOP if state is T.OPERATION_ENABLED else T.DISABLE_VOLTAGE


def start_up(node: int, mode: int, period_ms: int, master: int, heartbeat_ms: int) -> Iterator[Setting]:
    """Everything that a drive is told and asked before NMT start.

    ``mode`` is ``CST`` or ``CSV``; it stops by quick stop (0x6007 = 3) when the heartbeat of node ``master`` fails for three of its periods.
    """
    yield Setting(T.DEVICE_TYPE, 0, None, 4)
    for subindex in (1, 2, 3, 4):
        yield Setting(T.IDENTITY, subindex, None, 4)
    yield Setting(T.RATED_CURRENT, 0, None, 4)
    yield Setting(T.SUPPORTED_MODES, 0, None, 4)
    entries = T.TORQUE_PDO if mode == T.CST else T.VELOCITY_PDO
    yield from map_pdo(T.RPDO_SETTINGS, T.RPDO_MAPPING, T.RPDO1 + node, 1, entries)
    yield from map_pdo(T.TPDO_SETTINGS, T.TPDO_MAPPING, T.TPDO1 + node, 1, T.STATUS_PDO)
    yield from map_pdo(T.TPDO_SETTINGS + 1, T.TPDO_MAPPING + 1, T.TPDO2 + node, T.SLOW_EVERY, T.SLOW_PDO)
    yield Setting(T.INTERPOLATION_PERIOD, 1, period_ms, 1)
    yield Setting(T.INTERPOLATION_PERIOD, 2, -3, 1)
    yield Setting(T.MODE, 0, mode, 1)
    yield Setting(T.PRODUCER_HEARTBEAT, 0, heartbeat_ms, 2)
    yield Setting(T.CONSUMER_HEARTBEAT, 1, master << 16 | 3 * heartbeat_ms, 4)
    yield Setting(T.COMM_LOSS_REACTION, 0, 3, 2)


def supports(modes: int, mode: int) -> bool:
    """Whether object 0x6502 names the mode."""
    return bool(modes >> (mode - 1) & 1)


def amperes(torque_permille: int, rated_current_a: float) -> float:
    """Motor current of a reading; torque and current are proportional (CiA 402, 0x6077)."""
    return torque_permille * 1e-3 * rated_current_a


def permille(current_a: float, rated_current_a: float) -> float:
    """Torque command for a current."""
    return current_a / rated_current_a * 1e3
