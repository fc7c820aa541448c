"""Tolerance file and transmission file: what is made how exactly. Every number has a unit beside it."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from spsp_ctrl.config.error_sources import ERROR_SOURCES
from spsp_ctrl.config.scenario import Strict
from spsp_ctrl.config.units import UNITS, spellings

TOLERANCES_SCHEMA = "spsp-ctrl/tolerances/1"
TRANSMISSION_SCHEMA = "spsp-ctrl/transmission/1"


def check_unit(unit: str, si_unit: str) -> None:
    """Raises ``ValueError`` for a unit of another dimension, naming those that fit."""
    if UNITS.get(unit, ("", 0.0))[0] != si_unit:
        raise ValueError(f"unit {unit!r} does not fit here; use one of: {', '.join(spellings(si_unit))}")


class Quantity(Strict):
    """A number with its unit."""

    value: float
    unit: str
    source: str = ""
    """Where it comes from."""

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, given: Any) -> Any:
        if isinstance(given, int | float | str):
            raise ValueError(f"{given!r} has no unit; write it as {{value: {given}, unit: ...}}")
        return given

    @property
    def si(self) -> float:
        """Value in SI units."""
        return self.value * UNITS[self.unit][1]


def _of(si_unit: str, low: float = 0.0) -> Callable[[Quantity], Quantity]:
    def check(quantity: Quantity) -> Quantity:
        check_unit(quantity.unit, si_unit)
        if quantity.value < low:
            raise ValueError(f"{quantity.value:g} {quantity.unit} is out of range: it must not be negative")
        return quantity

    return check


Length = Annotated[Quantity, AfterValidator(_of("m"))]
Angle = Annotated[Quantity, AfterValidator(_of("rad"))]
Expansion = Annotated[Quantity, AfterValidator(_of("1/K"))]
Slope = Annotated[Quantity, AfterValidator(_of("m/m"))]
Warming = Annotated[Quantity, AfterValidator(_of("K"))]


class Materials(Strict):
    """How the parts grow with temperature, Eq (13)."""

    screw_length: Length | None = None
    """Length of screw and rod that grows; the rod at level when absent."""
    screw_expansion: Expansion = Quantity(value=11.5, unit="ppm/K")
    column_expansion: Expansion = Quantity(value=11.5, unit="ppm/K")
    frame_expansion: Expansion = Quantity(value=11.5, unit="ppm/K")


class ToleranceEntry(Strict):
    """One error and the limit that it keeps: it lies between -limit and +limit."""

    source: str
    limit: float = Field(gt=0.0)
    unit: str
    min: float | None = Field(default=None, gt=0.0)
    """Tightest limit that can be made, in ``unit``; for the allocation."""
    max: float | None = Field(default=None, gt=0.0)
    """Loosest limit that is sensible, in ``unit``; for the allocation."""
    fixed: bool = False
    """The allocation leaves this limit alone."""
    cost: float = Field(default=1.0, gt=0.0, le=1e6)
    """Relative cost of holding 10 um (0.1 mrad, 1 K); it falls as 1 / limit."""
    group: str = ""
    """Entries of one group get one common limit from the allocation."""
    distribution: Literal["uniform", "normal"] | None = None
    sigmas: float = Field(default=3.0, ge=1.0, le=10.0)
    """With a normal distribution: the limit is this many standard deviations."""
    varies: bool = False
    """Differs from pose to pose (lead error, play), so that zeroing at level does not remove it."""

    @model_validator(mode="before")
    @classmethod
    def _unit_given(cls, given: Any) -> Any:
        if isinstance(given, dict) and "limit" in given and "unit" not in given:
            name = given.get("source", "?")
            raise ValueError(f"limit {given['limit']} of {name!r} has no unit; add for instance `unit: mm`")
        return given

    @field_validator("source")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in ERROR_SOURCES:
            near = difflib.get_close_matches(name, ERROR_SOURCES, n=1, cutoff=0.4)
            raise ValueError(
                f"unknown error source {name!r}"
                + (f"; did you mean {near[0]!r}?" if near else "")
                + f" All are: {', '.join(ERROR_SOURCES)}"
            )
        return name

    @field_validator("unit")
    @classmethod
    def _fits(cls, unit: str, info: ValidationInfo) -> str:
        source = ERROR_SOURCES.get(info.data.get("source", ""))
        if source is not None:
            check_unit(unit, source.si_unit)
        return unit

    @model_validator(mode="after")
    def _ordered(self) -> ToleranceEntry:
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min ({self.min:g}) of {self.source!r} must not exceed max ({self.max:g})")
        return self

    def si(self, value: float) -> float:
        """A value of this entry in SI units."""
        return value * UNITS[self.unit][1]


class ToleranceFile(Strict):
    """A set of tolerances."""

    schema_: Literal["spsp-ctrl/tolerances/1"] = Field(alias="schema")
    name: str = Field(default="", max_length=80)
    requirement: Angle | None = None
    """Largest pitch or roll error allowed anywhere in the workspace."""
    materials: Materials = Materials()
    tolerances: tuple[ToleranceEntry, ...]

    @field_validator("tolerances")
    @classmethod
    def _once(cls, entries: tuple[ToleranceEntry, ...]) -> tuple[ToleranceEntry, ...]:
        if not entries:
            raise ValueError("no tolerances; add for instance `- {source: dl1, limit: 70, unit: um}`")
        twice = [name for name, count in Counter(e.source for e in entries).items() if count > 1]
        if twice:
            raise ValueError(f"error source {twice[0]!r} is listed twice; delete one")
        units: dict[str, set[str]] = {}
        for entry in entries:
            if entry.group:
                units.setdefault(entry.group, set()).add(ERROR_SOURCES[entry.source].si_unit)
        mixed = [group for group, kinds in units.items() if len(kinds) > 1]
        if mixed:
            raise ValueError(f"group {mixed[0]!r} mixes lengths, angles or temperatures; give them groups of their own")
        return entries


class GearStage(Strict):
    """One gear pair between motor and screw."""

    name: str = Field(min_length=1, max_length=40)
    normal_backlash: Length
    """J_bn: between the flanks, along the line of action."""
    pressure_angle: Angle = Quantity(value=20.0, unit="deg")
    pitch_diameter: Length
    """Of the driven gear."""
    turns_per_screw_turn: float = Field(default=1.0, gt=0.0, le=1000.0)
    """Of the driven gear; 1 for the gear on the screw."""

    @field_validator("pressure_angle")
    @classmethod
    def _below(cls, angle: Quantity) -> Quantity:
        if angle.si > 0.785:
            raise ValueError(f"a pressure angle of {angle.value:g} {angle.unit} is out of range: it must be below 45 deg")
        return angle


class TransmissionFile(Strict):
    """What lies between the motor's angle and the rod's length, for both actuators."""

    schema_: Literal["spsp-ctrl/transmission/1"] = Field(alias="schema")
    name: str = Field(default="", max_length=80)
    rod_limit: Length | None = None
    """What the rod length may be wrong by."""
    screw_lead: Length
    gear_ratio: float = Field(gt=0.0, le=1000.0)
    """Motor turns per screw turn."""
    resolver_error: Angle = Quantity(value=0.0, unit="arcmin")
    """Of the resolver on the motor."""
    gears: tuple[GearStage, ...] = ()
    lead_error: Slope = Quantity(value=0.0, unit="um/mm")
    """Rod error per travel from level."""
    periodic_lead_error: Length = Quantity(value=0.0, unit="um")
    """Amplitude over one turn of the screw."""
    screw_clearance: Length = Quantity(value=0.0, unit="um")
    """Axial play of the nut, from flank to flank."""
    screw_length: Length | None = None
    """l0 of Eq (13); the rod at level when absent."""
    screw_expansion: Expansion = Quantity(value=11.5, unit="ppm/K")
    screw_warming: Warming = Quantity(value=0.0, unit="K")
    """Beyond what a thermal compensation removes."""
