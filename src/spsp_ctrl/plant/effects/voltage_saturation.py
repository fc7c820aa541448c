"""Less voltage than the supply reads: a sagging bus, a drive limit."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="voltage_saturation",
    stage="drive",
    doc="Voltage limit of the winding below the bus voltage of the model.",
    parameters=(Parameter("voltage_limit_v", "V", 0.0, 1000.0, "voltage that really reaches the winding"),),
    hypotheses=(
        Hypothesis(
            name="voltage_saturation",
            free=(Free("voltage_limit_v", 1.0, 100.0, (6.0, 12.0, 20.0)),),
            channels=("current", "resolver"),
            regimes=("saturation", "speed", "slope"),
            twins=("velocity_saturation", "current_saturation"),
            source="back-EMF plus winding drop against the supply",
        ),
    ),
)


@stage
def lower_limit(limit: float, ceiling: float) -> float:
    """The smaller of a limit and a ceiling; a ceiling of zero is none."""
    if ceiling == 0.0 or ceiling > limit:
        return limit
    return ceiling
