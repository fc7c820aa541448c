"""Lead errors of screw and gear: a slope over the stroke and harmonics of the screw turn."""

from __future__ import annotations

from math import cos, sin

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="lead_error",
    stage="transmission",
    doc="Travel error: proportional part (also the guide-rail parallelism of Fig 14) and one- and two-per-turn parts.",
    prefix="lead_",
    parameters=(
        Parameter("lead_slope", "m/m", -0.01, 0.01, "travel error per travel"),
        Parameter("lead_first_m", "m", 0.0, 1e-3, "amplitude once per screw turn"),
        Parameter("lead_first_phase_rad", "rad", -7.0, 7.0, "its phase"),
        Parameter("lead_second_m", "m", 0.0, 1e-3, "amplitude twice per screw turn"),
        Parameter("lead_second_phase_rad", "rad", -7.0, 7.0, "its phase"),
    ),
    hypotheses=(
        Hypothesis(
            name="lead_error",
            free=(Free("lead_slope", -5e-3, 5e-3, (-3e-4, 3e-4)),),
            channels=("ruler", "imu"),
            regimes=("position",),
            twins=("guide_slope", "thermal_expansion"),
            source="cumulative lead deviation: ISO 3408-3",
        ),
        Hypothesis(
            name="periodic_lead_error",
            free=(
                Free("lead_first_m", 0.0, 1e-4, (2e-6, 1e-5)),
                Free("lead_first_phase_rad", -7.0, 7.0, (0.0, 1.57, 3.14, -1.57), nuisance=True),
                Free("lead_second_m", 0.0, 1e-4, (1e-6,)),
                Free("lead_second_phase_rad", -7.0, 7.0, (0.0, 1.57), nuisance=True),
            ),
            channels=("ruler", "imu"),
            regimes=("screw_phase",),
            twins=("resolver_eccentricity",),
            source="lead deviation within one turn: ISO 3408-3",
        ),
    ),
)


@stage
def screw_travel(
    screw_angle: float,
    pitch_m_rad: float,
    slope: float,
    first: float,
    first_phase: float,
    second: float,
    second_phase: float,
) -> tuple[float, float]:
    """Nut travel in m and its derivative by the screw angle in m/rad; the derivative keeps force and torque power-consistent."""
    gain = pitch_m_rad * (1.0 + slope)
    travel = gain * screw_angle
    if first != 0.0:
        travel += first * sin(screw_angle + first_phase)
        gain += first * cos(screw_angle + first_phase)
    if second != 0.0:
        travel += second * sin(2.0 * screw_angle + second_phase)
        gain += 2.0 * second * cos(2.0 * screw_angle + second_phase)
    return travel, gain
