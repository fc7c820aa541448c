"""What each signal name of an injection means: where it lies, and sizes that matter."""

from __future__ import annotations

from math import radians
from typing import NamedTuple

from spsp_ctrl.messages import AzimuthSample, BaseSample, DriveSample, ImuSample, Measurement, ResolverSample, TemperatureSample


class Signal(NamedTuple):
    """Place in a measurement (or in the command), and the defaults of each kind."""

    name: str
    sample: int
    """Index in ``Measurement``; -1 for a command."""
    values: tuple[int, ...]
    """Indices of what ``wrong``, ``noisy`` and, for a channel, every kind changes."""
    frame: bool
    """Whole frames stop, slow down and repeat; else a channel of frames that go on."""
    unit: str
    factor: float
    """From the unit of the scenario file to that of the message."""
    wrong: float
    noisy: float
    every: int
    delay_ms: float


_M = {name: i for i, name in enumerate(Measurement._fields)}


def _at(cls: type, *names: str) -> tuple[int, ...]:
    fields: tuple[str, ...] = cls._fields  # type: ignore[attr-defined]
    return tuple(fields.index(name) for name in names)


_DEG = radians(1.0)
_GYRO = [Signal(f"imu.gyro_{a}", _M["imu"], _at(ImuSample, f"gyro_{a}_rad_s"), False, "deg/s", _DEG, 5.0, 3.0, 20, 100.0) for a in "xyz"]
_ANGLE = [Signal(f"imu.{a}", _M["imu"], _at(ImuSample, f"{a}_rad"), False, "deg", _DEG, 2.0, 0.5, 40, 200.0) for a in ("pitch", "roll", "yaw")]
_AXES = ("pitch", "roll")

SIGNALS: tuple[Signal, ...] = (
    Signal("imu", _M["imu"], _at(ImuSample, "pitch_rad", "roll_rad"), True, "deg", _DEG, 2.0, 0.5, 8, 40.0),
    *_ANGLE,
    *_GYRO,
    *(Signal(f"resolver_{a}", _M[f"resolver_{a}"], _at(ResolverSample, "counts"), True, "counts", 1.0, 4096.0, 60.0, 10, 10.0) for a in _AXES),
    *(Signal(f"resolver_{a}.status", _M[f"resolver_{a}"], _at(ResolverSample, "status"), False, "bits", 1.0, 1.0, 0.0, 10, 10.0) for a in _AXES),
    *(Signal(f"drive_{a}", _M[f"drive_{a}"], _at(DriveSample, "fault_code"), True, "code", 1.0, 0x2310, 0.0, 10, 10.0) for a in _AXES),
    *(Signal(f"drive_{a}.current", _M[f"drive_{a}"], _at(DriveSample, "current_a"), False, "A", 1.0, 2.0, 6.0, 50, 50.0) for a in _AXES),
    *(Signal(f"drive_{a}.supply", _M[f"drive_{a}"], _at(DriveSample, "bus_voltage_v"), False, "V", 1.0, -10.0, 12.0, 50, 50.0) for a in _AXES),
    *(Signal(f"drive_{a}.enabled", _M[f"drive_{a}"], _at(DriveSample, "enabled"), False, "", 1.0, 1.0, 1.0, 50, 50.0) for a in _AXES),
    Signal("azimuth", _M["azimuth"], _at(AzimuthSample, "microsteps"), True, "microsteps", 1.0, 1000.0, 300.0, 10, 100.0),
    Signal("azimuth.count", _M["azimuth"], _at(AzimuthSample, "microsteps"), False, "microsteps", 1.0, 1000.0, 300.0, 100, 1000.0),
    *(
        Signal(f"azimuth.{s}_switch", _M["azimuth"], _at(AzimuthSample, f"{s}_switch"), False, "", 1.0, 1.0, 1.0, 10, 100.0)
        for s in ("left", "right", "home")
    ),
    Signal("temperature", _M["temperature"], _at(TemperatureSample, "screw_pitch_c", "screw_roll_c"), True, "degC", 1.0, 20.0, 5.0, 30, 2000.0),
    *(
        Signal(f"temperature.screw_{a}", _M["temperature"], _at(TemperatureSample, f"screw_{a}_c"), False, "degC", 1.0, 20.0, 5.0, 30, 2000.0)
        for a in _AXES
    ),
    Signal("base", _M["base"], _at(BaseSample, "pitch_rad", "roll_rad"), True, "deg", _DEG, 5.0, 1.0, 10, 100.0),
    # Command: (stamp, seq, enable, pitch current, pitch speed, roll current, roll speed, azimuth rate)
    Signal("command.pitch", -1, (3, 4), False, "A", 1.0, 2.0, 3.0, 50, 50.0),
    Signal("command.roll", -1, (5, 6), False, "A", 1.0, 2.0, 3.0, 50, 50.0),
    Signal("command.azimuth", -1, (7,), False, "deg/s", _DEG, 5.0, 10.0, 500, 1000.0),
)
BY_NAME = {signal.name: signal for signal in SIGNALS}
KINDS = ("off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent", "noisy")
