"""Which law this is: a digest of every source file that decides a command."""

from __future__ import annotations

import hashlib
from pathlib import Path

from spsp_ctrl import __version__

ROOT = Path(__file__).resolve().parent.parent
LAW_SOURCES = (
    "messages.py",
    "mechanism/frames.py",
    "mechanism/kinematics.py",
    "mechanism/levelling.py",
    "mechanism/profile.py",
    "control",
    "safety",
    "runtime/cycle.py",
)


def law_digest() -> str:
    """Same digest, same code: a replay must then be bit for bit."""
    digest = hashlib.sha256()
    for name in LAW_SOURCES:
        path = ROOT / name
        files = sorted(path.rglob("*.py")) if path.is_dir() else [path]
        for file in files:
            digest.update(file.relative_to(ROOT).as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions that matter for a replay."""
    import platform

    return {"spsp_ctrl": __version__, "python": platform.python_version(), "machine": platform.machine()}
