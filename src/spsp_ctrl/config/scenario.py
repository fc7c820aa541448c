"""Scenario file: what happens in a session (base motion, reference, load, temperature, duration, acceptance rows)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

SCENARIO_SCHEMA = "spsp-ctrl/scenario/1"


class Strict(BaseModel):
    """Base of every config model: unknown keys, NaN and infinity are errors; instances do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)


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
    """Constant turning on top."""
    roughness: Roughness = Roughness()
    """Broadband motion on top."""


class Heading(Strict):
    """Heading demand: at ``at_s`` go to ``heading_deg`` and hold it over the ground."""

    at_s: float = Field(ge=0.0)
    """When the demand is given."""
    heading_deg: float = Field(ge=-180.0, le=180.0)
    """Where to."""


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
    heading: tuple[Heading, ...] = (Heading(at_s=0.0, heading_deg=0.0),)
    """Heading demands in time order."""


class Load(Strict):
    """Load on the moving platform."""

    mass_kg: float = Field(default=7.0, ge=0.0, le=20.0)
    """Mass on the moving platform; its place is in the model file."""


class Temperature(Strict):
    """Surroundings and what was warm at the start."""

    ambient_c: float = Field(default=20.0, ge=-40.0, le=85.0)
    """Surroundings, and everything at the start but the screws."""
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


class Acceptance(Strict):
    """One row of the verdict: a figure of the summary against a limit."""

    name: str
    """What the row is called in tables."""
    value: str
    """Dotted path in ``summary.json``, e.g. ``error_arcmin.pitch.imu_max``."""
    limit: float
    """The figure's magnitude must not exceed this."""
    unit: str = ""
    """Unit shown behind the figure."""


AcceptanceRows = Annotated[tuple[Acceptance, ...], Field(max_length=50)]


class Scenario(Strict):
    """A session."""

    schema_: Literal["spsp-ctrl/scenario/1"] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=60)
    """Short name, for tables and files."""
    title: str = ""
    """One line for the report."""
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
    """Signals that go silent."""
    acceptance: AcceptanceRows = ()
    """Rows of the verdict."""
