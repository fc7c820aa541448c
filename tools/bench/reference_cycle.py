"""A control cycle that never changes: the measure against which the cycle of the program is held, on the same core at the same time.

It is the prototype of the first study: a compiled plant of three axes (4 sub-steps), a 40-byte IMU frame built and decoded with its checksum, an
estimator, a cascade of three axes in scalar Python, two CAN frames and one log record. Imports nothing of the program. Do not improve it.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Callable
from math import cos, sin

import numba
import numpy as np
from numpy.typing import NDArray

DT, SUBSTEPS = 1e-3, 4
FRAME = struct.Struct("<HHIdddf")
RECORD = struct.Struct("<16sqI24d")
CAN = struct.Struct("<IB3x8s")
RING_RECORDS = 4096


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def plant(x: NDArray[np.float64], u: NDArray[np.float64], dt: float, substeps: int) -> None:
    """Three masses with Coulomb friction and a spring, in place."""
    h = dt / substeps
    for _ in range(substeps):
        for i in range(3):
            v = x[2 * i + 1]
            friction = 0.2 * (1.0 if v > 1e-3 else -1.0 if v < -1e-3 else v * 1e3)
            x[2 * i + 1] = v + h * (u[i] - friction - 0.5 * v - 3.0 * x[2 * i])
            x[2 * i] += h * x[2 * i + 1]


class Axis:
    """Cascade of one axis: angle P, rate PI, limits."""

    __slots__ = ("before", "integral", "ki", "kp", "kr", "limit")

    def __init__(self, kp: float, kr: float, ki: float, limit: float) -> None:
        self.kp, self.kr, self.ki, self.limit = kp, kr, ki, limit
        self.integral = self.before = 0.0

    def step(self, reference: float, angle: float, rate: float, dt: float) -> tuple[float, float, float]:
        """Command, rate error and integral."""
        wanted = self.kp * (reference - angle)
        top = self.before + 40.0 * dt
        wanted = top if wanted > top else -top if wanted < -top else wanted
        self.before = abs(wanted)
        error = wanted - rate
        integral = self.integral + self.ki * error * dt
        u = self.kr * error + integral
        if u > self.limit or u < -self.limit:
            u = self.limit if u > 0.0 else -self.limit
        else:
            self.integral = integral
        return u, error, self.integral


def build() -> Callable[[int], None]:
    """The cycle as a function of its number."""
    x, u = np.zeros(6), np.zeros(3)
    axes = (Axis(8.0, 2.0, 4.0, 20.0), Axis(8.0, 2.0, 4.0, 20.0), Axis(5.0, 1.5, 2.0, 20.0))
    frame, can = bytearray(FRAME.size + 2), bytearray(CAN.size * 2)
    ring = bytearray(RING_RECORDS * RECORD.size)
    angles = [0.0, 0.0, 0.0]
    rates = [0.0, 0.0, 0.0]
    plant(x, u, DT, SUBSTEPS)

    def cycle(k: int) -> None:
        plant(x, u, DT, SUBSTEPS)
        # sensor: build, check, decode
        FRAME.pack_into(frame, 0, 0x6575, 0x80, k & 0xFFFFFFFF, float(x[0]), float(x[2]), float(x[4]), 0.0)
        struct.pack_into("<H", frame, FRAME.size, binascii.crc_hqx(frame[: FRAME.size], 0xFFFF))
        if binascii.crc_hqx(frame[: FRAME.size], 0xFFFF) != struct.unpack_from("<H", frame, FRAME.size)[0]:
            raise RuntimeError("checksum")
        _, _, _, a, b, c, _ = FRAME.unpack_from(frame, 0)
        # estimate: angle and rate by a fixed gain
        for i, seen in enumerate((a, b, c)):
            predicted = angles[i] + DT * rates[i]
            innovation = seen - predicted
            angles[i] = predicted + 0.4 * innovation
            rates[i] += 60.0 * innovation
        t = k * DT
        commands = []
        terms = []
        for i, axis in enumerate(axes):
            out, error, integral = axis.step(0.2 * sin(t + i) * cos(angles[i]), angles[i], rates[i], DT)
            u[i] = out
            commands.append(out)
            terms += [out, error, integral, angles[i], rates[i], t, innovation, predicted]
        CAN.pack_into(can, 0, 0x201, 8, struct.pack("<ii", int(commands[0] * 1e3), int(commands[1] * 1e3)))
        CAN.pack_into(can, CAN.size, 0x301, 8, struct.pack("<ii", int(commands[2] * 1e3), k & 0x7FFFFFFF))
        RECORD.pack_into(ring, (k % RING_RECORDS) * RECORD.size, b"reference-cycle-", k, k & 0xFFFFFFFF, *terms)

    return cycle
