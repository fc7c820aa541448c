"""A command near zero that the drive ignores: an analogue input with a threshold, dead time of the bridge."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="command_deadband",
    stage="drive",
    doc="Currents below a threshold give nothing; beyond it the command is shifted by it.",
    parameters=(Parameter("deadband_a", "A", 0.0, 50.0, "half width"),),
    hypotheses=(
        Hypothesis(
            name="command_deadband",
            free=(Free("deadband_a", 0.0, 1.0, (0.01, 0.05, 0.2)),),
            channels=("current", "resolver"),
            regimes=("reversal", "direction"),
            twins=("coulomb_friction", "stribeck_friction"),
            source="dead zone: Tao and Kokotovic, Adaptive Control of Systems with Actuator and Sensor Nonlinearities (1996)",
        ),
    ),
)


@stage
def outside_deadband(reference: float, half: float) -> float:
    """What the drive makes of a current reference in A."""
    if half == 0.0:
        return reference
    if reference > half:
        return reference - half
    return reference + half if reference < -half else 0.0
