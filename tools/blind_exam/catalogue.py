"""What can be hidden: the library's names with a moderate size each, kinds outside every library, and twins.

A draw changes the parameters of the truth and says what the right answer is. ``value`` of an answer is in SI under the library's parameter name.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tools.blind_exam.physics import Array, I

SEVERITIES = (0.03, 0.1, 0.3, 1.0, 3.0)
SCREW_LENGTH_M = 0.25
"""As in the model file: the sensors see only its product with the coefficient."""


class Hidden(NamedTuple):
    """One thing that is wrong with the machine."""

    effect: str
    stage: str
    values: dict[str, float]


Apply = Callable[[Array, float, np.random.Generator], dict[str, float]]


class Kind(NamedTuple):
    """How to hide one effect: ``apply(p, severity, rng)`` changes the truth and returns the library's parameters."""

    stage: str
    apply: Apply


def _sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def _spread(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.8, 1.25))


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-math.pi, math.pi))


def _plus(field: str, key: str, moderate: float, signed: bool = False) -> Apply:
    """``key`` of the library is ``field`` of the truth, which grows; the answer is all of it, as the model file should hold it."""

    def apply(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
        p[getattr(I, field)] += severity * moderate * _spread(rng) * (_sign(rng) if signed else 1.0)
        return {key: float(p[getattr(I, field)])}

    return apply


def _coulomb(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    size = severity * 5e-3 * _spread(rng)
    p[I.coulomb] += size
    p[I.static] += size
    return {"coulomb": float(p[I.coulomb])}


def _stribeck(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    size, speed = severity * 5e-3 * _spread(rng), 6.0 * _spread(rng)
    p[I.static] += size
    p[I.stribeck_speed] = speed
    return {"excess": size, "speed": speed}


def _asymmetry(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    coulomb, viscous = severity * 2e-3 * _spread(rng) * _sign(rng), severity * 1e-5 * _spread(rng) * _sign(rng)
    p[I.coulomb_asymmetry] += coulomb
    p[I.viscous_asymmetry] += viscous
    return {"coulomb": coulomb, "viscous": viscous}


def _presliding(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.bristle] /= 1.0 + severity * _spread(rng)  # softer bristles
    return {"bristle": float(p[I.bristle])}


def _ripple(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    order = float(rng.choice([1.0, 2.0, 4.0, 6.0]))
    p[I.ripple], p[I.ripple_order], p[I.ripple_phase] = severity * 3e-3 * _spread(rng), order, _phase(rng)
    return {"ripple": float(p[I.ripple]), "order": order, "phase": float(p[I.ripple_phase])}


def _cogging(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.cogging] += severity * 2e-3 * _spread(rng)
    p[I.cogging_order] = p[I.cogging_order] or 12.0
    return {"cogging": float(p[I.cogging]), "cogging_order": float(p[I.cogging_order])}


def _constant(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    size = float(np.clip(severity * 0.12 * _spread(rng) * _sign(rng), -0.4, 0.6))
    p[I.torque_constant] *= 1.0 + size
    return {"kt_error": size}


def _shrink(field: str, key: str, factor: float) -> Apply:
    """A limit that comes down as the severity goes up."""

    def apply(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
        p[getattr(I, field)] /= 1.0 + severity * factor * _spread(rng)
        return {key: float(p[getattr(I, field)])}

    return apply


def _speed_limit(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.speed_limit] = 500.0 / (1.0 + severity * 1.5 * _spread(rng))
    return {"speed_ceiling": float(p[I.speed_limit])}


def _periodic_lead(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    out: dict[str, float] = {}
    for field, key, size in (("first", "first", 3e-6), ("second", "second", 1.2e-6)):
        a, ph = getattr(I, field), getattr(I, field + "_phase")
        z = p[a] * np.exp(1j * p[ph]) + severity * size * _spread(rng) * np.exp(1j * _phase(rng))
        p[a], p[ph] = abs(z), np.angle(z)
        out |= {key: float(p[a]), key + "_phase": float(p[ph])}
    return out


def _expansion(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.expansion] += severity * 11.5e-6 * SCREW_LENGTH_M * _spread(rng)
    return {"screw_expansion": float(p[I.expansion]) / SCREW_LENGTH_M}


def _thermal_lag(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.temperature_lag] += severity * 1.0 * _spread(rng)
    return {"thermal_lag": float(p[I.temperature_lag])}


def _eccentricity(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    arcmin = math.pi / 10800
    out: dict[str, float] = {}
    for n, size in ((1, 8.0), (2, 5.0)):
        a, ph = (I.ecc1, I.ecc1_phase) if n == 1 else (I.ecc2, I.ecc2_phase)
        z = p[a] * np.exp(1j * p[ph]) + severity * size * arcmin * _spread(rng) * np.exp(1j * _phase(rng))
        p[a], p[ph] = abs(z), np.angle(z)
        name = "first" if n == 1 else "second"
        out |= {name: float(p[a]), name + "_phase": float(p[ph])}
    return out


def _quantisation(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.resolver_step] = 2 * math.pi / 16384 * (1.0 + 12.0 * severity * _spread(rng))
    return {"res_step": float(p[I.resolver_step])}


def _resonance(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.mode_gain], p[I.mode_hz], p[I.mode_damping] = 0.5 * severity * _spread(rng), float(rng.uniform(25, 60)), float(rng.uniform(0.02, 0.05))
    return {"frequency": float(p[I.mode_hz]), "damping": float(p[I.mode_damping]), "gain": float(p[I.mode_gain])}


LIBRARY: dict[str, Kind] = {
    "backlash": Kind("transmission", _plus("gap", "gap", 15e-6)),
    "axial_compliance": Kind("transmission", _plus("extra_compliance", "added_compliance", 1.0e-7)),
    "coulomb_friction": Kind("drive", _coulomb),
    "viscous_friction": Kind("drive", _plus("viscous", "viscous", 4e-5)),
    "stribeck_friction": Kind("drive", _stribeck),
    "friction_asymmetry": Kind("drive", _asymmetry),
    "load_friction": Kind("drive", _plus("load_factor", "load_factor", 0.5)),
    "presliding": Kind("drive", _presliding),
    "torque_offset": Kind("drive", _plus("torque_offset", "torque_offset", 3e-3, signed=True)),
    "torque_ripple": Kind("drive", _ripple),
    "cogging": Kind("drive", _cogging),
    "motor_constant_error": Kind("drive", _constant),
    "voltage_saturation": Kind("drive", _shrink("bus_voltage", "voltage_limit", 0.8)),
    "current_saturation": Kind("drive", _shrink("current_limit", "current_ceiling", 3.0)),
    "velocity_saturation": Kind("drive", _speed_limit),
    "command_deadband": Kind("drive", _plus("deadband", "deadband", 0.06)),
    "drive_lag": Kind("drive", _plus("extra_lag", "drive_lag", 1.5e-3)),
    "command_delay": Kind("drive", _plus("delay", "command_delay", 2e-3)),
    "lead_error": Kind("transmission", _plus("slope", "slope", 5e-4, signed=True)),
    "periodic_lead_error": Kind("transmission", _periodic_lead),
    "guide_slope": Kind("sensors", _plus("abbe", "guide_slope", 5e-4, signed=True)),
    "thermal_expansion": Kind("transmission", _expansion),
    "thermal_lag": Kind("thermal", _thermal_lag),
    "zero_offset": Kind("transmission", _plus("zero", "zero_offset", 15e-6, signed=True)),
    "resolver_eccentricity": Kind("sensors", _eccentricity),
    "resolver_quantisation": Kind("sensors", _quantisation),
    "resolver_noise": Kind("sensors", _plus("resolver_noise", "noise", 3e-4)),
    "structural_resonance": Kind("mechanism", _resonance),
    "sensor_dropout": Kind("sensors", _plus("dropout", "ruler_lost", 0.02)),
    "clock_skew": Kind("sensors", _plus("skew", "clock_skew", 5e-3, signed=True)),
}


def _out(**sizes: float) -> Apply:
    """Set fields: those in capitals take the severity, the others stand."""

    def apply(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
        for name, value in sizes.items():
            scaled = name.startswith("S_")
            p[getattr(I, name.removeprefix("S_"))] = value * _spread(rng) * (severity if scaled else 1.0)
        return {}

    return apply


def _bump(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.bump], p[I.bump_at], p[I.bump_width] = severity * 8e-3, float(rng.uniform(-8e-3, 8e-3)), float(rng.uniform(1e-3, 2e-3))
    return {}


def _stick(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.stick], p[I.stick_at], p[I.stick_width] = severity * 60.0, float(rng.uniform(-8e-3, 8e-3)), float(rng.uniform(5e-4, 1.2e-3))
    return {}


def _half(p: Array, severity: float, rng: np.random.Generator) -> dict[str, float]:
    p[I.half_ripple], p[I.half_phase] = severity * 4e-3 * _spread(rng), _phase(rng)
    return {}


OUTSIDE: dict[str, Kind] = {
    "quadratic_drag": Kind("drive", _out(S_drag2=1.5e-7)),
    "cubic_lead": Kind("transmission", _out(S_cubic=1.5)),
    "friction_bump": Kind("drive", _bump),
    "friction_warm_up": Kind("drive", _out(S_warm=0.6, warm_time=4.0)),
    "second_mode": Kind("sensors", _out(S_mode2_gain=0.4, mode2_hz=21.0)),
    "bus_crosstalk": Kind("sensors", _out(S_crosstalk=0.04, crosstalk_hz=37.0)),
    "sticking_guide": Kind("transmission", _stick),
    "hysteretic_stiffness": Kind("transmission", _out(S_hysteresis=3e6, hysteresis_width=1.2e-5)),
    "half_order_ripple": Kind("drive", _half),
    "ruler_drift": Kind("sensors", _out(S_ruler_expansion=2e-4, ruler_time=3.0)),
}

TWINS: tuple[frozenset[str], ...] = (
    frozenset({"torque_offset", "friction_asymmetry"}),
    frozenset({"lead_error", "guide_slope"}),
)
"""Names that the sensor set (or a motion that never stops) cannot tell apart: each counts as right when the other is named in one class with it."""


class LookAlike(NamedTuple):
    """Two names that the plain motion cannot part at these severities (whether so is checked in every case, from the truth alone)."""

    names: tuple[str, str]
    severities: tuple[float, ...]


LOOK_ALIKE: tuple[LookAlike, ...] = (
    LookAlike(("torque_offset", "friction_asymmetry"), (1.0, 3.0)),
    LookAlike(("coulomb_friction", "load_friction"), (0.3, 1.0)),
    LookAlike(("thermal_expansion", "zero_offset"), (0.3, 1.0)),
    LookAlike(("lead_error", "guide_slope"), (1.0, 3.0)),
    LookAlike(("drive_lag", "command_delay"), (0.3,)),
)
"""Pairs of the set ``twins``. A drive that lags by more than a millisecond is no twin of a delay any more: the loop itself shows the difference."""

SIZES: dict[str, tuple[tuple[str, ...], float]] = {
    "torque_offset": (("torque_offset",), 3e-3), "friction_asymmetry": (("coulomb_asymmetry",), 2e-3),
    "coulomb_friction": (("coulomb", "static"), 5e-3),
    "load_friction": (("load_factor",), 0.5), "thermal_expansion": (("expansion",), 11.5e-6 * SCREW_LENGTH_M), "zero_offset": (("zero",), 15e-6),
    "lead_error": (("slope",), 5e-4), "guide_slope": (("abbe",), 5e-4), "drive_lag": (("extra_lag",), 1.5e-3), "command_delay": (("delay",), 1.5e-3),
}  # fmt: skip
"""Fields by which a look-alike is sized to stand for its twin, and a moderate size."""


def look_alike_of(effect: str) -> str | None:
    """The name that the set ``twins`` pairs with an effect."""
    for pair in LOOK_ALIKE:
        if effect in pair.names:
            return pair.names[1 - pair.names.index(effect)]
    return None


def twins_of(effect: str) -> frozenset[str]:
    """The effect and what may stand for it."""
    return frozenset({effect}).union(*(pair for pair in TWINS if effect in pair))
