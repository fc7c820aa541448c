"""What a single axis is asked to do: a motion file (``spsp-ctrl/axis-scenario/1``), and the course of reference, load and temperature that it means.

`diagnose` writes one as ``next.yaml`` when names cannot be told apart; the virtual bench runs it, and a real bench can.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from spsp_ctrl.config.loader import Loaded, load_yaml_model
from spsp_ctrl.config.scenario import Strict
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, N_IN, temperature_slope
from spsp_ctrl.plant.axis_model import AxisController

AXIS_SCENARIO_SCHEMA = "spsp-ctrl/axis-scenario/1"
MM = 1e-3
Point = tuple[Annotated[float, Field(ge=0.0, le=3600.0)], float]


class Move(Strict):
    """A straight move with a trapezoid in speed."""

    to_mm: float = Field(ge=-10000.0, le=10000.0)
    """Where to, counted from the start of the file's coordinate."""
    speed_mm_s: float = Field(gt=0.0, le=10000.0)
    """Highest speed."""
    acceleration_mm_s2: float = Field(default=500.0, gt=0.0, le=1e6)
    """Acceleration of both ramps."""


class Wave(Strict):
    """A sine, or with ``to_hz`` one whose frequency grows steadily, about the place where the axis stands; it grows and fades over half a second."""

    amplitude_mm: float = Field(gt=0.0, le=10000.0)
    """Amplitude."""
    from_hz: float = Field(gt=0.0, le=100.0)
    """Frequency, at the start."""
    to_hz: float | None = Field(default=None, gt=0.0, le=100.0)
    """Frequency at the end; the amplitude falls as one over the frequency, so that the speed stays."""
    seconds: float = Field(gt=0.0, le=3600.0)
    """How long."""


class Segment(Strict):
    """One thing after the other: a move, a wave, or a rest."""

    name: str = Field(default="", max_length=40)
    """A motion of this name begins here; without one the motion goes on."""
    move: Move | None = None
    wave: Wave | None = None
    rest_s: float | None = Field(default=None, gt=0.0, le=3600.0)
    """Stand still."""

    @model_validator(mode="after")
    def _one(self) -> Segment:
        if sum(x is not None for x in (self.move, self.wave, self.rest_s)) != 1:
            raise ValueError("a segment is one of move, wave, rest_s")
        return self


class Limits(Strict):
    """What this motion keeps to; the bench refuses a file that does not."""

    travel_mm: tuple[float, float]
    """Lowest and highest place."""
    speed_mm_s: float = Field(gt=0.0)
    """Highest speed of the reference."""
    current_a: float = Field(gt=0.0)
    """Highest command."""


class AxisScenario(Strict):
    """The motion of a single axis."""

    schema_: Literal["spsp-ctrl/axis-scenario/1"] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=80)
    """Name."""
    title: str = ""
    """What it is for, in one line."""
    note: str = ""
    """More about it."""
    rate_hz: float = Field(gt=0.0, le=20000.0)
    """Rate of controller and log."""
    seconds: float = Field(gt=0.1, le=600.0)
    """Length of the log; after the last segment the axis stands still."""
    start_mm: float = Field(default=0.0, ge=-10000.0, le=10000.0)
    """Where it begins."""
    controller: AxisController
    """The loop that runs it."""
    segments: Annotated[tuple[Segment, ...], Field(min_length=1, max_length=500)]
    """What is asked, one after the other."""
    load_n: Annotated[tuple[Point, ...], Field(min_length=1, max_length=200)] = ((0.0, 0.0),)
    """Force against positive travel: pairs of time in s and N; each holds until the next."""
    mass_kg: Annotated[tuple[Point, ...], Field(min_length=1, max_length=200)] = ((0.0, 0.0),)
    """Mass put on the carriage: pairs of time in s and kg; each holds until the next."""
    screw_c: Annotated[tuple[Point, ...], Field(min_length=1, max_length=200)] = ((0.0, 20.0),)
    """Screw temperature: pairs of time in s and degC, straight lines between."""
    ambient_c: float = Field(default=20.0, ge=-40.0, le=85.0)
    """Surroundings."""
    limits: Limits

    @model_validator(mode="after")
    def _kept(self) -> AxisScenario:
        for text in breaches(self):
            raise ValueError(text)
        return self


@dataclass(frozen=True)
class Course:
    """A motion file as inputs of the kernel."""

    inputs: Array
    """(n, ``axis.IN``); the command column is empty, the controller makes it."""
    motions: tuple[tuple[int, str], ...]
    """First cycle and name of each motion."""


def _trapezoid(way_m: float, speed: float, acceleration: float, rate_hz: float) -> Array:
    """Speeds of a move, one each cycle, exact in distance."""
    top = min(speed, float(np.sqrt(acceleration * abs(way_m))))
    ramp = max(2, round(top / acceleration * rate_hz))
    flat = max(0, round(abs(way_m) / top * rate_hz) - ramp)
    shape = np.concatenate([np.arange(1, ramp + 1) / ramp, np.ones(flat), np.arange(ramp - 1, -1, -1) / ramp])
    return np.asarray(shape * (way_m * rate_hz / float(np.sum(shape))))


def _wave(wave: Wave, rate_hz: float) -> Array:
    n = round(wave.seconds * rate_hz)
    t = np.arange(n) / rate_hz
    end = wave.to_hz or wave.from_hz
    frequency = wave.from_hz + (end - wave.from_hz) * t / wave.seconds
    phase = 2.0 * pi * (wave.from_hz * t + 0.5 * (end - wave.from_hz) * t * t / wave.seconds)
    edge = np.clip(np.minimum(t, t[::-1]) / min(0.5, wave.seconds / 2.0), 0.0, 1.0)
    place = wave.amplitude_mm * MM * (wave.from_hz / frequency) * np.sin(phase) * edge * edge * (3.0 - 2.0 * edge)
    return np.asarray(np.diff(np.append(place, 0.0)) * rate_hz)


def _held(points: tuple[Point, ...], t: Array) -> Array:
    times, values = np.array([p[0] for p in points]), np.array([p[1] for p in points])
    return np.asarray(values[np.maximum(np.searchsorted(times, t + 1e-9, side="right") - 1, 0)], np.float64)


def _reference(scenario: AxisScenario) -> tuple[Array, Array, tuple[tuple[int, str], ...]]:
    rate, n = scenario.rate_hz, round(scenario.seconds * scenario.rate_hz)
    parts: list[Array] = []
    marks: list[tuple[int, str]] = []
    cycles, at = 0, scenario.start_mm * MM
    for segment in scenario.segments:
        if segment.name:
            marks.append((cycles, segment.name))
        if segment.move is not None:
            way = segment.move.to_mm * MM - at
            if abs(way) < 1e-12:
                continue
            speeds = _trapezoid(way, segment.move.speed_mm_s * MM, segment.move.acceleration_mm_s2 * MM, rate)
            at = segment.move.to_mm * MM
        elif segment.wave is not None:
            speeds = _wave(segment.wave, rate)
        else:
            speeds = np.zeros(round((segment.rest_s or 0.0) * rate))
        parts.append(speeds)
        cycles += len(speeds)
    speeds = np.concatenate([*parts, np.zeros(max(0, n - cycles))])[:n]
    place = scenario.start_mm * MM + np.concatenate([[0.0], np.cumsum(speeds)[:-1]]) / rate
    return place, speeds, tuple((k, name) for k, name in marks if k < n)


def breaches(scenario: AxisScenario) -> Iterator[str]:
    """Where a motion leaves its own limits."""
    place, speeds, _ = _reference(scenario)
    low, high = scenario.limits.travel_mm
    if place.min() < low * MM - 1e-9 or place.max() > high * MM + 1e-9:
        yield f"the motion goes from {place.min() / MM:.4g} to {place.max() / MM:.4g} mm, beyond its limits {low:g} to {high:g} mm"
    top = float(np.max(np.abs(speeds))) / MM
    if top > scenario.limits.speed_mm_s * 1.02:
        yield f"the motion reaches {top:.4g} mm/s, beyond its limit of {scenario.limits.speed_mm_s:g} mm/s"


def course(scenario: AxisScenario) -> Course:
    """The inputs that a motion file means, one row for each cycle."""
    place, speeds, marks = _reference(scenario)
    t = np.arange(len(place)) / scenario.rate_hz
    u = np.zeros((len(place), N_IN))
    u[:, IN.enabled] = 1.0
    u[:, IN.reference_m], u[:, IN.reference_m_s] = place, speeds
    u[:, IN.load_force_n], u[:, IN.load_mass_kg] = _held(scenario.load_n, t), _held(scenario.mass_kg, t)
    u[:, IN.screw_c] = np.interp(t, [p[0] for p in scenario.screw_c], [p[1] for p in scenario.screw_c])
    u[:, IN.ambient_c] = scenario.ambient_c
    u[:, IN.screw_c_s] = temperature_slope(u[:, IN.screw_c], scenario.rate_hz)
    return Course(u, marks)


def load_axis_scenario(path: Path) -> AxisScenario:
    """Read and check a motion file. Raises ``ConfigError`` with one line per problem."""
    loaded: Loaded[AxisScenario] = load_yaml_model(path, AxisScenario, AXIS_SCENARIO_SCHEMA)
    return loaded.model


def document(scenario: AxisScenario) -> dict[str, Any]:
    """The file as plain data."""
    return scenario.model_dump(by_alias=True, exclude_none=True, mode="json")
