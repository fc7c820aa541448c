"""What counts as noise on a platform, frequency by frequency, and residuals divided by it.

The noise of a channel is the spectrum of what the recalibrated model leaves of a commissioning log, plus the slow wander that the model states for
the IMU, which no second log repeats. In these units a residual at its floor is white with variance one, so evidence and deviations need no tuning.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from spsp_ctrl.discrepancy.masks import Mask
from spsp_ctrl.discrepancy.whitening import Split, robust_rms
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import G

SPIKE = 12.0
"""A sample this many rms away from its neighbours is a bad reading."""
KEEP_HZ = {"current": 25.0, "drive": 125.0, "resolver": 100.0, "imu": 50.0, "imu.heading": 2.0, "gyro": 60.0, "gyro.z": 5.0}
"""Frequencies above are not looked at."""
SPREAD, LEAST = 0.15, 4
"""Spectra are averaged over this share of the frequency to either side, and at least so many lines."""


def cosine_transform(values: Array) -> Array:
    """Orthonormal discrete cosine transform (type II): line k lies at k / (2 n) cycles a sample. White noise stays white."""
    n = len(values)
    folded = np.concatenate([values[::2], values[1::2][::-1]])
    lines = np.fft.fft(folded) * np.exp(-0.5j * np.pi * np.arange(n) / n)
    out = np.asarray(lines.real * (2.0 / n) ** 0.5)
    out[0] /= 2.0**0.5
    return out


def averaged(power: Array) -> Array:
    """Power of each line as mean over its neighbourhood."""
    n = len(power)
    k = np.arange(n)
    half = np.maximum(LEAST, (SPREAD * k).astype(int))
    low, high = np.maximum(0, k - half), np.minimum(n, k + half + 1)
    sums = np.concatenate([[0.0], np.cumsum(power)])
    return np.asarray((sums[high] - sums[low]) / (high - low))


@dataclass(frozen=True)
class Spectrum:
    """Noise of one channel: variance of white noise per sample at given frequencies."""

    hz: Array
    variance: Array

    def at(self, hz: Array) -> Array:
        """Between the lines."""
        return np.asarray(np.interp(hz, self.hz, self.variance))


def spectrum(values: Array, rate_hz: float) -> Spectrum:
    """From one record, without its spikes."""
    level = max(robust_rms(values), 1e-15)
    lines = cosine_transform(bridged(values, spikes(values)))
    hz = np.asarray(np.arange(len(lines)) * rate_hz / (2.0 * len(lines)), np.float64)
    return Spectrum(hz, averaged(lines * lines) + 1e-6 * level * level)


def flat(values: Array, rate_hz: float) -> Spectrum:
    """Without a commissioning log: white noise of the size of the scatter of neighbours around a straight line. A guess."""
    level = robust_rms(values[1:-1] - 0.5 * (values[:-2] + values[2:])) / 1.5**0.5
    return Spectrum(np.array([0.0, rate_hz]), np.full(2, max(level, 1e-12) ** 2))


@dataclass(frozen=True)
class Whitener:
    """Divides the residuals of one bench by the deviation of their noise, line by line."""

    scale: dict[str, Array]
    """One over the deviation, for the lines that are looked at."""
    spikes: dict[str, Mask]
    """Samples that a bad reading has spoilt, known from the log: they are bridged, whatever the model says."""

    def apply(self, residuals: Mapping[str, Array]) -> Array:
        """All channels in one vector."""
        return np.concatenate([cosine_transform(bridged(residuals[c], self.spikes[c]))[: len(s)] * s for c, s in self.scale.items()])

    def parts(self, whole: Array) -> dict[str, Array]:
        """A vector by channel again."""
        out, at = {}, 0
        for c, s in self.scale.items():
            out[c] = whole[at : at + len(s)]
            at += len(s)
        return out


def spikes(values: Array) -> Mask:
    """Samples that stand alone, far from the four around them."""
    if len(values) < 5:
        return np.zeros(len(values), np.bool_)
    padded = np.concatenate([values[:1], values[:1], values, values[-1:], values[-1:]])
    off = values - np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    return np.asarray(np.abs(off) > SPIKE * max(robust_rms(off), 1e-15), np.bool_)


def bridged(values: Array, bad: Mask) -> Array:
    """Bad samples replaced by the straight line between good ones."""
    if not bad.any():
        return values
    k = np.arange(len(values))
    return np.where(bad, np.interp(k, k[~bad], values[~bad]), values)


def whitener(residuals: Split, rates: Mapping[str, float], noise: Mapping[str, Spectrum], p: Array, copies: float) -> Whitener:
    """For records of these residuals. ``copies``: 1 for a log, 2 for the difference of two."""
    scale, bad = {}, {}
    for c, r in residuals.items():
        n, rate = len(r), rates[c]
        hz = np.asarray(np.arange(n) * rate / (2.0 * n), np.float64)
        keep = hz <= KEEP_HZ.get(c, KEEP_HZ[c.split(".")[0]])
        variance = noise[c].at(hz[keep]) + wander(c, hz[keep], n, rate, p)
        scale[c] = 1.0 / np.sqrt(copies * variance)
        bad[c] = spikes(r)
    return Whitener(scale, bad)


def wander(channel: str, hz: Array, n: int, rate_hz: float, p: Array) -> Array:
    """Variance of each line from the slow wander of the IMU: Gauss-Markov in pitch and roll, a random walk in heading."""
    span = n / rate_hz
    omega = 2.0 * np.pi * np.maximum(hz, 0.5 / span)
    out = np.zeros(len(hz))
    if channel in ("imu.pitch", "imu.roll") and p[G.imu_drift_rad] > 0.0 and p[G.imu_drift_time_s] > 0.0:
        size, time = float(p[G.imu_drift_rad]) ** 2, float(p[G.imu_drift_time_s])
        out = 2.0 * size * time / (1.0 + (omega * time) ** 2) * rate_hz
        out[0] = n * size * min(1.0, 2.0 * span / time)
    elif channel == "imu.heading":
        size = float(p[G.imu_yaw_walk_rad_sqrt_s]) ** 2
        out = size / omega**2 * rate_hz
        out[0] = n * size * span
    return np.asarray(out)
