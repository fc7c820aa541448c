"""Readings that do not arrive: the last one is shown again."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="sensor_dropout",
    stage="sensors",
    doc="A share of the readings of resolver and ruler is lost, at random but the same for the same cycle.",
    parameters=(
        Parameter("resolver_lost", "1", 0.0, 0.9, "share of the resolver readings"),
        Parameter("ruler_lost", "1", 0.0, 0.9, "share of the ruler readings"),
    ),
    per_axis=False,
    kind="axis",
    hypotheses=(
        Hypothesis(
            name="sensor_dropout",
            free=(Free("resolver_lost", 0.0, 0.5, (0.01, 0.1)), Free("ruler_lost", 0.0, 0.5, (0.01, 0.1))),
            channels=("resolver", "ruler"),
            regimes=("speed",),
            twins=("resolver_noise",),
            source="held sample; found by repeated readings in motion",
            random=True,
        ),
    ),
)


@stage
def is_lost(cycle: int, channel: int, share: float) -> bool:
    """Whether the reading of this cycle is lost: a hash of cycle and channel, so a run is a function of its inputs."""
    if share == 0.0:
        return False
    value = (cycle * 2 + channel + 1) * 2654435761 % 4294967296
    value = (value // 65536 + value * 40503) % 65536
    return value < share * 65536.0
