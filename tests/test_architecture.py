"""The arrows of the house: who may import whom, what a run on hardware and `--help` load, and that the tables (effects, faults) are complete.

Imports are read from the source with ``ast``, those inside functions included: an arrow drawn late is still an arrow. Imports under
``TYPE_CHECKING`` never run, so they may point at any package that the importing one may use, and at ``config`` types from everywhere.
"""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from spsp_ctrl.plant.effects import EFFECTS, Effect
from spsp_ctrl.safety.faults import BY_ID, BY_NUMBER, FAULTS

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "spsp_ctrl"

ARROWS: dict[str, set[str]] = {
    # package: what it may import (itself is always allowed, and the version in spsp_ctrl/__init__.py)
    "messages": set(),
    "config": {"messages"},
    "mechanism": {"messages", "config"},
    "control": {"messages", "config", "mechanism"},
    "safety": {"messages", "config", "mechanism"},
    "plant": {"messages", "config", "mechanism"},
    "devices": {"messages"},
    "rig": {"messages", "config", "mechanism", "plant", "devices"},
    "recording": {"messages", "config"},
    "runtime": {"messages", "config", "mechanism", "control", "safety", "rig", "recording"},
    "discrepancy": {"messages", "config", "mechanism", "plant", "recording", "runtime"},
    "tuning": {"messages", "config", "mechanism", "control", "plant", "rig", "recording", "runtime"},
    "experiments": {"messages", "config", "mechanism", "control", "safety", "plant", "rig", "recording", "runtime", "tuning"},
}
ARROWS["report"] = {*ARROWS, "discrepancy"}
ARROWS["cli"] = set(ARROWS)

PLANT_DOORS = {"rig/simulated.py", "rig/factory.py", "rig/world.py", "rig/served.py"}
"""The only files of the seam that know the plant: ``rig.base`` and rigs on a bus never do."""

EXCEPTIONS: dict[tuple[str, str], str] = {}
"""(file, imported module): why it is allowed against the table. Each one must still be needed."""

LOOP = (
    "messages.py",
    *(f"mechanism/{name}.py" for name in ("frames", "kinematics", "profile", "levelling")),
    *sorted(p.relative_to(SOURCE).as_posix() for d in ("control", "safety") for p in (SOURCE / d).glob("*.py")),
    "runtime/cycle.py",
)
"""What runs in every cycle: scalar Python, no arrays."""


class Import(NamedTuple):
    file: str
    line: int
    module: str
    typing_only: bool

    @property
    def target(self) -> str:
        parts = self.module.split(".")
        return parts[1] if parts[0] == "spsp_ctrl" and len(parts) > 1 else ""


def _imports(path: Path) -> Iterator[Import]:
    file = path.relative_to(SOURCE).as_posix()

    def walk(node: ast.AST, typing_only: bool) -> Iterator[Import]:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for child in node.body:
                yield from walk(child, True)
            for child in node.orelse:
                yield from walk(child, typing_only)
            return
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(file, node.lineno, alias.name, typing_only)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: relative import; write the whole name"
            module = node.module or ""
            if module == "spsp_ctrl":  # `from spsp_ctrl import plant` names the package in the alias
                for alias in node.names:
                    known = alias.name in ARROWS
                    yield Import(file, node.lineno, f"spsp_ctrl.{alias.name}" if known else module, typing_only)
            else:
                yield Import(file, node.lineno, module, typing_only)
        for child in ast.iter_child_nodes(node):
            yield from walk(child, typing_only)

    yield from walk(ast.parse(path.read_text(encoding="utf-8")), False)


IMPORTS = [found for path in sorted(SOURCE.rglob("*.py")) for found in _imports(path)]


def _package(file: str) -> str:
    return file.split("/")[0].removesuffix(".py")


def test_every_package_has_its_row() -> None:
    packages = {_package(p.relative_to(SOURCE).as_posix()) for p in SOURCE.rglob("*.py")} - {"__init__", "__main__"}
    assert packages <= ARROWS.keys(), f"new in src/spsp_ctrl: {packages - ARROWS.keys()}; give it a row in ARROWS"


def test_the_table_has_no_circle() -> None:
    left = dict(ARROWS)
    while left:
        free = [name for name, uses in left.items() if not (uses - {name}) & left.keys()]
        assert free, f"a circle among {sorted(left)}"
        for name in free:
            del left[name]


def test_imports_point_downwards() -> None:
    wrong, used = [], set()
    for found in IMPORTS:
        package, target = _package(found.file), found.target
        if not target or target == package or package == "__init__" or target in ARROWS[package]:
            continue
        if found.typing_only and target == "config":
            continue
        if (found.file, found.module) in EXCEPTIONS:
            used.add((found.file, found.module))
            continue
        wrong.append(f"src/spsp_ctrl/{found.file}:{found.line}: {package} must not import {found.module}")
    assert not wrong, "\n".join(wrong)
    assert used == EXCEPTIONS.keys(), f"no longer needed: {EXCEPTIONS.keys() - used}"


def test_the_reader_of_imports_sees_late_and_typing_imports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "SOURCE", tmp_path)
    path = tmp_path / "x.py"
    path.write_text(
        "from spsp_ctrl import plant\n"
        "if TYPE_CHECKING:\n    from spsp_ctrl.config.rig import RigConfig\n"
        "def f():\n    import numpy as np, numba\n",
        encoding="utf-8",
    )
    assert [(i.module, i.typing_only) for i in _imports(path)] == [
        ("spsp_ctrl.plant", False),
        ("spsp_ctrl.config.rig", True),
        ("numpy", False),
        ("numba", False),
    ]


def test_only_the_simulated_rig_knows_the_plant() -> None:
    found = {i.file for i in IMPORTS if _package(i.file) == "rig" and i.target == "plant"}
    assert found <= PLANT_DOORS


def test_numba_is_loaded_in_one_place() -> None:
    assert {i.file for i in IMPORTS if i.module.split(".")[0] == "numba"} == {"plant/compile.py"}


def test_the_loop_is_scalar() -> None:
    heavy = {"numpy", "scipy", "numba", "filterpy", "control"}
    wrong = [i for i in IMPORTS if i.file in LOOP and not i.typing_only and i.module.split(".")[0] in heavy]
    assert not wrong
    assert all((SOURCE / name).is_file() for name in LOOP)


def test_cli_modules_import_nothing_heavy_at_the_top() -> None:
    """Beside the subprocess below: names the line."""
    for path in sorted((SOURCE / "cli").glob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                light = name.split(".")[0] in sys.stdlib_module_names or name in ("click", "spsp_ctrl") or name.startswith("spsp_ctrl.cli")
                assert light, f"{path.name}:{node.lineno}: {name} belongs into the function that needs it"


def _loaded(code: str) -> set[str]:
    """Top packages (and our sub-packages) in ``sys.modules`` of a fresh interpreter after ``code``."""
    names = "{'.'.join(m.split('.')[:2]) if m.startswith('spsp_ctrl') else m.split('.')[0] for m in sys.modules}"
    script = f"{code}\nimport sys\nprint('\\n--', *{names})"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.rsplit("--", 1)[1].split())


def _modules(*packages: str) -> str:
    names = ["spsp_ctrl.runtime.loop", "spsp_ctrl.rig.base"]
    for package in packages:
        names += [f"spsp_ctrl.{package}.{p.stem}" for p in sorted((SOURCE / package).glob("*.py")) if p.stem not in ("__init__", "writer_process")]
    return "import " + ", ".join(names)


def test_a_run_on_hardware_loads_neither_plant_nor_numba() -> None:
    loaded = _loaded(_modules("control", "safety", "recording", "runtime"))
    assert {"spsp_ctrl.runtime", "spsp_ctrl.control", "spsp_ctrl.recording"} <= loaded
    assert not loaded & {"numba", "llvmlite", "spsp_ctrl.plant", "scipy", "matplotlib"}


def test_the_law_loads_no_arrays() -> None:
    loaded = _loaded("import spsp_ctrl.runtime.cycle, spsp_ctrl.runtime.replay, spsp_ctrl.mechanism.levelling, spsp_ctrl.mechanism.profile")
    assert not loaded & {"numpy", "numba", "scipy", "spsp_ctrl.plant", "spsp_ctrl.rig"}


def test_help_of_every_command_loads_nothing_heavy() -> None:
    code = """
import click
from spsp_ctrl.cli import cli
def visit(command, path):
    with click.Context(command, info_name=path) as context:
        assert command.get_help(context)
        for name in command.list_commands(context) if isinstance(command, click.Group) else ():
            visit(command.get_command(context, name), path + ' ' + name)
visit(cli, 'spsp-ctrl')
try:
    cli(['--help'])
except SystemExit as end:
    assert not end.code
"""
    loaded = _loaded(code)
    assert "spsp_ctrl.cli" in loaded
    assert not loaded & {"numpy", "scipy", "pydantic", "numba", "mcap", "rich", "yaml", "matplotlib", "control"}
    assert {name for name in loaded if name.startswith("spsp_ctrl.")} == {"spsp_ctrl.cli"}


def test_every_effect_file_is_in_the_registry() -> None:
    found: list[Effect] = []
    for path in sorted((SOURCE / "plant" / "effects").glob("*.py")):
        if path.stem in ("__init__", "base"):
            continue
        module = importlib.import_module(f"spsp_ctrl.plant.effects.{path.stem}")
        own = [value for value in vars(module).values() if isinstance(value, Effect)]
        assert own, f"{path.name} defines no effect"
        found += own
    assert {e.name for e in found} == {e.name for e in EFFECTS}
    assert [n for n, k in Counter(e.name for e in EFFECTS).items() if k > 1] == []
    assert [n for n, k in Counter(q.name for e in EFFECTS for q in e.parameters).items() if k > 1] == []


def test_every_effect_acts_somewhere_in_the_kernel() -> None:
    """A registry row without the call in its stage would be a parameter that does nothing."""
    text = "".join(p.read_text(encoding="utf-8") for p in [*(SOURCE / "plant" / "stages").glob("*.py"), SOURCE / "plant" / "kernel.py"])
    used = set(re.findall(r"\b[AGL]\.(\w+)", text + (SOURCE / "plant" / "axis.py").read_text(encoding="utf-8")))
    used |= set(re.findall(r"\bG\.(\w+)", (SOURCE / "rig" / "simulated.py").read_text(encoding="utf-8")))  # the transport delay of a frame
    unused = [f"{e.name}: {q.name}" for e in EFFECTS for q in e.parameters if q.name not in used]
    assert not unused


def test_every_fault_is_unique_and_used() -> None:
    assert len(BY_ID) == len(BY_NUMBER) == len(FAULTS)
    assert sorted(BY_NUMBER) == list(range(1, len(FAULTS) + 1)), "0 means no fault; numbers stand in logs and are not used again"
    for fault in FAULTS:
        assert re.fullmatch(r"[a-z]+(-[a-z]+)*", fault.id)
        assert fault.text
        assert fault.check
    raised: set[str] = set()
    for path in SOURCE.rglob("*.py"):
        raised |= set(re.findall(r"BY_ID\[\"([^\"]+)\"\]", path.read_text(encoding="utf-8")))
    assert raised == BY_ID.keys()
