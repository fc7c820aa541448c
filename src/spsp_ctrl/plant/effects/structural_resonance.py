"""A mode of the frame that carries the ruler: shaken by the moving mass, seen by the reading."""

from __future__ import annotations

from math import pi

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="structural_resonance",
    stage="mechanism",
    doc="One mode driven by the acceleration of the load; its deflection adds to the ruler reading.",
    prefix="mode_",
    parameters=(
        Parameter("mode_frequency_hz", "Hz", 0.0, 400.0, "natural frequency"),
        Parameter("mode_damping", "1", 0.0, 1.0, "damping ratio"),
        Parameter("mode_gain", "1", -10.0, 10.0, "participation: moving mass over modal mass"),
    ),
    per_axis=False,
    kind="axis",
    hypotheses=(
        Hypothesis(
            name="structural_resonance",
            free=(
                Free("mode_frequency_hz", 5.0, 300.0, (12.0, 25.0, 50.0, 100.0)),
                Free("mode_damping", 1e-3, 0.5, (0.03,)),
                Free("mode_gain", -2.0, 2.0, (-0.05, 0.05)),
            ),
            channels=("ruler",),
            regimes=("slope", "reversal"),
            twins=("axial_compliance",),
            source="single mode: Ewins, Modal Testing (2000)",
        ),
    ),
)


@stage
def mode_step(deflection: float, rate: float, acceleration: float, frequency: float, damping: float, gain: float, dt: float) -> tuple[float, float]:
    """Deflection and its rate after ``dt`` (semi-implicit, damping implicit: stable below 1 / (pi dt))."""
    omega = 2.0 * pi * frequency
    rate = (rate - dt * (omega * omega * deflection + gain * acceleration)) / (1.0 + 2.0 * damping * omega * dt)
    return deflection + dt * rate, rate
