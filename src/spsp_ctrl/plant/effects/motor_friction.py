"""Motor-side friction: Coulomb, Stribeck, viscous and load-dependent, with presliding (LuGre)."""

from __future__ import annotations

from math import exp

from spsp_ctrl.plant.effects.base import Effect, Free, Hypothesis, Parameter, stage

EFFECT = Effect(
    name="motor_friction",
    stage="drive",
    doc="Friction of motor, gear and screw seen at the motor shaft (LuGre; Canudas de Wit et al., 1995).",
    prefix="mf_",
    parameters=(
        Parameter("mf_coulomb_nm", "N m", 0.0, 10.0, "Coulomb level"),
        Parameter("mf_static_nm", "N m", 0.0, 10.0, "break-away level"),
        Parameter("mf_stribeck_rad_s", "rad/s", 0.0, 1e3, "Stribeck speed"),
        Parameter("mf_viscous_nm_s", "N m s/rad", 0.0, 1.0, "viscous coefficient"),
        Parameter("mf_bristle_nm_rad", "N m/rad", 0.0, 1e6, "presliding stiffness"),
        Parameter("mf_bristle_damping_nm_s", "N m s/rad", 0.0, 1.0, "presliding damping"),
        Parameter("mf_load_factor", "1", 0.0, 5.0, "Coulomb level added per screw torque of the load"),
    ),
    hypotheses=(
        Hypothesis(
            name="coulomb_friction",
            free=(Free("mf_coulomb_nm", 0.0, 0.5, (3e-3, 1e-2, 3e-2)),),
            channels=("current", "resolver"),
            regimes=("direction", "reversal"),
            twins=("stribeck_friction", "command_deadband", "motor_constant_error"),
            along=(("mf_bristle_nm_rad", 1.5), ("mf_bristle_damping_nm_s", 2e-3)),
            source="Coulomb; regularised by a bristle as in LuGre",
        ),
        Hypothesis(
            name="viscous_friction",
            free=(Free("mf_viscous_nm_s", 0.0, 5e-3, (1e-5, 5e-5, 3e-4)),),
            channels=("current", "resolver"),
            regimes=("speed",),
            twins=("stribeck_friction", "motor_constant_error"),
            source="linear in speed",
        ),
        Hypothesis(
            name="load_friction",
            free=(Free("mf_load_factor", 0.0, 3.0, (0.1, 0.5)),),
            channels=("current", "resolver"),
            regimes=("load", "direction"),
            twins=("coulomb_friction", "motor_constant_error"),
            along=(("mf_bristle_nm_rad", 1.5), ("mf_bristle_damping_nm_s", 2e-3)),
            source="efficiency of a screw: level proportional to the load torque",
        ),
        Hypothesis(
            name="presliding",
            free=(Free("mf_bristle_nm_rad", 0.02, 50.0, (0.1, 0.5, 3.0)), Free("mf_bristle_damping_nm_s", 0.0, 0.1, (5e-4,))),
            channels=("resolver", "current", "ruler"),
            regimes=("reversal",),
            twins=("backlash", "axial_compliance", "coulomb_friction"),
            source="LuGre bristle: Canudas de Wit et al., IEEE Trans. Autom. Control 40 (1995)",
        ),
    ),
)


@stage
def lugre(
    bristle: float,
    speed: float,
    coulomb: float,
    static: float,
    stribeck: float,
    stiffness: float,
    damping: float,
    dt: float,
) -> tuple[float, float]:
    """One LuGre step: new bristle deflection and friction without its viscous part.

    The bristle is integrated implicitly, which is stable at any speed (an explicit step is not once ``stiffness |v| dt > 2 Fc``).
    """
    if stiffness == 0.0 or coulomb == 0.0:
        return 0.0, 0.0
    level = coulomb
    if static > coulomb and stribeck > 0.0:
        ratio = speed / stribeck
        level += (static - coulomb) * exp(-ratio * ratio)
    new = (bristle + speed * dt) / (1.0 + stiffness * abs(speed) * dt / level)
    return new, stiffness * new + damping * (new - bristle) / dt
