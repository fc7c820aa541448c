"""The program under exam, run as anyone would: a command on three logs. And what its ``diagnosis.json`` says, in the exam's words."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from tools.blind_exam.machine import UNITS

TIMEOUT_S = 900.0
FLAGS = ("unexplained", "partly-explained", "not-understood", "invalid")
"""Verdicts that warn: the names, if any, are not the whole story."""


class Named(NamedTuple):
    """One effect that the diagnosis names."""

    effect: str
    members: frozenset[str]
    """Its class: every name that is given with it as not to be told apart."""
    where: str
    values: dict[str, tuple[float, float]]
    """Value and standard deviation in SI."""


class Finding(NamedTuple):
    """What the exam reads of a diagnosis."""

    verdict: str
    named: tuple[Named, ...]
    unexplained: int
    closed: dict[str, float]
    """Gap closed on held-out motion, by channel that was above its floor."""
    sentinel: bool
    following: str | None = None
    """File of the next experiment."""

    @property
    def flagged(self) -> bool:
        return self.unexplained > 0 or self.verdict in FLAGS


class Ran(NamedTuple):
    """How the program ended."""

    code: int
    seconds: float
    message: str


GAP = 1.2
"""A channel has a gap to close from this ratio of residual to floor on."""


def command(train: Path, commissioning: Path, held: Path, model: Path, out: Path, seed: int, more: tuple[Path, ...] = ()) -> list[str]:
    """The command line of one diagnosis; ``more``: further training logs."""
    logs = [str(train), *map(str, more), "--commissioning", str(commissioning), "--held-out", str(held)]
    return [sys.executable, "-m", "spsp_ctrl.cli", "diagnose", *logs, "--model", str(model), "--out", str(out), "--seed", str(seed), "--jobs", "1"]


def diagnose(words: list[str]) -> Ran:
    """Run it on one thread; a crash or an endless run is a result of the exam, not an error of it."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    start = time.monotonic()
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT_S, env={**os.environ, **threads}, check=False)
    except subprocess.TimeoutExpired:
        return Ran(-1, time.monotonic() - start, f"no end within {TIMEOUT_S:g} s")
    lines = done.stderr.strip().splitlines()
    return Ran(done.returncode, time.monotonic() - start, lines[-1] if lines else "")


def _si(entry: dict[str, Any]) -> tuple[float, float]:
    factor = UNITS.get(str(entry["unit"]), 1.0)
    sigma = entry["sigma"]
    return float(entry["value"]) * factor, float("nan") if sigma is None else float(sigma) * factor


def read(path: Path) -> Finding:
    """A diagnosis; raises ``KeyError``, ``TypeError`` or ``ValueError`` where it is not of the documented form."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    named = tuple(
        Named(
            str(row["name"]),
            frozenset([str(row["name"]), *(str(member["name"]) for member in row["class"])]),
            str(row["stage"]),
            {name: _si(value) for name, value in row["parameters"].items()},
        )
        for row in raw["effects"]
    )
    closed = {
        channel: float(gap["closed"])
        for channel, gap in raw["gap"].items()
        if gap["closed"] is not None and float(gap["before"]) >= GAP * float(gap["floor"]) > 0.0
    }
    verdict, following = str(raw["verdict"]), raw.get("next_experiment")
    return Finding(verdict, named, len(raw["unexplained"]), closed, verdict == "invalid", None if following is None else str(following))
