"""Effects that cannot exist: if a diagnosis names one of them, it is reading noise and its result is void."""

from __future__ import annotations

from math import e, pi, sin, sqrt

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

RIPPLE = Effect(
    name="sentinel_ripple",
    stage="drive",
    doc="Torque with a period of sqrt(2) pi / e screw turns, which nothing in the machine has. Alarm of the diagnosis.",
    parameters=(
        Parameter("sentinel_ripple_nm", "N m", 0.0, 1.0, "amplitude"),
        Parameter("sentinel_ripple_phase_rad", "rad", -7.0, 7.0, "its phase"),
    ),
    kind="axis",
    hypotheses=(
        Hypothesis(
            name="sentinel_ripple",
            free=(
                Free("sentinel_ripple_nm", 0.0, 0.1, (5e-4, 4e-3)),
                Free("sentinel_ripple_phase_rad", -7.0, 7.0, (0.0, 1.57, 3.14, -1.57), nuisance=True),
            ),
            channels=("current", "resolver"),
            regimes=("screw_phase",),
            source="none: cannot exist",
            sentinel=True,
        ),
    ),
)

PARITY = Effect(
    name="sentinel_parity",
    stage="mechanism",
    doc="Friction in every other cycle only. Alarm of the diagnosis.",
    parameters=(Parameter("sentinel_parity_n", "N", 0.0, 1e4, "friction of the odd cycles"),),
    per_axis=False,
    kind="axis",
    hypotheses=(
        Hypothesis(
            name="sentinel_parity",
            free=(Free("sentinel_parity_n", 0.0, 200.0, (1.0, 10.0)),),
            channels=("current", "resolver"),
            regimes=("always",),
            source="none: cannot exist",
            sentinel=True,
        ),
    ),
)

TURNS = sqrt(2.0) * pi / e


@stage
def sentinel_torque(screw_angle: float, amplitude: float, phase: float) -> float:
    """Torque in N m."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * sin(screw_angle / TURNS + phase)


@stage
def parity_force(cycle: int, rate: float, level: float) -> float:
    """Force in N against the motion of the load in odd cycles and with it in even ones: no friction in the mean."""
    if level == 0.0:
        return 0.0
    return (level if cycle % 2 else -level) * rate / (abs(rate) + 1e-4)
