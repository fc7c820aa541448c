"""Friction of the guide of the moving mass, at the load (LuGre)."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Parameter

EFFECT = Effect(
    name="guide_friction",
    stage="mechanism",
    doc="Carriage on its guide: Coulomb and static level, presliding, viscous part.",
    prefix="guide_",
    parameters=(
        Parameter("guide_coulomb_n", "N", 0.0, 1e4, "Coulomb level"),
        Parameter("guide_static_n", "N", 0.0, 1e4, "break-away level"),
        Parameter("guide_stribeck_m_s", "m/s", 0.0, 1.0, "Stribeck speed"),
        Parameter("guide_bristle_n_m", "N/m", 0.0, 1e9, "presliding stiffness"),
        Parameter("guide_bristle_damping_n_s_m", "N s/m", 0.0, 1e6, "presliding damping"),
        Parameter("guide_viscous_n_s_m", "N s/m", 0.0, 1e5, "viscous coefficient"),
    ),
    per_axis=False,
    kind="axis",
)
