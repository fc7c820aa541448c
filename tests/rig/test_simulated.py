"""The virtual rig against the contract of every rig, and what only it does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from tests.rig_contract import PERIOD_NS, Factory, contract, drive

from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.config.scenario import Dropout
from spsp_ctrl.plant.model import EffectEntry, PlantModel, Quantity, load_model
from spsp_ctrl.rig.simulated import SimulatedRig

CONFIG = Path(__file__).parents[2] / "config"
RIG = load_rig(CONFIG / "rig.yaml").model
SCENARIO = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
MODEL = load_model(CONFIG / "model.yaml")


def make() -> SimulatedRig:
    return SimulatedRig(RIG, MODEL, SCENARIO, seed=7)


@contract
def test_contract(check: Callable[[Factory], None]) -> None:
    check(make)


def test_another_seed_gives_other_noise() -> None:
    a, b = SimulatedRig(RIG, MODEL, SCENARIO, seed=1), SimulatedRig(RIG, MODEL, SCENARIO, seed=2)
    assert [m.imu for m in drive(a, 50, lambda k: 0.0)] != [m.imu for m in drive(b, 50, lambda k: 0.0)]


def test_dropout_withholds_imu_frames() -> None:
    scenario = SCENARIO.model_copy(update={"dropouts": (Dropout(at_s=0.1, duration_s=0.05),)})
    rig = SimulatedRig(RIG, MODEL, scenario, seed=1)
    seen = drive(rig, 250, lambda k: 0.0)
    ages = np.array([m.stamp_ns - m.imu.stamp_ns for m in seen[20:]]) / 1e6
    assert ages.max() >= 55.0
    assert seen[-1].stamp_ns - seen[-1].imu.stamp_ns <= 10 * PERIOD_NS


def test_imu_delay_effect_adds_to_the_transport() -> None:
    late = EffectEntry(effect="imu_delay", parameters={"imu_added_delay": Quantity(value=7.0, unit="ms")})
    model = PlantModel(MODEL.file.model_copy(update={"effects": (*MODEL.file.effects, late)}), MODEL.path)
    transport = [m.imu.received_ns - m.imu.stamp_ns for m in drive(SimulatedRig(RIG, model, SCENARIO, seed=1), 100, lambda k: 0.0)[50:]]
    assert set(transport) == {12_000_000}


def test_parked_platform_stays_put_with_the_drives_off() -> None:
    """Screw friction holds the off-centre load: a disabled rig does not sink."""
    rig = make()
    rig.open()
    start = rig.truth()
    for k in range(1500):
        rig.read(k * PERIOD_NS)
    end = rig.truth()
    assert abs(end.screw_pitch_m - start.screw_pitch_m) < 2e-6
    assert abs(end.screw_roll_m - start.screw_roll_m) < 2e-6
