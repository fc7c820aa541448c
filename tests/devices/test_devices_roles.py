"""Host and device of a protocol are written apart: they share tables of constants only, else a mistake of one would be right for the other."""

from __future__ import annotations

import ast
from pathlib import Path

import spsp_ctrl.devices

FOLDER = Path(spsp_ctrl.devices.__file__).parent
IO = {"socket", "serial", "can", "canopen", "os", "time", "threading", "select", "asyncio", "pytrinamic", "mscl", "random", "datetime"}


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names} if node.module == "spsp_ctrl.devices" else {node.module or ""}
    return found


def test_roles_share_tables_only() -> None:
    # units of the rig and of the wire: arithmetic that families and the virtual rig share, no protocol
    assert imports(FOLDER / "scaling.py") <= {"__future__", "math", "struct"}
    names = sorted(p.stem for p in FOLDER.glob("*.py") if p.stem not in ("__init__", "scaling"))
    assert {n.rsplit("_", 1)[1] for n in names} == {"table", "host", "device", "eds"}
    for name in names:
        role = name.rsplit("_", 1)[1]
        allowed = {"host": {"table", "host"}, "device": {"table", "device"}, "table": set(), "eds": {"device"}}[role]
        ours = {i.split(".")[2] for i in imports(FOLDER / f"{name}.py") if i.startswith("spsp_ctrl.devices.")}
        assert {n.rsplit("_", 1)[1] for n in ours} <= allowed, f"{name} imports {ours}"


def test_protocols_do_no_io_and_know_no_clock() -> None:
    for path in FOLDER.glob("*.py"):
        assert not {i.split(".")[0] for i in imports(path)} & IO, path.name


def test_only_transports_touch_ports() -> None:
    """A port is opened in ``devices/transport`` and nowhere else; the codecs there are as pure as the protocols."""
    pure = {"base", "bus_load", "lockstep", "opening", "slcan_codec", "slcan_device", "trouble"}
    for path in sorted((FOLDER / "transport").glob("*.py")):
        used = {i.split(".")[0] for i in imports(path)} & IO
        assert path.stem not in pure or not used, f"{path.name} imports {used}"
    source = FOLDER.parent
    for path in sorted(source.rglob("*.py")):
        if "transport" not in path.parts:
            assert not {i.split(".")[0] for i in imports(path)} & {"serial", "canopen", "pytrinamic", "mscl"}, path
