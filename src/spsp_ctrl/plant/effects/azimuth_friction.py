"""Friction of the azimuth bearing (LuGre)."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter

EFFECT = Effect(
    name="azimuth_friction",
    stage="azimuth",
    doc="Bearing and seal friction of the azimuth axis.",
    prefix="az_",
    parameters=(
        Parameter("az_coulomb_nm", "N m", 0.0, 100.0, "Coulomb level"),
        Parameter("az_static_nm", "N m", 0.0, 100.0, "break-away level"),
        Parameter("az_stribeck_rad_s", "rad/s", 0.0, 10.0, "Stribeck speed"),
        Parameter("az_bristle_nm_rad", "N m/rad", 0.0, 1e7, "presliding stiffness"),
        Parameter("az_bristle_damping_nm_s", "N m s/rad", 0.0, 1e4, "presliding damping"),
        Parameter("az_viscous_nm_s", "N m s/rad", 0.0, 1e3, "viscous coefficient"),
    ),
    per_axis=False,
    kind="platform",
    hypotheses=(
        Hypothesis(
            name="azimuth_friction",
            free=(Free("az_coulomb_nm", 0.0, 30.0, (0.5, 2.0)), Free("az_viscous_nm_s", 0.0, 100.0, (1.0,))),
            channels=("imu",),
            regimes=("direction", "speed"),
            twins=("azimuth_backlash",),
            along=(("az_bristle_nm_rad", 4000.0), ("az_bristle_damping_nm_s", 10.0)),
            source="Coulomb and viscous; what the stepper and its gear give way to it shows in the heading",
        ),
    ),
)
