"""Scenario file: what happens in a session (base motion, reference, load, temperature, duration, acceptance rows)."""

from __future__ import annotations

from math import isclose
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from spsp_ctrl.config.drawn import Drawn
from spsp_ctrl.config.strict import Strict as Strict

SCENARIO_SCHEMA = "spsp-ctrl/scenario/1"
Law = Literal["cascade", "stabiliser"]


class Sine(Strict):
    """One sinusoid ``amplitude * sin(2 pi (t - start) / period + phase)``."""

    amplitude_deg: float = Field(ge=-45.0, le=45.0)
    """Amplitude."""
    period_s: float = Field(ge=0.5, le=3600.0)
    """Period."""
    phase_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    """Phase at the start."""


class Roughness(Strict):
    """Small broadband base motion: a seeded sum of sines with random phases in a band."""

    rms_arcmin: float = Field(default=0.0, ge=0.0, le=10.0)
    """Size of each axis, rms; 0 switches it off."""
    low_hz: float = Field(default=2.0, gt=0.0, le=20.0)
    """Lower end of the band."""
    high_hz: float = Field(default=10.0, gt=0.0, le=50.0)
    """Upper end of the band."""

    @model_validator(mode="after")
    def _band(self) -> Roughness:
        if self.high_hz < self.low_hz:
            raise ValueError(f"high_hz ({self.high_hz:g}) must not be below low_hz ({self.low_hz:g})")
        return self


Line = tuple[Annotated[float, Field(ge=0.005, le=2.0)], Annotated[float, Field(gt=0.0, le=1e6)]]


class Spectrum(Strict):
    """Motion of one axis in a seaway: spectral lines whose phases are drawn from the seed of the run."""

    rms_deg: float = Field(gt=0.0, le=15.0)
    """The lines are scaled to this rms."""
    peak_deg: float = Field(gt=0.0, le=19.0)
    """Phases are drawn anew until the motion stays below this."""
    lines: Annotated[tuple[Line, ...], Field(min_length=1, max_length=200)]
    """Pairs of frequency in Hz and relative amplitude."""

    @model_validator(mode="after")
    def _possible(self) -> Spectrum:
        if self.peak_deg < 1.5 * self.rms_deg:
            raise ValueError(f"peak_deg ({self.peak_deg:g}) must be at least 1.5 times rms_deg ({self.rms_deg:g})")
        return self


class Sea(Strict):
    """A seaway; it adds to the sines of the axis."""

    pitch: Spectrum | None = None
    roll: Spectrum | None = None


class BaseMotion(Strict):
    """Motion of the swing table (carrier)."""

    axis_order: Literal["roll_pitch", "pitch_roll"] = "roll_pitch"
    """``roll_pitch``: R = Rz(yaw) Rx(-roll) Ry(pitch) (outer roll frame); ``pitch_roll``: R = Rz(yaw) Ry(pitch) Rx(-roll)."""
    start_s: float = Field(default=1.0, ge=0.0, le=3600.0)
    """When the motion begins."""
    ramp_s: float = Field(default=2.0, ge=0.1, le=60.0)
    """The motion grows smoothly from zero over this time, so that the start does not jerk the rig."""
    pitch: tuple[Sine, ...] = ()
    """Sines of the pitch axis, added up."""
    roll: tuple[Sine, ...] = ()
    """Sines of the roll axis, added up."""
    yaw: tuple[Sine, ...] = ()
    """Sines of the yaw axis, added up."""
    yaw_rate_deg_s: float = Field(default=0.0, ge=-30.0, le=30.0)
    """Constant turning on top: the carrier turns."""
    sea: Sea = Sea()
    """A sea spectrum on top."""
    roughness: Roughness = Roughness()
    """Broadband motion on top."""


class Heading(Strict):
    """Heading demand: at ``at_s`` go to ``heading_deg`` and hold it over the ground."""

    at_s: float = Field(ge=0.0)
    """When the demand is given."""
    heading_deg: float = Field(ge=-180.0, le=180.0)
    """Where to."""


class Staircase(Strict):
    """Values commanded one after the other on one axis: the first from the start on, each for ``dwell_s``."""

    axis: Literal["pitch", "roll"] = "roll"
    values_deg: Annotated[tuple[Annotated[float, Field(ge=-20.0, le=20.0)], ...], Field(min_length=1, max_length=500)]
    dwell_s: float = Field(gt=0.0, le=3600.0)
    """From one command to the next, travel included."""
    move_s: float = Field(default=0.0, ge=0.0, le=600.0)
    """Time of a smooth move from value to value; 0 is a step."""
    read_s: float = Field(default=0.2, gt=0.0, le=60.0)
    """Sensors are read over this time at the end of each dwell."""

    @model_validator(mode="after")
    def _room(self) -> Staircase:
        if self.move_s + self.read_s > self.dwell_s:
            raise ValueError(
                f"move_s ({self.move_s:g}) and read_s ({self.read_s:g}) do not fit into dwell_s ({self.dwell_s:g})"
            )
        return self


class ReferencePlan(Strict):
    """What the platform shall do."""

    kind: Literal["inertial", "joint"] = "inertial"
    """``inertial``: attitude in space, closed on the IMU; ``joint``: joint angles, closed on the resolvers (open loop)."""
    pitch_deg: float = Field(default=0.0, ge=-20.0, le=20.0)
    """Constant pitch."""
    roll_deg: float = Field(default=0.0, ge=-20.0, le=20.0)
    """Constant roll."""
    pitch: tuple[Sine, ...] = ()
    """Sines of pitch on top, added up."""
    roll: tuple[Sine, ...] = ()
    """Sines of roll on top, added up."""
    start_s: float = Field(default=1.0, ge=0.0, le=3600.0)
    """When the sines begin."""
    ramp_s: float = Field(default=2.0, ge=0.1, le=60.0)
    """They grow smoothly from zero over this time."""
    staircase: Staircase | None = None
    """Begins at ``start_s`` with its first value, which also holds before."""
    heading: tuple[Heading, ...] = (Heading(at_s=0.0, heading_deg=0.0),)
    """Heading demands in time order."""

    @model_validator(mode="after")
    def _one_source(self) -> ReferencePlan:
        stairs = self.staircase
        if stairs is not None and (getattr(self, stairs.axis) or getattr(self, f"{stairs.axis}_deg")):
            raise ValueError(f"staircase and {stairs.axis}/{stairs.axis}_deg both command {stairs.axis}; keep one of them")
        return self


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


class Dropout(Strict):
    """A signal goes silent for a while (the frames do not arrive)."""

    signal: Literal["imu"] = "imu"
    """Which signal."""
    at_s: float = Field(ge=0.0)
    """When it goes silent."""
    duration_s: float = Field(gt=0.0, le=3600.0)
    """For how long."""
    count: int = Field(default=1, ge=1, le=1000)
    """How many times."""
    every_s: float = Field(default=1.0, gt=0.0, le=3600.0)
    """From the start of one to the start of the next."""

    @model_validator(mode="after")
    def _apart(self) -> Dropout:
        if self.count > 1 and self.every_s <= self.duration_s:
            raise ValueError(f"every_s ({self.every_s:g}) must be above duration_s ({self.duration_s:g})")
        return self

    @property
    def spans_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each silence."""
        starts = (self.at_s + k * self.every_s for k in range(self.count))
        return tuple((start, start + self.duration_s) for start in starts)


class Acceptance(Strict):
    """One row of the verdict: a figure of the summary against bounds.

    In an experiment the row is judged on every run it applies to (all repeats, the named law and variants, all of them when none is named), and the
    worst value counts. ``across`` with ``order`` turns it into a shape claim: the figure must rise or fall from variant to variant by ``margin``.
    """

    name: str
    """What the row is called in tables."""
    value: str
    """Dotted path in ``summary.json``, e.g. ``error_arcmin.pitch.imu_max``."""
    limit: float | None = Field(default=None, ge=0.0)
    """Bound of the magnitude."""
    min: float | None = None
    max: float | None = None
    unit: str = ""
    paper: str = ""
    """What the paper states, in its words or numbers."""
    requirement: str = ""
    """What the paper requires of the machine, where that differs."""
    note: str = ""
    law: Law | None = None
    variant: str | tuple[str, ...] = ()
    motion: str = ""
    """One of `motions`; all of them when absent."""
    relative_to: str = ""
    """A variant: the figure is divided by that variant's and given in per cent."""
    across: tuple[str, ...] = ()
    """Variants in order."""
    order: Literal["rising", "falling"] = "rising"
    margin: float = Field(default=0.0, ge=0.0)
    """Smallest step from one of ``across`` to the next."""

    @model_validator(mode="after")
    def _bounded(self) -> Acceptance:
        given = [name for name in ("limit", "min", "max") if getattr(self, name) is not None]
        if self.across:
            if given or len(self.across) < 2:
                raise ValueError("a row with `across` names at least two variants and has `order` and `margin` instead of limit, min or max")
        elif not given:
            raise ValueError("a row needs a bound: limit (of the magnitude), min or max")
        elif "limit" in given and len(given) > 1:
            raise ValueError("give either limit (of the magnitude) or min and max")
        elif self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min ({self.min:g}) must not be above max ({self.max:g})")
        return self

    @property
    def variants(self) -> tuple[str, ...]:
        """Variants it applies to; empty means all."""
        if isinstance(self.variant, tuple):
            return self.variant
        return (self.variant,)


AcceptanceRows = Annotated[tuple[Acceptance, ...], Field(max_length=80)]


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
