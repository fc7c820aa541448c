"""Play in gear and screw, lumped at the rod: a gap with an elastic wall on each side."""

from __future__ import annotations

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="backlash",
    stage="transmission",
    doc="Total play between motor and rod, as travel of the rod.",
    parameters=(Parameter("gap_m", "m", 0.0, 5e-3, "total play at the rod"),),
    hypotheses=(
        Hypothesis(
            name="backlash",
            free=(Free("gap_m", 0.0, 1e-3, (3e-6, 1.5e-5, 6e-5)),),
            channels=("ruler", "current"),
            regimes=("reversal",),
            twins=("axial_compliance", "presliding"),
            source="gap between elastic walls: Nordin and Gutman, Automatica 38 (2002)",
        ),
    ),
)


@stage
def contact_force(deflection: float, rate: float, gap: float, stiffness: float, damping: float) -> float:
    """Force through a gap of total width ``gap`` closed by springs; zero inside the gap, never adhesive.

    Works alike for translation (m, N) and rotation (rad, N m). A gap of zero is a plain spring and damper.
    """
    half = 0.5 * gap
    if gap == 0.0:
        return stiffness * deflection + damping * rate
    if deflection > half:
        force = stiffness * (deflection - half) + damping * rate
        return force if force > 0.0 else 0.0
    if deflection < -half:
        force = stiffness * (deflection + half) + damping * rate
        return force if force < 0.0 else 0.0
    return 0.0
