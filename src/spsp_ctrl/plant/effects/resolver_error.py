"""Resolver and converter: eccentricity harmonics, noise, quantisation, converter faults."""

from __future__ import annotations

from math import floor, pi, sin

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

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
    hypotheses=(
        Hypothesis(
            name="resolver_eccentricity",
            free=(
                Free("res_first_rad", 0.0, 0.05, (1e-3, 5e-3)),
                Free("res_first_phase_rad", -7.0, 7.0, (0.0, 1.57, 3.14, -1.57), nuisance=True),
                Free("res_second_rad", 0.0, 0.05, (1e-3,)),
                Free("res_second_phase_rad", -7.0, 7.0, (0.0, 1.57), nuisance=True),
            ),
            channels=("resolver",),
            regimes=("motor_phase",),
            twins=("periodic_lead_error", "torque_ripple"),
            source="eccentricity and quadrature error: Hanselman, IEEE Trans. Ind. Electron. 37 (1990)",
        ),
        Hypothesis(
            name="resolver_noise",
            free=(Free("res_noise_rad", 0.0, 0.05, (1e-4, 1e-3)),),
            channels=("resolver",),
            regimes=("always",),
            twins=("resolver_quantisation",),
            source="white noise",
            random=True,
        ),
    ),
)


@stage
def eccentric(reading: float, angle: float, first: float, first_phase: float, second: float, second_phase: float) -> float:
    """``reading`` with the harmonics of the motor angle added, in rad."""
    if first != 0.0:
        reading += first * sin(angle + first_phase)
    if second != 0.0:
        reading += second * sin(2.0 * angle + second_phase)
    return reading


@stage
def resolver_counts(
    angle: float,
    first: float,
    first_phase: float,
    second: float,
    second_phase: float,
    noise: float,
    counts_per_turn: float,
    step: float = 0.0,
) -> float:
    """Multi-turn reading in whole counts (as a float).

    ``counts_per_turn`` zero means an ideal converter of 2^32 counts; ``step`` is a coarser one, in rad.
    """
    reading = eccentric(angle + noise, angle, first, first_phase, second, second_phase)
    if step != 0.0:
        reading = step * floor(reading / step + 0.5)
    per_turn = counts_per_turn if counts_per_turn > 0.0 else 4294967296.0
    return floor(reading * per_turn / (2.0 * pi) + 0.5)
