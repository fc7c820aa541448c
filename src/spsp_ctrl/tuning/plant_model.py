"""Linear model of one axis at level, from a plant model file: what the gains are designed on.

Motor with current lag and viscous friction, gear and screw as a spring with damping to the platform, platform inertia with viscous hinge and gravity.
Everything that is not smooth (Coulomb friction, play, cogging, quantisation) and every sensor error is left out, as are the couplings between the
axes, which vanish at level. The same equations as ``plant.stages``, linearised (a test compares both).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil
from typing import Any, Literal

import control as ct
import numpy as np

from spsp_ctrl.config.units import UNITS
from spsp_ctrl.mechanism.kinematics import jacobian
from spsp_ctrl.plant.effects import BY_NAME
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, A, G
from spsp_ctrl.plant.model import PlantModel, Quantity, effect_keys

Axis = Literal["pitch", "roll"]
GRAVITY = 9.80665
LOAD_KG = 7.0
"""Load of the paper's tests."""
_SMOOTH = {"motor_friction": "viscous", "hinge_friction": "viscous"}
"""Effects with a part that is linear; every other effect is either not smooth or does not matter to a loop."""


@dataclass(frozen=True, slots=True)
class AxisPlant:
    """One axis, in SI."""

    torque_constant_nm_a: float
    current_lag_s: float
    motor_inertia_kg_m2: float
    motor_viscous_nm_s: float
    travel_per_rad_m: float
    """Rod travel per motor angle."""
    stiffness_n_m: float
    damping_n_s_m: float
    lever_m: float
    """Rod travel per platform angle at level (negative: a positive angle shortens the rod)."""
    platform_inertia_kg_m2: float
    hinge_viscous_nm_s: float
    weight_nm: float
    """Toppling moment of gravity per angle in space."""
    imu_period_s: float
    imu_delay_s: float
    attitude_lag_s: float
    gyro_lag_s: float

    def scaled(self, torque_constant: float = 1.0, motor_inertia: float = 1.0) -> AxisPlant:
        """The same axis with other motor parameters: a corner of the tolerance."""
        return replace(
            self,
            torque_constant_nm_a=self.torque_constant_nm_a * torque_constant,
            motor_inertia_kg_m2=self.motor_inertia_kg_m2 * motor_inertia,
        )

    def imu_delay_cycles(self, period_s: float) -> int:
        """Whole control cycles from the instant of a frame to the cycle that sees it."""
        return ceil(self.imu_delay_s / period_s - 1e-6)

    def imu_every(self, period_s: float) -> int:
        """Control cycles per IMU frame."""
        return max(1, round(self.imu_period_s / period_s))


def axis_plant(model: PlantModel, axis: Axis = "roll", load_kg: float = LOAD_KG) -> AxisPlant:
    """One axis of a plant model with ``load_kg`` on the platform."""
    p = model.parameters()
    a = p[N_AXIS_PARAMETERS if axis == "roll" else 0 :]
    height, radius = float(p[G.column_height_m]), float(p[G.hinge_radius_m])
    j11, _, j22 = jacobian(0.0, 0.0, height, height, height, radius, radius)
    offset, plate = (p[G.load_cog_y_m], p[G.plate_ixx_kg_m2]) if axis == "roll" else (p[G.load_cog_x_m], p[G.plate_iyy_kg_m2])
    cog = load_kg * p[G.load_cog_z_m] + p[G.plate_mass_kg] * p[G.plate_cog_z_m]
    return AxisPlant(
        torque_constant_nm_a=float(a[A.torque_constant_nm_a]),
        current_lag_s=float(a[A.current_lag_s]),
        motor_inertia_kg_m2=float(a[A.rotor_inertia_kg_m2]),
        motor_viscous_nm_s=float(a[A.mf_viscous_nm_s]),
        travel_per_rad_m=float(a[A.screw_lead_m] / (2.0 * np.pi * a[A.gear_ratio])),
        stiffness_n_m=float(a[A.axial_stiffness_n_m]),
        damping_n_s_m=float(a[A.contact_damping_n_s_m]),
        lever_m=j22 if axis == "roll" else j11,
        platform_inertia_kg_m2=float(plate + load_kg * (p[G.load_gyration_xy_m2] + offset**2 + p[G.load_cog_z_m] ** 2)),
        hinge_viscous_nm_s=float(a[A.hf_viscous_nm_s]),
        weight_nm=float(GRAVITY * cog),
        imu_period_s=float(1.0 / p[G.imu_rate_hz]),
        imu_delay_s=float(p[G.imu_delay_s]),
        attitude_lag_s=float(p[G.imu_attitude_lag_s]),
        gyro_lag_s=float(p[G.imu_gyro_lag_s]),
    )


def state_space(plant: AxisPlant) -> Any:
    """Continuous state space: current, motor angle and speed, platform angle in space and its rate.

    Inputs ``acting`` (current that the drive follows, A), ``base`` and ``base_rate`` (angle of the base, rad, and its rate); outputs ``motor`` (motor
    angle, rad), ``current`` (A), ``angle`` (platform angle in space, rad) and its ``rate``. Kinetics as in ``plant.stages.drive`` and ``.mechanism``.
    """
    g, lever = plant.travel_per_rad_m, plant.lever_m
    k, c = plant.stiffness_n_m, plant.damping_n_s_m
    jm, jp = plant.motor_inertia_kg_m2, plant.platform_inertia_kg_m2
    lag = plant.current_lag_s
    # rod force = k (g motor - lever (angle - base)) + c (the same of the rates): rows over (state, inputs)
    force = np.array([0.0, k * g, c * g, -k * lever, -c * lever, 0.0, k * lever, c * lever])
    rows = np.zeros((5, 8))
    rows[0, 0], rows[0, 5] = -1.0 / lag, 1.0 / lag
    rows[1, 2] = 1.0
    rows[2] = -g * force / jm
    rows[2, 0] += plant.torque_constant_nm_a / jm
    rows[2, 2] -= plant.motor_viscous_nm_s / jm
    rows[3, 4] = 1.0
    rows[4] = lever * force / jp
    rows[4, 3] += plant.weight_nm / jp
    rows[4, 4] -= plant.hinge_viscous_nm_s / jp
    rows[4, 7] += plant.hinge_viscous_nm_s / jp
    seen = np.zeros((4, 5))
    seen[0, 1] = seen[1, 0] = seen[2, 3] = seen[3, 4] = 1.0
    return ct.ss(
        rows[:, :5],
        rows[:, 5:],
        seen,
        np.zeros((4, 3)),
        inputs=["acting", "base", "base_rate"],
        outputs=["motor", "current", "angle", "rate"],
        name="plant",
    )


@lru_cache(maxsize=64)
def discrete(plant: AxisPlant, period_s: float) -> Any:
    """``state_space`` sampled at the control rate: a command is held for one cycle, the base moves on a straight line through it.

    The seam's own cycle of latency is a block of the loop.
    """
    continuous = state_space(plant)
    held, straight = (ct.c2d(continuous, period_s, method) for method in ("zoh", "foh"))
    b, d = straight.B.copy(), straight.D.copy()
    b[:, 0], d[:, 0] = held.B[:, 0], held.D[:, 0]
    return ct.ss(held.A, b, held.C, d, period_s, inputs=continuous.input_labels, outputs=continuous.output_labels)


def smooth(model: PlantModel) -> PlantModel:
    """The plant model with every effect removed but for the viscous part of its friction, no noise, and resolvers of 2^24 counts."""
    kept = []
    for entry in model.file.effects:
        name = _SMOOTH.get(entry.effect)
        if name is not None:
            viscous = {key: q for key, q in entry.parameters.items() if key == name}
            kept.append(entry.model_copy(update={"parameters": viscous}))
    actuator = dict(model.file.actuator)
    for key, value in (("current_noise", 0.0), ("resolver_counts", float(2**SMOOTH_BITS))):
        actuator[key] = Quantity(value=value, unit=actuator[key].unit)
    return PlantModel(model.file.model_copy(update={"effects": tuple(kept), "actuator": actuator}), model.path)


SMOOTH_BITS = 24
"""Resolver of the smooth plant: fine enough to be linear, coarse enough for the rig file."""


def corner(model: PlantModel, torque_constant: float = 1.0, motor_inertia: float = 1.0) -> PlantModel:
    """The plant model with other motor parameters on both actuators."""
    actuator = dict(model.file.actuator)
    for key, factor in (("torque_constant", torque_constant), ("rotor_inertia", motor_inertia)):
        actuator[key] = actuator[key].model_copy(update={"value": actuator[key].value * factor})
    return PlantModel(model.file.model_copy(update={"actuator": actuator}), model.path)


def effect_value(model: PlantModel, effect: str, name: str) -> float:
    """One parameter of an effect in SI (by its key in the model file), 0 where the effect is absent; the first entry counts."""
    known = effect_keys(BY_NAME[effect])
    for entry in model.file.effects:
        if entry.effect == effect and name in entry.parameters and name in known:
            quantity = entry.parameters[name]
            return float(quantity.value * UNITS[quantity.unit][1])
    return 0.0
