"""Resolver and converter: eccentricity harmonics, noise, quantisation, converter faults."""

from __future__ import annotations

from math import floor, pi, sin

from spsp_ctrl.plant.effects.base import Effect, Parameter, stage

EFFECT = Effect(
    name="resolver_error",
    stage="sensors",
    doc="Angle error once and twice per motor turn (inside the paper's 10 arcmin) and white noise.",
    prefix="res_",
    parameters=(
        Parameter("res_first_rad", "rad", 0.0, 0.1, "amplitude once per turn"),
        Parameter("res_first_phase_rad", "rad", -7.0, 7.0, "its phase"),
        Parameter("res_second_rad", "rad", 0.0, 0.1, "amplitude twice per turn"),
        Parameter("res_second_phase_rad", "rad", -7.0, 7.0, "its phase"),
        Parameter("res_noise_rad", "rad", 0.0, 0.1, "standard deviation of the noise"),
    ),
)


@stage
def resolver_counts(
    angle: float,
    first: float,
    first_phase: float,
    second: float,
    second_phase: float,
    noise: float,
    counts_per_turn: float,
) -> float:
    """Multi-turn reading in whole counts (as a float). ``counts_per_turn`` zero means an ideal converter of 2^32 counts."""
    reading = angle + noise
    if first != 0.0:
        reading += first * sin(angle + first_phase)
    if second != 0.0:
        reading += second * sin(2.0 * angle + second_phase)
    per_turn = counts_per_turn if counts_per_turn > 0.0 else 4294967296.0
    return floor(reading * per_turn / (2.0 * pi) + 0.5)
