"""The platform as designed (numbers of the model file, read as plain YAML), the one that stands in the exam, and what can be hidden in it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from tools.blind_exam.machine import JITTER, UNITS
from tools.blind_exam.platform_physics import N_LEG, Array, L, N, R

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "config" / "model.yaml"
FACTORS = UNITS | {
    "deg/s2": math.pi / 180, "mm": 1e-3, "degC": 1.0, "arcmin/s": math.pi / 10800, "deg/h^0.5": math.pi / 180 / 60, "deg/h": math.pi / 648000,
}  # fmt: skip
LEGS = ("pitch", "roll")
ACTUATOR = {
    "torque_constant": "kt", "current_lag": "current_lag", "current_limit": "current_limit", "rotor_inertia": "inertia",
    "current_noise": "current_noise", "screw_lead": "lead", "gear_ratio": "gear", "axial_stiffness": "stiffness",
    "contact_damping": "damping", "resolver_counts": "counts",
}  # fmt: skip
RIG = {
    "column_height": ("height",), "hinge_radius": ("upper", "lower"), "plate_ixx": ("ixx",), "plate_iyy": ("iyy",), "plate_izz": ("izz",),
    "load_cog_x": ("cog_x",), "load_cog_y": ("cog_y",), "load_cog_z": ("cog_z",), "load_gyration_xy": ("own_xy",), "load_gyration_z": ("own_z",),
    "carrier_izz": ("carrier_izz",), "az_holding": ("az_holding",), "az_teeth": ("az_teeth",), "az_microsteps": ("az_microsteps",),
    "az_rotor_inertia": ("az_inertia",), "az_rotor_damping": ("az_damping",), "az_detent": ("az_detent",), "az_gear_ratio": ("az_gear",),
    "az_stiffness": ("az_stiffness",), "az_damping": ("az_mesh_damping",), "az_ramp": ("az_ramp",), "imu_attitude_lag": ("attitude_lag",),
    "imu_gyro_lag": ("gyro_lag",),
}  # fmt: skip
PER_LEG = {
    "motor_friction": {"coulomb": "coulomb", "static": "static", "stribeck": "stribeck_speed", "viscous": "viscous", "bristle": "bristle",
                       "bristle_damping": "bristle_damping", "load_factor": "load_factor"},
    "cogging": {"cogging": "cogging", "cogging_order": "cogging_order"},
    "backlash": {"gap": "gap"},
    "lead_error": {"slope": "slope", "first": "first", "first_phase": "first_phase", "second": "second", "second_phase": "second_phase"},
    "zero_offset": {"zero_offset": "zero"},
    "hinge_friction": {"coulomb": "hinge_coulomb", "bristle": "hinge_stiffness", "viscous": "hinge_viscous"},
    "resolver_error": {"first": "ecc1", "first_phase": "ecc1_phase", "second": "ecc2", "second_phase": "ecc2_phase", "noise": "resolver_noise"},
}  # fmt: skip
WHOLE = {
    "geometric_error": {"dh": "dh", "dr_upper": "dru", "dr_lower": "drl"},
    "azimuth_backlash": {"az_gap": "az_gap"},
    "azimuth_friction": {"coulomb": "az_coulomb", "bristle": "az_bristle", "viscous": "az_viscous"},
    "imu_noise": {"imu_noise": "imu_noise", "imu_step": "imu_step", "gyro_noise": "gyro_noise", "gyro_step": "gyro_step"},
    "imu_bias": {k: k for k in ("imu_roll_bias", "imu_pitch_bias", "imu_yaw_bias", "gyro_bias_x", "gyro_bias_y", "gyro_bias_z")},
    "imu_drift": {"imu_drift": "drift", "imu_drift_time": "drift_time", "imu_yaw_walk": "walk", "imu_yaw_drift": "yaw_drift"},
    "imu_misalignment": {"imu_mount_x": "mount_x", "imu_mount_y": "mount_y", "imu_mount_z": "mount_z"},
    "imu_levelling": {"imu_levelling_time": "levelling"},
}  # fmt: skip
JITTERED_LEG = (
    "inertia", "kt", "stiffness", "damping", "gap", "coulomb", "static", "viscous", "bristle", "load_factor", "cogging", "first", "hinge_coulomb",
    "hinge_viscous", "hinge_stiffness",
)  # fmt: skip
JITTERED_RIG = ("ixx", "iyy", "izz", "cog_x", "cog_y", "az_gap", "az_coulomb", "az_viscous", "az_holding")


def _si(entry: dict[str, Any]) -> float:
    return float(entry["value"]) * FACTORS.get(str(entry["unit"]), 1.0)


def nominal(path: Path = MODEL) -> Array:
    """The platform as designed."""
    p = np.zeros(N)
    raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    for k in range(2):
        b = k * N_LEG
        for key, name in ACTUATOR.items():
            p[b + getattr(L, name)] = _si(raw["actuator"][key])
        p[b + L.stribeck_speed], p[b + L.bristle] = 6.0, 1.5
    for key, fields in RIG.items():
        for name in fields:
            p[getattr(R, name)] = _si(raw["rig"][key])
    p[R.mass_z] = _si(raw["rig"]["plate_mass"]) * _si(raw["rig"]["plate_cog_z"])
    p[R.load], p[R.drift_time] = 7.0, 60.0
    for row in raw["effects"]:
        values = {key: _si(entry) for key, entry in row["parameters"].items()}
        if row["effect"] == "thermal_expansion":
            p[[L.expansion, N_LEG + L.expansion]] = values["screw_expansion"] * values["screw_length"]
        for key, value in values.items():
            if row["effect"] in PER_LEG and key in PER_LEG[row["effect"]]:
                at = getattr(L, PER_LEG[row["effect"]][key])
                for k, leg in enumerate(LEGS):
                    if row.get("axis", leg) in (leg, "both"):
                        p[k * N_LEG + at] = value
            elif row["effect"] in WHOLE and key in WHOLE[row["effect"]]:
                p[getattr(R, WHOLE[row["effect"]][key])] = value
    return p


def built(drawn: Array, rng: np.random.Generator) -> Array:
    """The machine that was really built: numbers a few per cent off, and small faults that no list names."""
    p = drawn.copy()

    def off() -> float:
        return 1.0 + JITTER * float(np.clip(rng.standard_normal(), -1.25, 1.25))

    for k in range(2):
        for name in JITTERED_LEG:
            p[k * N_LEG + getattr(L, name)] *= off()
        b = k * N_LEG
        p[b + L.third], p[b + L.ecc4], p[b + L.place_friction] = 2e-7 * off(), 1e-4 * off(), 0.003
    for name in JITTERED_RIG:
        p[getattr(R, name)] *= off()
    p[R.colour] = 0.3
    return p


class Kind(NamedTuple):
    """How to hide one effect: ``apply(p, leg, severity, rng)`` changes the truth and returns the library's parameters in SI."""

    places: tuple[str, ...]
    apply: Callable[[Array, int, float, np.random.Generator], dict[str, float]]


def _leg(field: str, key: str, size: float, signed: bool = False, also: str = "", scale: float = 0.0) -> Kind:
    def apply(p: Array, leg: int, severity: float, rng: np.random.Generator) -> dict[str, float]:
        i = leg * N_LEG + getattr(L, field)
        change = severity * size * float(rng.uniform(0.8, 1.25)) * (float(rng.choice([-1.0, 1.0])) if signed else 1.0)
        before = p[i]
        p[i] = p[i] * (1.0 + change) if scale else p[i] + change
        if also:
            p[leg * N_LEG + getattr(L, also)] += change
        return {key: change if scale or before == 0.0 else float(p[i])}

    return Kind(LEGS, apply)


def _rig(place: str, fields: dict[str, str], size: float, signed: bool = True) -> Kind:
    def apply(p: Array, leg: int, severity: float, rng: np.random.Generator) -> dict[str, float]:
        name = str(rng.choice(list(fields)))
        i = getattr(R, fields[name])
        p[i] += severity * size * float(rng.uniform(0.8, 1.25)) * (float(rng.choice([-1.0, 1.0])) if signed else 1.0)
        return {name: float(p[i])}

    return Kind((place,), apply)


def _turning(field: str, key: str, size: float) -> Kind:
    def apply(p: Array, leg: int, severity: float, rng: np.random.Generator) -> dict[str, float]:
        at, phase = leg * N_LEG + getattr(L, field), leg * N_LEG + getattr(L, field + "_phase")
        whole = p[at] * np.exp(1j * p[phase]) + severity * size * float(rng.uniform(0.8, 1.25)) * np.exp(1j * rng.uniform(-math.pi, math.pi))
        p[at], p[phase] = abs(whole), float(np.angle(whole))
        return {key: float(p[at])}

    return Kind(LEGS, apply)


def _ripple(p: Array, leg: int, severity: float, rng: np.random.Generator) -> dict[str, float]:
    b, order = leg * N_LEG, float(rng.choice([1.0, 2.0, 4.0, 8.0]))
    p[b + L.ripple], p[b + L.ripple_order], p[b + L.ripple_phase] = severity * 3e-3 * float(rng.uniform(0.8, 1.25)), order, float(rng.uniform(-3, 3))
    return {"ripple": float(p[b + L.ripple])}


def _late(p: Array, leg: int, severity: float, rng: np.random.Generator) -> dict[str, float]:
    return {"imu_added_delay": severity * 4e-3 * float(rng.uniform(0.8, 1.25))}


def _compliance(p: Array, leg: int, severity: float, rng: np.random.Generator) -> dict[str, float]:
    i, added = leg * N_LEG + L.stiffness, severity * 1.5e-7 * float(rng.uniform(0.8, 1.25))
    p[i] = 1.0 / (1.0 / p[i] + added)
    return {"added_compliance": added}


LIBRARY: dict[str, Kind] = {
    "backlash": _leg("gap", "gap", 20e-6),
    "coulomb_friction": _leg("coulomb", "coulomb", 6e-3, also="static"),
    "viscous_friction": _leg("viscous", "viscous", 6e-5),
    "load_friction": _leg("load_factor", "load_factor", 0.4),
    "motor_constant_error": _leg("kt", "kt_error", 0.12, signed=True, scale=1.0),
    "torque_offset": _leg("offset", "torque_offset", 4e-3, signed=True),
    "torque_ripple": Kind(LEGS, _ripple),
    "lead_error": _leg("slope", "slope", 8e-4, signed=True),
    "periodic_lead_error": _turning("first", "first", 8e-6),
    "zero_offset": _leg("zero", "zero_offset", 60e-6, signed=True),
    "resolver_eccentricity": _turning("ecc1", "first", 3e-3),
    "axial_compliance": Kind(LEGS, _compliance),
    "drive_lag": _leg("lag", "drive_lag", 1.5e-3),
    "hinge_friction": _leg("hinge_coulomb", "coulomb", 1.0),
    "azimuth_backlash": _rig("azimuth", {"az_gap": "az_gap"}, 1.5e-3, signed=False),
    "azimuth_friction": _rig("azimuth", {"coulomb": "az_coulomb"}, 1.5, signed=False),
    "imu_bias": _rig("imu", {"imu_roll_bias": "imu_roll_bias", "imu_pitch_bias": "imu_pitch_bias"}, 4e-4),
    "imu_misalignment": _rig("imu", {"imu_mount_z": "mount_z"}, 6e-3),
    "imu_delay": Kind(("imu",), _late),
    "geometric_error": _rig("base", {"dh": "dh", "dr_upper": "dru"}, 1.5e-4),
}
TWINS = (
    {"zero_offset", "imu_bias", "geometric_error", "imu_misalignment", "thermal_expansion"}, {"torque_offset", "friction_asymmetry"},
    {"lead_error", "geometric_error", "imu_scale"}, {"drive_lag", "command_delay"}, {"torque_ripple", "cogging"},
)  # fmt: skip
"""Names that the sensors of this rig cannot tell apart count as one."""
OUTSIDE: dict[str, Kind] = {
    "quadratic drag": _leg("drag", "drag", 6e-7),
    "cubic lead": _leg("cubic", "cubic", 2.0, signed=True),
    "friction bump": _leg("bump", "bump", 1.2e-2),
    "friction over the place": _leg("place_friction", "place", 0.4),
    "IMU rocks on its mount": _rig("imu", {"play": "play_of_imu"}, 3e-4),
    "acceleration leaks into roll": _rig("imu", {"leak": "acceleration_leak"}, 1.5e-4),
    "heading wobbles with the azimuth": _rig("azimuth", {"wobble": "wobble"}, 2e-3),
    "fourth harmonic of the resolver": _leg("ecc4", "ecc4", 4e-3),
}
SEVERITIES = (0.1, 0.3, 1.0, 3.0)
