"""Numbers as they travel, in one place: what a bus rounds. Used by the families, the device side, and the virtual rig that has no bus."""

from __future__ import annotations

import struct
from math import pi

TEMPERATURE_STEP_C = 0.0625
"""Of the temperature object of a drive, and of a digital sensor of 12 bit."""
_I16, _I32 = 1 << 15, 1 << 31
_SINGLES = struct.Struct("<6f")


def permille(current_a: float, rated_a: float) -> int:
    """Current as thousandths of the rated one, 16 bit."""
    return round(min(max(current_a / rated_a * 1e3, -_I16), _I16 - 1))


def amperes(torque_permille: int, rated_a: float) -> float:
    """The current of it; torque and current are proportional (CiA 402, 0x6077)."""
    return torque_permille * 1e-3 * rated_a


def counts_s(speed_rad_s: float, counts_per_turn: int) -> int:
    """Speed in counts per second, 32 bit."""
    return round(min(max(speed_rad_s * counts_per_turn / (2.0 * pi), -_I32), _I32 - 1))


def rad_s(speed_counts_s: int, counts_per_turn: int) -> float:
    """The speed of it."""
    return speed_counts_s * (2.0 * pi) / counts_per_turn


def pulses_s(rate_rad_s: float, microsteps_per_rad: float) -> int:
    """Rate in whole microsteps per second, 32 bit."""
    return round(min(max(rate_rad_s * microsteps_per_rad, -_I32), _I32 - 1))


def singles(values: tuple[float, float, float, float, float, float]) -> tuple[float, ...]:
    """Six numbers as single floats."""
    return _SINGLES.unpack(_SINGLES.pack(*values))


def millivolts(voltage_v: float) -> int:
    """Supply voltage in whole millivolts."""
    return max(0, round(voltage_v * 1e3))


def sixteenths(temperature_c: float) -> int:
    """Temperature in steps of 1/16 degree."""
    return round(temperature_c / TEMPERATURE_STEP_C)
