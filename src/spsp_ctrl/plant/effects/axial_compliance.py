"""Axial compliance beyond that of the model: a soft bearing seat, a loose nut housing."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="axial_compliance",
    stage="transmission",
    doc="Compliance in series with the axial stiffness of the model.",
    parameters=(Parameter("added_compliance_m_n", "m/N", 0.0, 1e-5, "compliance added in series"),),
    hypotheses=(
        Hypothesis(
            name="axial_compliance",
            free=(Free("added_compliance_m_n", 0.0, 5e-6, (2e-8, 2e-7, 1e-6)),),
            channels=("ruler", "current"),
            regimes=("load", "reversal", "slope"),
            twins=("backlash", "structural_resonance"),
            source="series springs of screw, nut and bearing: ISO 3408-4",
        ),
    ),
)


@stage
def softened(stiffness: float, compliance: float) -> float:
    """Stiffness in N/m with ``compliance`` in series."""
    if compliance == 0.0:
        return stiffness
    return stiffness / (1.0 + stiffness * compliance)
