"""Trinamic TMCL, the module's side: instructions, axis parameters, the ramp of its motion controller, reference search."""

from __future__ import annotations

from dataclasses import dataclass, field

from spsp_ctrl.devices import tmcl_table as T

_U32 = 1 << 32


def _signed(value: int) -> int:
    return (value + (1 << 31)) % _U32 - (1 << 31)


@dataclass(slots=True)
class Axis:
    """One motor of the module. ``advance`` moves it; the switches are set from outside before."""

    parameters: dict[int, int] = field(
        default_factory=lambda: {
            T.TARGET_POSITION: 0, T.TARGET_SPEED: 0, T.MAX_SPEED: 51200, T.MAX_ACCELERATION: 51200, T.MAX_CURRENT: 128, T.STANDBY_CURRENT: 8,
            T.RIGHT_DISABLE: 0, T.LEFT_DISABLE: 0, T.MICROSTEPS: 8, T.SOFT_STOP: 0, T.SEARCH_MODE: T.SEARCH_LEFT, T.SEARCH_SPEED: 10000,
            T.SWITCH_SPEED: 1000, T.SWITCH_DISTANCE: 0, T.LAST_SWITCH: 0, T.ERROR_FLAGS: 0, T.DRIVER_FLAGS: 0,
        }
    )  # fmt: skip
    position: float = 0.0
    """Microsteps."""
    speed: float = 0.0
    """Microsteps per second."""
    positioning: bool = False
    """Going to the target position, else holding the target speed."""
    left_switch: bool = False
    right_switch: bool = False
    home_switch: bool = False
    search_phase: int = 0
    """0 none, 1 towards the switch, 2 back until it opens."""

    def read(self, number: int) -> int | None:
        """An axis parameter, None for one that the module has not."""
        live = {
            T.POSITION: round(self.position), T.SPEED: round(self.speed), T.HOME_SWITCH: int(self.home_switch),
            T.RIGHT_SWITCH: int(self.right_switch), T.LEFT_SWITCH: int(self.left_switch),
            T.POSITION_REACHED: int(self.positioning and self.speed == 0.0 and round(self.position) == self.parameters[T.TARGET_POSITION]),
        }  # fmt: skip
        return live.get(number, self.parameters.get(number))

    def write(self, number: int, value: int) -> int:
        """Set an axis parameter; the status of the answer."""
        if number == T.POSITION:
            self.position = float(value)
            return T.OK
        if number in (T.SPEED, T.POSITION_REACHED, T.HOME_SWITCH, T.RIGHT_SWITCH, T.LEFT_SWITCH, T.SWITCH_DISTANCE, T.LAST_SWITCH):
            return T.NOT_AVAILABLE if number in (T.SWITCH_DISTANCE, T.LAST_SWITCH) else T.WRONG_TYPE
        if number not in self.parameters:
            return T.WRONG_TYPE
        ranges = {
            T.MAX_SPEED: (0, 7_999_774), T.MAX_ACCELERATION: (1, 7_629_278), T.MAX_CURRENT: (0, 255), T.STANDBY_CURRENT: (0, 255),
            T.MICROSTEPS: (0, 8), T.RIGHT_DISABLE: (0, 1), T.LEFT_DISABLE: (0, 1), T.SOFT_STOP: (0, 1),
            T.SEARCH_SPEED: (0, 7_999_774), T.SWITCH_SPEED: (0, 7_999_774),
        }  # fmt: skip
        low, high = ranges.get(number, (-(1 << 31), (1 << 31) - 1))
        base = value & ~T.SEARCH_OPPOSITE
        if not low <= value <= high or (number == T.SEARCH_MODE and base not in (T.SEARCH_LEFT, T.SEARCH_HOME_NEGATIVE, T.SEARCH_HOME_POSITIVE)):
            return T.INVALID_VALUE
        self.parameters[number] = value
        if number == T.TARGET_POSITION:
            self.positioning, self.search_phase = True, 0
        elif number == T.TARGET_SPEED:
            self.positioning, self.search_phase = False, 0
        return T.OK

    def rotate(self, speed: int) -> int:
        """Hold a speed."""
        if abs(speed) > 7_999_774:
            return T.INVALID_VALUE
        return self.write(T.TARGET_SPEED, speed)

    def search(self, on: bool) -> None:
        """Start or end the reference search."""
        self.search_phase = int(on)
        self.positioning = False
        self.parameters[T.TARGET_SPEED] = 0

    def demand(self, dt_s: float) -> float:
        """Speed that the ramp goes towards now, for a motor that is moved from outside (``position`` and ``speed`` are set there)."""
        target = self._search() if self.search_phase else self._wanted(dt_s)
        return 0.0 if self._blocked(target) else target

    def _blocked(self, target: float) -> bool:
        towards_right = target > 0.0 and self.right_switch and not self.parameters[T.RIGHT_DISABLE]
        towards_left = target < 0.0 and self.left_switch and not self.parameters[T.LEFT_DISABLE]
        return bool(towards_right or towards_left) and not self._ignores_switches()

    def advance(self, dt_s: float) -> None:
        """Let time pass: ramp with the maximum acceleration, stop at the end switches, search."""
        target = self._search() if self.search_phase else self._wanted(dt_s)
        step = self.parameters[T.MAX_ACCELERATION] * dt_s
        if self._blocked(target):
            target = 0.0
            if not self.parameters[T.SOFT_STOP]:
                self.speed = 0.0
        self.speed += min(max(target - self.speed, -step), step)
        self.position += self.speed * dt_s
        if self.positioning and abs(self.parameters[T.TARGET_POSITION] - self.position) <= abs(self.speed) * dt_s and abs(self.speed) <= 2.0 * step:
            self.position, self.speed = float(self.parameters[T.TARGET_POSITION]), 0.0

    def _ignores_switches(self) -> bool:
        return bool(self.search_phase) and self.parameters[T.SEARCH_MODE] & ~T.SEARCH_OPPOSITE in (T.SEARCH_HOME_NEGATIVE, T.SEARCH_HOME_POSITIVE)

    def _wanted(self, dt_s: float) -> float:
        if not self.positioning:
            return float(self.parameters[T.TARGET_SPEED])
        way = self.parameters[T.TARGET_POSITION] - self.position
        braking: float = (2.0 * self.parameters[T.MAX_ACCELERATION] * abs(way)) ** 0.5
        speed = min(float(self.parameters[T.MAX_SPEED]), braking, abs(way) / dt_s)
        return speed if way > 0.0 else -speed

    def _search(self) -> float:
        """Towards the switch fast, back from it slowly; where it opens is zero."""
        mode = self.parameters[T.SEARCH_MODE]
        base, opposite = mode & ~T.SEARCH_OPPOSITE, bool(mode & T.SEARCH_OPPOSITE)
        up = (base == T.SEARCH_HOME_POSITIVE) != opposite
        switch = self.home_switch if base != T.SEARCH_LEFT else self.right_switch if opposite else self.left_switch
        if self.search_phase == 1 and switch:
            self.search_phase = 2
            self.parameters[T.LAST_SWITCH] = round(self.position)
            self.speed = 0.0
        elif self.search_phase == 2 and not switch:
            self.parameters[T.SWITCH_DISTANCE] = round(self.position)
            self.position = self.speed = 0.0
            self.search(False)
            return 0.0
        number = T.SEARCH_SPEED if self.search_phase == 1 else T.SWITCH_SPEED
        return float(self.parameters[number]) * (1.0 if up == (self.search_phase == 1) else -1.0)


class Module:
    """A stepper module that counts in pulses per second. ``serial`` and ``can`` take what the host sends and return the answers."""

    def __init__(self, axes: int = 1, address: int = T.MODULE, host: int = T.HOST, name: str = "1241", version: tuple[int, int] = (1, 10)) -> None:
        self.axes = [Axis() for _ in range(axes)]
        self._address, self._host = address, host
        self._name, self._version = name, version
        self._globals = {T.SWITCH_POLARITY: 0}
        self.analogue = [0] * 4
        """Analogue inputs, 0 to 4095."""
        self._held = b""

    def serial(self, data: bytes) -> bytes:
        """Answers to the whole requests in a byte stream."""
        self._held += data
        out = b""
        while len(self._held) >= T.SERIAL_BYTES:
            request, rest = self._held[: T.SERIAL_BYTES], self._held[T.SERIAL_BYTES :]
            right = sum(request[:-1]) % 256 == request[-1]
            if request[0] != self._address or (not right and self._address in rest):
                self._held = self._held[1:]  # not the beginning of a request
                continue
            self._held = rest
            if right and request[1] == T.VERSION and request[2] == T.VERSION_TEXT:
                out += bytes((self._host,)) + self._text()
                continue
            status, value = self._carry_out(request[1:8]) if right else (T.WRONG_CHECKSUM, 0)
            body = bytes((self._host, self._address, status, request[1])) + (value % _U32).to_bytes(4, "big")
            out += body + bytes((sum(body) % 256,))
        return out

    def can(self, identifier: int, data: bytes) -> list[tuple[int, bytes]]:
        """Answers to one CAN frame of seven bytes, or eight with a sum that is not looked at (as the vendor's client sends it)."""
        if identifier != self._address or len(data) not in (T.CAN_BYTES, T.CAN_BYTES + 1):
            return []
        if data[0] == T.VERSION and data[1] == T.VERSION_TEXT:
            return [(self._host, self._text())]
        status, value = self._carry_out(data[: T.CAN_BYTES])
        return [(self._host, bytes((self._address, status, data[0])) + (value % _U32).to_bytes(4, "big"))]

    def advance(self, dt_s: float) -> None:
        """Let time pass for every axis."""
        for axis in self.axes:
            axis.advance(dt_s)

    def _text(self) -> bytes:
        major, minor = self._version
        return f"{self._name[:4]:>4}V{major}{minor:02d}".encode("ascii")[:8]

    def _carry_out(self, request: bytes) -> tuple[int, int]:
        """Status and value of the answer."""
        instruction, kind, motor = request[:3]
        value = _signed(int.from_bytes(request[3:7], "big"))
        if instruction == T.VERSION:
            number = int("".join(c for c in self._name if c.isdigit()) or 0)
            return (T.OK, number << 16 | self._version[0] << 8 | self._version[1]) if kind == T.VERSION_BINARY else (T.WRONG_TYPE, 0)
        if instruction == T.GET_GLOBAL:
            return (T.OK, self._globals[kind]) if kind in self._globals and motor == 0 else (T.WRONG_TYPE, 0)
        if instruction == T.SET_GLOBAL:
            if kind not in self._globals or motor != 0:
                return T.WRONG_TYPE, value
            self._globals[kind] = value
            return T.OK, value
        if instruction == T.GET_INPUT and motor == T.ANALOGUE_INPUTS:
            return (T.OK, self.analogue[kind]) if kind < len(self.analogue) else (T.WRONG_TYPE, 0)
        if instruction not in (T.ROTATE_RIGHT, T.ROTATE_LEFT, T.STOP, T.MOVE, T.SET_PARAMETER, T.GET_PARAMETER, T.REFERENCE_SEARCH):
            return T.INVALID_COMMAND, 0
        if motor >= len(self.axes):
            return T.INVALID_VALUE, 0
        axis = self.axes[motor]
        if instruction == T.GET_PARAMETER:
            found = axis.read(kind)
            return (T.WRONG_TYPE, 0) if found is None else (T.OK, found)
        if instruction == T.SET_PARAMETER:
            return axis.write(kind, value), value
        if instruction == T.MOVE:
            if kind not in (T.MOVE_ABSOLUTE, T.MOVE_RELATIVE):
                return T.WRONG_TYPE, value
            target = _signed(value + (round(axis.position) if kind == T.MOVE_RELATIVE else 0))
            return axis.write(T.TARGET_POSITION, target), target
        if instruction == T.REFERENCE_SEARCH:
            if kind == T.SEARCH_STATUS:
                return T.OK, axis.search_phase
            if kind not in (T.SEARCH_START, T.SEARCH_STOP):
                return T.WRONG_TYPE, value
            axis.search(kind == T.SEARCH_START)
            return T.OK, value
        speed = 0 if instruction == T.STOP else value if instruction == T.ROTATE_RIGHT else -value
        return axis.rotate(speed), value
