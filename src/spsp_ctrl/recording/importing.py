"""A foreign recording becomes a log: read, scaled to SI, judged, written whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from spsp_ctrl import __version__
from spsp_ctrl.config.import_map import TARGETS, Column, ImportMap, leaves
from spsp_ctrl.config.loader import ConfigError, ConfigProblem, Loaded
from spsp_ctrl.config.units import UNITS
from spsp_ctrl.messages import NO_MEASUREMENT
from spsp_ctrl.recording import importing_checks as checks
from spsp_ctrl.recording.importing_checks import Array, Channel, Check, Grid
from spsp_ctrl.recording.importing_sources import MASTER, Source, near, open_source
from spsp_ctrl.recording.reader import LogError
from spsp_ctrl.recording.schema import HEADER, JSON_TOPICS, TOPICS
from spsp_ctrl.recording.writer_process import McapLog

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Imported:
    """What was found, and whether a log was written."""

    source: str
    out: str
    samples: int
    rate_hz: float
    duration_s: float
    motions: tuple[tuple[str, float], ...]
    """Name and start in the time of the log."""
    checks: tuple[Check, ...]
    channels: tuple[Channel, ...]

    @property
    def refused(self) -> tuple[Check, ...]:
        """The checks that stand in the way."""
        return tuple(check for check in self.checks if check.verdict == checks.REFUSED)

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``; NaN becomes null."""
        return dict(_finite(asdict(self)))

    def lines(self) -> Iterator[str]:
        """For a person: checks, channels, motions."""
        yield f"{self.source}: {self.samples} samples, {self.duration_s:g} s at {self.rate_hz:g} Hz"
        rows: list[tuple[str, ...]] = [("check", "channel", "found", "allowed", "verdict", "")]
        rows += [(c.name, c.channel, f"{c.value:.4g}", c.limit, c.verdict, c.text) for c in self.checks]
        yield from _aligned(rows)
        if self.channels:
            rows = [("channel", "from", "unit", "min", "max", "rms", "step", "longest hold")]
            rows += [
                (c.name, c.source, c.unit, *(f"{v:.5g}" for v in (c.low, c.high, c.rms, c.step)), f"{c.hold_s:.3g} s") for c in self.channels
            ]
            yield from _aligned(rows)
        for name, start in self.motions:
            yield f"motion {name!r} from {start:g} s"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _aligned(rows: list[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def _silent(done: int, total: int) -> None:
    pass


def import_log(path: Path, loaded: Loaded[ImportMap], out: Path | None, *, force: bool = False, progress: Progress = _silent) -> Imported:
    """Judge the recording at ``path`` by its map and write it to ``out`` (None: only judge).

    Nothing is written when a check refuses: see ``Imported.refused``. Raises ``LogError`` for a recording that cannot be read, ``ConfigError`` for a
    map that does not fit it, ``FileExistsError`` for an ``out`` that is there already.
    """
    if out is not None:
        _free(path, out, force)
    given = loaded.model
    wanted = tuple(c.source for fields in given.columns.values() for c in fields.values()) + ((given.time.source,) if given.time.source else ())
    source = open_source(path, given, wanted)
    raw = {
        (topic, name): _read(source, loaded, ("columns", topic, name, "source"), column.source, path)
        for topic, fields in given.columns.items()
        for name, column in fields.items()
    }
    start, stop, grid, found = _window(source, loaded, raw, path)
    channels: list[Channel] = []
    motions: tuple[tuple[str, float], ...] = ()
    values: dict[tuple[str, str], Array] = {}
    if grid is not None:
        for (topic, name), column in _columns(given):
            kind = dict(leaves(TARGETS[topic]))[name]
            values[topic, name] = _scaled(raw[topic, name][start:stop], column)
            found += checks.judge_values(name, kind, values[topic, name])
            channels.append(checks.describe(name, column.source, given.field_unit(topic, name), values[topic, name], grid.rate_hz))
        found += _signs(values, grid.rate_hz)
        motions = _motions(loaded, grid)
    found = _accept(loaded, found)
    count = 0 if grid is None else len(grid.cycles)
    duration = 0.0 if grid is None else float(grid.stamps_ns[-1]) * 1e-9
    result = Imported(path.name, str(out or ""), count, grid.rate_hz if grid else 0.0, duration, motions, tuple(found), tuple(channels))
    if grid is not None and out is not None and not result.refused:
        _write(path, out, loaded, grid, values, motions, progress)
    return result


def _free(path: Path, out: Path, force: bool) -> None:
    if out.resolve() == path.resolve():
        raise FileExistsError(f"{out} is the recording itself; give another name")
    if out.is_dir():
        raise IsADirectoryError(f"{out}: is a folder; give the name of a file")
    if out.exists() and not force:
        raise FileExistsError(f"{out} exists; give another name or --force")
    if not out.parent.is_dir():
        raise FileNotFoundError(f"{out.parent}: no such folder")


def _columns(given: ImportMap) -> Iterator[tuple[tuple[str, str], Column]]:
    for topic, fields in given.columns.items():
        for name, column in fields.items():
            yield (topic, name), column


def _read(source: Source, loaded: Loaded[ImportMap], place: tuple[str, ...], name: str, path: Path) -> Array:
    try:
        return source.get(name)
    except KeyError:
        text = f"{path.name} has no column {name!r}{near(name, source.names())}"
        raise ConfigError([ConfigProblem(loaded.path, *loaded.locate(place), text)]) from None


def _window(source: Source, loaded: Loaded[ImportMap], raw: dict[tuple[str, str], Array], path: Path) -> tuple[int, int, Grid | None, list[Check]]:
    """First and last sample that are wanted, their grid, and the checks of time."""
    time = loaded.model.time
    lengths = {name: len(column) for (_, name), column in raw.items()}
    times: Array | None = None
    if time.source:
        times = _read(source, loaded, ("time", "source"), time.source, path) * (1.0 if time.source == MASTER else UNITS[time.unit][1])
        lengths["time"] = len(times)
    if len(set(lengths.values())) > 1:
        raise LogError(f"{path}: columns of different length: " + ", ".join(f"{name} {n}" for name, n in lengths.items()))
    samples = next(iter(lengths.values()))
    clock = times if times is not None else np.arange(samples) / float(time.rate_hz or 1.0)
    start, stop = 0, samples
    if time.from_s is not None or time.to_s is not None:
        low, high = -np.inf if time.from_s is None else time.from_s, np.inf if time.to_s is None else time.to_s
        inside = np.flatnonzero((clock >= low) & (clock <= high))
        start, stop = (int(inside[0]), int(inside[-1]) + 1) if len(inside) else (0, 0)
    if stop - start < 3:
        return start, stop, None, [Check("samples", "time", stop - start, ">= 3", checks.REFUSED, "nothing to import: from_s, to_s?")]
    if times is None:
        grid = checks.constant_rate(stop - start, time)
        return start, stop, Grid(grid.stamps_ns, grid.cycles, grid.rate_hz, float(clock[start])), []
    found, verdicts = checks.judge_time(times[start:stop], time)
    return start, stop, found, verdicts


def _scaled(raw: Array, column: Column) -> Array:
    factor = column.sign * column.scale * UNITS[column.unit][1]
    return np.asarray((raw - column.offset) * factor, np.float64)


def _signs(values: dict[tuple[str, str], Array], rate_hz: float) -> Iterator[Check]:
    by_topic: dict[str, dict[str, Array]] = {}
    for (topic, name), column in values.items():
        if np.all(np.isfinite(column)):
            by_topic.setdefault(topic, {})[name] = column
            clipped = checks.saturated(name, column)
            if clipped is not None:
                yield clipped
    yield from checks.judge_axis(by_topic.get("/axis", {}), rate_hz)
    yield from checks.judge_platform(by_topic.get("/measurement", {}), rate_hz)


def _motions(loaded: Loaded[ImportMap], grid: Grid) -> tuple[tuple[str, float], ...]:
    """Start of each motion in the time of the log."""
    given = loaded.model
    end = float(grid.stamps_ns[-1]) * 1e-9
    if given.repeat is not None:
        first, step = given.repeat.first_sample, given.repeat.period_samples
        laps = (len(grid.cycles) - first) // step
        if laps < 2:
            text = f"repeat: {len(grid.cycles) - first} samples hold {max(laps, 0)} whole laps of {step}; two are needed"
            raise ConfigError([ConfigProblem(loaded.path, *loaded.locate(("repeat",)), text)])
        return tuple((given.repeat.name, float(stamp) * 1e-9) for stamp in grid.stamps_ns[first::step])
    found = []
    for i, motion in enumerate(given.motions):
        start, stop = motion.from_s - grid.start_s, motion.to_s - grid.start_s
        if stop <= 0.0 or start >= end:
            text = f"motion {motion.name!r} lies outside of the recording ({grid.start_s:g} to {grid.start_s + end:g} s)"
            raise ConfigError([ConfigProblem(loaded.path, *loaded.locate(("motions", i)), text)])
        found.append((motion.name, float(grid.stamps_ns[np.searchsorted(grid.stamps_ns, start * 1e9)]) * 1e-9))
        after = given.motions[i + 1].from_s - grid.start_s if i + 1 < len(given.motions) else end
        if stop < after - 1.0 / grid.rate_hz:
            found.append(("idle", float(grid.stamps_ns[np.searchsorted(grid.stamps_ns, stop * 1e9)]) * 1e-9))
    return tuple(found)


def _accept(loaded: Loaded[ImportMap], found: list[Check]) -> list[Check]:
    names = {check.name for check in found}
    for i, name in enumerate(loaded.model.accept):
        if name not in names:
            text = f"accept: no check {name!r} here; there are: {', '.join(sorted(names))}"
            raise ConfigError([ConfigProblem(loaded.path, *loaded.locate(("accept", i)), text)])
    firm = {"time-finite", "samples", "monotonic", "nan", "finite", "flag"}  # without these there is no log at all
    wanted = set(loaded.model.accept) - firm
    return [
        Check(c.name, c.channel, c.value, c.limit, checks.ACCEPTED, c.text) if c.verdict == checks.REFUSED and c.name in wanted else c for c in found
    ]


def _rows(topic: str, loaded: Loaded[ImportMap], grid: Grid, values: dict[tuple[str, str], Array]) -> NDArray[Any]:
    """Every message of a topic with its header, as one structured array."""
    given, codec = loaded.model, TOPICS[topic]
    rows = np.zeros(len(grid.cycles), codec.dtype)
    rows.view(np.uint8).reshape(len(rows), -1)[:, : len(HEADER)] = np.frombuffer(HEADER, np.uint8)
    if topic == "/measurement":
        for name, value in zip(rows.dtype.names or (), codec.flatten(NO_MEASUREMENT), strict=True):
            rows[name] = value
    rows["stamp_ns"], rows["cycle"] = grid.stamps_ns, grid.cycles
    fields = set(given.columns[topic]) | set(given.constants.get(topic, {}))
    for name, constant in given.constants.get(topic, {}).items():
        rows[name] = constant.value * UNITS[constant.unit][1]
    for name in given.columns[topic]:
        column = values[topic, name]
        rows[name] = column if rows.dtype[name].kind == "f" else np.rint(column)
    for sample in sorted({name.split(".")[0] for name in fields if "." in name}):
        _stamp(rows, topic, sample, given, grid, fields)
    return rows


def _stamp(rows: NDArray[Any], topic: str, sample: str, given: ImportMap, grid: Grid, fields: set[str]) -> None:
    """Stamp and sequence of one sample inside ``/measurement`` (or of the command in ``/control``): new in every cycle, or where it changes."""
    new = np.ones(len(rows), bool)
    if sample in given.held:
        new[1:] = False
        for name in given.columns[topic]:
            if name.startswith(f"{sample}."):
                new[1:] |= rows[name][1:] != rows[name][:-1]
    latest = np.maximum.accumulate(np.where(new, np.arange(len(rows)), 0))
    names = rows.dtype.names or ()
    for name, value in (("stamp_ns", grid.stamps_ns[latest]), ("received_ns", grid.stamps_ns[latest]), ("seq", np.cumsum(new) - 1)):
        if f"{sample}.{name}" in names:
            rows[f"{sample}.{name}"] = value
    if f"{sample}.valid" in names and f"{sample}.valid" not in fields:
        rows[f"{sample}.valid"] = True


def _run(path: Path, loaded: Loaded[ImportMap], grid: Grid) -> dict[str, str]:
    given = loaded.model
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    facts = {
        "kind": "axis" if "/axis" in given.columns else "platform",
        "rate_hz": f"{grid.rate_hz:.9g}",
        "controller": given.controller.kind,
        "recorded": " ".join(name for fields in given.columns.values() for name in fields),
        "imported_from": path.name,
        "imported_sha256": digest,
        "import_map": given.name,
    }
    return facts | ({"command_unit": given.command_unit} if "/axis" in given.columns else {})


def _write(
    path: Path, out: Path, loaded: Loaded[ImportMap], grid: Grid, values: dict[tuple[str, str], Array],
    motions: tuple[tuple[str, float], ...], progress: Progress,
) -> None:  # fmt: skip
    given = loaded.model
    topics = tuple(topic for topic in TOPICS if topic in given.columns)
    blocks = [(_rows(topic, loaded, grid, values).tobytes(), TOPICS[topic].layout.size) for topic in topics]
    starts = {round(start * 1e9): name for name, start in motions}
    events = len(topics) + list(JSON_TOPICS).index("/events")
    part = out.with_name(out.name + ".part")
    try:
        with part.open("wb") as stream:
            log = McapLog(stream, topics)
            log.attachment("import-map.yaml", loaded.path.read_bytes())
            if given.controller.kind == "cascade":
                log.attachment("controller.yaml", yaml.safe_dump(given.controller.model_dump(), sort_keys=False).encode())
            log.metadata("run", _run(path, loaded, grid))
            log.metadata("versions", {"spsp_ctrl": __version__})
            told = 0
            for k, stamp in enumerate(grid.stamps_ns.tolist()):
                if stamp in starts:
                    event = {"stamp_ns": stamp, "level": "info", "id": "motion", "text": starts[stamp]}
                    log.message(events, stamp, told, json.dumps(event).encode())
                    told += 1
                for topic, (data, size) in enumerate(blocks):
                    log.message(topic, stamp, k, data[k * size : (k + 1) * size])
                if k % 2000 == 0:
                    progress(k, len(grid.stamps_ns))
            log.finish()
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)
