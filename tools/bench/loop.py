"""Simulated seconds per wall second with the real law on the virtual rig, with and without recording."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.recording.writer import Recorder
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.clock import LockStepClock
from spsp_ctrl.runtime.loop import CycleRecorder, NullRecorder, run_loop
from tools.bench.common import line, load, repeated

CONFIG = Path(__file__).resolve().parents[2] / "config"
SIMULATED_S = 20.0


def main() -> None:
    """Print the figures."""
    config = load_rig(CONFIG / "rig.yaml").model
    scenario = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
    model = load_model(CONFIG / "model.yaml")

    def speed(recorder: CycleRecorder) -> float:
        rig = SimulatedRig(config, model, scenario, 1)
        rig.open()
        clock = LockStepClock(round(1e9 / config.rate_hz))
        state = cycle.start(config, scenario.reference)
        begin = time.perf_counter()
        run_loop(rig, clock, cycle.controller(config), state, round(SIMULATED_S * 1e9), recorder, rate_hz=config.rate_hz)
        return SIMULATED_S / (time.perf_counter() - begin)

    def recorded() -> float:
        with tempfile.TemporaryDirectory() as folder:
            recorder = Recorder(Path(folder) / "run.mcap", real_time=False)
            try:
                return speed(recorder)
            finally:
                recorder.close()

    print(f"loop: {config.rate_hz} Hz, law {config.control.law}, {SIMULATED_S:g} s of {scenario.name}; {load()}")
    plain, references = repeated(lambda: speed(NullRecorder()))
    print(line("simulated s per wall s, law and plant", plain, "s/s", "30"))
    print(line("the same with the log written", repeated(recorded)[0], "s/s"))
    cycles = [1e6 / (s * config.rate_hz) for s in plain]
    print(line("one cycle", cycles, "us"))
    unit = statistics.median(references) / 200_000 * 1e9
    print(line("reference: one step of a float loop in Python", [unit], "ns"))
    print(f"one cycle is worth {statistics.median(cycles) * 1e3 / unit:.0f} steps of the reference")


if __name__ == "__main__":
    main()
