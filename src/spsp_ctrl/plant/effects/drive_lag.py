"""A lag between command and drive: input filter, sampled field bus, slow current loop."""

from __future__ import annotations

from math import exp

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="drive_lag",
    stage="drive",
    doc="First-order lag of the command, before the loops of the drive.",
    parameters=(Parameter("drive_lag_s", "s", 0.0, 0.05, "time constant"),),
    hypotheses=(
        Hypothesis(
            name="drive_lag",
            free=(Free("drive_lag_s", 0.0, 0.02, (3e-4, 1e-3, 4e-3)),),
            channels=("current", "resolver"),
            regimes=("slope",),
            twins=("command_delay",),
            source="first-order low-pass",
        ),
    ),
)


@stage
def lagged(state: float, command: float, time_constant: float, dt: float) -> float:
    """The command after ``dt`` more seconds of the lag."""
    return command + (state - command) * exp(-dt / time_constant)
