"""Tables of the pages in ``docs/``, made from the code that they describe.

``python -m tools.make_docs`` rewrites what stands between ``<!-- generated: NAME -->`` and ``<!-- end -->``; with ``--check`` it writes
nothing, names what is out of date and exits 1. Everything outside the markers is written by hand.
"""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_type_hints

from spsp_ctrl import messages
from spsp_ctrl.cli import common
from spsp_ctrl.config.import_map import ImportMap
from spsp_ctrl.config.rig import MechanismFile, RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.config.served import ServedFile
from spsp_ctrl.config.units import UNITS, spellings
from spsp_ctrl.plant import layout
from spsp_ctrl.plant.axis import INPUTS, OUTPUTS
from spsp_ctrl.plant.axis_model import AXIS_KEYS, AxisController, AxisFile, load_axis_model
from spsp_ctrl.plant.effects import EFFECTS, Parameter
from spsp_ctrl.plant.model import ModelFile, Quantity, effect_keys, key, load_model
from spsp_ctrl.recording.schema import JSON_TOPICS, TOPICS, Codec, ros_name
from spsp_ctrl.runtime.operator import VERBS
from spsp_ctrl.safety.faults import FAULTS, Reaction
from tools.doc_fields import attribute_docs, config_tables, prose, table, unit_of
from tools.doc_words import EXIT_WORDS, FIELDS, INNER, REACTIONS, RIG_OUTPUTS, TOPIC_WORDS, WORKING

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
MARKER = re.compile(r"(<!-- generated: ([a-z-]+) -->\n).*?(<!-- end -->)", re.S)
_ROS = {"float": "float64", "int": "int64", "bool": "bool"}


def field_meaning(cls: type, name: str) -> str:
    """Meaning of a message field: its docstring, else the words of this folder for names that many messages share."""
    found = attribute_docs(cls).get(name) or FIELDS.get(f"{cls.__name__}.{name}") or FIELDS.get(name, "")
    return found or prose(_axis_word(name))


def _axis_word(name: str) -> str:
    """``joint_roll_rate_rad_s`` and its sisters."""
    match = re.match(r"(platform|joint|base|motor|azimuth|heading|current|rod_force|screw|lever)?_?(pitch|roll|yaw)?_?(rate|accel)?_?", name)
    assert match
    what, axis, rate = match.groups()
    of = {
        "platform": "attitude of the platform in space", "joint": "joint angle", "base": "tilt of the base", "motor": "motor shaft",
        "azimuth": "azimuth joint angle", "heading": "heading of the platform in space", "current": "motor current", "rod_force": "force in the rod",
        "screw": "screw",
    }.get(what or "", "")  # fmt: skip
    if not of:
        return ""
    kind = {"rate": "rate of the ", "accel": "acceleration of the "}.get(rate or "", "")
    return f"{kind}{of}" + (f", {axis}" if axis else "")


def message_table(cls: type) -> str:
    """Fields of one message class."""
    rows = []
    for name, hint in get_type_hints(cls).items():
        kind = _ROS.get(hint.__name__) or f"[{hint.__name__}](#{hint.__name__.lower()})"
        rows.append((f"`{name}`", kind, unit_of(name), field_meaning(cls, name)))
    return table(("field", "type", "unit", "meaning"), rows)


def message_classes(cls: type, seen: list[type]) -> list[type]:
    """A message class and those inside it, added to ``seen``."""
    if cls not in seen and hasattr(cls, "_fields"):
        seen.append(cls)
        for hint in get_type_hints(cls).values():
            message_classes(hint, seen)
    return seen


def topics() -> str:
    """All topics."""
    rows = [
        (f"`{topic}`", f"`{ros_name(codec.cls)}`", "CDR", str(codec.layout.size), *TOPIC_WORDS[topic])
        for topic, codec in TOPICS.items()
    ]
    rows += [(f"`{topic}`", f"`{schema['title']}`", "JSON", "", *TOPIC_WORDS[topic]) for topic, schema in JSON_TOPICS.items()]
    return table(("topic", "schema", "encoding", "bytes with header", "rate", "same seed, same bytes", "content"), rows)


def log_fields() -> str:
    """Every message class of every topic."""
    seen: list[type] = []
    for codec in TOPICS.values():
        message_classes(codec.cls, seen)
    return "\n\n".join(f"### {cls.__name__}\n\n{prose(cls.__doc__)}\n\n{message_table(cls)}" for cls in seen)


def json_fields() -> str:
    """The JSON topics."""
    parts = []
    for topic, schema in JSON_TOPICS.items():
        rows = []
        for name, what in schema["properties"].items():
            values = " or ".join(f"`{v}`" for v in what["enum"]) if "enum" in what else what["type"]
            rows.append((f"`{name}`", values, unit_of(name), FIELDS.get(f"{topic}.{name}") or field_meaning(messages.OperatorRequest, name)))
        parts.append(f"`{topic}`\n\n" + table(("field", "type", "unit", "meaning"), rows))
    return "\n\n".join(parts) + f"\n\nVerbs that the operator channel takes: {', '.join(f'`{v}`' for v in VERBS)}."


def enumerations() -> str:
    """The numbers that stand for names."""
    rows = []
    for cls in (messages.Mode, messages.Limited, messages.ResolverStatus, messages.ReferenceKind):
        values = ", ".join(f"{int(member)} `{member.name}`" for member in cls.__members__.values())
        rows.append((cls.__name__, prose(cls.__doc__), values))
    return table(("name", "meaning", "values"), rows)


def offsets() -> str:
    """Offsets in ``/measurement``, as an example that other software can check itself against."""

    def rows(codec: Codec) -> Iterator[tuple[str, ...]]:
        assert codec.dtype.fields is not None
        for name, (kind, offset, *_) in list(codec.dtype.fields.items())[:14]:
            yield str(offset), f"`{name}`", str(kind)

    return table(("byte", "field", "type"), rows(TOPICS["/measurement"]))


def _si(name: str) -> str:
    return unit_of(name) or "1"


def state() -> str:
    """The state vector."""
    rows = []
    for i, axis in enumerate(layout.AXES):
        rows += [(str(i * layout.N_AXIS_STATE + k), f"`{axis}: X.{n}`", u, doc) for k, (n, u, doc) in enumerate(layout.AXIS_STATE)]
    rows += [(str(getattr(layout.S, n)), f"`S.{n}`", u, doc) for n, u, doc in layout.RIG_STATE]
    return table(("index", "name", "unit", "meaning"), rows)


def inputs() -> str:
    """Inputs of one control instant."""
    return table(("index", "name", "unit", "meaning"), [(str(i), f"`U.{n}`", u, doc) for i, (n, u, doc) in enumerate(layout.INPUTS)])


def commands() -> str:
    """The command row."""
    return table(("index", "name", "unit", "meaning"), [(str(i), f"`C.{n}`", *INNER[n]) for i, n in enumerate(layout.COMMAND)])


def outputs() -> str:
    """Truth and readings."""
    rows = [(str(i), f"`O.{n}`", _si(n), field_meaning(messages.Truth, n)) for i, n in enumerate(layout.TRUTH)]
    rows += [(str(layout.N_TRUTH + i), f"`O.{n}`", *RIG_OUTPUTS[n]) for i, n in enumerate(layout.SENSED)]
    return table(("index", "name", "unit", "meaning"), rows)


def work() -> str:
    """Scratch that is constant over one cycle."""
    return table(("index", "name", "unit", "meaning"), [(str(i), f"`W.{n}`", *WORKING[n]) for i, n in enumerate(layout.WORK)])


def sizes() -> str:
    """Lengths of the arrays."""
    each, own = layout.N_AXIS_PARAMETERS, len(layout.GLOBAL_PARAMETERS)
    rows = [
        ("parameters", "`p`", str(layout.N_PARAMETERS), f"{each} for each actuator, then {own} of the rig"),
        ("state", "`x`", str(layout.N_STATE), f"{layout.N_AXIS_STATE} for each actuator, then {len(layout.RIG_STATE)} of the rig"),
        ("inputs", "`u`", str(layout.N_INPUT), f"one row for each control instant; the last {layout.N_NOISE} are noise"),
        ("command", "`command`", str(layout.N_COMMAND), "acts during one cycle"),
        ("output", "`out`", str(layout.N_OUTPUT), f"{layout.N_TRUTH} true values in the order of `/truth`, then {len(layout.SENSED)} readings"),
        ("work", "`w`", str(layout.N_WORK), "scratch, filled by `prepare` at the start of each cycle"),
    ]
    return table(("array", "in the code", "length", "content"), rows)


def _design(quantity: Quantity | None) -> tuple[str, str]:
    return (f"{quantity.value:g}", quantity.source.replace("|", "\\|")) if quantity else ("", "")


def _bounds(parameter: Parameter, unit: str) -> str:
    factor = UNITS[unit][1] if unit in UNITS else 1.0
    return f"{parameter.low / factor:.6g} … {parameter.high / factor:.6g}"


def _parameters(known: dict[str, Parameter], given: dict[str, Quantity], axes: dict[str, str] | None = None) -> str:
    rows = []
    for name, parameter in known.items():
        quantity = given.get(name)
        value, source = _design(quantity)
        value = (axes or {}).get(name, value)
        unit = quantity.unit if quantity else parameter.unit
        rows.append((f"`{name}`", parameter.doc, unit, _bounds(parameter, unit), value, source))
    return table(("key", "meaning", "unit", "bounds in it", "as designed", "source"), rows)


def _as_designed() -> ModelFile:
    return load_model(ROOT / "config" / "model.yaml").file


def actuator() -> str:
    """Base parameters of an actuator."""
    return _parameters({key(q): q for q in layout.AXIS_BASE}, _as_designed().actuator)


def rig_parameters() -> str:
    """Base parameters of the rig."""
    return _parameters({key(q): q for q in layout.GLOBAL_BASE}, _as_designed().rig)


def effects() -> str:
    """The effect registry."""
    file, parts = _as_designed(), []
    axis_file = _axis_as_designed()
    for effect in EFFECTS:
        alone = effect.kind == "axis"
        entries = [entry for entry in (axis_file.effects if alone else file.effects) if entry.effect == effect.name]
        given: dict[str, Quantity] = {}
        axes: dict[str, str] = {}
        for entry in entries:
            given |= entry.parameters
            if getattr(entry, "axis", "both") != "both":
                for name, quantity in entry.parameters.items():
                    axes[name] = (axes[name] + ", " if name in axes else "") + f"{_design(quantity)[0]} ({getattr(entry, 'axis', '')})"
        where = "single axis only" if alone else "one set for each actuator" if effect.per_axis else "one set for the rig"
        present = "" if entries else " Not in the as-designed model."
        text = f"### {effect.name}\n\n{effect.doc} Stage: {effect.stage}; {where}.{present}\n\n"
        parts.append(text + _parameters(effect_keys(effect), given, axes))
    return "\n\n".join(parts)


def _axis_as_designed() -> AxisFile:
    return load_axis_model(ROOT / "config" / "axis.yaml").file


def axis_parameters() -> str:
    """Section ``axis:`` of the model of a single axis."""
    return _parameters(AXIS_KEYS, _axis_as_designed().axis)


def axis_state() -> str:
    """State of a single axis behind that of its actuator."""
    first = layout.N_AXIS_STATE
    return table(("index", "name", "unit", "meaning"), [(str(first + i), f"`Y.{n}`", u, doc) for i, (n, u, doc) in enumerate(layout.LOAD_STATE)])


def axis_arrays() -> str:
    """Inputs and outputs of a single axis."""
    rows = [(str(i), f"`IN.{name}`", _si(name)) for i, name in enumerate(INPUTS)]
    rows += [(str(i), f"`OUT.{name}`", _si(name)) for i, name in enumerate(OUTPUTS)]
    return table(("index", "name", "unit"), rows)


def hypotheses() -> str:
    """The names that a diagnosis may give."""
    rows = []
    for effect in EFFECTS:
        for h in effect.hypotheses:
            free = "<br>".join(f"`{q.name}` {q.low:g} … {q.high:g}" + (" (of the session)" if q.nuisance else "") for q in h.free)
            twins = ", ".join(f"`{twin}`" for twin in h.twins)
            where = {"axis": "single axis", "platform": "platform", "both": "both"}[effect.kind]
            rows.append((f"[`{h.name}`](#{h.name})", effect.stage, where, free, ", ".join(h.channels), ", ".join(h.regimes), twins, prose(h.source)))
    return table(("name", "stage", "where", "what is free, in SI", "channels", "regimes", "twins", "form"), rows)


def units() -> str:
    """What may stand behind ``unit:``."""
    si = dict.fromkeys(unit for unit, _ in UNITS.values())
    return table(("SI unit inside", "spellings"), [(unit, ", ".join(f"`{s}`" for s in spellings(unit))) for unit in si])


def faults() -> str:
    """The fault table."""
    rows = [(str(f.number), f"`{f.id}`", f.reaction.name, f.text, f.check) for f in FAULTS]
    return table(("number", "id", "reaction", "what happened", "what to check"), rows)


def reactions() -> str:
    """The classes of reaction."""
    docs = attribute_docs(Reaction)
    source = inspect.getsource(Reaction)
    assert all(r.name in source for r in Reaction)
    return table(("reaction", "meaning"), [(r.name, docs.get(r.name) or REACTIONS[r.name]) for r in Reaction])


def exit_codes() -> str:
    """Exit codes of every command."""
    codes = {0: "", **{int(v): n for n, v in vars(common).items() if n.startswith("EXIT_") and isinstance(v, int)}}
    return table(("code", "meaning"), [(str(code), EXIT_WORDS[code]) for code in sorted(codes)])


GENERATORS: dict[str, Callable[[], Any]] = {
    "topics": topics,
    "log-fields": log_fields,
    "json-fields": json_fields,
    "enumerations": enumerations,
    "offsets": offsets,
    "sizes": sizes,
    "state": state,
    "inputs": inputs,
    "command": commands,
    "outputs": outputs,
    "work": work,
    "actuator": actuator,
    "rig-parameters": rig_parameters,
    "effects": effects,
    "units": units,
    "axis-parameters": axis_parameters,
    "axis-controller": lambda: config_tables(AxisController),
    "axis-state": axis_state,
    "axis-arrays": axis_arrays,
    "hypotheses": hypotheses,
    "faults": faults,
    "reactions": reactions,
    "exit-codes": exit_codes,
    "scenario-keys": lambda: config_tables(Scenario),
    "import-map-keys": lambda: config_tables(ImportMap),
    "rig-keys": lambda: config_tables(RigConfig),
    "served-keys": lambda: config_tables(ServedFile),
    "mechanism-keys": lambda: config_tables(MechanismFile).split("\n\n### ")[0],
}


def render(text: str) -> tuple[str, list[str]]:
    """A page with every table made anew, and the names of the tables that changed. Raises ``KeyError`` for a marker without generator."""
    changed = []

    def replace(match: re.Match[str]) -> str:
        fresh = f"{match[1]}\n{GENERATORS[match[2]]()}\n\n{match[3]}"
        if fresh != match[0]:
            changed.append(match[2])
        return fresh

    return MARKER.sub(replace, text), changed


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 when a page is out of date")
    check = parser.parse_args().check
    stale = 0
    for path in sorted(DOCS.glob("*.md")):
        fresh, changed = render(path.read_text(encoding="utf-8"))
        if changed:
            stale += 1
            print(f"{path.relative_to(ROOT)}: {', '.join(changed)} {'out of date; run python -m tools.make_docs' if check else 'rewritten'}")
            if not check:
                path.write_text(fresh, encoding="utf-8")
    return 1 if check and stale else 0


if __name__ == "__main__":
    raise SystemExit(main())
