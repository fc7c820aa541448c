"""Messages as CDR with ROS 2 schemas: one codec for every NamedTuple of ``messages``.

A message is laid out field by field in little-endian CDR (float -> float64, int -> int64, bool -> bool, a nested message in
place), so a payload has a fixed size and a log of one topic is an array.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, get_type_hints

from spsp_ctrl.messages import AxisSample, Control, Measurement, Timing, Truth

if TYPE_CHECKING:
    import numpy as np

HEADER = b"\x00\x01\x00\x00"
"""Encapsulation header: CDR, little-endian."""

RECORD = struct.Struct("<BQHIQQ")
"""Head of an MCAP message record: opcode, length of what follows, channel, sequence, log time, publish time."""
MESSAGE_OPCODE = 5
OPCODE_AND_LENGTH = 9

_ROS = {float: "float64", int: "int64", bool: "bool"}
_CODE = {float: "d", int: "q", bool: "?"}
_NUMPY = {float: "<f8", int: "<i8", bool: "?"}


def _fields(cls: type) -> list[tuple[str, type]]:
    return list(get_type_hints(cls).items())


def _leaves(cls: type, prefix: str = "") -> Iterator[tuple[str, type]]:
    for name, kind in _fields(cls):
        if kind in _CODE:
            yield prefix + name, kind
        else:
            yield from _leaves(kind, f"{prefix}{name}.")


def _nested(cls: type) -> Iterator[type]:
    for _, kind in _fields(cls):
        if kind not in _CODE:
            yield kind
            yield from _nested(kind)


def ros_name(cls: type) -> str:
    """Schema name of a message class."""
    return f"spsp_ctrl/msg/{cls.__name__}"


def ros_schema(cls: type) -> str:
    """``ros2msg`` text with the definitions of nested messages."""

    def body(c: type) -> str:
        return "".join(f"{_ROS.get(kind) or 'spsp_ctrl/' + kind.__name__} {name}\n" for name, kind in _fields(c))

    text = body(cls)
    for nested in dict.fromkeys(_nested(cls)):
        text += f"{'=' * 80}\nMSG: spsp_ctrl/{nested.__name__}\n{body(nested)}"
    return text


def _parts(cls: type, path: str) -> list[str]:
    """The leaves of a message as source text: ``path`` is the expression for the message, runs of leaves come starred."""
    if all(kind in _CODE for _, kind in _fields(cls)):
        return [f"*{path}"]
    return [
        item
        for i, (_, kind) in enumerate(_fields(cls))
        for item in ([f"{path}[{i}]"] if kind in _CODE else _parts(kind, f"{path}[{i}]"))
    ]


def _flattener(cls: type) -> Callable[[Any], tuple[Any, ...]]:
    """A function that turns a message into the flat tuple of its leaves (made from text once, as ``namedtuple`` itself does)."""
    space: dict[str, Any] = {}
    exec(f"def flatten(m):\n    return ({', '.join(_parts(cls, 'm'))},)", space)  # text built from our own class names only
    flatten: Callable[[Any], tuple[Any, ...]] = space["flatten"]
    return flatten


def _unflattener(cls: type) -> Callable[[tuple[Any, ...]], Any]:
    """The inverse: leaves to nested messages."""
    space: dict[str, Any] = {}
    position = 0

    def expression(c: type) -> str:
        nonlocal position
        space[c.__name__] = c
        items = []
        for _, kind in _fields(c):
            if kind in _CODE:
                items.append(f"v[{position}]")
                position += 1
            else:
                items.append(expression(kind))
        return f"{c.__name__}({', '.join(items)})"

    text = f"def build(v):\n    return {expression(cls)}"
    exec(text, space)
    build: Callable[[tuple[Any, ...]], Any] = space["build"]
    return build


@dataclass(frozen=True, slots=True)
class Codec:
    """How one message class lies in the log."""

    cls: type
    layout: struct.Struct
    flatten: Callable[[Any], tuple[Any, ...]]
    build: Callable[[tuple[Any, ...]], Any]

    @property
    def dtype(self) -> np.dtype[Any]:
        """A payload as one structured element, with dotted field names."""
        return _dtype(self.cls)

    def encode(self, message: NamedTuple) -> bytes:
        """CDR payload."""
        return self.layout.pack(HEADER, *self.flatten(message))

    def decode(self, payload: bytes) -> Any:
        """Message from a CDR payload."""
        return self.build(self.layout.unpack(payload)[1:])


def _placed(cls: type) -> Iterator[tuple[str, type, int, int]]:
    """Name, kind, padding before and offset of every leaf in a payload without its header."""
    offset = 0
    for name, kind in _leaves(cls):
        size = struct.calcsize("<" + _CODE[kind])
        pad = -offset % size
        yield name, kind, pad, offset + pad
        offset += pad + size


def _codec(cls: type) -> Codec:
    code = "<4s" + "".join("x" * pad + _CODE[kind] for _, kind, pad, _ in _placed(cls))
    return Codec(cls, struct.Struct(code), _flattener(cls), _unflattener(cls))


@cache
def _dtype(cls: type) -> np.dtype[Any]:
    import numpy as np  # here: the writer process packs nothing and must start soon

    names, kinds, _, offsets = zip(*_placed(cls), strict=True)
    size = _codec(cls).layout.size
    return np.dtype(
        {
            "names": list(names),
            "formats": [_NUMPY[kind] for kind in kinds],
            "offsets": [len(HEADER) + offset for offset in offsets],
            "itemsize": size,
        }
    )


TOPICS: dict[str, Codec] = {
    "/measurement": _codec(Measurement),
    "/control": _codec(Control),
    "/timing": _codec(Timing),
    "/truth": _codec(Truth),
    "/axis": _codec(AxisSample),
}
CYCLIC = ("/measurement", "/control", "/timing", "/truth")
"""What a rig records in every cycle; a log of a single axis holds ``/axis`` instead."""


def packer(head: str, topics: tuple[str, ...]) -> Callable[..., None]:
    """A function ``pack(buffer, at, t, k, first, *messages)`` that lays one message of each topic as MCAP message records, one after the other, into
    ``buffer`` from ``at`` on, in one ``struct`` call.

    ``t`` is the log time in ns, ``k`` the sequence, ``first`` a tuple of what ``head`` (codes of :mod:`struct`) lays out before the records. The
    channel of a topic is its place in ``CYCLIC``, counted from 1.
    """
    code, names, values = "<" + head, [], []
    space: dict[str, Any] = {"header": HEADER}
    for name in topics:
        codec, channel = TOPICS[name], CYCLIC.index(name) + 1
        record = struct.pack("<BQH", MESSAGE_OPCODE, RECORD.size - OPCODE_AND_LENGTH + codec.layout.size, channel)
        code += f"{len(record)}sIQQ" + codec.layout.format.removeprefix("<")
        space[f"record{channel}"] = record
        names.append(f"m{channel}")
        values += [f"record{channel}", "k", "t", "t", "header", *_parts(codec.cls, names[-1])]
    space["layout"] = struct.Struct(code).pack_into
    exec(f"def pack(b, at, t, k, first, {', '.join(names)}):\n    layout(b, at, *first, {', '.join(values)})", space)
    pack: Callable[..., None] = space["pack"]
    return pack


EVENT_SCHEMA = {
    "title": "spsp_ctrl.Event",
    "type": "object",
    "properties": {
        "stamp_ns": {"type": "integer"},
        "level": {"type": "string", "enum": ["info", "warning", "error"]},
        "id": {"type": "string"},
        "text": {"type": "string"},
    },
    "required": ["stamp_ns", "level", "id", "text"],
}
OPERATOR_SCHEMA = {
    "title": "spsp_ctrl.OperatorRequest",
    "type": "object",
    "properties": {
        "stamp_ns": {"type": "integer"},
        "verb": {"type": "string"},
        "value": {"type": "number"},
        "source": {"type": "string"},
    },
    "required": ["stamp_ns", "verb", "value", "source"],
}
JSON_TOPICS: dict[str, dict[str, Any]] = {"/events": EVENT_SCHEMA, "/operator": OPERATOR_SCHEMA}
