"""Import map: how the columns of a foreign recording become a log. Every number has a unit beside it."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import Field, field_validator, model_validator

from spsp_ctrl.config.scenario import Strict
from spsp_ctrl.config.units import UNITS, spellings
from spsp_ctrl.messages import AxisSample, Control, Measurement

IMPORT_MAP_SCHEMA = "spsp-ctrl/import-map/1"

TARGETS: dict[str, type] = {"/axis": AxisSample, "/measurement": Measurement, "/control": Control}
"""Topics that can be imported. ``stamp_ns`` and ``cycle`` of each come from the sample time."""
OWN = ("stamp_ns", "cycle")

_ENDINGS = (  # longest first
    ("_rad_s2", "rad/s2"), ("_rad_s", "rad/s"), ("_m_s", "m/s"), ("_m_rad", "m/rad"), ("_rad", "rad"), ("_kg", "kg"), ("_ns", "s"),
    ("_m", "m"), ("_n", "N"), ("_a", "A"), ("_v", "V"), ("_c", "degC"), ("_s", "s"),
)  # fmt: skip


def leaves(cls: type, prefix: str = "") -> Iterator[tuple[str, type]]:
    """Dotted name and type of every number in a message."""
    for name, kind in get_type_hints(cls).items():
        if kind in (float, int, bool):
            yield prefix + name, kind
        else:
            yield from leaves(kind, f"{prefix}{name}.")


def si_unit(name: str) -> str:
    """SI unit that the ending of a field's name states; ``1`` for counts, numbers and flags."""
    if name.endswith("_microsteps_s"):
        return "1"
    return next((unit for ending, unit in _ENDINGS if name.endswith(ending)), "1")


class Table(Strict):
    """How a text table is written. Other formats have no such choices."""

    separator: Literal[",", ";", "tab", "space"] = ","
    """Between the columns; ``space`` is any run of blanks."""
    decimal: Literal[".", ","] = "."
    """Decimal point."""
    header_line: int = Field(default=1, ge=0, le=1000)
    """Line with the names, counted from 1; 0: there is none, columns are called ``1``, ``2``, ..."""
    skip_after_header: int = Field(default=0, ge=0, le=1000)
    """Lines between the names and the numbers, for instance one with units."""
    encoding: Literal["utf-8", "latin-1", "utf-16"] = "utf-8"
    """Of the file."""


class Time(Strict):
    """When the samples were taken: a column, a constant rate, or both (then they must agree)."""

    source: str = Field(default="", max_length=200)
    """Name of the time column; empty: samples follow each other at ``rate_hz``."""
    unit: Literal["s", "ms", "us", "ns"] = "s"
    """Of that column."""
    rate_hz: float | None = Field(default=None, gt=0.0, le=100e3)
    """Sample rate; taken from the column when absent."""
    max_jitter: float = Field(default=0.02, ge=0.0, le=0.5)
    """Largest deviation of one step from the sample time, as a share of it."""
    max_gap_s: float = Field(default=0.0, ge=0.0, le=3600.0)
    """Longest hole that is taken; it shows in ``cycle``. 0: none."""
    max_rate_error: float = Field(default=0.001, ge=0.0, le=0.1)
    """Largest relative difference between ``rate_hz`` and the column."""
    from_s: float | None = None
    """Leave out what lies before, in the time of the file."""
    to_s: float | None = None
    """Leave out what lies after."""

    @model_validator(mode="after")
    def _known(self) -> Time:
        if not self.source and self.rate_hz is None:
            raise ValueError("no sample time: give `source:` (the time column) or `rate_hz:`")
        if self.from_s is not None and self.to_s is not None and self.from_s >= self.to_s:
            raise ValueError(f"from_s ({self.from_s:g}) must be smaller than to_s ({self.to_s:g})")
        return self


class Column(Strict):
    """One column: field = sign * scale * (source - offset), turned from ``unit`` into SI."""

    source: str = Field(min_length=1, max_length=200)
    """Name of the column (variable, signal) in the file."""
    unit: str
    """Unit of what comes out of sign, scale and offset."""
    sign: Literal[1, -1] = 1
    """-1 turns the direction round."""
    scale: float = 1.0
    """Factor, for instance mm per volt of a probe; never 0."""
    offset: float = 0.0
    """Reading at zero, in what the file holds."""

    @field_validator("unit")
    @classmethod
    def _one(cls, unit: str) -> str:
        if unit not in UNITS:
            near = difflib.get_close_matches(unit, UNITS, n=1, cutoff=0.4)
            raise ValueError(f"unknown unit {unit!r}" + (f"; did you mean {near[0]!r}?" if near else ""))
        return unit

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, scale: float) -> float:
        if scale == 0.0:
            raise ValueError("a scale of 0 throws the column away; delete it and give a constant")
        return scale


class Constant(Strict):
    """Value of a field that was not recorded."""

    value: float
    """The value; 0 and 1 for a flag."""
    unit: str = "1"
    """Its unit."""


class Motion(Strict):
    """A stretch of the recording with one kind of motion."""

    name: str = Field(min_length=1, max_length=40, pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]*$")
    """For instance ``ladder``, ``sine``, ``reversals``."""
    from_s: float
    """Its start, in the time of the file."""
    to_s: float
    """Its end."""

    @model_validator(mode="after")
    def _forward(self) -> Motion:
        if self.from_s >= self.to_s:
            raise ValueError(f"motion {self.name!r}: from_s ({self.from_s:g}) must be smaller than to_s ({self.to_s:g})")
        return self


class Repeat(Strict):
    """The same motion again and again: what differs between its laps is the repeatability of rig and sensors."""

    name: str = Field(default="repeat", min_length=1, max_length=40, pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]*$")
    """Name of the motion."""
    period_samples: int = Field(ge=2, le=100_000_000)
    """Samples of one lap."""
    first_sample: int = Field(default=0, ge=0)
    """Where the first lap begins, counted from the first sample of the log."""


class CascadeController(Strict):
    """Position loop around a speed loop, as docs/log-format.md states it ("The known cascade")."""

    kind: Literal["cascade"]
    """This one."""
    kp_1_s: float = Field(gt=0.0, le=1e5)
    """Gain of the position loop."""
    kv: float = Field(gt=0.0, le=1e9)
    """Gain of the speed loop, in units of the command per m/s."""
    feedforward: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of the reference rate that is added to the demanded speed."""
    limit: float = Field(gt=0.0, le=1e9)
    """The command is clipped to this, both ways, in its own unit."""
    feedback: Literal["load", "resolver"] = "load"
    """What the loops are closed on."""
    rate_span: int = Field(default=1, ge=1, le=4)
    """Cycles over which the speed is taken."""


class OtherController(Strict):
    """No known law: the command is an input that was recorded."""

    kind: Literal["none", "recorded"]
    """``none``: open loop; ``recorded``: some loop was closed whose law is not known."""


class ImportMap(Strict):
    """How one kind of foreign recording is read."""

    schema_: Literal["spsp-ctrl/import-map/1"] = Field(alias="schema")
    """Kind and version of this file."""
    name: str = Field(min_length=1, max_length=80)
    """What is recorded; goes into the log."""
    format: Literal["csv", "mat", "mf4", "by ending"] = "by ending"
    """Format of the file; ``by ending`` looks at its name."""
    table: Table = Table()
    """Only for ``csv``."""
    time: Time
    """Sample time."""
    command_unit: Literal["A", "V", "N", "1"] = "A"
    """Unit of ``/axis`` ``command_a``: A for a current drive, V for a drive that is commanded in volts, N for a force, 1 for anything else."""
    columns: Annotated[dict[str, dict[str, Column]], Field(min_length=1)]
    """Topic, field, column. ``/axis``, or ``/measurement`` and ``/control`` with dotted names as in docs/log-format.md."""
    constants: dict[str, dict[str, Constant]] = Field(default={})
    """Topic, field, value of what was not recorded. ``/axis`` needs every field in one of the two."""
    motions: tuple[Motion, ...] = ()
    """Named stretches; ``diagnose`` fits on some and judges on others."""
    repeat: Repeat | None = None
    """Laps of one motion, instead of ``motions``."""
    held: tuple[str, ...] = ()
    """Samples of ``/measurement`` (``imu``, ``temperature``, ...) that are slower than the recording: a new one where a value changes."""
    controller: CascadeController | OtherController = Field(default=OtherController(kind="none"), discriminator="kind")
    """The controller that ran during the recording."""
    accept: tuple[str, ...] = ()
    """Names of checks (first column of the table of checks) whose failure is known and taken."""

    @model_validator(mode="after")
    def _together(self) -> ImportMap:
        if "/axis" in self.columns and len(self.columns) > 1:
            raise ValueError("`/axis` stands alone: a platform is `/measurement` with `/control`")
        if self.repeat and self.motions:
            raise ValueError("give `motions:` or `repeat:`, not both")
        for a, b in zip(self.motions, self.motions[1:], strict=False):
            if b.from_s < a.to_s:
                raise ValueError(f"motion {b.name!r} begins at {b.from_s:g} s, before {a.name!r} ends at {a.to_s:g} s")
        if "/axis" not in self.columns and (self.controller.kind == "cascade" or self.command_unit != "A"):
            raise ValueError("`controller: {kind: cascade}` and `command_unit:` belong to `/axis`")
        return self

    def field_unit(self, topic: str, name: str) -> str:
        """SI unit of a field of this recording."""
        return self.command_unit if (topic, name) == ("/axis", "command_a") else si_unit(name)


def problems(given: ImportMap) -> list[tuple[tuple[str | int, ...], str]]:
    """What no single key can know: (place, text) of fields that do not exist, units that do not fit, fields left open."""
    found = list(_misfits(given))
    have = {*given.columns.get("/axis", {}), *given.constants.get("/axis", {}), *OWN}
    missing = [name for name, _ in leaves(AxisSample) if name not in have]
    if "/axis" in given.columns and missing and not found:
        found.append((("columns", "/axis"), f"not said where these come from: {', '.join(missing)}; give a column or a constant for each"))
    return found


def _misfits(given: ImportMap) -> Iterator[tuple[tuple[str | int, ...], str]]:
    for part in ("columns", "constants"):
        for topic, fields in getattr(given, part).items():
            if topic not in TARGETS or (part == "constants" and topic not in given.columns):
                yield (part, topic), f"{part}.{topic}: no such topic here; use one of: {', '.join(TARGETS)}"
                continue
            known = dict(leaves(TARGETS[topic]))
            for name, entry in fields.items():
                text = _field_problem(given, topic, name, known.get(name), entry)
                if text:
                    yield (part, topic, name), text
                elif part == "constants" and name in given.columns[topic]:
                    yield (part, topic, name), f"{name} is given as a column and as a constant; delete one"
    samples = {name.split(".")[0] for name in given.columns.get("/measurement", {}) if "." in name}
    for i, name in enumerate(given.held):
        if name not in samples:
            yield ("held", i), f"held: {name!r} is no sample with columns; those are: {', '.join(sorted(samples)) or 'none'}"


def _field_problem(given: ImportMap, topic: str, name: str, kind: Any, entry: Column | Constant) -> str:
    if name in OWN or name.endswith("_ns") or name.endswith(".seq"):
        return f"{topic} {name} is made from the sample time; delete this line"
    if kind is None:
        near = difflib.get_close_matches(name, dict(leaves(TARGETS[topic])), n=1, cutoff=0.4)
        return f"{topic} has no field {name!r}" + (f"; did you mean {near[0]!r}?" if near else "")
    wanted = given.field_unit(topic, name)
    if UNITS.get(entry.unit, ("", 0.0))[0] != wanted:
        hint = "; set `command_unit:` when the command is no current" if name == "command_a" else ""
        return f"unit {entry.unit!r} does not fit {name}; use one of: {', '.join(spellings(wanted))}{hint}"
    if isinstance(entry, Constant) and kind is bool and entry.value not in (0.0, 1.0):
        return f"{name} is a flag: 0 or 1"
    return ""
