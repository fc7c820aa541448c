"""The result folder: written beside its place and moved there when it is whole, so that an interrupted run leaves nothing."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path


def check_out(out: Path) -> str:
    """What is wrong with a result folder; empty when it can be made."""
    if out.exists() and not out.is_dir():
        return f"{out}: is a file; give a new folder"
    if out.exists() and any(out.iterdir()):
        return f"{out}: the folder is not empty; give a new one"
    if not out.absolute().parent.is_dir():
        return f"{out}: the folder above it does not exist"
    return ""


@contextlib.contextmanager
def scratch(out: Path) -> Iterator[Path]:
    """A folder beside ``out``; gone at the end whatever happens, unless it was published."""
    folder = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.absolute().parent))
    folder.chmod(0o755)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def publish(folder: Path, out: Path) -> None:
    """Move the whole folder to its place at once."""
    if out.is_dir():
        out.rmdir()  # empty, or this raises
    folder.rename(out)
