"""Every command and example in README.md and docs/ is run as it stands, in a folder with nothing but copies of ``config/`` and ``hil/``.

In ``sh`` blocks each line must exit with 0, or with N where it ends in ``# exit N``. A ``yaml`` block after ``<!-- file: PATH -->`` is written
there first; ``python`` blocks are run. ``<!-- not run: reason -->`` before a block leaves it out. Lines that set up a checkout are left to CI.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"(?:<!-- (?P<mark>not run|file): (?P<what>.*?) -->\n)?```(?P<kind>sh|python|yaml)\n(?P<body>.*?)^```$", re.S | re.M)
SET_UP = re.compile(r"(make|git clone|cd|(\S*/)?pip3?|(\S*/)?python3? -m (venv|pip)|(source|\.) \S*activate)\b")
EXIT = re.compile(r"\s+# exit (\d+)$")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


class Block(NamedTuple):
    """One fenced block that is carried out."""

    line: int
    kind: str
    body: str
    file: str


def blocks(text: str) -> Iterator[Block]:
    """What a page asks to be run, in order."""
    for match in BLOCK.finditer(text):
        line = text[: match.start("body")].count("\n") + 1
        if match["mark"] == "not run":
            assert match["what"].strip(), f"line {line}: a block that is not run needs a reason"
        elif match["kind"] != "yaml" or match["mark"] == "file":
            yield Block(line, match["kind"], match["body"], match["what"] or "")


def commands(body: str) -> Iterator[tuple[int, str, int]]:
    """Line in the block, command, expected exit code; continued lines joined, set-up left out."""
    offset, held = 0, ""
    for i, line in enumerate(body.splitlines()):
        if not held:
            offset = i
        held += line
        if held.endswith("\\"):
            held = held[:-1]
            continue
        text, held = held.strip(), ""
        wanted = EXIT.search(text)
        text = EXIT.sub("", text)
        if text and not text.startswith("#") and not SET_UP.match(text):
            yield offset, text, int(wanted[1]) if wanted else 0


def test_blocks_are_read_as_meant() -> None:
    text = "```sh\nmake run\ntrue\nfalse  # exit 1\necho a \\\n  b\n```\n"
    text += "<!-- not run: needs hardware -->\n```sh\nboom\n```\n```yaml\na: 1\n```\n<!-- file: x -->\n```yaml\nb: 2\n```\n"
    found = list(blocks(text))
    assert [(b.kind, b.file) for b in found] == [("sh", ""), ("yaml", "x")]
    assert [(c, n) for _, c, n in commands(found[0].body)] == [("true", 0), ("false", 1), ("echo a   b", 0)]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_page(page: Path, tmp_path: Path) -> None:
    found = list(blocks(page.read_text(encoding="utf-8")))
    if not found:
        pytest.skip("nothing to run on this page")
    for folder in ("config", "hil"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "MPLBACKEND": "Agg"}
    for block in found:
        if block.kind == "yaml":
            (tmp_path / block.file).write_text(block.body, encoding="utf-8")
            continue
        steps = [(0, "", 0)] if block.kind == "python" else list(commands(block.body))
        for offset, command, wanted in steps:
            argv = ["bash", "-c", command] if command else [sys.executable, "-c", block.body]
            done = subprocess.run(argv, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=120)
            where = f"{page.name}:{block.line + offset}: {command or 'python block'}"
            assert done.returncode == wanted, f"{where}: exit {done.returncode}, expected {wanted}\n{done.stdout[-1000:]}{done.stderr[-2000:]}"
            if command.startswith("spsp-ctrl"):
                assert "Traceback" not in done.stderr, where
