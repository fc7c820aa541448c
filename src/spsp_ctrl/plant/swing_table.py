"""The swing table: motion of the carrier, row by row for each control instant, from analytic derivatives.

Each axis angle is ``envelope(t) * (sines + roughness)``, yaw also a rate that grows smoothly to its value. The time
argument of the sines starts at ``start_s``; the envelope is a quintic smoothstep over ``ramp_s`` and exactly 0 before,
so angles, rates and accelerations have no jump. Roughness is a sum of sines with seeded frequencies and phases,
independent for pitch and roll: flat over its band, with the stated rms.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, radians, sqrt
from typing import NamedTuple

import numpy as np

from spsp_ctrl.config.scenario import BaseMotion, Roughness, Sine, Spectrum
from spsp_ctrl.mechanism.frames import imu_roll_from_roll
from spsp_ctrl.mechanism.profile import smooth_ramp
from spsp_ctrl.plant.arrays import Array

GRAVITY_M_S2 = 9.80665
"""Standard gravity (ISO 80000-3)."""
ROUGHNESS_SINES = 24
SEA_SPAN_S = 300.0
SEA_DRAWS = 40
CHUNK = 125
"""Rows computed at once, always on the same grid of cycles: so a row has the same bits in whichever block."""
N_ROW = 18

X, Y, Z = 0, 1, 2


class _Waves(NamedTuple):
    """Sines of one axis, as columns: amplitude (rad), angular frequency (rad/s), phase (rad)."""

    amplitude: Array
    omega: Array
    phase: Array


class SwingTable:
    """Base motion of a session; deterministic for a seed.

    ``arm_m`` is the height of the U-joint centre (pivot) above the point where the swing axes meet, along the z axis of
    the base. Raises ``ValueError`` for a rate that is not positive.
    """

    def __init__(self, motion: BaseMotion, rate_hz: int, seed: int, arm_m: float = 0.45) -> None:
        if rate_hz <= 0:
            raise ValueError(f"rate_hz of the swing table must be positive, not {rate_hz}")
        self._motion = motion
        self._rate_hz = rate_hz
        self._arm_m = arm_m
        pitch_seed, roll_seed, pitch_sea, roll_sea = np.random.SeedSequence(seed).spawn(4)
        self._pitch = _joined(_waves(motion.pitch, motion.roughness, pitch_seed), motion.sea.pitch, pitch_sea)
        self._roll = _joined(_waves(motion.roll, motion.roughness, roll_seed), motion.sea.roll, roll_sea)
        self._yaw = _waves(motion.yaw, None, None)
        self._yaw_rate_rad_s = radians(motion.yaw_rate_deg_s)
        self._inner = order_of(motion.axis_order)
        self._chunks: dict[int, tuple[Array, Array]] = {}

    def block(self, first_cycle: int, n: int) -> Array:
        """Rows of cycles ``first_cycle`` to ``first_cycle + n - 1`` (t = cycle / rate), shape (n, 18).

        Columns: base-to-inertial rotation (9, row by row); angular velocity (3, rad/s) and angular acceleration (3,
        rad/s^2) in base axes; specific acceleration of the pivot ``R^T (a + g z)`` (3, m/s^2) in base axes.
        """
        return self._rows(first_cycle, n, 0)

    def angles(self, first_cycle: int, n: int) -> Array:
        """What the table's encoders show: pitch, roll and yaw of its axes in rad (yaw not wrapped), shape (n, 3)."""
        return self._rows(first_cycle, n, 1)

    def _rows(self, first: int, n: int, which: int) -> Array:
        if first < 0 or n < 0:
            raise ValueError(f"the swing table has no cycles {first} to {first + n - 1}: ask from cycle 0 on")
        out = np.empty((n, (N_ROW, 3)[which]))
        done = 0
        while done < n:
            index, offset = divmod(first + done, CHUNK)
            take = min(CHUNK - offset, n - done)
            out[done : done + take] = self._chunk(index)[which][offset : offset + take]
            done += take
        return out

    def _chunk(self, index: int) -> tuple[Array, Array]:
        """Rows and angles of one chunk; the last few are kept, since blocks overlap and angles follow rows."""
        found = self._chunks.get(index)
        if found is None:
            while len(self._chunks) >= 16:
                del self._chunks[next(iter(self._chunks))]
            t = np.arange(index * CHUNK, (index + 1) * CHUNK, dtype=np.float64) / self._rate_hz
            found = self._chunks[index] = self._compute(t)
        return found

    def _compute(self, t: Array) -> tuple[Array, Array]:
        ramp_s = self._motion.ramp_s
        after = t - self._motion.start_s
        ramp = smooth_ramp(np.clip(after / ramp_s, 0.0, 1.0), ramp_s)
        pitch, roll, yaw = (_enveloped(waves, after, ramp) for waves in (self._pitch, self._roll, self._yaw))
        if self._yaw_rate_rad_s:
            value, rate, _, integral = ramp
            turned = integral + np.maximum(after - ramp_s, 0.0)
            yaw = yaw + self._yaw_rate_rad_s * np.stack((turned, value, rate))

        tilt = (pitch, roll)
        rows = composed(yaw, [(axis, sign, tilt[which]) for axis, sign, which in self._inner], self._arm_m)
        return rows, np.stack((pitch[0], roll[0], yaw[0]), axis=1)


def order_of(axis_order: str) -> tuple[tuple[int, float, int], tuple[int, float, int]]:
    """Axis, sign and angle (0 pitch, 1 roll) of the two tilting frames, the outer one first."""
    # roll turns about -x: the sign comes from frames
    roll, pitch = (X, imu_roll_from_roll(1.0), 1), (Y, 1.0, 0)
    return (roll, pitch) if axis_order == "roll_pitch" else (pitch, roll)


def composed(yaw: Array, tilts: Sequence[tuple[int, float, Array]], arm_m: float) -> Array:
    """Rows of ``SwingTable.block`` from angle, rate and acceleration (3, n) of yaw and of the tilting frames (axis, sign, motion)."""
    # Component-first: five row vectors that every rotation takes along. The first three are the rows of R, the
    # others omega and alpha.
    n = yaw.shape[1]
    v = np.zeros((3, 5, n))
    v[X, 0] = v[Y, 1] = v[Z, 2] = 1.0
    _rotate(v, Z, yaw)
    for axis, sign, motion in tilts:
        _rotate(v, axis, sign * motion)
    wx, wy, wz = v[:, 3]
    ax, ay, _ = v[:, 4]
    h = arm_m
    rows = np.empty((n, N_ROW))
    for i in range(5):
        rows[:, 3 * i : 3 * i + 3] = v[:, i].T
    # alpha x r + omega x (omega x r) with r = (0, 0, h); gravity reaction along the vertical, the last row of R
    rows[:, 15] = h * (ay + wx * wz) + GRAVITY_M_S2 * v[X, 2]
    rows[:, 16] = h * (wy * wz - ax) + GRAVITY_M_S2 * v[Y, 2]
    rows[:, 17] = -h * (wx * wx + wy * wy) + GRAVITY_M_S2 * v[Z, 2]
    return rows


def _waves(sines: tuple[Sine, ...], roughness: Roughness | None, seed: np.random.SeedSequence | None) -> _Waves:
    amplitude = [radians(s.amplitude_deg) for s in sines]
    omega = [2.0 * pi / s.period_s for s in sines]
    phase = [radians(s.phase_deg) for s in sines]
    if roughness is not None and roughness.rms_arcmin > 0.0:
        rng = np.random.Generator(np.random.PCG64(seed))
        # one frequency at random in each of equal parts of the band: flat, no gap, and no common period
        part = (np.arange(ROUGHNESS_SINES) + rng.uniform(size=ROUGHNESS_SINES)) / ROUGHNESS_SINES
        frequency = roughness.low_hz + (roughness.high_hz - roughness.low_hz) * part
        omega += [2.0 * pi * float(f) for f in frequency]
        phase += [float(x) for x in rng.uniform(0.0, 2.0 * pi, size=ROUGHNESS_SINES)]
        amplitude += [radians(roughness.rms_arcmin / 60.0) * sqrt(2.0 / ROUGHNESS_SINES)] * ROUGHNESS_SINES
    return _Waves(*(np.array(column, dtype=np.float64).reshape(-1, 1) for column in (amplitude, omega, phase)))


def _joined(waves: _Waves, sea: Spectrum | None, seed: np.random.SeedSequence) -> _Waves:
    if sea is None:
        return waves
    return _Waves(*(np.vstack(pair) for pair in zip(waves, sea_waves(sea, seed), strict=True)))


def sea_waves(sea: Spectrum, seed: np.random.SeedSequence) -> _Waves:
    """Lines of a seaway with phases from ``seed``, scaled to its rms; the first draw that keeps the peak over ``SEA_SPAN_S``.

    Raises ``ValueError`` when no draw of ``SEA_DRAWS`` does.
    """
    frequency, weight = np.array(sea.lines, dtype=np.float64).T
    amplitude = weight * (radians(sea.rms_deg) * sqrt(2.0) / sqrt(float(weight @ weight)))
    omega = 2.0 * pi * frequency
    rng = np.random.Generator(np.random.PCG64(seed))
    t = np.arange(0.0, SEA_SPAN_S, min(0.5, 0.05 / float(frequency.max())))
    peak = np.inf
    for _ in range(SEA_DRAWS):
        phase = rng.uniform(0.0, 2.0 * pi, size=len(frequency))
        motion = amplitude @ np.sin(np.outer(omega, t) + phase[:, None])
        peak = min(peak, float(np.abs(motion).max()))
        if peak <= radians(sea.peak_deg):
            return _Waves(amplitude[:, None], omega[:, None], phase[:, None])
    raise ValueError(
        f"no phases of the sea keep {sea.rms_deg:g} deg rms below peak_deg = {sea.peak_deg:g} for {SEA_SPAN_S:g} s; "
        f"the lowest peak of {SEA_DRAWS} draws is {np.degrees(peak):.1f} deg"
    )


def _enveloped(waves: _Waves, after: Array, ramp: tuple[Array, Array, Array, Array]) -> Array:
    """Angle, rate and acceleration of envelope times sines, shape (3, len(after))."""
    e, de, dde, _ = ramp
    angle = waves.omega * after + waves.phase
    sine = waves.amplitude * np.sin(angle)
    f = np.add.reduce(sine, axis=0)
    df = np.add.reduce(waves.amplitude * waves.omega * np.cos(angle), axis=0)
    ddf = -np.add.reduce(waves.omega * waves.omega * sine, axis=0)
    return np.stack((e * f, de * f + e * df, dde * f + 2.0 * de * df + e * ddf))


def _rotate(v: Array, axis: int, motion: Array) -> None:
    """Take the row vectors ``v`` (3, 5, n) through a rotation about ``axis`` by ``motion`` (angle, rate, acceleration),
    in place.

    Components in the turned frame, then what the turning adds: omega' = Q^T omega + q' e, alpha' = Q^T alpha + (Q^T
    omega) x q' e + q'' e.
    """
    angle, rate, accel = motion
    j, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    v[j], v[k] = c * v[j] + s * v[k], c * v[k] - s * v[j]
    v[j, 4] += rate * v[k, 3]
    v[k, 4] -= rate * v[j, 3]
    v[axis, 3] += rate
    v[axis, 4] += accel
