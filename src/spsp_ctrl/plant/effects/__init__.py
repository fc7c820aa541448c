"""The effect registry: one row for each effect. A new effect is a file here, a row here and a call in its stage."""

from __future__ import annotations

from spsp_ctrl.plant.effects import (
    azimuth_backlash,
    azimuth_friction,
    backlash,
    cogging,
    geometric_error,
    hinge_friction,
    imu_error,
    lead_error,
    motor_friction,
    resolver_error,
    structure_expansion,
    thermal_expansion,
)
from spsp_ctrl.plant.effects.base import Effect, Parameter, Stage

EFFECTS: tuple[Effect, ...] = (
    motor_friction.EFFECT,
    cogging.EFFECT,
    backlash.EFFECT,
    lead_error.EFFECT,
    thermal_expansion.EFFECT,
    geometric_error.ZERO_OFFSET,
    geometric_error.EFFECT,
    structure_expansion.EFFECT,
    hinge_friction.EFFECT,
    azimuth_backlash.EFFECT,
    azimuth_friction.EFFECT,
    resolver_error.EFFECT,
    imu_error.NOISE,
    imu_error.BIAS,
    imu_error.DRIFT,
    imu_error.MISALIGNMENT,
    imu_error.LEVELLING,
)

BY_NAME: dict[str, Effect] = {effect.name: effect for effect in EFFECTS}

__all__ = ["BY_NAME", "EFFECTS", "Effect", "Parameter", "Stage"]
