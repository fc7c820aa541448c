"""What a variant of an experiment draws at random, from the seed of each of its runs: a motion within ranges, a plant within a tolerance."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from spsp_ctrl.config.strict import Strict


def _rising(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] > span[1]:
        raise ValueError(f"the first number of a range ({span[0]:g}) must not be above the second ({span[1]:g})")
    return span


Amplitude = Annotated[float, Field(gt=0.0, le=20.0)]
Period = Annotated[float, Field(ge=0.5, le=60.0)]
Rms = Annotated[float, Field(gt=0.0, le=8.0)]


class DrawnSine(Strict):
    """One sine of a drawn motion: amplitude and period even within their ranges, the phase anywhere."""

    amplitude_deg: Annotated[tuple[Amplitude, Amplitude], AfterValidator(_rising)]
    """Smallest and largest amplitude."""
    period_s: Annotated[tuple[Period, Period], AfterValidator(_rising)]
    """Shortest and longest period."""


class DrawnSea(Strict):
    """A drawn seaway of one axis: lines about a period, an octave and a half wide, with random spacing; at most 3.3 times the rms at its peak."""

    rms_deg: Annotated[tuple[Rms, Rms], AfterValidator(_rising)]
    """Smallest and largest rms."""
    period_s: Annotated[tuple[Period, Period], AfterValidator(_rising)]
    """Shortest and longest period of the strongest line."""
    lines: int = Field(default=24, ge=2, le=200)
    """Spectral lines."""


class DrawnMotion(Strict):
    """A drawn motion of the swing table in place of the sines and the sea of `base`. It is drawn anew until the rig can follow it."""

    axis_order: Annotated[tuple[Literal["roll_pitch", "pitch_roll"], ...], Field(min_length=1, max_length=2)] = ("roll_pitch", "pitch_roll")
    """One of these."""
    pitch: tuple[DrawnSine, ...] = ()
    """Sines of the pitch axis, added up."""
    roll: tuple[DrawnSine, ...] = ()
    """Sines of the roll axis, added up."""
    sea_pitch: DrawnSea | None = None
    """A sea on top, pitch."""
    sea_roll: DrawnSea | None = None
    """A sea on top, roll."""


class DrawnPlant(Strict):
    """A drawn plant: every physical, continuous number of the model file times an even factor, phases anywhere."""

    within_percent: float = Field(gt=0.0, le=50.0)
    """Largest deviation of a factor from 1."""
    keep: tuple[str, ...] = ()
    """Parameters, by dotted name, that are left as they are beside those that are never drawn."""


class Drawn(Strict):
    """What is drawn. Run `k` draws from its own seed and from the name of the variant, so that any run can be made again alone."""

    motion: DrawnMotion | None = None
    plant: DrawnPlant | None = None
