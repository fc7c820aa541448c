"""What an effect is: one physical thing with a standard name, its parameters, and the stage in which it acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from spsp_ctrl.plant.compile import compiled

Stage = Literal["drive", "transmission", "mechanism", "azimuth", "thermal", "sensors"]
F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of the plant.

    ``unit`` is the SI unit in which the kernel uses it; a model file may give any unit of the same dimension. Values outside
    ``low``..``high`` (SI) are refused.
    """

    name: str
    unit: str
    low: float
    high: float
    doc: str


@dataclass(frozen=True, slots=True)
class Free:
    """A parameter that a hypothesis lets free, in SI."""

    name: str
    low: float
    high: float
    starts: tuple[float, ...]
    """Finite sizes to start a fit from, several: at zero most effects here have no gradient."""
    nuisance: bool = False
    """It belongs to the session (a phase, a zero), not to the machine: fitted anew for each recording."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One name that a diagnosis may give: what it frees, and where it would show."""

    name: str
    free: tuple[Free, ...]
    channels: tuple[str, ...]
    """``current``, ``resolver``, ``ruler``, ``imu``: where it shows, the clearest first."""
    regimes: tuple[str, ...]
    """``reversal``, ``speed``, ``direction``, ``position``, ``screw_phase``, ``motor_phase``, ``load``, ``temperature``, ``saturation``,
    ``slope`` (of the command), ``always``."""
    source: str
    """Where its form comes from."""
    twins: tuple[str, ...] = ()
    """Names that look alike on one axis, known in advance."""
    along: tuple[tuple[str, float], ...] = ()
    """Values set with it where the parameter is still zero (a friction level needs a presliding stiffness)."""
    sentinel: bool = False
    """It cannot exist: if a diagnosis names it, the diagnosis is invalid."""
    random: bool = False
    """It changes the scatter of a channel, not its mean: seen in the floor, not by a simulation."""


Kind = Literal["both", "platform", "axis"]


@dataclass(frozen=True, slots=True)
class Effect:
    """A named imperfection. Absent from a model file, all its parameters are zero and it does nothing."""

    name: str
    stage: Stage
    doc: str
    parameters: tuple[Parameter, ...]
    prefix: str = ""
    """Common start of the parameter names, left out in a model file."""
    per_axis: bool = True
    """True: the parameters exist once for each actuator; False: once for the rig."""
    kind: Kind = "both"
    """Which kind of model may hold it."""
    hypotheses: tuple[Hypothesis, ...] = ()
    """Names under which a diagnosis may find it."""


def stage(function: F) -> F:
    """Mark a stage function: compiled where numba is present, plain Python otherwise."""
    return compiled(function)
