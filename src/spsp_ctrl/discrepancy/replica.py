"""The model run along a record, and what is left between the two, channel by channel.

A log with a known cascade in the model file is simulated in closed loop from its reference: the channel is the command. Otherwise the recorded
command acts (in velocity mode, where no torque command is logged, the measured current), and a slow tracking loop keeps the simulated motor at the
recorded angle: ``u = u_rec + kv (kp e + e')``. What it has to add is the torque that the model is missing, so nothing drifts however long the
record, and every effect that depends on the place acts at the right place.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Literal

import numpy as np

from spsp_ctrl.discrepancy.records import Record
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, OUT, inputs_from
from spsp_ctrl.plant.axis_model import AxisModel
from spsp_ctrl.plant.layout import A, L

TRACKING_HZ = 8.0
"""Crossover of the tracking loop."""
SETTLE_S = 0.3
"""Left out at the start: the state there is a guess."""
TAIL_S = 0.012
"""Left out at the end: the smoothed reference of the tracking loop has no future there."""
WARMING_S = 0.3
"""A screw does not warm within this time: what its sensor shows faster is noise."""
SLOW_HZ = 100.0
"""Rate to which the current is averaged: beyond, there is only noise and what ``drive`` shows."""
COMMAND_NAMES = ("command_delay", "drive_lag", "command_deadband", "current_saturation", "voltage_saturation", "velocity_saturation")
TORQUE_NAMES = (
    "coulomb_friction", "viscous_friction", "stribeck_friction", "friction_asymmetry", "load_friction", "presliding", "torque_offset",
    "torque_ripple", "cogging", "motor_constant_error", "resolver_eccentricity", "sentinel_ripple", "sentinel_parity",
)  # fmt: skip
UNITS = {"force": "N", "current": "A", "drive": "A", "resolver": "rad", "ruler": "m"}
"""Channels and their units. ``current``: measured current that the model does not explain at the measured motion. ``drive``: current that does not
follow from the command. ``ruler``: load that does not follow from the motor. ``force``: command in closed loop, as force at the load."""


@dataclass(frozen=True, slots=True)
class Replica:
    """A model beside one record."""

    model: AxisModel
    record: Record
    inputs: Array
    measured: dict[str, Array]
    tracking: bool
    scale: float
    """Force per command of a bare axis, else 1."""
    travel_per_rad: float
    skip: int
    every: int
    torque: Literal["command", "current", "unknown"] = "command"
    """What is known of the torque: its command, only the measured current (velocity mode), or nothing."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of this record."""
        if not self.tracking:
            return ("force",)
        known = {"command": ("current", "drive", "resolver", "ruler"), "current": ("current", "resolver", "ruler"), "unknown": ("ruler",)}
        return known[self.torque]

    @property
    def blind(self) -> tuple[str, ...]:
        """Names that such a record says nothing about: in velocity mode the way from command to current is inside the drive."""
        return () if self.torque == "command" else COMMAND_NAMES if self.torque == "current" else (*COMMAND_NAMES, *TORQUE_NAMES)

    def prepared(self, p: Array) -> Array:
        """The parameters with the loop that this record is run in."""
        if not self.tracking:
            return p
        q = p.copy()
        q[L.loop], q[L.kp_1_s], q[L.kv], q[L.feedforward] = 2.0, *self.gains, 1.0
        q[L.limit], q[L.rate_span] = 1e9, 1.0
        return q

    @property
    def gains(self) -> tuple[float, float]:
        """Position and speed gain of the tracking loop, from the model as given."""
        return tracking_gains(self.model)

    def run(self, p: Array) -> Array:
        """Outputs of the model at every sample."""
        return self.model.simulate(self.prepared(p), self.inputs)

    def residuals(self, p: Array) -> dict[str, Array]:
        """Simulated minus measured, by channel, averaged to their rates, without the start."""
        return self.compare(self.run(p))

    def compare(self, y: Array) -> dict[str, Array]:
        """The same from outputs."""
        m = self.measured
        if not self.tracking:
            return {"force": self._slow((y[:, OUT.command_a] - m["command"]) * self.scale, 1)}
        drive = (y[:, OUT.current_a] - y[:, OUT.command_a]) - (m["current"] - m["command"])
        motor = y[:, OUT.motor_rad] - m["motor"]
        ruler = (y[:, OUT.load_m] - m["load"]) - self.travel_per_rad * motor
        every = {
            "current": self._slow(y[:, OUT.current_a] - m["current"], self.every),
            "drive": self._slow(drive, 1),
            "resolver": self._slow(motor, 1),
            "ruler": self._slow(ruler, 1),
        }
        return {c: every[c] for c in self.channels}

    def rows(self, channel: str) -> Array:
        """Row of the record in the middle of each residual of a channel."""
        every = self.every if channel == "current" else 1
        n = (len(self.inputs) - self.skip - self.tail) // every
        return np.asarray(self.skip + np.arange(n) * every + every // 2, np.int64)

    @property
    def tail(self) -> int:
        """Samples at the end that are not compared."""
        return max(1, round(TAIL_S * self.record.rate_hz)) if self.tracking else 0

    def _slow(self, values: Array, every: int) -> Array:
        kept = values[self.skip : len(values) - self.tail]
        n = len(kept) // every
        return np.asarray(kept[: n * every].reshape(n, every).mean(axis=1)) if every > 1 else kept


def tracking_gains(model: AxisModel) -> tuple[float, float]:
    """Position gain in 1/s and speed gain in A s/m for a crossover of ``TRACKING_HZ``."""
    p = model.parameters()
    ratio = model.travel_per_rad
    inertia = p[A.rotor_inertia_kg_m2] + p[L.moving_mass_kg] * ratio * ratio
    w = 2.0 * pi * TRACKING_HZ
    return w / 4.0, float(w * inertia / p[A.torque_constant_nm_a] / ratio)


def replica(model: AxisModel, record: Record) -> Replica:
    """Put a model beside a record."""
    p = model.parameters()
    u = inputs_from(record.rows, record.rate_hz)
    tracking = model.file.controller.kind != "cascade"
    ratio = model.travel_per_rad
    u[:, IN.screw_c] = smooth(u[:, IN.screw_c], max(1, round(0.5 * WARMING_S * record.rate_hz)))
    motor = record.motor_rad(float(p[A.resolver_counts]) or 2.0 * pi)
    rows = record.rows
    torque: Literal["command", "current", "unknown"] = "command"
    command = np.asarray(rows["command_a"], np.float64)
    if tracking and rows["velocity_mode"].any():
        torque = "current" if np.ptp(rows["current_a"]) > 0.0 else "unknown"
        command = smooth(np.asarray(rows["current_a"], np.float64), 1)
        u[:, IN.velocity_mode], u[:, IN.command_a] = 0.0, command
    measured = {
        "motor": motor,
        "load": np.asarray(rows["load_m"], np.float64),
        "current": np.asarray(rows["current_a"], np.float64),
        "command": command,
    }
    if tracking:
        place = smooth(median3(motor), max(1, round(0.004 * record.rate_hz))) * ratio
        rate = np.concatenate([[0.0], np.diff(place)]) * record.rate_hz
        u[:, IN.reference_m] = place
        u[:, IN.reference_m_s] = rate + command / tracking_gains(model)[1]
    scale = float(p[A.torque_constant_nm_a] / ratio) if not tracking else 1.0
    every = max(1, round(record.rate_hz / SLOW_HZ))
    return Replica(model, record, u, measured, tracking, scale, ratio, max(2, round(SETTLE_S * record.rate_hz)), every, torque)


def median3(values: Array) -> Array:
    """Median of three neighbours: a single outlier does not pull the model along."""
    if len(values) < 3:
        return values
    middle = np.median(np.stack([values[:-2], values[1:-1], values[2:]]), axis=0)
    return np.concatenate([values[:1], middle, values[-1:]])


def smooth(values: Array, half: int) -> Array:
    """Mean over ``2 half + 1`` samples without phase."""
    width = 2 * half + 1
    padded = np.concatenate([np.full(half, values[0]), values, np.full(half, values[-1])])
    sums = np.concatenate([[0.0], np.cumsum(padded - values[0])])
    return np.asarray((sums[width:] - sums[:-width]) / width + values[0])
