"""Azimuth homed by its zero switch between the travel switches, from anywhere, with a counter that starts anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.control import homing
from spsp_ctrl.control.homing import HomingState, Phase
from spsp_ctrl.messages import AzimuthSample, Mode, OperatorRequest
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.rig.injection import InjectedRig
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.runtime import cycle

CONFIG = Path(__file__).parents[2] / "config"
STEP_DEG = 360.0 / 76800.0


@dataclass
class Axis:
    """Azimuth with switches at +-91.5 deg and a vane of +-0.5 deg; the count is off by ``offset``."""

    angle: float
    offset: int = 0
    vane: bool = True

    def search(self, rate_deg_s: float = 5.0, most_s: float = 200.0) -> tuple[HomingState, float]:
        state, k = homing.START, 0
        while state.phase < Phase.FOUND and k < most_s * 100:
            sample = AzimuthSample(
                k * 10_000_000, k, True, round(self.angle / STEP_DEG) + self.offset, 0.0, self.angle >= 91.5, self.angle <= -91.5,
                self.vane and abs(self.angle) <= 0.5,
            )  # fmt: skip
            state = homing.step(state, sample)
            assert homing.step(state, sample) == state, "nothing happens between frames"
            self.angle += state.direction * rate_deg_s * 0.01
            k += 1
        return state, k * 0.01


@pytest.mark.parametrize("start", [-91.4, -30.0, -0.6, -0.4, 0.0, 0.3, 0.7, 40.0, 91.6])
@pytest.mark.parametrize("offset", [0, -12345])
def test_zero_is_found_from_anywhere(start: float, offset: int) -> None:
    axis = Axis(start, offset)
    state, took_s = axis.search()
    assert state.phase == Phase.FOUND
    assert abs(state.zero - offset) * STEP_DEG < 0.03
    assert took_s < 60.0
    assert homing.step(state, AzimuthSample(0, 10**6, True, 5, 0.0, True, True, True)) == state


def test_without_a_vane_it_fails_after_both_switches() -> None:
    axis = Axis(10.0, vane=False)
    state, took_s = axis.search()
    assert state.phase == Phase.FAILED
    assert took_s < 120.0
    assert abs(axis.angle) < 92.0


@pytest.mark.parametrize(("park", "offset", "fault"), [(-4.0, 5000.0, ""), (-3.0, -800.0, ""), (4.0, 0.0, "homing-failed")])
def test_a_rig_whose_counter_is_wrong_homes_arms_and_holds_its_heading(park: float, offset: float, fault: str) -> None:
    rig_file = load_rig(CONFIG / "rig.yaml").model
    supervisor = rig_file.supervisor.model_copy(update={"homing": "azimuth", "homing_timeout_s": 0.5 if fault else 60.0, "homing_rate_deg_s": 10.0})
    config = rig_file.model_copy(update={"supervisor": supervisor})
    still = load_scenario(CONFIG / "experiments" / "still.yaml").model.model_dump(by_alias=True)
    hurt = [{"signal": "azimuth.count", "kind": "wrong", "at_s": 0.0, "size": offset}]
    scenario = Scenario.model_validate(still | {"park": {"azimuth_deg": park}, "faults": hurt, "acceptance": []})
    rig = InjectedRig(SimulatedRig(config, load_model(CONFIG / "model.yaml"), scenario, 1), scenario.faults, 1)
    rig.open()
    controller, state = cycle.controller(config), cycle.start(config, scenario.reference)
    modes: list[Mode] = []
    for k in range(6000):
        now = k * 1_000_000
        control, state = cycle.step(state, controller, rig.read(now), (), now, 1e-3)
        rig.write(control.command, now)
        if not modes or modes[-1] != control.mode:
            modes.append(Mode(control.mode))
        if control.mode == Mode.HOMING:
            assert abs(control.command.azimuth_rate_rad_s) < 0.18
            assert control.command.pitch_speed_rad_s == 0.0
    if fault:
        assert state.supervisor.fault is not None
        assert state.supervisor.fault.id == fault
        assert modes == [Mode.DISARMED, Mode.HOMING, Mode.STOPPING, Mode.FAULT]
        return
    assert modes == [Mode.DISARMED, Mode.HOMING, Mode.READY, Mode.ALIGNING, Mode.ACTIVE]
    assert abs(state.zero - offset) * STEP_DEG < 0.06
    truth = rig.truth()
    assert truth is not None
    assert abs(control.estimate.azimuth_rad - truth.azimuth_rad) < 2e-3
    # homed again only when asked
    request = (OperatorRequest(6000 * 1_000_000, "stop", 0.0, "test"),)
    _, state = cycle.step(state, controller, rig.read(6000 * 1_000_000), request, 6000 * 1_000_000, 1e-3)
    assert state.supervisor.homed
