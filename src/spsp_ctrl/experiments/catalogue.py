"""The shipped experiments: scenario files in the folder ``experiments`` beside the rig file."""

from __future__ import annotations

import difflib
from pathlib import Path

from spsp_ctrl.config.loader import ConfigError, ConfigProblem

FOLDER = "experiments"
STUDIES = 20
"""From this ``position`` on a file is a study of our own law (ladder, robustness): listed and played by name, not part of ``all``."""


def shipped(rig_path: Path) -> dict[str, Path]:
    """Name to file, in alphabetical order."""
    return {path.stem: path for path in sorted((rig_path.parent / FOLDER).glob("*.yaml"))}


def find(name: str, rig_path: Path) -> Path:
    """The file of an experiment: a shipped name, or the file itself. Raises ``ConfigError``."""
    known = shipped(rig_path)
    if name in known:
        return known[name]
    path = Path(name)
    if path.is_file():
        return path
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        raise ConfigError([ConfigProblem(path, 0, 0, "no such file")])
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}"
    where = rig_path.parent / FOLDER
    raise ConfigError([ConfigProblem(None, 0, 0, f"no experiment {name!r} in {where}; {hint} (or give a scenario file)")])
