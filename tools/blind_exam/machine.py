"""The machine as designed (numbers of the model file, read as plain YAML) and the one that stands in the exam: a few per cent off everywhere."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tools.blind_exam.physics import NAMES, Array, I, Law, N

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "config" / "axis.yaml"

UNITS: dict[str, float] = {
    "1": 1.0, "mm": 1e-3, "um": 1e-6, "m": 1.0, "ms": 1e-3, "s": 1.0, "mH": 1e-3, "N/um": 1e6, "um/N": 1e-6, "mN m": 1e-3, "um/mm": 1e-3,
    "arcmin": math.pi / 10800, "mA": 1e-3, "ppm/K": 1e-6, "rad": 1.0, "deg": math.pi / 180, "ppm": 1e-6, "%": 1e-2,
    "mrad": 1e-3, "mm/s": 1e-3,
}  # fmt: skip
"""Factors to SI; a unit that is not listed is SI already."""

JITTERED = (
    "rotor_inertia", "moving_mass", "torque_constant", "resistance", "stiffness", "damping", "gap", "coulomb", "static", "stribeck_speed",
    "viscous", "bristle", "bristle_damping", "load_factor", "guide_coulomb", "guide_viscous", "guide_bristle", "cogging", "first",
)  # fmt: skip
JITTER = 0.04

ACTUATOR = {
    "rotor_inertia": "rotor_inertia", "torque_constant": "torque_constant", "resistance": "resistance", "inductance": "inductance",
    "current_lag": "current_lag", "current_limit": "current_limit", "bus_voltage": "bus_voltage", "screw_lead": "lead", "gear_ratio": "gear",
    "axial_stiffness": "stiffness", "contact_damping": "damping", "resolver_counts": "counts",
}  # fmt: skip

EFFECTS: dict[str, dict[str, str]] = {
    "motor_friction": {
        "coulomb": "coulomb", "static": "static", "stribeck": "stribeck_speed", "viscous": "viscous", "bristle": "bristle",
        "bristle_damping": "bristle_damping", "load_factor": "load_factor",
    },
    "cogging": {"cogging": "cogging", "cogging_order": "cogging_order"},
    "backlash": {"gap": "gap"},
    "lead_error": {"slope": "slope", "first": "first", "first_phase": "first_phase", "second": "second", "second_phase": "second_phase"},
    "resolver_error": {"first": "ecc1", "first_phase": "ecc1_phase", "second": "ecc2", "second_phase": "ecc2_phase", "noise": "resolver_noise"},
    "guide_friction": {"coulomb": "guide_coulomb", "bristle": "guide_bristle", "viscous": "guide_viscous"},
    "zero_offset": {"zero_offset": "zero"},
}  # fmt: skip
"""Numbers of the effects of a model file under the names of the truth; the guide has no static excess here, its elements slip one by one."""


def si(entry: dict[str, Any]) -> float:
    """A ``{value, unit}`` of a model file in SI."""
    return float(entry["value"]) * UNITS.get(str(entry["unit"]), 1.0)


def jittered(nominal: Array, rng: np.random.Generator) -> Array:
    """The machine that was really built: each number within a few per cent of the drawing."""
    p = nominal.copy()
    for name in JITTERED:
        p[getattr(I, name)] *= 1.0 + JITTER * float(np.clip(rng.standard_normal(), -1.25, 1.25))
    return p


def cascade(nominal: Array, crossover_hz: float = 14.0, resolver: bool = True) -> Law:
    """Gains from the numbers as designed: speed crossover, position a fourth of it."""
    w = 2.0 * math.pi * crossover_hz
    ratio = float(nominal[I.lead] / (2 * math.pi * nominal[I.gear]))
    inertia = float(nominal[I.rotor_inertia] + (nominal[I.moving_mass] + 2.0) * ratio**2)
    kv = w * inertia / float(nominal[I.torque_constant]) / ratio
    limit = min(5.0, float(nominal[I.current_limit]))
    return Law(round(w / 4, 3), round(kv, 3), 1.0, limit, float(resolver), float(nominal[I.lead] / nominal[I.gear]), float(nominal[I.counts]))


def blank() -> Array:
    """All effects absent, numbers that must not be zero at a harmless value."""
    harmless = {
        "stribeck_speed": 6.0, "bump_width": 1e-3, "stick_width": 1e-3, "warm_time": 10.0, "crosstalk_hz": 97.0, "mode_hz": 60.0,
        "mode_damping": 0.03, "mode2_hz": 31.0, "tiny": 1.0,
        "temperature_lag": 0.02, "temperature_offset": 1.0, "ruler_step": 1e-7, "bristle": 1.5, "counts": 16384.0,
    }  # fmt: skip
    p = np.zeros(N)
    for name, value in harmless.items():
        p[NAMES.index(name)] = value
    return p


def nominal(path: Path = MODEL) -> Array:
    """The axis as designed, from a model file of an axis (read as YAML, not through the program)."""
    p = blank()
    raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    for key, name in ACTUATOR.items():
        p[NAMES.index(name)] = si(raw["actuator"][key])
    p[I.moving_mass], p[I.ruler_step] = si(raw["axis"]["moving_mass"]), si(raw["axis"]["ruler_step"])
    for row in raw["effects"]:
        values = {key: si(entry) for key, entry in row["parameters"].items()}
        if row["effect"] == "thermal_expansion":
            p[I.expansion] = values["screw_expansion"] * values["screw_length"]
        else:
            for key, value in values.items():
                if key in EFFECTS[row["effect"]]:
                    p[NAMES.index(EFFECTS[row["effect"]][key])] = value
    return p
