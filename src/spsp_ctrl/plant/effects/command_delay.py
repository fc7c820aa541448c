"""A command that acts late: a cycle of the field bus, a queue in the drive."""

from __future__ import annotations

from math import floor

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="command_delay",
    stage="drive",
    doc="Pure delay of the command beyond the documented cycle, at most eight cycles.",
    parameters=(Parameter("command_delay_s", "s", 0.0, 0.016, "delay"),),
    hypotheses=(
        Hypothesis(
            name="command_delay",
            free=(Free("command_delay_s", 0.0, 0.016, (5e-4, 2e-3, 6e-3)),),
            channels=("current", "resolver"),
            regimes=("slope",),
            twins=("drive_lag", "clock_skew"),
            source="pure delay with fractional part",
        ),
    ),
)

HISTORY = 9
"""Commands that are remembered: the one of this cycle and eight before it."""


@stage
def remember(x: Array, at: int, command: float) -> None:
    """Put the command of the new cycle in front of the earlier ones at ``x[at:]``."""
    for i in range(HISTORY - 1, 0, -1):
        x[at + i] = x[at + i - 1]
    x[at] = command


@stage
def delayed(x: Array, at: int, time: float, dt: float, delay: float, period: float) -> float:
    """Mean of the delayed command from ``time`` to ``time + dt`` after the start of the cycle: continuous in the delay."""
    begin = floor((time - delay) / period)
    end_time = time + dt - delay
    end = floor(end_time / period)
    first = min(max(int(-begin), 0), HISTORY - 1)
    last = min(max(int(-end), 0), HISTORY - 1)
    if first == last:
        return float(x[at + first])
    share = (end_time - end * period) / dt
    return float((1.0 - share) * x[at + first] + share * x[at + last])
