"""The issue's own figures on the virtual rig: what the default law holds, what the paper's cascade holds, what each compensation is worth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from spsp_ctrl.config.loader import apply_overrides, load_rig, load_scenario
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments import summary
from spsp_ctrl.messages import Control, Measurement, OperatorRequest, Timing, Truth
from spsp_ctrl.plant.model import PlantModel, load_model
from spsp_ctrl.recording.schema import CYCLIC, TOPICS
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.clock import LockStepClock
from spsp_ctrl.runtime.loop import LoopResult, run_loop

CONFIG = Path(__file__).parents[2] / "config"
RIG = load_rig(CONFIG / "rig.yaml")
SWING = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
MODEL = load_model(CONFIG / "model.yaml")


class Memory:
    """Keeps the cyclic messages as the log would hold them."""

    def __init__(self) -> None:
        self.rows: dict[str, list[bytes]] = {topic: [] for topic in CYCLIC}

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        assert truth is not None
        for topic, message in zip(CYCLIC, (measurement, control, timing, truth), strict=True):
            self.rows[topic].append(TOPICS[topic].encode(message))

    def event(self, stamp_ns: int, level: str, id: str, text: str) -> None:
        """Not needed."""

    def operator(self, request: OperatorRequest) -> None:
        """Not needed."""

    def topics(self) -> dict[str, NDArray[Any]]:
        return {topic: np.frombuffer(b"".join(rows), TOPICS[topic].dtype) for topic, rows in self.rows.items()}


def run(
    *sets: str, scenario: Scenario = SWING, seed: int = 1, model: PlantModel = MODEL
) -> tuple[LoopResult, dict[str, NDArray[Any]]]:
    """One run in lock-step: how it ended, and its cyclic topics as the log would hold them."""
    config = apply_overrides(RIG, sets).model if sets else RIG.model
    rig = SimulatedRig(config, model, scenario, seed)
    rig.open()
    memory = Memory()
    result = run_loop(
        rig,
        LockStepClock(round(1e9 / config.rate_hz)),
        cycle.controller(config),
        cycle.start(config, scenario.reference),
        round(scenario.duration_s * 1e9),
        memory,
        rate_hz=config.rate_hz,
    )
    return result, memory.topics()


def changed(**values: Any) -> Scenario:
    return Scenario.model_validate(SWING.model_dump(by_alias=True) | values)


def test_default_law_holds_level_on_the_swinging_table_and_is_not_a_hidden_ideal() -> None:
    result, topics = run()
    assert result.ended == "completed"
    figures = summary.errors(topics, SWING.settle_s, SWING.duration_s)
    for axis in ("pitch", "roll"):
        error = figures["error_arcmin"][axis]
        assert 0.05 < error["imu_max"] <= 2.0, error
        assert error["true_max"] <= 3.0, error
    assert figures["azimuth_error_deg"]["imu_max"] <= 0.2
    assert figures["azimuth_error_deg"]["imu_rms"] <= 0.05
    swing = topics["/truth"][topics["/truth"]["stamp_ns"] > SWING.settle_s * 1e9]
    assert np.degrees(np.ptp(swing["base_roll_rad"])) == pytest.approx(30.0, abs=0.1)
    assert np.degrees(np.ptp(swing["base_pitch_rad"])) == pytest.approx(12.0, abs=0.1)


def test_cascade_lands_where_the_paper_does() -> None:
    result, topics = run("control.law=cascade")
    assert result.ended == "completed"
    figures = summary.errors(topics, SWING.settle_s, SWING.duration_s)
    for axis in ("pitch", "roll"):
        assert 1.0 <= figures["error_arcmin"][axis]["imu_max"] <= 3.3, figures["error_arcmin"]


OPEN_LOOP = changed(
    name="open-loop",
    duration_s=20.0,
    settle_s=4.0,
    park={},
    base={},
    reference={"kind": "joint", "roll": [{"amplitude_deg": 8.0, "period_s": 8.0}], "start_s": 1.0, "ramp_s": 1.0},
    acceptance=[],
)


def rod_error_um(topics: dict[str, NDArray[Any]], scenario: Scenario) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Rod position in mm, true minus believed rod travel in um, and direction of travel, of the roll leg."""
    control, truth = topics["/control"], topics["/truth"]
    keep = summary.judged(control, scenario.settle_s, scenario.duration_s)
    error = (truth["rod_roll_m"] - control["estimate.rod_roll_m"])[keep] * 1e6
    return truth["rod_roll_m"][keep] * 1e3, error, control["roll.rod_speed_ref_m_s"][keep]


def hysteresis_um(topics: dict[str, NDArray[Any]]) -> float:
    """Mean distance between the error on the way up and on the way down at the same place (Fig 16's reversal step)."""
    place, error, speed = rod_error_um(topics, OPEN_LOOP)
    up, down = speed > 1e-3, speed < -1e-3
    widths = []
    for centre in np.arange(-12.0, 12.5, 1.0):
        near = np.abs(place - centre) < 0.5
        widths.append(error[up & near].mean() - error[down & near].mean())
    return float(np.mean(np.abs(widths)))


def test_backlash_compensation_earns_its_place() -> None:
    """Open loop, 8 deg / 8 s with 7 kg: reversal hysteresis of the rod error with and without the compensation."""
    with_it = hysteresis_um(run(scenario=OPEN_LOOP)[1])
    without = hysteresis_um(run("compensation.backlash.enabled=false", scenario=OPEN_LOOP)[1])
    assert without > 8.0
    assert without >= 2.0 * with_it, (without, with_it)


def coasting_um(topics: dict[str, NDArray[Any]], scenario: Scenario) -> float:
    """Change of the roll rod's error (true minus believed) from the start to the last 20 ms of a silence of the IMU, mean over the silences."""
    control, truth = topics["/control"], topics["/truth"]
    t = control["stamp_ns"] * 1e-9
    error = (truth["rod_roll_m"] - control["estimate.rod_roll_m"]) * 1e6
    changes = []
    for silence in scenario.dropouts:
        during = (t >= silence.at_s) & (t < silence.at_s + silence.duration_s)
        changes.append(abs(error[during][-20:].mean() - error[during][0]))
    assert len(changes) >= 5
    return float(np.mean(changes))


def test_backlash_compensation_earns_its_place_while_the_imu_is_silent() -> None:
    """Base roll 10 deg / 4 s, 80 ms of silence at each reversal of the rod: what the controller believes of the rod, with and without."""
    reversals = [1.0 + 1.0 + 2.0 * k for k in range(3, 9)]
    scenario = changed(
        name="coasting",
        duration_s=19.0,
        base={"start_s": 1.0, "ramp_s": 2.0, "roll": [{"amplitude_deg": 10.0, "period_s": 4.0}]},
        dropouts=[{"at_s": t - 0.01, "duration_s": 0.08} for t in reversals],
        acceptance=[],
    )
    with_it = coasting_um(run(scenario=scenario)[1], scenario)
    without = coasting_um(run("compensation.backlash.enabled=false", scenario=scenario)[1], scenario)
    assert without > 8.0
    assert without >= 2.0 * with_it, (without, with_it)


def test_thermal_compensation_earns_its_place() -> None:
    """Open loop with screws 20 K warm: mean rod error with and without Eq (13)."""
    warm = OPEN_LOOP.model_copy(
        update={"temperature": OPEN_LOOP.temperature.model_copy(update={"screw_c": 40.0, "hold": True})}
    )
    _, with_it, _ = rod_error_um(run(scenario=warm)[1], warm)
    _, without, _ = rod_error_um(run("compensation.thermal.enabled=false", scenario=warm)[1], warm)
    assert without.mean() == pytest.approx(57.5, abs=15.0)
    assert abs(without.mean()) >= 2.0 * abs(with_it.mean()), (without.mean(), with_it.mean())
    assert np.abs(without).max() >= 2.0 * np.abs(with_it).max()


@pytest.mark.parametrize("mode", ["velocity"])
def test_velocity_mode_of_the_drives_works_too(mode: str) -> None:
    scenario = changed(duration_s=16.0)
    result, topics = run(f"pitch_actuator.mode={mode}", f"roll_actuator.mode={mode}", scenario=scenario)
    assert result.ended == "completed"
    figures = summary.errors(topics, scenario.settle_s, scenario.duration_s)
    assert max(figures["error_arcmin"][axis]["imu_max"] for axis in ("pitch", "roll")) <= 3.0


def test_lost_imu_frames_are_coasted_over_and_a_long_silence_stops_the_rig() -> None:
    short = changed(duration_s=14.0, dropouts=[{"at_s": 10.03, "duration_s": 0.04}, {"at_s": 12.0, "duration_s": 0.04}])
    result, topics = run(scenario=short)
    assert result.ended == "completed"
    assert topics["/control"]["estimate.coasting"].any()
    figures = summary.errors(topics, short.settle_s, short.duration_s)
    assert max(figures["error_arcmin"][axis]["true_max"] for axis in ("pitch", "roll")) <= 3.0
    long = changed(duration_s=14.0, dropouts=[{"at_s": 10.0, "duration_s": 3.0}])
    result, topics = run(scenario=long)
    assert result.ended == "fault: imu-stale"
    control = topics["/control"]
    stopped = control["stamp_ns"][np.argmax(control["mode"] == 5)] * 1e-9
    assert 10.04 < stopped < 10.10
    assert not control["command.enable"][-1]
    assert control["stamp_ns"][-1] * 1e-9 < 10.5
