"""The first power-on of docs/hardware.md, command by command, against the served virtual rig: what the page prints is what comes out."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

pytestmark = pytest.mark.realtime

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "hardware.md"
OMITTED = "…"


class Step(NamedTuple):
    """A command and what the page says it prints."""

    line: int
    command: str
    exit_code: int
    printed: list[str]


def steps(text: str) -> Iterator[Step]:
    """Every ``$`` line of the ``console`` blocks."""
    for block in re.finditer(r"^```console\n(.*?)^```$", text, re.S | re.M):
        line = text[: block.start(1)].count("\n") + 1
        for part in re.finditer(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", block[1], re.M):
            command, _, note = part[1].partition("   # exit ")
            yield Step(line + block[1][: part.start()].count("\n"), command, int(note or 0), part[2].splitlines())


def differs(printed: list[str], found: list[str]) -> str:
    """First printed line that is not found in its place; ``…`` stands for any number of lines, within a line for any text."""
    at, free = 0, False
    for line in printed:
        if line == OMITTED:
            free = True
            continue
        wanted = re.compile(".*".join(map(re.escape, line.split(OMITTED))))
        place = next((i for i, other in enumerate(found[at:] if free else found[at : at + 1]) if wanted.fullmatch(other)), None)
        if place is None:
            return line
        at, free = at + place + 1, False
    return "" if free or at == len(found) else f"and nothing after: {found[at]}"


def test_the_comparison_is_awake() -> None:
    assert differs(["a", OMITTED, "c"], ["a", "b", "c"]) == ""
    assert differs(["a", "c"], ["a", "b", "c"]) == "c"
    assert differs(["a", OMITTED, "d"], ["a", "b", "c"]) == "d"
    assert differs(["a"], ["a", "b"]).endswith("b")
    assert differs(["n: … x", OMITTED], ["n: 12 x", "b"]) == ""
    assert differs(["n: … y"], ["n: 12 x"]) == "n: … y"
    found = list(steps("```console\n$ x --y   # exit 3\n1\n$ z\n```\n"))
    assert found == [Step(2, "x --y", 3, ["1"]), Step(4, "z", 0, [])]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, dict[str, str], dict[str, str]]]:
    """A folder with the files of the page on a bus and ports of its own, and the plant server running."""
    folder = tmp_path_factory.mktemp("power-on")
    for name in ("hil", "config"):
        shutil.copytree(ROOT / name, folder / name)
    group = f"239.74.163.{100 + os.getpid() % 100}"
    own = {"/tmp/spsp-ctrl-hil": str(folder / "ports"), "239.74.163.4": group, "/dev/shm/spsp-ctrl-hil": f"/dev/shm/spsp-ctrl-{os.getpid()}"}
    rig = folder / "hil" / "rig-hil.yaml"
    text = rig.read_text(encoding="utf-8")
    for there, here in own.items():
        assert there in text
        text = text.replace(there, here)
    rig.write_text(text, encoding="utf-8")
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    program = [sys.executable, "-m", "spsp_ctrl.cli", "plant", "serve", "--config", "hil/rig-plant.yaml"]
    server = subprocess.Popen(program, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert server.stdout is not None
    try:
        said = server.stdout.readline()
        if not said.startswith("ready"):
            rest = said + server.stdout.read()
            if "multicast" in rest:
                pytest.skip(f"no multicast here: {rest}")
            raise AssertionError(rest)
        yield folder, environment, own
    finally:
        server.terminate()
        server.wait(10)


def test_every_step_prints_what_the_page_says(served: tuple[Path, dict[str, str], dict[str, str]]) -> None:
    folder, environment, own = served
    text = PAGE.read_text(encoding="utf-8")
    found = list(steps(text))
    assert len(found) >= 7
    for step in found:
        argv = [sys.executable, "-m", "spsp_ctrl.cli", *step.command.split()[1:]]
        done = subprocess.run(argv, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=180)
        out = done.stdout
        for there, here in own.items():
            out = out.replace(here, there)
        where = f"hardware.md:{step.line}: {step.command}"
        assert done.returncode == step.exit_code, f"{where}: exit {done.returncode}\n{out[-2000:]}{done.stderr[-2000:]}"
        missing = differs(step.printed, [line.rstrip() for line in out.splitlines()])
        assert not missing, f"{where}: {missing!r} is not in its place in\n{out}"
        time.sleep(0.2)  # the server begins anew when a controller has left
