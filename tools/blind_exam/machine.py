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
PLATFORM = ROOT / "config" / "model.yaml"

UNITS: dict[str, float] = {
    "1": 1.0, "mm": 1e-3, "um": 1e-6, "m": 1.0, "ms": 1e-3, "s": 1.0, "mH": 1e-3, "N/um": 1e6, "um/N": 1e-6, "mN m": 1e-3, "um/mm": 1e-3,
    "arcmin": math.pi / 10800, "mA": 1e-3, "ppm/K": 1e-6, "rad": 1.0, "deg": math.pi / 180, "ppm": 1e-6, "%": 1e-2, "mrad": 1e-3,
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
        "mode_damping": 0.03, "mode2_hz": 31.0, "tiny": 1.0, "temperature_lag": 0.02, "temperature_offset": 1.0, "bristle": 1.5, "counts": 16384.0,
    }  # fmt: skip
    p = np.zeros(N)
    for name, value in harmless.items():
        p[NAMES.index(name)] = value
    return p


def nominal(path: Path | None = None) -> Array:
    """The axis as designed, from the model file of an axis (or, without one, from the platform's actuator and a carriage of 8 kg)."""
    p = blank()
    source = path or (MODEL if MODEL.exists() else PLATFORM)
    raw = yaml.safe_load(source.read_text(encoding="utf-8"))
    for key, name in ACTUATOR.items():
        p[NAMES.index(name)] = si(raw["actuator"][key])
    p[I.moving_mass], p[I.guide_coulomb], p[I.guide_viscous], p[I.guide_bristle] = 8.0, 11.0, 60.0, 9e5
    effects = {e["effect"]: {k: si(v) for k, v in e["parameters"].items()} for e in raw["effects"] if e.get("axis", "both") == "both"}
    friction = effects.get("motor_friction", {})
    for key, name in (("coulomb", "coulomb"), ("static", "static"), ("stribeck", "stribeck_speed"), ("viscous", "viscous"), ("bristle", "bristle"),
                      ("bristle_damping", "bristle_damping"), ("load_factor", "load_factor")):  # fmt: skip
        if key in friction:
            p[NAMES.index(name)] = friction[key]
    p[I.gap] = effects.get("backlash", {}).get("gap", 0.0)
    return p
