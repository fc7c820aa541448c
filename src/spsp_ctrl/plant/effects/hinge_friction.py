"""Friction of the U joint, the rod ends and the rod guide, seen at the platform axis (LuGre)."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="hinge_friction",
    stage="mechanism",
    doc="Interference-fit hinges and rod guide: Coulomb and static level, presliding, viscous part.",
    prefix="hf_",
    parameters=(
        Parameter("hf_coulomb_nm", "N m", 0.0, 100.0, "Coulomb level"),
        Parameter("hf_static_nm", "N m", 0.0, 100.0, "break-away level"),
        Parameter("hf_stribeck_rad_s", "rad/s", 0.0, 10.0, "Stribeck speed"),
        Parameter("hf_bristle_nm_rad", "N m/rad", 0.0, 1e7, "presliding stiffness"),
        Parameter("hf_bristle_damping_nm_s", "N m s/rad", 0.0, 1e4, "presliding damping"),
        Parameter("hf_viscous_nm_s", "N m s/rad", 0.0, 1e3, "viscous coefficient"),
    ),
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="hinge_friction",
            free=(Free("hf_coulomb_nm", 0.0, 30.0, (0.3, 1.0)), Free("hf_viscous_nm_s", 0.0, 50.0, (1.0,))),
            channels=("current", "resolver", "imu"),
            regimes=("direction", "reversal", "speed"),
            twins=("coulomb_friction", "viscous_friction"),
            along=(("hf_bristle_nm_rad", 9000.0), ("hf_bristle_damping_nm_s", 4.0)),
            source="LuGre at the joint: it also winds up screw and gap, which friction of the motor does not",
        ),
    ),
)
