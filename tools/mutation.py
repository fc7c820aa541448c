"""Mutation testing of ``safety/`` and ``control/limits.py``: does a test fail when the code is changed?

``python -m tools.mutation`` makes one small change at a time (an operator, a comparison, a number, a condition) and runs the tests of these
modules in a fork of this process. A mutant that no test notices has survived; survivors are printed with their line. What is text in the fault table
is left out. ``--share 0.3`` takes a part, the same for the same seed.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import click

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "spsp_ctrl"
TESTS = {
    "control/limits.py": ("tests/control/test_limits.py",),
    "safety/supervisor.py": ("tests/safety/test_supervisor.py",),
    "safety/axis.py": ("tests/safety/test_axis.py",),
    "safety/imu.py": ("tests/safety/test_imu.py",),
    "safety/azimuth.py": ("tests/safety/test_azimuth.py",),
    "safety/temperature.py": ("tests/safety/test_temperature.py",),
    "safety/consistency.py": ("tests/safety/test_consistency.py",),
    "safety/judge.py": ("tests/safety/test_judge.py",),
    "safety/steps.py": ("tests/safety/test_steps.py",),
    "safety/faults.py": ("tests/safety/test_supervisor.py",),
}
"""Modules and the tests that watch over each of them."""
TIMEOUT_S = 60
_SWAPS: dict[type, tuple[type, ...]] = {
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt), ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,), ast.And: (ast.Or,), ast.Or: (ast.And,), ast.BitOr: (ast.BitAnd,), ast.USub: (ast.UAdd,),
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change."""

    file: str
    line: int
    what: str
    code: str
    """The whole module with it."""


def _places(tree: ast.Module) -> Iterator[ast.AST]:
    """What is code: no annotations, docstrings, or decorators."""

    def walk(node: ast.AST) -> Iterator[ast.AST]:
        for name, child in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "bases", "keywords") and not isinstance(node, ast.Call):
                continue
            for item in child if isinstance(child, list) else [child]:
                if not isinstance(item, ast.AST) or isinstance(item, ast.arguments | ast.Import | ast.ImportFrom):
                    continue
                if isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant):
                    continue
                if isinstance(item, ast.AnnAssign):
                    if item.value is not None:
                        yield from walk(ast.Expr(item.value))
                    continue
                yield item
                yield from walk(item)

    yield from walk(tree)


def _changes(node: ast.AST) -> Iterator[tuple[str, str, object]]:
    """Field to replace, in words, and by what."""
    if isinstance(node, ast.BinOp | ast.BoolOp | ast.UnaryOp):
        for kind in _SWAPS.get(type(node.op), ()):
            yield "op", f"{type(node.op).__name__} -> {kind.__name__}", kind()
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "operand", "not x -> not not x", ast.UnaryOp(ast.Not(), node.operand)
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for kind in _SWAPS.get(type(node.ops[0]), ()):
            yield "ops", f"{type(node.ops[0]).__name__} -> {kind.__name__}", [kind()]
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        yield "value", f"{node.value} -> {node.value + 1}", node.value + 1
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield "value", f"{node.value} -> {not node.value}", not node.value
    if isinstance(node, ast.If | ast.IfExp):
        yield "test", "condition -> True", ast.Constant(True)
        yield "test", "condition -> False", ast.Constant(False)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("min", "max"):
        other = "max" if node.func.id == "min" else "min"
        yield "func", f"{node.func.id} -> {other}", ast.Name(other, ast.Load())


def mutants(file: str) -> Iterator[Mutant]:
    """All changes of one module."""
    text = (SOURCE / file).read_text(encoding="utf-8")
    tree = ast.parse(text)
    for node in list(_places(tree)):
        if file == "safety/faults.py" and getattr(node, "lineno", 0) < text[: text.index("BY_ID")].count("\n"):
            continue
        for field, words, value in _changes(node):
            before = getattr(node, field)
            setattr(node, field, value)
            code = ast.unparse(ast.fix_missing_locations(tree))
            setattr(node, field, before)
            yield Mutant(file, getattr(node, "lineno", 0), words, code)


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from changed source."""

    def __init__(self, mutant: Mutant) -> None:
        self._name = "spsp_ctrl." + mutant.file.removesuffix(".py").replace("/", ".")
        self._code = mutant.code

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Only for that module."""
        return importlib.util.spec_from_loader(name, self) if name == self._name else None

    def exec_module(self, module: ModuleType) -> None:
        """Run the changed code."""
        exec(compile(self._code, self._name, "exec"), module.__dict__)


def killed(mutant: Mutant | None) -> bool:
    """Whether a test fails (or does not end in time) under ``mutant``; None: the code as it is."""
    files = TESTS[mutant.file] if mutant else tuple(dict.fromkeys(f for tests in TESTS.values() for f in tests))
    child = os.fork()
    if child == 0:
        code = 1
        try:
            signal.alarm(TIMEOUT_S if mutant else 0)
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, 1)
            os.dup2(null, 2)
            if mutant is not None:
                sys.meta_path.insert(0, _Mutated(mutant))
            import pytest

            quiet = ["-x", "-q", "-p", "no:cacheprovider", "--no-header", "-W", "ignore"]
            code = int(pytest.main([*quiet, *(str(ROOT / f) for f in files)]))
        except BaseException:
            code = 1
        finally:
            os._exit(1 if code else 0)
    _, status = os.waitpid(child, 0)
    return status != 0


def _preload() -> None:
    """What a child need not load again: everything that does not depend on what is changed."""
    import hypothesis  # noqa: F401
    import numpy  # noqa: F401
    import pytest  # noqa: F401

    import spsp_ctrl.config.loader
    import spsp_ctrl.mechanism.kinematics
    import spsp_ctrl.mechanism.levelling
    import spsp_ctrl.mechanism.profile
    import spsp_ctrl.messages  # noqa: F401


@click.command(epilog="Example: python -m tools.mutation --only safety/axis.py")
@click.option("--only", default="", help="Only modules that begin with this.")
@click.option("--share", default=1.0, type=click.FloatRange(0.0, 1.0), help="Part of the mutants to try.")
@click.option("--seed", default=1, help="Which part.")
def main(only: str, share: float, seed: int) -> None:
    """Make small changes, run the tests, print the share that was noticed and what survived. Exit 1 below 90 %."""
    with contextlib.suppress(ValueError):
        sys.path.remove("")
    _preload()
    chosen = random.Random(seed)
    found = [m for file in TESTS if file.startswith(only) for m in mutants(file) if chosen.random() < share]
    began = time.monotonic()
    survivors: list[Mutant] = []
    counts: dict[str, list[int]] = {}
    for mutant in found:
        row = counts.setdefault(mutant.file, [0, 0])
        row[1] += 1
        if killed(mutant):
            row[0] += 1
        else:
            survivors.append(mutant)
            print(f"survived {mutant.file}:{mutant.line}: {mutant.what}", flush=True)
    for file, (dead, total) in counts.items():
        print(f"{file:24} {dead:4}/{total:<4} {100.0 * dead / total:5.1f} %")
    dead, total = len(found) - len(survivors), len(found)
    print(f"killed {dead}/{total} = {100.0 * dead / max(total, 1):.1f} % in {time.monotonic() - began:.0f} s")
    raise SystemExit(0 if total and dead >= 0.9 * total else 1)


if __name__ == "__main__":
    main()
