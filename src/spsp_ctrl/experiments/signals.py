"""Signals of a log as an evaluation needs them: IMU frames on their own time, rods by the resolvers, kinematics on arrays."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.mechanism import kinematics
from spsp_ctrl.mechanism.frames import roll_from_imu
from spsp_ctrl.messages import Mode

ARCMIN_PER_RAD = 10800.0 / np.pi
ARCSEC_PER_RAD = 60.0 * ARCMIN_PER_RAD
DEG_PER_RAD = 180.0 / np.pi
UM_PER_M = 1e6

Topics = Mapping[str, NDArray[Any]]
Figures = dict[str, Any]
Array = NDArray[np.float64]
Curves = dict[str, tuple[Array, Array]]
"""Name of a curve to its abscissa and ordinate, in the units of a report."""


def wrap(angle: Array) -> Array:
    """The same directions in [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def judged(control: NDArray[Any], settle_s: float, duration_s: float) -> NDArray[np.bool_]:
    """Cycles that count: after the start-up transient, before the final stop, while the loop is active."""
    t = control["stamp_ns"] * 1e-9
    return np.asarray((t >= settle_s) & (t <= duration_s) & (control["mode"] == int(Mode.ACTIVE)))


class Frames(NamedTuple):
    """IMU frames: index of the cycle that first saw each, device stamp, attitude as the platform's own angles."""

    cycle: NDArray[np.intp]
    stamp_s: Array
    pitch_rad: Array
    roll_rad: Array
    heading_rad: Array

    def among(self, keep: NDArray[np.bool_]) -> Frames:
        """Those that arrived in the chosen cycles."""
        chosen = keep[self.cycle]
        return Frames(self.cycle[chosen], self.stamp_s[chosen], self.pitch_rad[chosen], self.roll_rad[chosen], self.heading_rad[chosen])


def imu_frames(topics: Topics) -> Frames:
    """Every IMU frame once, as it came in."""
    m = topics["/measurement"]
    seq = m["imu.seq"]
    fresh = np.flatnonzero((np.diff(seq, prepend=-1) != 0) & m["imu.valid"])
    return Frames(
        fresh,
        m["imu.stamp_ns"][fresh] * 1e-9,
        m["imu.pitch_rad"][fresh],
        np.array([roll_from_imu(angle) for angle in m["imu.roll_rad"][fresh].tolist()], dtype=np.float64),
        m["imu.yaw_rad"][fresh],
    )


def resolver_rods(topics: Topics, config: RigConfig) -> tuple[Array, Array]:
    """Rod travel from level in m by the resolvers through the nominal transmission, no compensation; each of shape (cycles,)."""
    m = topics["/measurement"]
    rods = []
    for axis, actuator in (("pitch", config.pitch_actuator), ("roll", config.roll_actuator)):
        turns = m[f"resolver_{axis}.counts"] / 2.0**actuator.resolver_bits
        travel = turns * actuator.screw_lead_mm * 1e-3 / actuator.gear_ratio
        rods.append(travel + actuator.zero_offset_um * 1e-6)
    return rods[0], rods[1]


def attitude_from_rods(rod_pitch_m: Array, rod_roll_m: Array, config: RigConfig) -> tuple[Array, Array]:
    """Pitch and roll in rad from rod travels, nominal geometry."""
    m = config.mechanism
    level, lengths = m.level_m, (m.height_m, m.moving_radius_m, m.static_radius_m)
    pairs = [kinematics.attitude_from_rods(level + a, level + b, *lengths) for a, b in zip(rod_pitch_m.tolist(), rod_roll_m.tolist(), strict=True)]
    found = np.array(pairs, dtype=np.float64).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def rods_from_attitude(pitch_rad: Array, roll_rad: Array, config: RigConfig) -> tuple[Array, Array]:
    """Rod travels from level in m, nominal geometry."""
    m = config.mechanism
    lengths = (m.height_m, m.moving_radius_m, m.static_radius_m)
    pairs = [kinematics.rod_lengths(a, b, *lengths) for a, b in zip(pitch_rad.tolist(), roll_rad.tolist(), strict=True)]
    found = np.array(pairs, dtype=np.float64).reshape(-1, 2) - m.level_m
    return found[:, 0], found[:, 1]


def thin(x: Array, y: Array, columns: int = 1100) -> tuple[Array, Array]:
    """Smallest and largest sample of each of ``columns`` slots: a curve for a picture that keeps every spike."""
    if len(x) <= 2 * columns:
        return np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    edges = np.linspace(0, len(x), columns + 1).astype(np.intp)
    chosen = sorted({int(a + k) for a, b in pairwise(edges.tolist()) for k in (np.argmin(y[a:b]), np.argmax(y[a:b]))})
    return np.asarray(x[chosen], dtype=np.float64), np.asarray(y[chosen], dtype=np.float64)
