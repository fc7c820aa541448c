"""Scenario file: what happens in a session (base motion, reference, load, temperature, duration, acceptance rows)."""

from __future__ import annotations

from math import isclose
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from spsp_ctrl.config.acceptance import Acceptance as Acceptance
from spsp_ctrl.config.acceptance import AcceptanceRows, Law
from spsp_ctrl.config.drawn import Drawn
from spsp_ctrl.config.injection import Dropout as Dropout
from spsp_ctrl.config.injection import Injection
from spsp_ctrl.config.motion import BaseMotion as BaseMotion
from spsp_ctrl.config.motion import Heading as Heading
from spsp_ctrl.config.motion import ReferencePlan as ReferencePlan
from spsp_ctrl.config.motion import Roughness as Roughness
from spsp_ctrl.config.motion import Sea as Sea
from spsp_ctrl.config.motion import Sine as Sine
from spsp_ctrl.config.motion import Spectrum as Spectrum
from spsp_ctrl.config.motion import Staircase as Staircase
from spsp_ctrl.config.strict import Strict as Strict

SCENARIO_SCHEMA = "spsp-ctrl/scenario/1"


class Load(Strict):
    """Load on the moving platform."""

    mass_kg: float = Field(default=7.0, ge=0.0, le=20.0)
    """Mass on the moving platform; its place is in the model file."""


class Temperature(Strict):
    """Surroundings and what was warm at the start."""

    ambient_c: float = Field(default=20.0, ge=-40.0, le=85.0)
    """Surroundings, and everything at the start but the screws."""
    start_c: float | None = Field(default=None, ge=-40.0, le=85.0)
    """Temperature of column and frame (and of the screws without ``screw_c``) at the start; ambient when absent."""
    step_at_s: float = Field(default=0.0, ge=0.0, le=86_400.0)
    """Until then the surroundings are at ``start_c``."""
    sensor_error_c: float = Field(default=0.0, ge=-20.0, le=20.0)
    """Constant error of the temperature sensors."""
    screw_c: float | None = Field(default=None, ge=-40.0, le=120.0)
    """Screw temperature at the start; ambient when absent."""
    hold: bool = False
    """Keep the screws at ``screw_c`` (a heater), instead of letting them cool."""


class Park(Strict):
    """Joint angles at the start: where the last session left the platform."""

    pitch_deg: float = Field(default=0.0, ge=-19.0, le=19.0)
    """Pitch joint."""
    roll_deg: float = Field(default=0.0, ge=-19.0, le=19.0)
    """Roll joint."""
    azimuth_deg: float = Field(default=0.0, ge=-90.0, le=90.0)
    """Azimuth joint."""


class Repeats(Strict):
    """The same motion again: run ``k`` has the seed ``first_seed + k`` and, with ``spread_phases``, other phases."""

    count: int = Field(default=1, ge=1, le=100)
    first_seed: Annotated[int, Field(ge=0, le=2**31 - 1)] | Literal["commit"] | None = None
    """The rig file's own when absent. `commit`: made from the commit of the program, so that nobody could tune on it; it is printed."""
    spread_phases: bool = False
    """Adds ``k`` times 137.5 deg to the phases of roll and ``k`` times 222.5 deg to those of pitch: never the same pair twice."""


class ModelChange(Strict):
    """A variation of one parameter of the plant model: a factor, or a value with its unit."""

    factor: float | None = None
    value: float | None = None
    unit: str = ""
    """Unit shown behind the figure."""

    @model_validator(mode="after")
    def _one(self) -> ModelChange:
        if (self.factor is None) == (self.value is None):
            raise ValueError("give either factor, or value and unit")
        if (self.value is None) != (self.unit == ""):
            raise ValueError("a value needs its unit, and a factor has none")
        return self


NAME = r"^[A-Za-z0-9][A-Za-z0-9 .,()/_+-]*$"


class Identified(Strict):
    """A figure of another variant: the mean over its runs under the same law."""

    variant: str
    """Whose runs."""
    value: str
    """Dotted path in `summary.json`."""


class Variant(Strict):
    """A named change of an experiment. Mappings are laid over mappings, everything else replaces what stood there."""

    name: str = Field(min_length=1, max_length=40, pattern=NAME)
    rig: dict[str, Any] = Field(default_factory=dict)
    """Laid over the rig file."""
    model: dict[str, ModelChange] = Field(default_factory=dict)
    """Parameters of the plant by dotted name, e.g. ``actuator.torque_constant`` or ``effects.backlash.gap``."""
    scenario: dict[str, Any] = Field(default_factory=dict)
    """Laid over this file."""
    laws: tuple[Law, ...] = ()
    repeats: int | None = Field(default=None, ge=1, le=1000)
    """Runs of this variant instead of `repeats.count`; `--repeats` does not change it."""
    drawn: Drawn = Drawn()
    """What is drawn from the seed of each run."""
    identified: dict[str, Identified] = Field(default_factory=dict)
    """Keys of the rig file, dotted, that take figures of another variant's runs; those are made first."""


class Motion(Strict):
    """A named motion: every variant is played on each of them."""

    name: str = Field(min_length=1, max_length=40, pattern=NAME)
    scenario: dict[str, Any] = Field(default_factory=dict)
    """Laid over this file, below the variant's own."""


class Bench(Strict):
    """The push-rod bench of Fig 13 instead of the platform: one actuator, grating ruler, pulley and weight."""

    actuator: Literal["pitch", "roll"] = "roll"
    weight_n: float = Field(default=0.0, ge=0.0, le=2000.0)
    """Pulls the rod back."""
    carriage_kg: float = Field(default=2.0, gt=0.0, le=100.0)
    guide_friction_n: float = Field(default=3.0, ge=0.0, le=200.0)
    from_mm: float = Field(default=-34.0, ge=-500.0, le=500.0)
    to_mm: float = Field(default=34.0, ge=-500.0, le=500.0)
    step_mm: float = Field(default=2.0, gt=0.0, le=100.0)
    move_s: float = Field(default=0.4, gt=0.0, le=60.0)
    """Turning by hand from one place to the next."""
    dwell_s: float = Field(default=0.3, gt=0.0, le=60.0)
    """Standstill before the reading."""
    grating_accuracy_um: float = Field(default=5.0, ge=0.0, le=100.0)
    """Width of the band in which the scale's own error lies."""
    grating_period_mm: float = Field(default=20.0, gt=0.0, le=1000.0)
    """Length over which that error comes back."""
    grating_resolution_um: float = Field(default=1.0, gt=0.0, le=100.0)

    @model_validator(mode="after")
    def _way(self) -> Bench:
        steps = abs(self.to_mm - self.from_mm) / self.step_mm
        if steps < 1.0 or not isclose(steps, round(steps), abs_tol=1e-6):
            raise ValueError(f"from_mm to to_mm must be a whole number of step_mm ({self.step_mm:g})")
        return self


FigureName = Literal["errors", "stations", "open_loop", "push_rod", "heading", "thermal", "base", "ladder", "draws"]


class Scenario(Strict):
    """A session, or an experiment of several: ``spsp-ctrl run`` plays it once, ``spsp-ctrl experiment`` with repeats, laws and variants."""

    schema_: Literal["spsp-ctrl/scenario/1"] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=60)
    """Short name, for tables and files."""
    title: str = ""
    position: int = Field(default=100, ge=1, le=1000)
    """Place among the experiments of a list; from 20 on it is not part of ``experiment all``."""
    paper: str = ""
    """What the paper did."""
    note: str = ""
    """What this file does, and where it differs."""
    duration_s: float = Field(default=40.0, ge=0.1, le=86_400.0)
    """Length of the session; braking comes after it."""
    settle_s: float = Field(default=6.0, ge=0.0)
    """Errors are judged after this time: start-up and alignment are not part of the figure."""
    base: BaseMotion = BaseMotion()
    """Motion of the swing table."""
    reference: ReferencePlan = ReferencePlan()
    """What the platform shall do."""
    park: Park = Park()
    """Where the platform stands at the start."""
    load: Load = Load()
    """Load on the platform."""
    temperature: Temperature = Temperature()
    """Surroundings."""
    dropouts: tuple[Dropout, ...] = ()
    """Silences of the IMU."""
    faults: Annotated[tuple[Injection, ...], Field(max_length=100)] = ()
    """Named faults of signals, on a timeline."""
    bench: Bench | None = None
    laws: tuple[Law, ...] = ()
    """Laws to run with; the rig file's own when empty."""
    rig: dict[str, Any] = Field(default_factory=dict)
    """Laid over the rig file for every run."""
    model: dict[str, ModelChange] = Field(default_factory=dict)
    """Variation of the plant for every run."""
    repeats: Repeats = Repeats()
    variants: Annotated[tuple[Variant, ...], Field(max_length=50)] = ()
    motions: Annotated[tuple[Motion, ...], Field(max_length=20)] = ()
    """Motions to play each variant on; only the file's own when empty."""
    figures: tuple[FigureName, ...] = ("errors",)
    acceptance: AcceptanceRows = ()

    @model_validator(mode="after")
    def _names(self) -> Scenario:
        names = [v.name for v in self.variants]
        double = sorted({n for n in names if names.count(n) > 1})
        if double:
            raise ValueError(f"variant {double[0]!r} is given twice")
        for row in self.acceptance:
            for name in (*row.variants, *row.across, *((row.relative_to,) if row.relative_to else ())):
                if name and name not in names:
                    raise ValueError(f"acceptance row {row.name!r} names the variant {name!r}; known: {', '.join(names) or 'none'}")
            if row.motion and row.motion not in [m.name for m in self.motions]:
                raise ValueError(f"acceptance row {row.name!r} names the motion {row.motion!r}, which is not under motions")
        for variant in self.variants:
            for found in variant.identified.values():
                sources = [v for v in self.variants if v.name == found.variant and not v.identified]
                if not sources:
                    raise ValueError(f"variant {variant.name!r} takes figures of {found.variant!r}, which is no variant with given values")
        return self
