"""A speed limit in the drive."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="velocity_saturation",
    stage="drive",
    doc="Speed limit of the drive: clips the speed command, and above it takes the driving current away.",
    parameters=(Parameter("speed_ceiling_rad_s", "rad/s", 0.0, 1e4, "motor speed at which it begins"),),
    hypotheses=(
        Hypothesis(
            name="velocity_saturation",
            free=(Free("speed_ceiling_rad_s", 5.0, 1000.0, (40.0, 100.0, 200.0)),),
            channels=("resolver", "current"),
            regimes=("saturation", "speed"),
            twins=("voltage_saturation", "viscous_friction"),
            source="speed limiter of a servo drive (CiA 402 object 0x6080)",
        ),
    ),
)

BAND = 0.02
"""Share of the limit over which the current goes from full to none."""


@stage
def folded(reference: float, speed: float, ceiling: float) -> float:
    """Current reference in A that is left at ``speed``."""
    if ceiling == 0.0 or reference * speed <= 0.0:
        return reference
    over = (abs(speed) - ceiling) / (BAND * ceiling)
    if over <= 0.0:
        return reference
    return reference * (1.0 - over) if over < 1.0 else 0.0


@stage
def limited_speed(command: float, ceiling: float) -> float:
    """Speed command in rad/s after the limiter."""
    if ceiling == 0.0:
        return command
    if command > ceiling:
        return ceiling
    return -ceiling if command < -ceiling else command
