"""Documentation read from classes: attribute docstrings, units from names, ranges and defaults of the config models."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterable
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo

UNITS = (
    # longest ending first; the same endings in messages and in config files
    ("_a_s_rad", "A s/rad"), ("_a_rad", "A/rad"), ("_rad_s2", "rad/s²"), ("_rad_s", "rad/s"), ("_m_rad", "m/rad"), ("_deg_s2", "°/s²"),
    ("_deg_s", "°/s"), ("_mm_s2", "mm/s²"), ("_mm_s", "mm/s"), ("_m_s", "m/s"), ("_nm_a", "N m/A"), ("_kg_m2", "kg m²"), ("_ppm_k", "ppm/K"),
    ("_n_um", "N/µm"), ("_1_s2", "1/s²"), ("_1_s", "1/s"), ("_microsteps_s", "microsteps/s"), ("microsteps", "microsteps"), ("counts", "counts"),
    ("lost_steps", "full steps"), ("_arcmin", "′"), ("_mrad", "mrad"), ("_rad", "rad"), ("_deg", "°"), ("_mm", "mm"), ("_um", "µm"), ("_nm", "N m"),
    ("_ns", "ns"), ("_ms", "ms"), ("_hz", "Hz"), ("_kg", "kg"), ("_m", "m"), ("_n", "N"), ("_a", "A"), ("_v", "V"), ("_c", "°C"), ("_s", "s"),
)  # fmt: skip


def unit_of(name: str) -> str:
    """Unit that the ending of a name states; empty where it has none."""
    return next((unit for ending, unit in UNITS if name.endswith(ending)), "")


def prose(text: str | None) -> str:
    """First paragraph of a docstring as Markdown on one line, fit for a table cell."""
    first = inspect.cleandoc(text or "").split("\n\n")[0]
    return " ".join(first.split()).replace("``", "`").replace("|", "\\|")


@cache
def attribute_docs(cls: type) -> dict[str, str]:
    """Text below each annotated attribute of a class, with those of its base classes."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if base.__module__.split(".")[0] != "spsp_ctrl":
            continue
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        assert isinstance(body, ast.ClassDef)
        for node, after in zip(body.body, body.body[1:], strict=False):
            if (
                isinstance(node, ast.AnnAssign)
                and isinstance(node.target, ast.Name)
                and isinstance(after, ast.Expr)
                and isinstance(after.value, ast.Constant)
                and isinstance(after.value.value, str)
            ):
                found[node.target.id] = prose(after.value.value)
    return found


def table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A Markdown table."""
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models(argument)]


def _kind(annotation: Any) -> str:
    """Type of a key in words."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(arguments[0])
    if origin is Literal:
        return " or ".join(f"`{value}`" for value in arguments)
    if origin in (Union, UnionType):
        return " or ".join(_kind(a) for a in arguments if a is not NoneType)
    if origin is tuple:
        return "list of " + (_kind(arguments[0]) if len(arguments) == 2 and arguments[1] is Ellipsis else ", ".join(map(_kind, arguments)))
    if origin is dict or annotation is dict:
        return "mapping"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"[{annotation.__name__}](#{annotation.__name__.lower()})"
    return {str: "text", float: "number", int: "whole number", bool: "`true` or `false`"}.get(annotation, "any value")


def _range(info: FieldInfo) -> str:
    words = []
    for item in info.metadata:
        if isinstance(item, Ge):
            words.append(f"≥ {item.ge:g}")
        elif isinstance(item, Gt):
            words.append(f"> {item.gt:g}")
        elif isinstance(item, Le):
            words.append(f"≤ {item.le:g}")
        elif isinstance(item, Lt):
            words.append(f"< {item.lt:g}")
        elif isinstance(item, MinLen) and item.min_length:
            words.append(f"at least {item.min_length} long")
        elif isinstance(item, MaxLen):
            words.append(f"at most {item.max_length} long")
    return ", ".join(words)


def _value(value: Any) -> str:
    if isinstance(value, BaseModel):
        return "{" + ", ".join(f"{k}: {_value(v)}" for k, v in value.model_dump(by_alias=True).items()) + "}"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k}: {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, bool):
        return str(value).lower()
    return "absent" if value is None else f"{value}"


def _default(info: FieldInfo) -> str:
    if info.is_required():
        return "**required**"
    value = info.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return "its own defaults"
    if value == "":
        return "empty"
    return f"`{_value(value)}`" if value is not None else "absent"


def config_tables(root: type[BaseModel], below: int = 3) -> str:
    """Every mapping of a file as a section with a table of its keys, the whole file first, each model once, in order of first use."""
    order, waiting = [], [root]
    while waiting:
        model = waiting.pop(0)
        if model in order:
            continue
        order.append(model)
        children = [child for info in model.model_fields.values() for child in _models(info.annotation)]
        waiting = [*children, *waiting]
    parts = []
    for model in order:
        docs = attribute_docs(model)
        rows = []
        for name, info in model.model_fields.items():
            key = info.alias or name
            kind = _kind(info.annotation)
            limit = _range(info)
            rows.append((f"`{key}`", unit_of(key), kind + (f"; {limit}" if limit else ""), _default(info), docs.get(name, "")))
        heading = f"{'#' * below} {model.__name__}"
        parts.append(f"{heading}\n\n{prose(model.__doc__)}\n\n" + table(("key", "unit", "value", "default", "meaning"), rows))
    return "\n\n".join(parts)
