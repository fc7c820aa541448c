"""Pictures of design commands with matplotlib (extra ``design``): one style, SVG that is the same byte for byte.

matplotlib is imported when a picture is asked for, never by the control loop or a run.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PITCH, ROLL, THIRD, GREY = "#2a6fbb", "#d9722b", "#3f8f5f", "#6b7280"
"""Colours of pitch and roll, as in the run report, and of what is neither."""
STYLE: Any = {
    "font.size": 9.0,
    "axes.grid": True,
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "svg.hashsalt": "spsp-ctrl",
    "svg.fonttype": "none",
}


class NoPictures(Exception):
    """matplotlib is not installed."""


def require() -> None:
    """Raises :class:`NoPictures` before anything is computed for a picture that cannot be drawn."""
    if importlib.util.find_spec("matplotlib") is None:
        raise NoPictures("pictures need matplotlib: pip install 'spsp-ctrl[design]', or leave --out away")


def figure(width_in: float, height_in: float) -> Figure:
    """An empty figure in the common style; no display is needed."""
    require()
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcParams.update(STYLE)
    return Figure(figsize=(width_in, height_in), layout="constrained")


def save(fig: Figure, folder: Path, name: str) -> Path:
    """Write ``folder/name.svg``, making the folder. No date goes into the file, so that same input gives same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.svg"
    fig.savefig(path, metadata={"Date": None})
    return path
