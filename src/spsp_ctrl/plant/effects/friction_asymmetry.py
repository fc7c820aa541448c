"""Friction that differs by direction: preload of a wiper, a nut that runs harder one way."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="friction_asymmetry",
    stage="drive",
    doc="Half the difference of the friction in positive and negative direction.",
    prefix="asym_",
    parameters=(
        Parameter("asym_coulomb_nm", "N m", -10.0, 10.0, "Coulomb level: more in positive, less in negative direction"),
        Parameter("asym_viscous_nm_s", "N m s/rad", -1.0, 1.0, "viscous coefficient, likewise"),
    ),
    hypotheses=(
        Hypothesis(
            name="friction_asymmetry",
            free=(Free("asym_coulomb_nm", -0.05, 0.05, (-1e-3, 1e-3)), Free("asym_viscous_nm_s", -2e-4, 2e-4, (-5e-6, 5e-6))),
            channels=("current", "resolver"),
            regimes=("direction", "speed"),
            twins=("torque_offset",),
            along=(("mf_bristle_nm_rad", 1.5), ("mf_bristle_damping_nm_s", 2e-3)),
            source="direction-dependent Coulomb and viscous level: Armstrong-Helouvry, Control of Machines with Friction (1991)",
        ),
    ),
)

KEPT = 0.05
"""Share of the level that is left at the least: friction never drives."""


@stage
def level_difference(speed: float, difference: float, level: float) -> float:
    """Level in N m to add to ``level`` at this sign of the speed."""
    if difference == 0.0 or speed == 0.0:
        return 0.0
    added = difference if speed > 0.0 else -difference
    floor = (KEPT - 1.0) * level
    return added if added > floor else floor


@stage
def viscous_difference(speed: float, difference: float, viscous: float) -> float:
    """Friction in N m to add to ``viscous * speed``."""
    if difference == 0.0:
        return 0.0
    added = difference if speed > 0.0 else -difference
    floor = (KEPT - 1.0) * viscous
    return speed * (added if added > floor else floor)
