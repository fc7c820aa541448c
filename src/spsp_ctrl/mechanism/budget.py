"""Transmission budget (sections 3.5.1, 3.5.2 and Fig 11 of the paper): from gears, screw and temperature to rod length and attitude.

Every cause becomes a rod-length error; the error model turns rod length into attitude over the whole workspace. Lengths in m, angles in rad.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sqrt
from typing import Literal

import numpy as np

from spsp_ctrl.config.tolerances import TransmissionFile
from spsp_ctrl.mechanism.error_model import Lengths, error_sources, level_length, sensitivity
from spsp_ctrl.mechanism.tolerance import WORST_GRID, Poses
from spsp_ctrl.mechanism.vectorised import rod_lengths

Kind = Literal["play", "gear", "screw", "thermal", "sensor"]


def circumferential_backlash(normal_m: float, pressure_angle_rad: float) -> float:
    """Backlash along the pitch circle from that between the flanks: J_wt = J_bn / cos(alpha) (section 3.5.1)."""
    return normal_m / cos(pressure_angle_rad)


def rod_per_turn(angle_rad: float, turns_per_screw_turn: float, lead_m: float) -> float:
    """Rod travel that belongs to an angle of a gear which turns this many times per turn of the screw."""
    return angle_rad / (2.0 * pi * turns_per_screw_turn) * lead_m


def thermal_growth(length_m: float, expansion_1_k: float, warming_k: float) -> float:
    """Eq (13): l0 alpha dT."""
    return length_m * expansion_1_k * warming_k


@dataclass(frozen=True)
class Row:
    """One cause."""

    name: str
    kind: Kind
    how: str
    """How the rod error comes about, in figures."""
    rod_m: float
    """Largest rod error; play counts in full, from flank to flank."""


@dataclass(frozen=True)
class RodEffect:
    """Largest attitude error per rod error over the workspace, rad/m."""

    pitch_by_pitch_rod: float
    roll_by_pitch_rod: float
    roll_by_roll_rod: float

    @property
    def greatest(self) -> float:
        """Of the three."""
        return max(self.pitch_by_pitch_rod, self.roll_by_pitch_rod, self.roll_by_roll_rod)


@dataclass(frozen=True)
class Budget:
    """The causes of one actuator with their sums."""

    rows: tuple[Row, ...]
    effect: RodEffect
    rod_limit_m: float | None

    @property
    def worst_m(self) -> float:
        """All causes at their largest, added."""
        return sum(row.rod_m for row in self.rows)

    @property
    def rss_m(self) -> float:
        """Added in squares."""
        return sqrt(sum(row.rod_m**2 for row in self.rows))

    @property
    def play_m(self) -> float:
        """Lost motion at a reversal."""
        return sum(row.rod_m for row in self.rows if row.kind == "play")


def rod_effect(pitch_limit_rad: float, roll_limit_rad: float, lengths_m: Lengths) -> RodEffect:
    """Attitude per rod length over the workspace."""
    poses = Poses.grid(pitch_limit_rad, roll_limit_rad, WORST_GRID)
    known = error_sources(lengths_m)
    largest = np.abs(sensitivity(poses.pitch_rad, poses.roll_rad, lengths_m, [known["dl1"], known["dl2"]])).max(axis=-1)
    return RodEffect(float(largest[0, 0]), float(largest[1, 0]), float(largest[1, 1]))


def largest_travel(pitch_limit_rad: float, roll_limit_rad: float, lengths_m: Lengths) -> float:
    """Largest rod travel from level within the joint limits, m."""
    poses = Poses.grid(pitch_limit_rad, roll_limit_rad, WORST_GRID)
    level = level_length(lengths_m)
    return max(float(np.abs(length - level).max()) for length in rod_lengths(poses.pitch_rad, poses.roll_rad, *lengths_m))


def transmission_budget(file: TransmissionFile, pitch_limit_rad: float, roll_limit_rad: float, lengths_m: Lengths) -> Budget:
    """The budget of a transmission file for a mechanism."""
    lead = file.screw_lead.si
    rows = []
    for gear in file.gears:
        along = circumferential_backlash(gear.normal_backlash.si, gear.pressure_angle.si)
        angle = along / (0.5 * gear.pitch_diameter.si)
        how = (
            f"J_bn {1e6 * gear.normal_backlash.si:g} µm, J_wt {1e6 * along:.1f} µm on {1e3 * gear.pitch_diameter.si:g} mm: "
            f"{np.degrees(angle) * 60.0:.2f}′ of the gear"
        )
        rows.append(Row(f"backlash, {gear.name}", "play", how, rod_per_turn(angle, gear.turns_per_screw_turn, lead)))
    if file.screw_clearance.value:
        rows.append(Row("screw clearance", "play", "axial play of the nut", file.screw_clearance.si))
    if file.lead_error.value:
        travel = largest_travel(pitch_limit_rad, roll_limit_rad, lengths_m)
        how = f"{1e3 * file.lead_error.si:g} µm/mm over {1e3 * travel:.2f} mm from level"
        rows.append(Row("lead error", "screw", how, file.lead_error.si * travel))
    if file.periodic_lead_error.value:
        rows.append(Row("periodic lead error", "screw", "amplitude over a turn of the screw", file.periodic_lead_error.si))
    if file.resolver_error.value:
        how = f"{np.degrees(file.resolver_error.si) * 60.0:g}′ at the motor, ratio {file.gear_ratio:g}, lead {1e3 * lead:g} mm"
        rows.append(Row("resolver", "sensor", how, rod_per_turn(file.resolver_error.si, file.gear_ratio, lead)))
    if file.screw_warming.value:
        length = level_length(lengths_m) if file.screw_length is None else file.screw_length.si
        how = f"Eq (13): {1e3 * length:g} mm, {1e6 * file.screw_expansion.si:g} ppm/K, {file.screw_warming.si:g} K"
        rows.append(Row("thermal deformation", "thermal", how, thermal_growth(length, file.screw_expansion.si, file.screw_warming.si)))
    limit = None if file.rod_limit is None else file.rod_limit.si
    return Budget(tuple(rows), rod_effect(pitch_limit_rad, roll_limit_rad, lengths_m), limit)
