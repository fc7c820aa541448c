"""Columns of foreign recordings by name: text tables, MATLAB files, MDF 4 (what dSPACE ControlDesk, CANape and INCA export)."""

from __future__ import annotations

import contextlib
import csv
import difflib
import gc
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.import_map import ImportMap, Table
from spsp_ctrl.recording.reader import LogError

Array = NDArray[np.float64]
MAX_SAMPLES = 20_000_000
MASTER = "(master)"
"""Name of the time axis that an MDF file keeps beside each channel."""
ENDINGS = {".csv": "csv", ".txt": "csv", ".tsv": "csv", ".mat": "mat", ".mf4": "mf4", ".mdf": "mf4"}
_CELL = re.compile(r"(?P<name>.+?)\(:, *(?P<column>\d+)\)$")


class Source(Protocol):
    """A recording whose columns are asked for by name."""

    def names(self) -> list[str]:
        """Columns that there are."""

    def get(self, name: str) -> Array:
        """One column as float64. Raises ``KeyError`` for a name that is not there, ``LogError`` for one that is no column of numbers."""


def open_source(path: Path, given: ImportMap, wanted: tuple[str, ...]) -> Source:
    """The recording at ``path``; ``wanted`` are the columns that will be asked for. Raises ``LogError``, ``OSError``."""
    kind = ENDINGS.get(path.suffix.lower(), "") if given.format == "by ending" else given.format
    if path.is_dir():
        raise LogError(f"{path}: is a folder; give the recording in it")
    with path.open("rb") as stream:
        head = stream.read(128)
    if not head:
        raise LogError(f"{path}: is empty")
    if kind == "csv":
        return CsvSource(path, given.table, wanted)
    if kind == "mat":
        return MatSource(path, head)
    if kind == "mf4":
        return Mf4Source(path, head)
    raise LogError(f"{path}: {path.suffix or 'no'} ending is not known ({', '.join(ENDINGS)}); set `format:` in the map")


class CsvSource:
    """A text table, read once."""

    def __init__(self, path: Path, table: Table, wanted: tuple[str, ...]) -> None:
        self._path = path
        try:
            with path.open(encoding=table.encoding, newline="") as stream:
                lines = _lines(stream, table)
                self._names, first = _header(path, lines, table)
                places = {name: self._names.index(name) for name in dict.fromkeys(wanted) if name in self._names}
                self._columns = _numbers(path, lines, first, places, table)
        except UnicodeError:
            raise LogError(f"{path}: is not {table.encoding} text; set `table: {{encoding: ...}}` in the map") from None
        except csv.Error as error:
            raise LogError(f"{path}: is not a table: {error}") from None

    def names(self) -> list[str]:
        return self._names

    def get(self, name: str) -> Array:
        return self._columns[name]


def _lines(stream: Any, table: Table) -> Iterator[list[str]]:
    if table.separator == "space":
        return (line.split() for line in stream)
    return csv.reader(stream, delimiter={"tab": "\t"}.get(table.separator, table.separator))


def _header(path: Path, lines: Iterator[list[str]], table: Table) -> tuple[list[str], tuple[int, list[str]] | None]:
    """Names, and the first line of numbers where it had to be read to count the columns."""
    row: list[str] | None = None
    for _ in range(max(table.header_line, 1)):
        row = next(lines, None)
    if row is None:
        raise LogError(f"{path}: ends before line {max(table.header_line, 1)}")
    if table.header_line == 0:
        return [str(i + 1) for i in range(len(row))], (1, row)
    names = [cell.strip().removeprefix("\ufeff") for cell in row]
    twice = {name for name in names if name and names.count(name) > 1}
    if twice:
        raise LogError(f"{path}:{table.header_line}: two columns are called {sorted(twice)[0]!r}; rename one")
    for _ in range(table.skip_after_header):
        next(lines, None)
    return names, None


def _numbers(
    path: Path, lines: Iterator[list[str]], first: tuple[int, list[str]] | None, places: dict[str, int], table: Table
) -> dict[str, Array]:
    """The wanted columns; an empty cell is NaN."""
    found: dict[str, list[float]] = {name: [] for name in places}
    wanted = [(found[name].append, place) for name, place in places.items()]
    comma = table.decimal == ","
    number = first[0] - 1 if first else table.header_line + table.skip_after_header
    rows: Iterator[list[str]] = iter([first[1]]) if first else iter(())
    count = 0
    for source in (rows, lines):
        for row in source:
            number += 1
            if not row or (len(row) == 1 and not row[0].strip()):
                continue
            count += 1
            if count > MAX_SAMPLES:
                raise LogError(f"{path}:{number}: more than {MAX_SAMPLES} lines; cut the recording")
            for append, place in wanted:
                append(_number(path, number, row, place, comma))
    return {name: np.array(values) for name, values in found.items()}


def _number(path: Path, line: int, row: list[str], place: int, comma: bool) -> float:
    if place >= len(row):
        raise LogError(f"{path}:{line}: {len(row)} columns, column {place + 1} is missing")
    text = row[place].strip()
    if not text:
        return float("nan")
    try:
        return float(text.replace(",", ".") if comma else text)
    except ValueError:
        hint = "; set `table: {decimal: \",\"}` in the map" if re.fullmatch(r"[-+]?\d+,\d+", text) else ""
        raise LogError(f"{path}:{line}:{place + 1}: {text[:40]!r} is not a number{hint}") from None


class MatSource:
    """A MATLAB file up to version 7. ``name``, ``structure.field`` and ``matrix(:, 2)`` are columns."""

    def __init__(self, path: Path, head: bytes) -> None:
        if head.startswith(b"MATLAB 7.3") or head.startswith(b"\x89HDF"):
            raise LogError(f"{path}: is a MATLAB 7.3 (HDF5) file; save it in MATLAB with `save NAME -v7`")
        try:
            from scipy.io import loadmat
        except ModuleNotFoundError:
            raise LogError(f"{path}: reading MATLAB files needs scipy: pip install 'spsp-ctrl[design]'") from None
        try:
            found = loadmat(path, squeeze_me=True, struct_as_record=False)
        except Exception as error:  # damaged bytes make the parser raise nearly anything
            raise LogError(f"{path}: cannot be read as a MATLAB file: {_short(error)}") from None
        self._path = path
        self._variables = {name: value for name, value in found.items() if not name.startswith("__")}

    def names(self) -> list[str]:
        found: list[str] = []
        for name, value in self._variables.items():
            fields = getattr(value, "_fieldnames", None)
            if fields:
                found += [f"{name}.{field}" for field in fields]
            elif isinstance(value, np.ndarray) and value.ndim == 2:
                found += [f"{name}(:,{i + 1})" for i in range(min(value.shape[1], 99))]
            else:
                found.append(name)
        return found

    def get(self, name: str) -> Array:
        match = _CELL.match(name)
        plain, column = (match["name"], int(match["column"])) if match else (name, 0)
        head, *rest = plain.split(".")
        value: Any = self._variables[head]
        for part in rest:
            if part not in getattr(value, "_fieldnames", ()):
                raise KeyError(name)
            value = getattr(value, part)
        if column:
            if np.ndim(value) != 2 or not 1 <= column <= value.shape[1]:
                raise KeyError(name)
            value = value[:, column - 1]
        return _column(self._path, name, value)


class Mf4Source:
    """An MDF 4 file. All channels used must share one raster (one time axis), which is called ``(master)``."""

    def __init__(self, path: Path, head: bytes) -> None:
        if not head.startswith((b"MDF     ", b"UnFinMF ")):
            raise LogError(f"{path}: is not an MDF file")
        try:
            from asammdf import MDF
        except ModuleNotFoundError:
            raise LogError(f"{path}: reading MDF files needs asammdf: pip install 'spsp-ctrl[mf4]'") from None
        self._path = path
        self._first = ""
        self._times: Array | None = None
        problem = ""
        with _silent_deletion():  # a half-made reader complains while it is taken down; our own line says what is wrong
            try:
                self._mdf = MDF(path)
                self._names = sorted(name for name in self._mdf.channels_db)
            except Exception as error:
                problem = _short(error)
            if problem:
                gc.collect()
        if problem:
            raise LogError(f"{path}: cannot be read as an MDF file: {problem}")

    def names(self) -> list[str]:
        return [MASTER, *self._names]

    def get(self, name: str) -> Array:
        if name == MASTER:
            if self._times is None:
                raise LogError(f"{self._path}: no channel was read before its time axis")
            return self._times
        if name not in self._names:
            raise KeyError(name)
        if len(self._mdf.channels_db[name]) > 1:
            raise LogError(f"{self._path}: channel {name!r} is there {len(self._mdf.channels_db[name])} times; export with unique names")
        try:
            signal = self._mdf.get(name)
            if signal.invalidation_bits is not None and np.any(signal.invalidation_bits):
                signal = signal.validate(copy=True)  # leaves out the samples that the logger marked as invalid: a hole in the time axis
        except Exception as error:
            raise LogError(f"{self._path}: channel {name!r} cannot be read: {_short(error)}") from None
        times = np.asarray(signal.timestamps, float)
        if self._times is None:
            self._times, self._first = times, name
        elif not np.array_equal(times, self._times):
            raise LogError(
                f"{self._path}: {name!r} has another time axis than {self._first!r} ({len(times)} and {len(self._times)} samples); "
                "export all signals in one raster"
            )
        return _column(self._path, name, signal.samples)


@contextlib.contextmanager
def _silent_deletion() -> Iterator[None]:
    before = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        sys.unraisablehook = before


def _column(path: Path, name: str, value: Any) -> Array:
    try:
        column = np.asarray(value)
        if column.dtype.kind not in "buif" or column.ndim > 1:
            raise TypeError
        column = np.atleast_1d(column).astype(np.float64)
    except (TypeError, ValueError):
        shape = " x ".join(map(str, np.shape(value))) or "no array"
        raise LogError(f"{path}: {name!r} is not one column of real numbers ({shape})") from None
    if len(column) > MAX_SAMPLES:
        raise LogError(f"{path}: {name!r} has more than {MAX_SAMPLES} samples; cut the recording")
    return column


def _short(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".rstrip(": ").splitlines()[0][:200]


def near(name: str, names: list[str]) -> str:
    """Hint for a column that is not there."""
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
    there = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"; did you mean {close[0]!r}?" if close else f"; there are: {there}"
