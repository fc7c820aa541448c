"""What the stabiliser holds on the virtual rig, nominal and in the corners, and that a plainer law takes over when it must.

Figures are by the IMU that closes the loop unless said otherwise, largest over the seeds, after the stated transient. The lower bounds
say that this is a real plant with a real sensor: noise and quantisation of the IMU alone give 0.05 arcmin rms.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.experiments.test_acceptance import MODEL, changed, run

from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments import summary
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, A, G
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.runtime.loop import LoopResult

Sines = list[tuple[float, float]]


class Changed(PlantModel):
    """The plant with some parameters multiplied."""

    factors: dict[str, float]

    def parameters(self) -> Array:
        p = MODEL.parameters()
        for name, factor in self.factors.items():
            if name in A._fields:
                for axis in range(2):
                    p[axis * N_AXIS_PARAMETERS + getattr(A, name)] *= factor
            else:
                p[getattr(G, name)] *= factor
        return p


def plant(**factors: float) -> PlantModel:
    model = Changed(MODEL.file, MODEL.path)
    object.__setattr__(model, "factors", factors)
    return model


def swing(pitch: Sines, roll: Sines, duration_s: float = 20.0, **more: Any) -> Scenario:
    def sines(waves: Sines) -> list[dict[str, float]]:
        return [{"amplitude_deg": a, "period_s": t} for a, t in waves]

    base = {
        "start_s": 1.0,
        "ramp_s": 3.0,
        "pitch": sines(pitch),
        "roll": sines(roll),
        "roughness": {"rms_arcmin": 0.05, "low_hz": 2.0, "high_hz": 10.0},
    }
    return changed(name="swing", duration_s=duration_s, settle_s=8.0, base=base, acceptance=[], **more)


def held(
    scenario: Scenario, *sets: str, model: PlantModel = MODEL, seeds: tuple[int, ...] = (1, 2)
) -> tuple[dict[str, float], list[dict[str, object]], LoopResult]:
    """Worst axis and seed of each figure, and the events of the last run."""
    worst = {"imu_max": 0.0, "imu_rms": 0.0, "true_max": 0.0}
    for seed in seeds:
        result, topics = run(*sets, scenario=scenario, seed=seed, model=model)
        assert result.ended == "completed", result.ended
        figures = summary.errors(topics, scenario.settle_s, scenario.duration_s)
        assert figures["samples"] > 5000
        for name in worst:
            worst[name] = max(worst[name], *(figures["error_arcmin"][axis][name] for axis in ("pitch", "roll")))
    return worst, result.events, result


SEA_ROLL = [(0.9 * g, t) for g, t in zip((0.5, 0.8, 1.2, 1.4, 1.2, 1.0, 0.7, 0.5), (11, 9.3, 8.1, 7.3, 6.5, 5.7, 4.9, 4.1), strict=True)]


@pytest.mark.parametrize(
    ("pitch", "roll", "most", "rms"),
    [
        ([], [(15.0, 8.0)], 0.6, 0.13),
        ([(6.0, 4.0)], [(15.0, 8.0)], 0.6, 0.13),
        ([], [(10.0, 2.0)], 0.8, 0.2),
        ([(2.0, 5.3)], SEA_ROLL, 0.7, 0.13),
        ([], [(3.0, 10.0)], 0.6, 0.13),
        ([], [], 0.4, 0.12),
    ],
    ids=["roll-15-8", "2dof", "fast-10-2", "several-sines", "slow-3-10", "still"],
)
def test_stabiliser_holds(pitch: Sines, roll: Sines, most: float, rms: float) -> None:
    error, events, _ = held(swing(pitch, roll))
    assert 0.1 < error["imu_max"] <= most, error
    assert 0.05 < error["imu_rms"] <= rms, error
    assert error["true_max"] <= 1.0, error
    assert not [e for e in events if e["id"] == "law-fallback"]


TWO = ([(6.0, 4.0)], [(15.0, 8.0)])


def test_outer_frame_in_pitch_is_held_as_well_though_azimuth_must_turn() -> None:
    """Azimuth turns to and fro by 1.2 degrees through its play, under 15 degrees of tilt: play not known shows as a tilt error of 0.5 arcmin."""
    scenario = swing(*TWO)
    other = scenario.model_copy(update={"base": scenario.base.model_copy(update={"axis_order": "pitch_roll"})})
    error, events, _ = held(other)
    assert error["imu_max"] <= 0.6, error
    assert error["imu_rms"] <= 0.15, error
    assert error["true_max"] <= 1.0, error
    assert not [e for e in events if e["id"] == "law-fallback"]


@pytest.mark.parametrize(
    "factors",
    [
        {"torque_constant_nm_a": 1.3, "rotor_inertia_kg_m2": 0.7},
        {"torque_constant_nm_a": 0.7, "rotor_inertia_kg_m2": 1.3},
        {"gap_m": 2.0},
        {"axial_stiffness_n_m": 0.5},
    ],
    ids=lambda f: "-".join(f"{k}x{v}" for k, v in f.items()),
)
def test_default_gains_hold_in_the_corners_without_chatter(factors: dict[str, float]) -> None:
    error, events, _ = held(swing(*TWO), model=plant(**factors), seeds=(1,))
    assert error["imu_max"] <= 1.2, error
    assert not [e for e in events if e["id"] == "law-fallback"]


def test_performance_gains_chatter_in_a_corner_and_fall_back_by_themselves() -> None:
    sets = "control.stabiliser.performance.enabled=true"
    nominal, events, _ = held(swing(*TWO), sets, seeds=(1,))
    assert nominal["imu_max"] <= 0.6
    assert not [e for e in events if e["id"] == "law-fallback"]
    corner = plant(torque_constant_nm_a=1.3, rotor_inertia_kg_m2=0.7)
    error, events, _ = held(swing(*TWO), sets, model=corner, seeds=(1,))
    fallback = [e for e in events if e["id"] == "law-fallback"]
    assert len(fallback) == 1
    assert "chatter" in str(fallback[0]["text"])
    assert error["imu_max"] <= 1.2, error


def test_taking_over_while_moving_does_not_jump() -> None:
    """From the stabiliser to the plain cascade in the middle of a fast swing: the plain law starts with what was fed forward."""
    hot = "control.stabiliser.speed.kp_a_s_rad=0.08"
    corner = plant(torque_constant_nm_a=1.3, rotor_inertia_kg_m2=0.7)
    scenario = swing([], [(8.0, 4.0)], duration_s=14.0)
    late = (hot, "control.watch.window_s=6.0", "control.watch.chatter_a=0.1")
    _, topics = run(*late, scenario=scenario, model=corner)
    control, truth = topics["/control"], topics["/truth"]
    steps = np.flatnonzero(np.diff(control["law_step"]))
    assert len(steps) == 1
    at = int(steps[0])
    after = slice(at, at + 300)
    assert np.abs(truth["platform_roll_rad"][after]).max() * 10800 / np.pi < 8.0
    speed = control["roll.rod_speed_ref_m_s"]
    assert np.abs(np.diff(speed[at - 2 : at + 20])).max() <= 0.4e-3 + 1e-12


def test_short_silences_of_the_imu_do_not_show() -> None:
    silences = [{"signal": "imu", "at_s": 8.05 + 0.9 * k, "duration_s": 0.05} for k in range(12)]
    error, _, _ = held(swing(*TWO, dropouts=silences))
    assert error["imu_max"] <= 1.0, error
    assert error["true_max"] <= 1.2, error


def test_a_slow_imu_that_is_known_to_be_slow_is_no_harm() -> None:
    error, _, _ = held(swing(*TWO), "imu.delay_ms=20", model=plant(imu_delay_s=4.0), seeds=(1,))
    assert error["imu_max"] <= 1.0, error
