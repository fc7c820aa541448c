"""Thermal expansion of column (height) and frame (hinge radii)."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Parameter

EFFECT = Effect(
    name="structure_expansion",
    stage="mechanism",
    doc="Column height and hinge radii grow with their own temperatures; a steel column nearly cancels a steel screw.",
    parameters=(
        Parameter("column_expansion_1_k", "1/K", -1e-4, 1e-4, "expansion coefficient of the column"),
        Parameter("frame_expansion_1_k", "1/K", -1e-4, 1e-4, "expansion coefficient of platform and base plate"),
    ),
    per_axis=False,
    kind="platform",
)
