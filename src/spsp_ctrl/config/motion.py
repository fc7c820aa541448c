"""Motion in a scenario file: of the swing table (carrier) and of the reference."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from spsp_ctrl.config.strict import Strict


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
