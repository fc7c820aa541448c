"""Strict YAML files: every problem of a file at once, each as one line ``file:line:column: what is wrong, what to do``."""

from __future__ import annotations

import copy
import difflib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import UnionType
from typing import Any, Generic, TypeVar, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, ValidationError

from spsp_ctrl.config.import_map import IMPORT_MAP_SCHEMA, ImportMap, problems
from spsp_ctrl.config.rig import MECHANISM_SCHEMA, RIG_SCHEMA, BusDriver, MechanismFile, RigConfig
from spsp_ctrl.config.scenario import SCENARIO_SCHEMA, Scenario
from spsp_ctrl.config.served import SERVED_SCHEMA, ServedFile
from spsp_ctrl.config.tolerances import TOLERANCES_SCHEMA, TRANSMISSION_SCHEMA, ToleranceFile, TransmissionFile

M = TypeVar("M", bound=BaseModel)
Location = tuple[str | int, ...]
MAX_BYTES = 1 << 20
MAX_NODES = 50_000
MAX_DEPTH = 50

KINDS = {
    RIG_SCHEMA: "a rig file",
    MECHANISM_SCHEMA: "a mechanism file",
    SCENARIO_SCHEMA: "a scenario file",
    "spsp-ctrl/model/1": "a plant model file",
    TOLERANCES_SCHEMA: "a tolerance file",
    TRANSMISSION_SCHEMA: "a transmission file",
    IMPORT_MAP_SCHEMA: "an import map",
    "spsp-ctrl/axis-scenario/1": "a motion file of a single axis",
    SERVED_SCHEMA: "a plant server file",
}


@dataclass(frozen=True, slots=True)
class ConfigProblem:
    """One thing that is wrong, and where. ``line`` 0 means the file as a whole, ``path`` None an option of the command line."""

    path: Path | None
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        if self.path is None:
            return self.message
        return f"{self.path}:{self.line}:{self.column}: {self.message}" if self.line else f"{self.path}: {self.message}"


class ConfigError(Exception):
    """A file or option that cannot be used."""

    def __init__(self, problems: Sequence[ConfigProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))


@dataclass(frozen=True, slots=True)
class Loaded(Generic[M]):
    """A checked file with the places of its keys."""

    model: M
    path: Path
    data: dict[str, Any]
    marks: dict[Location, tuple[int, int]] = field(repr=False)

    def locate(self, place: Location) -> tuple[int, int]:
        """Line and column (from 1) of a key, or of the nearest mapping around it."""
        while place not in self.marks and place:
            place = place[:-1]
        return self.marks.get(place, (1, 1))


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """YAML 1.1 without its traps: ``2e-5`` is a number, ``on`` and ``12:30`` are text."""


_Loader.yaml_implicit_resolvers = {
    key: [(tag, rx) for tag, rx in resolvers if tag.rsplit(":", 1)[-1] not in ("float", "bool", "int", "timestamp")]
    for key, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"^(true|false)$", re.I), list("tTfF"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"^[-+]?[0-9]+$"), list("-+0123456789"))
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+|\.(inf|nan|Inf|NaN))$"),
    list("-+0123456789."),
)


_Loader.add_constructor("tag:yaml.org,2002:int", lambda loader, node: int(node.value))  # 010 is ten, not eight
_PLAIN = tuple(f"tag:yaml.org,2002:{kind}" for kind in ("map", "seq", "str", "int", "float", "bool", "null"))


def _read(path: Path) -> str:
    try:
        if not path.exists():
            raise ConfigError([ConfigProblem(path, 0, 0, "no such file")])
        if path.is_dir():
            raise ConfigError([ConfigProblem(path, 0, 0, "is a folder, expected a YAML file")])
        with path.open("rb") as stream:  # never more than this: the path may be a device
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError([ConfigProblem(path, 0, 0, f"cannot be read: {error.strerror}")]) from None
    if len(data) > MAX_BYTES:
        raise ConfigError([ConfigProblem(path, 0, 0, f"is larger than {MAX_BYTES >> 20} MiB: not a configuration file")])
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        what = "is a binary file, expected YAML text" if b"\0" in data[:4096] else "is not UTF-8 text; save it as UTF-8 YAML"
        raise ConfigError([ConfigProblem(path, line, 1, what)]) from None


def _construct(path: Path, text: str) -> tuple[Any, dict[Location, tuple[int, int]]]:
    """Plain data and the place of every key."""
    try:
        root = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        hint = "; indent with spaces, not tabs" if "tab" in str(error.problem) or "'\\t'" in str(error.problem) else ""
        raise ConfigError([ConfigProblem(path, line, column, f"not valid YAML: {error.problem}{hint}")]) from None
    except yaml.YAMLError as error:
        first = str(error).splitlines()[0]
        raise ConfigError([ConfigProblem(path, 1, 1, f"not valid YAML: {first}")]) from None
    if root is None:
        raise ConfigError([ConfigProblem(path, 1, 1, "is empty; copy one of the files in config/ and change it")])
    if not isinstance(root, yaml.MappingNode):
        raise ConfigError([ConfigProblem(path, 1, 1, "expected `key: value` lines at the top level")])
    marks: dict[Location, tuple[int, int]] = {(): (1, 1)}
    problems: list[ConfigProblem] = []
    scalars = _Loader("")
    count = 0

    def walk(node: yaml.Node, place: Location) -> Any:
        nonlocal count
        count += 1
        if count > MAX_NODES:
            raise ConfigError([ConfigProblem(path, node.start_mark.line + 1, 1, "too many values (aliases repeated?)")])
        if len(place) > MAX_DEPTH:
            text = f"nested deeper than {MAX_DEPTH} levels (an alias inside its own anchor?)"
            raise ConfigError([ConfigProblem(path, node.start_mark.line + 1, node.start_mark.column + 1, text)])
        if node.tag not in _PLAIN:
            problems.append(ConfigProblem(path, node.start_mark.line + 1, node.start_mark.column + 1, f"tag {node.tag!r} is not allowed; delete it"))
            return None
        if isinstance(node, yaml.MappingNode):
            result: dict[str, Any] = {}
            for key_node, value_node in node.value:
                line, column = key_node.start_mark.line + 1, key_node.start_mark.column + 1
                if not isinstance(key_node, yaml.ScalarNode):
                    problems.append(ConfigProblem(path, line, column, "a list or mapping cannot be a key; write `key: value`"))
                    continue
                key = str(key_node.value)
                if key in result:
                    problems.append(ConfigProblem(path, line, column, f"key {key!r} is given twice; delete one"))
                marks[(*place, key)] = (line, column)
                result[key] = walk(value_node, (*place, key))
            return result
        if isinstance(node, yaml.SequenceNode):
            items = []
            for i, child in enumerate(node.value):
                marks[(*place, i)] = (child.start_mark.line + 1, child.start_mark.column + 1)
                items.append(walk(child, (*place, i)))
            return items
        try:
            return scalars.construct_object(node)
        except (yaml.YAMLError, ValueError) as error:
            mark = node.start_mark
            problems.append(ConfigProblem(path, mark.line + 1, mark.column + 1, f"cannot be read as a value: {error}"))
            return None

    data = walk(root, ())
    if problems:
        raise ConfigError(problems)
    return data, marks


def load_yaml_model(path: Path, model: type[M], schema: str) -> Loaded[M]:
    """Read, check and convert one file. Raises ``ConfigError`` with every problem found."""
    path = Path(path)
    return _load(path, *_construct(path, _read(path)), model, schema)


def _load(
    path: Path, data: dict[str, Any], marks: dict[Location, tuple[int, int]], model: type[M], schema: str
) -> Loaded[M]:
    given = data.get("schema")
    if given != schema:
        line, column = marks.get(("schema",), (1, 1))
        if given is None:
            text = f"no `schema:` line; a file of this kind starts with `schema: {schema}`"
        elif given in KINDS:
            text = f"this is {KINDS[given]}, not {KINDS[schema]}"
        else:
            text = f"unknown schema {given!r}; expected {schema!r}"
        raise ConfigError([ConfigProblem(path, line, column, text)])
    return validate_data(path, data, marks, model)


def validate_data(path: Path, data: dict[str, Any], marks: dict[Location, tuple[int, int]], model: type[M]) -> Loaded[M]:
    """Check plain data whose keys stand at ``marks`` in ``path``. Raises ``ConfigError`` with every problem found."""
    loaded: Loaded[Any] = Loaded(None, path, data, marks)
    try:
        # through JSON, where strict still takes a list for a tuple; else `true` would pass for 1.0 and "6.0" for 6.0
        checked = model.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        items: list[dict[str, Any]] = [dict(item) | {"loc": _untagged(data, item["loc"])} for item in error.errors()]
        meant = {(*item["loc"][:-1], key) for item in items if (key := _meant(model, item))}
        problems = [_problem(loaded, model, item) for item in items if item["type"] != "missing" or item["loc"] not in meant]
        unique = {str(problem): problem for problem in problems}
        raise ConfigError(sorted(unique.values(), key=lambda p: (p.line, p.column, p.message))) from None
    loaded = Loaded(checked, path, data, marks)
    if isinstance(checked, RigConfig):
        found = [ConfigProblem(path, *loaded.locate(place), text) for place, text in checked.misfits()]
        if found:
            raise ConfigError(sorted(found, key=lambda p: (p.line, p.column)))
    return loaded


def _untagged(data: Any, place: Location) -> Location:
    """A place without the tags (`driver: bus`) that pydantic puts in where one of several classes was chosen."""
    found: list[str | int] = []
    for part in place:
        if isinstance(data, dict) and part not in data and part == data.get("driver"):
            continue
        found.append(part)
        data = data.get(part) if isinstance(data, dict) else data[part] if isinstance(data, list) and isinstance(part, int) else None
    return tuple(found)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) in (Union, UnionType, tuple, list, dict) or get_args(annotation):
        for argument in get_args(annotation):
            yield from _models(argument)


def _keys(model: type[BaseModel], place: Location) -> list[str]:
    """Keys allowed in the mapping at ``place``."""
    current, by_name = [model], False
    for part in place:
        if isinstance(part, int) or by_name:
            by_name = False
            continue
        found = []
        for candidate in current:
            for name, info in candidate.model_fields.items():
                if (info.alias or name) == part:
                    found += list(_models(info.annotation))
                    by_name = get_origin(info.annotation) is dict
        if not found:
            return []
        current = found
    return [info.alias or name for candidate in current for name, info in candidate.model_fields.items()]


def _tags(model: type[BaseModel], place: Location) -> list[str]:
    """What may stand as ``driver`` where one of several classes is chosen."""
    classes = [model]
    for part in place:
        classes = [found for c in classes for name, info in c.model_fields.items() if name == part for found in _models(info.annotation)]
    return [str(tag) for c in classes if "driver" in c.model_fields for tag in get_args(c.model_fields["driver"].annotation)]


_UNITS = re.compile(r"_(mm|cm|um|m|deg|rad|arcmin|ms|us|s|min|ns|hz|khz|ma|a|v|mnm|nm|n|c|ppm_k|n_um|kg|mm_s|mm_s2|deg_s|deg_s2|1_s|1_s2)$")


def _meant(model: type[BaseModel], item: dict[str, Any]) -> str:
    """The key that was meant by an unknown one with the wrong unit or a misspelling; empty when nothing is near."""
    if item["type"] != "extra_forbidden":
        return ""
    name, allowed = str(item["loc"][-1]), _keys(model, item["loc"][:-1])
    stem = _UNITS.sub("", name)
    same = [key for key in allowed if key != name and _UNITS.sub("", key) == stem]
    near = difflib.get_close_matches(name, allowed, n=1)
    return (same or near or [""])[0]


def _problem(loaded: Loaded[Any], model: type[BaseModel], item: dict[str, Any]) -> ConfigProblem:
    place: Location = tuple(item["loc"])
    dotted = ".".join(map(str, place))
    kind, context = item["type"], item.get("ctx", {})
    value = item.get("input")
    line, column = loaded.locate(place)
    if kind == "extra_forbidden":
        meant = _meant(model, item)
        if meant and _UNITS.sub("", meant) == _UNITS.sub("", str(place[-1])):
            text = f"unknown key {dotted!r}: this quantity is given as {meant!r} (mind the unit)"
        else:
            text = f"unknown key {dotted!r}" + (f"; did you mean {meant!r}?" if meant else "; delete it")
    elif kind == "missing":
        text = f"key {dotted!r} is missing; add it to this mapping"
    elif kind == "value_error":
        text = f"{context.get('error', item['msg'])}" + (f" ({dotted})" if dotted else "")
    elif kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        sign = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
        limit = " and ".join(f"{sign[k]} {v:g}" for k, v in context.items() if k in sign)
        text = f"{dotted} = {value!r} is out of range: it must be {limit}"
    elif kind == "finite_number":
        text = f"{dotted} = {value!r}: a finite number is needed"
    elif kind in ("float_type", "int_type") and isinstance(value, str):
        text = f"{dotted} = {value!r} is text, a number is needed" + (" (without quotes or unit)" if value[:1].strip("-+.").isdigit() else "")
    elif kind in ("model_type", "dict_type", "tuple_type"):
        names = (("nothing", type(None)), ("`key: value` lines", dict), ("a list", list))
        found = next((name for name, kind_of in names if isinstance(value, kind_of)), repr(value))
        text = f"{dotted}: expected {'a list' if kind == 'tuple_type' else '`key: value` lines'}, found {found}"
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        key = str(context.get("discriminator", "")).strip("'")
        given = value.get(key) if isinstance(value, dict) else None
        allowed = context.get("expected_tags") or ", ".join(repr(str(tag)) for tag in _tags(model, place))
        text = f"key '{dotted}.{key}' is missing; give one of {allowed}"
        if given is not None:
            text = f"{dotted}.{key} = {given!r}: it must be one of {allowed}"
        line, column = loaded.locate((*place, key))
    elif kind == "json_invalid":
        text = "holds text that is not valid Unicode"
    else:
        text = f"{dotted} = {value!r}: {item['msg'][0].lower()}{item['msg'][1:]}"
    return ConfigProblem(loaded.path, line, column, text)


def load_rig(path: Path) -> Loaded[RigConfig]:
    """A rig file."""
    return load_yaml_model(path, RigConfig, RIG_SCHEMA)


def load_mechanism(path: Path) -> Loaded[RigConfig] | Loaded[MechanismFile]:
    """The file with a ``mechanism:`` section: a rig file, or a mechanism alone."""
    path = Path(path)
    data, marks = _construct(path, _read(path))
    if data.get("schema") == RIG_SCHEMA:
        return _load(path, data, marks, RigConfig, RIG_SCHEMA)
    return _load(path, data, marks, MechanismFile, MECHANISM_SCHEMA)


def load_scenario(path: Path) -> Loaded[Scenario]:
    """A scenario file."""
    return load_yaml_model(path, Scenario, SCENARIO_SCHEMA)


def load_tolerances(path: Path) -> Loaded[ToleranceFile]:
    """A tolerance file."""
    return load_yaml_model(path, ToleranceFile, TOLERANCES_SCHEMA)


def load_transmission(path: Path) -> Loaded[TransmissionFile]:
    """A transmission file."""
    return load_yaml_model(path, TransmissionFile, TRANSMISSION_SCHEMA)


def load_import_map(path: Path) -> Loaded[ImportMap]:
    """An import map, its fields and units checked against the messages."""
    loaded = load_yaml_model(path, ImportMap, IMPORT_MAP_SCHEMA)
    found = [ConfigProblem(loaded.path, *loaded.locate(place), text) for place, text in problems(loaded.model)]
    if found:
        raise ConfigError(sorted(found, key=lambda p: (p.line, p.column)))
    return loaded


@dataclass(frozen=True, slots=True)
class Served:
    """A plant server file with the files that it names."""

    rig: RigConfig
    driver: BusDriver
    scenario: Path
    model: Path


def load_served(path: Path, overrides: Sequence[str] = ()) -> Served:
    """A plant server file and its rig file, over which ``overrides`` are laid; the rig must be one that is served."""
    loaded = load_yaml_model(path, ServedFile, SERVED_SCHEMA)
    rig = load_rig(resolve_reference(loaded, ("rig",)))
    if overrides:
        rig = apply_overrides(rig, overrides)
    driver = rig.model.rig
    if not isinstance(driver, BusDriver) or driver.world != "served":
        line, column = rig.locate(("rig", "world"))
        raise ConfigError([ConfigProblem(rig.path, line, column, "only a rig with `driver: bus` and `world: served` can be served")])
    return Served(rig.model, driver, resolve_reference(loaded, ("scenario",)), resolve_reference(rig, ("rig", "model")))


def resolve_reference(loaded: Loaded[Any], place: Location) -> Path:
    """The file that the value at ``place`` names, relative to the file it stands in; it must exist."""
    value: Any = loaded.data
    model: Any = loaded.model
    for part in place:
        model = getattr(model, str(part))
        value = value.get(part) if isinstance(value, dict) else None
    path = loaded.path.parent / str(model)
    if not path.is_file():
        line, column = loaded.locate(place)
        text = f"{'.'.join(map(str, place))}: no such file: {path}"
        raise ConfigError([ConfigProblem(loaded.path, line, column, text)])
    return path


def apply_overrides(loaded: Loaded[M], overrides: Sequence[str]) -> Loaded[M]:
    """``key.path=value`` texts laid over a file and checked with it. Raises ``ConfigError`` that names the text."""
    data = copy.deepcopy(loaded.data)
    marks = dict(loaded.marks)
    for text in overrides:
        name, separator, raw = text.partition("=")
        parts = name.strip().split(".")
        if not separator or not all(parts):
            raise ConfigError([ConfigProblem(None, 0, 0, f"--set {text}: expected KEY=VALUE, e.g. control.law=cascade")])
        try:
            value = yaml.load(raw, Loader=_Loader)
            json.dumps(value)
        except (yaml.YAMLError, ValueError, TypeError, RecursionError):
            raise ConfigError([ConfigProblem(None, 0, 0, f"--set {text}: the value is not valid YAML")]) from None
        target = data
        for part in parts[:-1]:
            target = target.setdefault(part, {}) if isinstance(target, dict) else None
        if not isinstance(target, dict):
            raise ConfigError([ConfigProblem(None, 0, 0, f"--set {text}: {name} is not a key of this file")])
        target[parts[-1]] = value
        marks[tuple(parts)] = (0, 0)  # no line of the file: it stands on the command line
    try:
        checked = validate_data(loaded.path, data, marks, type(loaded.model))
    except ConfigError as error:
        which = " ".join(f"--set {text}" for text in overrides)
        raise ConfigError([ConfigProblem(None, 0, 0, f"{which}: {p.message}") for p in error.problems]) from None
    return checked


def dump_resolved(model: BaseModel) -> str:
    """YAML text of a checked file with every default written out; it loads back to the same values."""
    return yaml.safe_dump(model.model_dump(mode="json", by_alias=True), sort_keys=False, allow_unicode=True)
