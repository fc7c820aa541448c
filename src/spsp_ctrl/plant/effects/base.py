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


def stage(function: F) -> F:
    """Mark a stage function: compiled where numba is present, plain Python otherwise."""
    return compiled(function)
