"""Stribeck friction: what the level at rest exceeds the sliding level by, falling with speed."""

from __future__ import annotations

from math import exp

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="stribeck_friction",
    stage="drive",
    doc="Friction level that falls off with speed, on top of the Coulomb level.",
    prefix="stribeck_",
    parameters=(
        Parameter("stribeck_excess_nm", "N m", 0.0, 10.0, "excess at standstill"),
        Parameter("stribeck_speed_rad_s", "rad/s", 0.0, 1e3, "speed at which 1/e of it is left"),
    ),
    hypotheses=(
        Hypothesis(
            name="stribeck_friction",
            free=(Free("stribeck_excess_nm", 0.0, 0.2, (2e-3, 1e-2)), Free("stribeck_speed_rad_s", 0.2, 400.0, (3.0, 20.0, 120.0))),
            channels=("current", "resolver"),
            regimes=("speed", "reversal"),
            twins=("viscous_friction", "coulomb_friction", "command_deadband"),
            along=(("mf_bristle_nm_rad", 1.5), ("mf_bristle_damping_nm_s", 2e-3)),
            source="Gaussian Stribeck curve, Armstrong-Helouvry et al., Automatica 30 (1994)",
        ),
    ),
)


@stage
def stribeck_level(speed: float, excess: float, knee: float) -> float:
    """Level in N m to add to the Coulomb level at ``speed``."""
    if excess == 0.0 or knee == 0.0:
        return 0.0
    ratio = speed / knee
    return excess * exp(-ratio * ratio)
