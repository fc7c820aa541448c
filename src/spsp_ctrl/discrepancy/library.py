"""The names that a diagnosis of an axis may give, from the effect registry, as variables to fit and starts to try."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from spsp_ctrl.discrepancy.variables import Variable, pair, place, values_of
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis_model import AXIS_EFFECTS, AxisModel
from spsp_ctrl.plant.effects import Effect, Free, Hypothesis
from spsp_ctrl.plant.layout import A

LIMITS = ("voltage_limit_v", "current_ceiling_a", "speed_ceiling_rad_s")
"""Sizes that act by being small: absent at zero, strongest near it."""
STIFFNESS = "bristle_nm_rad"
"""A friction level that the model did not have needs a presliding stiffness; nobody knows it, so it is fitted with the level."""
MODE = "mode_frequency_hz"
COULOMB, STATIC, COGGING = "mf_coulomb_nm", "mf_static_nm", "cogging_nm"
WHERE = {"drive": "axis", "transmission": "axis", "mechanism": "axis", "sensors": "axis", "thermal": "axis"}


@dataclass(frozen=True)
class Group:
    """Sizes to start from: a set of values, and steps of single variables from there of which a screening takes the best combination."""

    values: Array
    steps: tuple[tuple[int, float], ...]
    """Variable and size of the step; none where the values themselves are the start."""


@dataclass(frozen=True)
class Candidate:
    """One name with its variables, and sizes to start from."""

    name: str
    effect: Effect
    hypothesis: Hypothesis
    variables: tuple[Variable, ...]
    base: Array
    """Parameters on which the values are placed."""
    groups: tuple[Group, ...]

    def at(self, values: Array) -> Array:
        """Parameters with the variables at ``values``, kept inside their bounds."""
        low, high = np.array([v.low for v in self.variables]), np.array([v.high for v in self.variables])
        return place(self.base, self.variables, np.clip(values, low, high))


def _index(model: AxisModel, name: str) -> int:
    return model.index(name)


def hypotheses(model: AxisModel, p: Array) -> Iterator[tuple[Effect, Hypothesis]]:
    """Names that a simulation of this model can judge."""
    for effect in AXIS_EFFECTS:
        for h in effect.hypotheses:
            if h.random or (h.name == "stribeck_friction" and p[_index(model, COULOMB)] == 0.0):
                continue  # what friction at rest has more than in motion needs a friction in motion
            if model.file.bare and ("ruler" in h.channels[:1] or "drive" in h.channels[:1] or h.name in _NOT_BARE):
                continue
            yield effect, h


_NOT_BARE = ("resolver_eccentricity", "resolver_quantisation", "motor_constant_error", "voltage_saturation", "velocity_saturation")
"""A rigid axis with one sensor in a known loop has no second channel in which these would show, or no winding."""


def _size_of(f: Free) -> float:
    return min(abs(s) for s in f.starts if s != 0.0)


def candidate(
    model: AxisModel,
    effect: Effect,
    h: Hypothesis,
    p: Array,
    reach: dict[str, float],
    orders: Sequence[float],
    lines: Sequence[float] = (),
    calibrated: bool = False,
) -> Candidate:
    """Variables and starts of a name at parameters ``p``. ``reach`` gives the largest speed, current, voltage of the records,
    ``orders`` and ``lines`` where what is left has its strongest orders of the motor turn and its strongest frequencies.

    ``calibrated``: no number of the model is free beside the name; a friction level then moves in motion and at rest alike.
    """
    base = p.copy()
    companions: list[Variable] = []
    for name, value in h.along:
        if base[_index(model, name)] == 0.0:
            base[_index(model, name)] = value
            if name.endswith(STIFFNESS):
                companions.append(Variable(name, _index(model, name), 0.05 * value, 20.0 * value, 0.1 * value, nuisance=True))
    variables: list[Variable] = []
    linear: list[list[tuple[str, float]]] = []  # variables of which each is a column of its own
    shapes: list[list[tuple[Variable, float]]] = []  # tried one by one
    skip = set()
    frees = {f.name: f for f in h.free}
    for f in h.free:
        if f.name in skip:
            continue
        i = _index(model, f.name)
        phase = next((n for n in frees if n.endswith("phase_rad") and n.startswith(f.name.rsplit("_", 1)[0])), None)
        if phase is not None and f.name != phase and not f.name.endswith("order"):
            skip.add(phase)
            size = _size_of(f)
            variables += pair(f.name, i, _index(model, phase), f.high, 0.3 * size, p, nuisance=False)
            linear.append([(f"{f.name}.cos", size), (f"{f.name}.sin", size)])
        elif f.name in LIMITS:
            top = reach.get(f.name, f.starts[0])
            v = Variable(f.name, i, f.low, f.high, max(1e-3 * top, 1e-4))
            variables.append(v)
            shapes.append([(v, min(max(share * top, f.low), f.high)) for share in (1.15, 1.06, 1.0, 0.95, 0.88, 0.8, 0.7, 0.6)])
        elif f.name.endswith("order"):
            v = Variable(f.name, i, f.low, f.high, 1e-3)
            variables.append(v)
            present = (float(base[i]),) if base[i] != 0.0 else ()
            shapes.append([(v, o) for o in dict.fromkeys((*present, *orders, 1.0, f.starts[0])) if f.low <= o <= f.high])
        elif f.name == MODE:
            v = Variable(f.name, i, f.low, f.high, 0.01 * f.starts[0])
            variables.append(v)
            shapes.append([(v, s) for s in (*(x for x in lines if f.low <= x <= f.high), *f.starts)])
        elif f.low > 0.0 or "damping" in f.name:
            now = float(base[i])
            v = Variable(f.name, i, f.low, f.high, 0.02 * (now or f.starts[0]))
            variables.append(v)
            near = (now,) if "damping" in f.name else (0.6 * now, 0.9 * now, 1.15 * now, 1.6 * now)
            far = () if now and "damping" in f.name else f.starts
            shapes.append([(v, s) for s in (*(near if now else ()), *far) if f.low <= s <= f.high])
        else:
            static = _index(model, STATIC) if calibrated and f.name == COULOMB and base[_index(model, STATIC)] > 0.0 else -1
            low = -f.high if f.name == COGGING and base[i] < 0.0 else f.low
            v = Variable(f.name, i, low, f.high, 0.3 * _size_of(f), nuisance=f.nuisance, along=static)
            variables.append(v)
            linear.append([(f.name, s) for s in f.starts])
    variables += companions
    return Candidate(h.name, effect, h, tuple(variables), base, tuple(_groups(base, variables, linear, shapes)))


def _groups(
    base: Array, variables: Sequence[Variable], linear: list[list[tuple[str, float]]], shapes: list[list[tuple[Variable, float]]]
) -> Iterator[Group]:
    at = {v.name: k for k, v in enumerate(variables)}
    for combination in product(*shapes):
        shaped = base.copy()
        for v, value in combination:
            shaped[v.index] = value
        zero = values_of(shaped, variables)
        if not linear:
            yield Group(zero, ())
        elif len(linear) == 1 and "." not in linear[0][0][0]:
            for name, size in linear[0]:  # one size of a kind that may be non-smooth: each start on its own
                yield Group(zero, ((at[name], size),))
        else:
            yield Group(zero, tuple((at[name], size) for entries in linear for name, size in (entries if "." in entries[0][0] else entries[:1])))


NOMINAL_SIGMA = 0.04
"""Tolerance of a number of the model as designed, relative, unless a commissioning log says better."""
_REFIT = (
    "rotor_inertia_kg_m2", "torque_constant_nm_a", "axial_stiffness_n_m", "mf_coulomb_nm", "mf_viscous_nm_s", "mf_load_factor", "mf_static_nm",
    "mf_bristle_nm_rad", "gap_m", "cogging_nm", "guide_coulomb_n", "screw_expansion_1_k", "current_lag_s",
)  # fmt: skip
_PAIRS = (
    ("lead_first_m", "lead_first_phase_rad"), ("lead_second_m", "lead_second_phase_rad"), ("res_first_rad", "res_first_phase_rad"),
    ("res_second_rad", "res_second_phase_rad"),
)  # fmt: skip
_ZEROS = (("lead_slope", 2e-5, 1e-5), ("zero_offset_m", 1e-6, 1e-6))
"""Numbers that a honest recalibration may move from zero: name, standard deviation, step."""


def nominal_variables(model: AxisModel, p: Array, reference: Array, sigma: float) -> tuple[Variable, ...]:
    """What a recalibration may change, each with its tolerance around ``reference``."""
    made: list[Variable] = []
    names = ("moving_mass_kg",) if model.file.bare else _REFIT
    for name in names:
        i = model.index(name)
        value = float(reference[i])
        if value != 0.0:
            low = -2.0 * abs(value) if name == "cogging_nm" else 0.5 * value
            # where the rotor stands at the zero of the resolver is not on a drawing: cogging may have either sign
            width = 1.0 if name == "cogging_nm" and sigma >= NOMINAL_SIGMA else sigma
            made.append(Variable(name, i, low, 2.0 * abs(value), 0.02 * abs(value), mean=value, sigma=width * abs(value)))
    if model.file.bare:
        return tuple(made)
    for name, phase in _PAIRS:
        size = float(reference[model.index(name)])
        if size > 0.0:
            tolerance = sigma * size
            made += [
                replace(v, mean=v.get(reference), sigma=tolerance)
                for v in pair(name, model.index(name), model.index(phase), 10.0 * size, 0.2 * size, reference)
            ]
    for name, tolerance, step in _ZEROS:
        i = model.index(name)
        value = float(reference[i])
        made.append(Variable(name, i, value - 1e-3, value + 1e-3, step, mean=value, sigma=tolerance * sigma / NOMINAL_SIGMA))
    return tuple(made)


def reaches(model: AxisModel, p: Array, current: Array, speed: Array) -> dict[str, float]:
    """The largest current, speed and winding voltage: where a limit would have to lie to be felt."""
    voltage = np.abs(p[A.resistance_ohm] * current + p[A.torque_constant_nm_a] * speed)
    return {
        "current_ceiling_a": float(np.quantile(np.abs(current), 0.9995)),
        "speed_ceiling_rad_s": float(np.quantile(np.abs(speed), 0.9995)),
        "voltage_limit_v": float(np.quantile(voltage, 0.9995)),
    }
