"""Compilation of the plant's stage functions with numba, and its cache.

numba notices an edit of the file that holds a function, but not of a function it calls in another file. The cache therefore lives in a
folder named after a digest of *all* plant and mechanism sources, so an edited effect can never run with a stale kernel.

``SPSP_CTRL_PLAIN=1`` in the environment leaves every stage as plain Python: the twin that tests compare with. It is hundreds of
times slower and refused for real time.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

PLANT = Path(__file__).resolve().parent
MECHANISM_SOURCES = ("frames.py", "kinematics.py", "profile.py")
"""What the plant uses of the mechanism; the design tools beside them do not concern the kernel."""


def source_digest() -> str:
    """Digest of every source file that ends up in the kernel."""
    digest = hashlib.sha256()
    for path in sorted([*PLANT.rglob("*.py"), *(PLANT.parent / "mechanism" / name for name in MECHANISM_SOURCES)]):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Where compiled kernels are kept for this source: ``$XDG_CACHE_HOME``, else ``~/.cache``, else the temporary folder."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = root / "spsp-ctrl" / f"kernel-{source_digest()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(folder)
    except OSError:
        folder = Path(tempfile.gettempdir()) / f"spsp-ctrl-{os.getuid()}" / f"kernel-{source_digest()}"
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def _load_njit() -> Callable[..., Any] | None:
    if os.environ.get("SPSP_CTRL_PLAIN") == "1":
        return None
    os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_folder()))
    try:
        import numba
    except ImportError:
        return None
    numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]  # type: ignore[attr-defined]  # set by name at import
    return cast("Callable[..., Any]", numba.njit)


_NJIT = _load_njit()
IS_COMPILED = _NJIT is not None
WHY_PLAIN = (
    ""
    if IS_COMPILED
    else (
        "SPSP_CTRL_PLAIN=1 is set"
        if os.environ.get("SPSP_CTRL_PLAIN") == "1"
        else "numba is not installed (pip install numba)"
    )
)


def compiled(function: F) -> F:
    """Compile without fast-math, so that the same inputs give the same bits on one machine type."""
    if _NJIT is None:
        return function
    return cast("F", _NJIT(cache=True, error_model="numpy")(function))


def entry(function: F) -> F:
    """Compile an entry point that is called from Python once per cycle."""
    if _NJIT is None:
        return function
    return cast("F", _NJIT(cache=True, nogil=True, error_model="numpy")(function))
