"""The linear model of one axis against the plant itself and against what can be said by hand."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

from spsp_ctrl.plant.layout import C, O, S
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.plant.virtual import VirtualPlant
from spsp_ctrl.tuning.measure import still
from spsp_ctrl.tuning.plant_model import Axis, axis_plant, corner, discrete, effect_value, smooth, state_space

AXES: tuple[Axis, ...] = ("pitch", "roll")


@pytest.mark.parametrize("axis", AXES)
def test_structural_mode_is_that_of_two_inertias_on_a_spring(model: PlantModel, axis: Axis) -> None:
    p = axis_plant(model, axis)
    at_rod = 1.0 / (p.motor_inertia_kg_m2 / p.travel_per_rad_m**2), p.lever_m**2 / p.platform_inertia_kg_m2
    by_hand = np.sqrt(p.stiffness_n_m * sum(at_rod)) / (2.0 * np.pi)
    poles = ct.poles(state_space(p))
    mode = max(poles, key=lambda s: s.imag)
    assert abs(mode) / (2.0 * np.pi) == pytest.approx(by_hand, rel=2e-3)
    assert 95.0 < by_hand < 115.0


@pytest.mark.parametrize("axis", AXES)
def test_step_of_current_moves_the_plant_as_the_model_says(model: PlantModel, axis: Axis) -> None:
    """Against the kernel with everything that is not smooth removed: motor, current and platform after a step of current."""
    plain = smooth(model)
    plant = VirtualPlant(plain, still("joint"), 1000, 1, substep_s=20e-6)
    start = {name: float(plant.out[getattr(O, name)]) for name in (f"joint_{axis}_rad", f"motor_{axis}_rate_rad_s", f"current_{axis}_a")}
    # let gravity's sag of the free axis aside: the difference to a run without the step
    still_plant = VirtualPlant(plain, still("joint"), 1000, 1, substep_s=20e-6)
    command, none = np.zeros(len(C)), np.zeros(len(C))
    command[C.enable] = none[C.enable] = 1.0
    command[getattr(C, f"{axis}_current")] = 0.05
    steps = 40
    seen = np.zeros((steps, 3))
    for k in range(steps):
        moved, free = plant.advance(command), still_plant.advance(none)
        seen[k] = [float(moved[getattr(O, name)] - free[getattr(O, name)]) for name in start]
    system = discrete(axis_plant(plain, axis), 1e-3)
    u = np.zeros((3, steps + 1))
    u[0] = 0.05
    response = ct.forced_response(system, inputs=u)
    angle = response.outputs[2, 1:]
    speed = response.states[2, 1:]
    current = response.outputs[1, 1:]
    for column, expected in zip(seen.T, (angle, speed, current), strict=True):
        assert np.abs(column - expected).max() < 0.01 * np.abs(expected).max()


def test_smooth_keeps_viscous_friction_and_drops_the_rest(model: PlantModel) -> None:
    plain = smooth(model)
    assert {e.effect for e in plain.file.effects} == {"motor_friction", "hinge_friction"}
    assert axis_plant(plain, "roll") == axis_plant(model, "roll")
    assert effect_value(plain, "motor_friction", "coulomb") == 0.0
    assert effect_value(model, "motor_friction", "coulomb") == pytest.approx(0.010)
    assert effect_value(model, "backlash", "gap") == pytest.approx(12e-6)


def test_corner_of_the_model_file_is_the_scaled_axis(model: PlantModel) -> None:
    assert axis_plant(corner(model, 1.3, 0.7), "pitch") == axis_plant(model, "pitch").scaled(1.3, 0.7)


def test_state_of_the_virtual_plant_stays_level_without_current(model: PlantModel) -> None:
    plant = VirtualPlant(smooth(model), still("joint"), 1000, 1)
    assert abs(plant.state[S.roll]) < 1e-12
