"""Trinamic TMCL, the host's side: requests, answers, and a stepper that is asked in turns without waiting."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

from spsp_ctrl.devices import tmcl_table as T

_REQUEST, _REPLY = struct.Struct(T.REQUEST_LAYOUT), struct.Struct(T.REPLY_LAYOUT)
_LIMIT = 1 << 31


class Request(NamedTuple):
    """One instruction for a module."""

    instruction: int
    type: int
    motor: int
    value: int


class Reply(NamedTuple):
    """Its answer."""

    status: int
    instruction: int
    value: int


def clip(value: float) -> int:
    """Nearest whole number of 32 bits; a number that is none becomes 0."""
    return 0 if value != value else round(min(max(value, -_LIMIT), _LIMIT - 1))


def to_serial(request: Request, module: int = T.MODULE) -> bytes:
    """Nine bytes for a serial line."""
    body = _REQUEST.pack(module, *request)
    return body + bytes((sum(body) & 0xFF,))


def to_can(request: Request, module: int = T.MODULE) -> tuple[int, bytes]:
    """Identifier and seven bytes for CAN."""
    return module, _REQUEST.pack(module, *request)[1:]


def from_can(identifier: int, data: bytes, host: int = T.HOST, module: int = T.MODULE) -> Reply | None:
    """The answer in a CAN frame (with or without a trailing sum); None for any other frame."""
    if identifier != host or len(data) not in (T.CAN_BYTES, T.CAN_BYTES + 1) or data[0] != module:
        return None
    if len(data) == T.CAN_BYTES + 1 and (identifier + sum(data[:-1])) & 0xFF != data[-1]:
        return None
    return Reply(*_REPLY.unpack(bytes((identifier & 0xFF,)) + data[: T.CAN_BYTES])[2:])


class SerialReplies:
    """Answers out of a byte stream. A wrong byte costs the answer that it is in."""

    def __init__(self, host: int = T.HOST, module: int = T.MODULE) -> None:
        self._head = bytes((host, module))
        self._held = b""
        self.skipped_bytes = 0

    def feed(self, data: bytes) -> list[Reply]:
        """Every answer that is complete now."""
        held, at = self._held + data, 0
        found: list[Reply] = []
        while len(held) - at >= T.SERIAL_BYTES:
            body = held[at : at + T.BODY_BYTES]
            known = body[2] in T.STATUS_TEXT
            if body[:2] == self._head and known and sum(body) & 0xFF == held[at + T.BODY_BYTES]:
                found.append(Reply(*_REPLY.unpack(body)[2:]))
                at += T.SERIAL_BYTES
            else:
                self.skipped_bytes += 1
                at += 1
        self._held = held[at:]
        return found


def rotate(motor: int, speed: float) -> Request:
    """Turn at a constant speed: right (counting up) for a positive one. In the module's unit, see ``SpeedUnit``."""
    return Request(T.ROTATE_RIGHT, 0, motor, clip(speed)) if speed >= 0.0 or speed != speed else Request(T.ROTATE_LEFT, 0, motor, clip(-speed))


def stop(motor: int) -> Request:
    """Ramp down to a stand-still."""
    return Request(T.STOP, 0, motor, 0)


def get(motor: int, parameter: int) -> Request:
    """Ask for an axis parameter."""
    return Request(T.GET_PARAMETER, parameter, motor, 0)


def put(motor: int, parameter: int, value: float) -> Request:
    """Set an axis parameter."""
    return Request(T.SET_PARAMETER, parameter, motor, clip(value))


def search(motor: int, what: int) -> Request:
    """Reference search: start, stop or status."""
    return Request(T.REFERENCE_SEARCH, what, motor, 0)


class SpeedUnit(NamedTuple):
    """Speed of a module: pulses (microsteps) per second, or the internal number of a TMC429 with its pulse divisor."""

    pulse_divisor: int = -1
    """Axis parameter 154; -1 for a module that counts in pulses per second."""

    @property
    def pulses_s(self) -> float:
        """Microsteps per second of one unit."""
        return 1.0 if self.pulse_divisor < 0 else T.CLOCK_HZ / ((1 << self.pulse_divisor) * 2048 * 32)

    def to_module(self, microsteps_s: float) -> int:
        """Number for the module."""
        return clip(microsteps_s / self.pulses_s)

    def from_module(self, number: int) -> float:
        """Microsteps per second."""
        return number * self.pulses_s


class StepperReading(NamedTuple):
    """Newest value of each thing that is asked for."""

    position_microsteps: int
    speed_microsteps_s: float
    left_switch: bool
    right_switch: bool
    home_switch: bool
    stamp_ns: int
    """When the oldest of them was asked for."""
    seq: int
    """Complete rounds of questions; -1 before the first."""


_ASKED = (T.POSITION, T.SPEED, T.LEFT_SWITCH, T.RIGHT_SWITCH, T.HOME_SWITCH)


class Stepper:
    """One motor, asked in turns with one request on the way at a time; ``step`` never waits.

    An answer does not say which parameter it is of. After a lost one the module's version is asked for, and everything that arrives before
    that answer is dropped: so a late answer is never taken for another.
    """

    TIMEOUT_NS = 50_000_000

    def __init__(self, motor: int = 0, unit: SpeedUnit | None = None, *, paced: bool = False) -> None:
        self._motor = motor
        self._unit = unit or SpeedUnit()
        self._waiting: Request | None = None
        self._sent_ns = 0
        self._turn = 0
        self._values = dict.fromkeys(_ASKED, 0)
        self._round_ns = 0
        self._order: Request | None = None
        self._paced = paced
        self._due = not paced
        self.reading = StepperReading(0, 0.0, False, False, False, 0, -1)
        self.lost = 0
        """Requests without an answer."""
        self.refused = 0
        """Answers other than ok."""
        self.problem = ""
        """The newest refusal in words."""

    def command(self, microsteps_s: float) -> None:
        """Speed to hold from now on; goes out before the next question."""
        self._order = rotate(self._motor, self._unit.to_module(microsteps_s))

    def halt(self) -> None:
        """Stop; goes out before the next question."""
        self._order = stop(self._motor)

    def ask_again(self) -> None:
        """Ask for everything once more. A stepper that is ``paced`` asks nothing without it; else rounds follow each other."""
        self._due = True

    def step(self, now_ns: int, replies: Iterable[Reply]) -> Request | None:
        """Take what has arrived; the request to send now, if any."""
        for reply in replies:
            if self._waiting is not None and reply.instruction == self._waiting.instruction:
                self._take(reply, self._waiting)
                self._waiting = None
        if self._waiting is not None:
            if now_ns - self._sent_ns < self.TIMEOUT_NS:
                return None
            self.lost += 1
            self._waiting = Request(T.VERSION, T.VERSION_BINARY, 0, 0)
        elif self._order is not None:
            self._waiting, self._order = self._order, None
        else:
            if self._turn == 0:
                if not self._due:
                    return None
                self._due = not self._paced
                self._round_ns = now_ns
            self._waiting = get(self._motor, _ASKED[self._turn])
        self._sent_ns = now_ns
        return self._waiting

    def _take(self, reply: Reply, asked: Request) -> None:
        if reply.status != T.OK:
            self.refused += 1
            self.problem = f"instruction {asked.instruction}, type {asked.type}: {T.STATUS_TEXT.get(reply.status, 'unknown status')} ({reply.status})"
            return
        if asked.instruction != T.GET_PARAMETER:
            return
        self._values[asked.type] = reply.value
        self._turn = (self._turn + 1) % len(_ASKED)
        if self._turn == 0:
            position, speed, left, right, home = (self._values[p] for p in _ASKED)
            seq = self.reading.seq + 1
            self.reading = StepperReading(position, self._unit.from_module(speed), bool(left), bool(right), bool(home), self._round_ns, seq)
