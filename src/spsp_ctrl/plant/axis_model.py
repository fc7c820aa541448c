"""The model file of a single axis (``kind: axis``): actuator, moving mass, controller, effects; with the calls that simulate it.

Two forms. A full one has the actuator of a platform and a load behind an elastic screw. A bare one has ``force_per_command`` in place of the
motor's data: a rigid mass, moved by a force that is proportional to the command (whatever its unit: A or V).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from spsp_ctrl.config.loader import ConfigError, ConfigProblem, Loaded, load_yaml_model
from spsp_ctrl.config.scenario import Strict
from spsp_ctrl.config.units import UNITS
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, N_OUT, axis_read, axis_rollout, axis_windows, driven_load, feedback, rest_state
from spsp_ctrl.plant.axis_controller import MAX_SPAN
from spsp_ctrl.plant.effects import BY_NAME, EFFECTS, Hypothesis, Parameter
from spsp_ctrl.plant.effects.guide_slope import ruler_error
from spsp_ctrl.plant.effects.resolver_error import eccentric
from spsp_ctrl.plant.layout import AXIS_BASE, AXIS_PARAMETERS, GLOBAL_BASE, LOAD_BASE, LOAD_EFFECTS, N_LOAD_MODEL, N_LOAD_STATE, A, G, L, X, Y
from spsp_ctrl.plant.model import MODEL_SCHEMA, Location, Quantity, effect_keys, key, nearest, wrong_quantity

SUBSTEP_S = 100e-6
"""Integration step of a full axis, as of the platform."""
RIGID_SUBSTEP_S = 250e-6
"""The same where nothing is elastic: the shortest time is that of the presliding."""
FORCE = Parameter("force_per_command_n_v", "N/V", 1e-3, 1e6, "force on the load per unit of command")
RIG_KEYS = ("temperature_reference_c", "stop_stiffness_n_m", "stop_damping_n_s_m")
BARE_KEYS = ("screw_lead_m", "gear_ratio", "current_lag_s", "current_limit_a", "resolver_counts")
BARE_DEFAULTS = {
    A.resistance_ohm: 0.0, A.inductance_h: 1e-9, A.bus_voltage_v: 1e9, A.rotor_inertia_kg_m2: 0.0, A.current_lag_s: 5e-5, A.current_limit_a: 1e9,
    A.screw_lead_m: 2.0 * pi, A.gear_ratio: 1.0, A.axial_stiffness_n_m: 1e12, A.rod_min_m: -1e9, A.rod_max_m: 1e9, G.temperature_reference_c: 20.0,
}  # fmt: skip
"""What a bare axis is made of beyond its file: no winding, no rotor, no stops."""


class AxisEffect(Strict):
    """One effect that acts."""

    effect: str
    """Standard name."""
    parameters: dict[str, Quantity]
    """Its parameters; what is not given is zero."""


class AxisController(Strict):
    """Who commands the axis, as far as that is known."""

    kind: Literal["none", "recorded", "cascade"] = "none"
    """``cascade`` is the loop of docs/log-format.md, replayed in a simulation; otherwise the recorded command acts."""
    feedback: Literal["load", "resolver"] = "load"
    """What the cascade reads."""
    kp_1_s: float = Field(default=0.0, ge=0.0)
    """Position gain."""
    kv: float = Field(default=0.0, ge=0.0)
    """Speed gain in A s/m, or V s/m for a drive commanded in volts."""
    feedforward: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of the reference rate that is fed forward."""
    limit: float = Field(default=1e9, gt=0.0)
    """Limit of the command in A (V)."""
    rate_span: int = Field(default=1, ge=1, le=MAX_SPAN)
    """Cycles over which the speed is taken."""


class AxisFile(Strict):
    """A single axis as written in a file."""

    schema_: Literal["spsp-ctrl/model/1"] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=80)
    """Name of the model."""
    kind: Literal["axis"]
    """What is modelled."""
    rate_hz: float = Field(gt=0.0, le=20000.0)
    """Rate of controller and log."""
    actuator: dict[str, Quantity]
    """The drive: every key of a platform's actuator, or the short form with `force_per_command`."""
    axis: dict[str, Quantity]
    """Moving mass, ruler, hard stops, reference temperature."""
    controller: AxisController = AxisController()
    """Who commands."""
    effects: tuple[AxisEffect, ...] = ()
    """What acts beside the ideal axis."""

    @property
    def bare(self) -> bool:
        """A rigid mass, moved by a force."""
        return "force_per_command" in self.actuator


_INDEX: dict[str, int] = (
    {q.name: i for i, q in enumerate(AXIS_PARAMETERS)}
    | {name: int(getattr(G, name)) for name in RIG_KEYS}
    | {q.name: int(getattr(L, q.name)) for q in LOAD_BASE + LOAD_EFFECTS}
    | {name: int(getattr(L, name)) for name in ("kp_1_s", "kv", "feedforward", "limit")}
)
_RIG = tuple(q for q in GLOBAL_BASE if q.name in RIG_KEYS)
ACTUATOR_KEYS = {key(q): q for q in AXIS_BASE}
BARE_ACTUATOR_KEYS = {"force_per_command": FORCE} | {key(q): q for q in AXIS_BASE if q.name in BARE_KEYS}
AXIS_KEYS = {key(q): q for q in LOAD_BASE + _RIG}
AXIS_EFFECTS = tuple(effect for effect in EFFECTS if effect.kind != "platform" and (effect.per_axis or effect.kind == "axis"))
"""Effects that a single axis can have."""
_OPTIONAL = {"ruler_step", "ruler_noise"}
NOT_RIGID = ("backlash", "axial_compliance", "voltage_saturation")
"""Effects without meaning on a rigid mass that is moved by a force."""


@dataclass(frozen=True, slots=True)
class AxisModel:
    """A checked axis."""

    file: AxisFile
    path: Path
    substep_s: float = 0.0
    """Integration step; 0 takes that of the form."""

    @property
    def period_s(self) -> float:
        """Time of a cycle."""
        return 1.0 / self.file.rate_hz

    @property
    def substeps(self) -> int:
        """Integration steps in a cycle."""
        step = self.substep_s or (RIGID_SUBSTEP_S if self.file.bare else SUBSTEP_S)
        return max(1, round(self.period_s / step))

    @property
    def travel_per_rad(self) -> float:
        """Travel of the load in m per rad of the motor: N at the load times it is N m at the motor."""
        p = self.parameters()
        return float(p[A.screw_lead_m] / (2.0 * pi * p[A.gear_ratio]))

    def parameters(self) -> Array:
        """The flat parameter array, in SI (``layout.A`` of the first actuator, ``layout.G``, ``layout.L``)."""
        file = self.file
        p = np.zeros(N_LOAD_MODEL)
        if file.bare:
            for index, value in BARE_DEFAULTS.items():
                p[index] = value
            p[L.rigid] = 1.0
        for _, keys, name, quantity in _entries(file):
            parameter = keys[name]
            if parameter is not FORCE:
                p[_INDEX[parameter.name]] = quantity.value * UNITS[quantity.unit][1]
        if file.bare:
            force = file.actuator["force_per_command"]
            p[A.torque_constant_nm_a] = force.value * UNITS[force.unit][1] * p[A.screw_lead_m] / (2.0 * pi * p[A.gear_ratio])
        c = file.controller
        p[L.loop] = 0.0 if c.kind != "cascade" else 1.0 if c.feedback == "load" else 2.0
        p[L.kp_1_s], p[L.kv], p[L.feedforward], p[L.limit], p[L.rate_span] = c.kp_1_s, c.kv, c.feedforward, c.limit, c.rate_span
        return p

    @staticmethod
    def index(name: str) -> int:
        """Place of a parameter (by its name in ``layout``) in the flat array. Raises ``KeyError``."""
        return _INDEX[name]

    def hypotheses(self) -> dict[str, Hypothesis]:
        """Names that a diagnosis of this axis may give: a rigid one has nothing elastic, no play and no winding."""
        found = {h.name: h for effect in AXIS_EFFECTS for h in effect.hypotheses}
        return {name: h for name, h in found.items() if not (self.file.bare and name in NOT_RIGID)}

    def without(self, *names: str) -> AxisModel:
        """The same axis without the named effects."""
        for name in names:
            if name not in BY_NAME:
                raise KeyError(f"no effect {name!r}; known: {', '.join(e.name for e in AXIS_EFFECTS)}")
        kept = tuple(entry for entry in self.file.effects if entry.effect not in names)
        return AxisModel(self.file.model_copy(update={"effects": kept}), self.path, self.substep_s)

    def simulate(self, p: Array, u: Array, x0: Array | None = None, first: int = 0) -> Array:
        """Readings at every SYNC of ``u`` (``axis.OUT``), from ``x0`` or from rest at the first reference."""
        x = rest_state(p, u, float(u[0, IN.reference_m])) if x0 is None else x0.copy()
        y = np.zeros((len(u), N_OUT))
        axis_rollout(x, p.copy(), u, y, np.zeros((0, N_LOAD_STATE)), first, self.substeps, self.period_s)
        return y

    def trace(self, p: Array, u: Array, x0: Array | None = None, first: int = 0) -> tuple[Array, Array]:
        """The same, and the state at every SYNC."""
        x = rest_state(p, u, float(u[0, IN.reference_m])) if x0 is None else x0.copy()
        y, states = np.zeros((len(u), N_OUT)), np.zeros((len(u), N_LOAD_STATE))
        axis_rollout(x, p.copy(), u, y, states, first, self.substeps, self.period_s)
        return y, states

    def windows(self, p: Array, u: Array, starts: Array, at: NDArray[np.int64]) -> Array:
        """Multiple shooting: rows ``at[i]`` to ``at[i + 1]`` from state ``starts[i]``, the last window until the end."""
        y = np.zeros((len(u), N_OUT))
        axis_windows(starts, np.asarray(at, np.int64), p.copy(), u, y, self.substeps, self.period_s)
        return y

    def start_states(
        self,
        p: Array,
        u: Array,
        at: NDArray[np.int64],
        motor_rad: Array,
        motor_rad_s: Array,
        current_a: Array,
        load_m: Array | None = None,
        load_m_s: Array | None = None,
    ) -> Array:
        """States at rows ``at`` from readings there (smoothed), one row for each; errors of the sensors that ``p`` holds are taken out.

        Without ``load_m`` the load stands where the model lets the motor drive it: no offset between the two zeros can then wind up the screw.
        Bristles stand where a steady motion keeps them; the commands before are those of ``u``.
        """
        at = np.asarray(at, np.int64)
        x = np.zeros((len(at), N_LOAD_STATE))
        error = [
            eccentric(0.0, angle, p[A.res_first_rad], p[A.res_first_phase_rad], p[A.res_second_rad], p[A.res_second_phase_rad]) for angle in motor_rad
        ]
        x[:, X.angle], x[:, X.speed], x[:, X.current] = np.asarray(motor_rad) - error, motor_rad_s, current_a
        x[:, X.screw_temperature] = u[at, IN.screw_c] + p[L.thermal_lag_s] * u[at, IN.screw_c_s]
        for i, row in enumerate(x):
            row[Y.travel], row[Y.rate] = driven_load(row, p, float(u[at[i], IN.load_force_n]))
        if load_m is not None and p[L.rigid] == 0.0:
            x[:, Y.travel] = [value - ruler_error(value, p[L.guide_slope], p[L.guide_curve_1_m]) for value in load_m]
            if load_m_s is not None:
                x[:, Y.rate] = load_m_s
        rate = x[:, Y.rate]
        for bristle, speed, level, stiffness in (
            (X.bristle, x[:, X.speed], p[A.mf_coulomb_nm], p[A.mf_bristle_nm_rad]),
            (Y.guide, rate, p[L.guide_coulomb_n], p[L.guide_bristle_n_m]),
        ):
            x[:, bristle] = np.sign(speed) * level / stiffness if stiffness > 0.0 else 0.0
        before = np.maximum(at[:, None] - np.arange(1, X.past_speed_0 - X.past_current_0 + 1), 0)
        x[:, X.past_current_0 : X.past_speed_0] = u[before, IN.command_a]
        x[:, X.past_speed_0 : X.past_speed_0 + before.shape[1]] = u[before, IN.command_rad_s]
        x[:, X.lag_current], x[:, X.lag_speed] = u[before[:, 0], IN.command_a], u[before[:, 0], IN.command_rad_s]
        y = np.zeros(N_OUT)
        for i, row in enumerate(x):
            row[Y.held_resolver], row[Y.held_ruler] = motor_rad[i], row[Y.travel]
            axis_read(row, p, int(at[i]), y)
            row[Y.position_1 : Y.position_1 + MAX_SPAN] = feedback(p, y) - rate[i] * self.period_s * np.arange(1, MAX_SPAN + 1)
        return x


def axis_model(values: Mapping[str, Any], path: Path = Path("-")) -> AxisModel:
    """A model from the content of a file. Raises ``ValueError`` for what a file would be refused for."""
    model = AxisModel(AxisFile.model_validate(values), path)
    for place, text in check(model.file):
        raise ValueError(f"{text} ({'.'.join(map(str, place))})")
    return model


def _entries(file: AxisFile) -> Iterator[tuple[Location, dict[str, Parameter], str, Quantity]]:
    keys = BARE_ACTUATOR_KEYS if file.bare else ACTUATOR_KEYS
    for name, quantity in file.actuator.items():
        yield ("actuator", name), keys, name, quantity
    for name, quantity in file.axis.items():
        yield ("axis", name), AXIS_KEYS, name, quantity
    for i, entry in enumerate(file.effects):
        effect = BY_NAME.get(entry.effect)
        if effect in AXIS_EFFECTS:
            for name, quantity in entry.parameters.items():
                yield ("effects", i, "parameters", name), effect_keys(effect), name, quantity


def check(file: AxisFile) -> Iterator[tuple[Location, str]]:
    """Everything that is wrong with a model beyond its form: place and text."""
    known = [effect.name for effect in AXIS_EFFECTS]
    for i, entry in enumerate(file.effects):
        if entry.effect not in known:
            what = "acts on a platform, not on a single axis" if entry.effect in BY_NAME else "is unknown" + nearest(entry.effect, known)
            yield ("effects", i, "effect"), f"effect {entry.effect!r} {what}"
        elif file.bare and entry.effect in NOT_RIGID:
            yield ("effects", i, "effect"), f"effect {entry.effect!r} has no meaning on a rigid mass that is moved by a force"
    seen: dict[str, Location] = {}
    for place, keys, name, quantity in _entries(file):
        if name not in keys:
            yield place, f"unknown parameter {name!r}" + nearest(name, list(keys))
            continue
        parameter = keys[name]
        wrong = wrong_quantity(parameter, name, quantity)
        if wrong is not None:
            yield (*place, wrong[0]), wrong[1]
            if wrong[0] == "unit":
                continue
        if place[0] == "effects" and parameter.name in seen:
            yield place, f"{name}: given twice (also in entry {seen[parameter.name][1]} of effects)"
        seen[parameter.name] = place
    needed = {"actuator": {"force_per_command": FORCE}, "axis": {"moving_mass": AXIS_KEYS["moving_mass"]}}
    if not file.bare:
        needed = {"actuator": ACTUATOR_KEYS, "axis": {name: q for name, q in AXIS_KEYS.items() if name not in _OPTIONAL}}
    for section, wanted in needed.items():
        for missing in wanted.keys() - getattr(file, section).keys():
            yield (section,), f"parameter {missing!r} is missing: {wanted[missing].doc} [{wanted[missing].unit}]"
    if file.controller.kind == "cascade" and not (file.controller.kp_1_s > 0.0 and file.controller.kv > 0.0):
        yield ("controller",), "a cascade needs kp_1_s and kv"


def load_axis_model(path: Path) -> AxisModel:
    """Read and check the model file of an axis. Raises ``ConfigError`` with one line per problem."""
    loaded: Loaded[AxisFile] = load_yaml_model(path, AxisFile, MODEL_SCHEMA)
    problems = []
    for place, text in check(loaded.model):
        line, column = loaded.locate(place)
        problems.append(ConfigProblem(path=path, line=line, column=column, message=f"{text} ({'.'.join(map(str, place))})"))
    if problems:
        raise ConfigError(tuple(sorted(problems, key=lambda problem: (problem.line, problem.column, problem.message))))
    return AxisModel(loaded.model, path)
