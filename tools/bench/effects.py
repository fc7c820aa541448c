"""What the effects cost in the kernel: all of them present, against all absent (their zero tests remain), per control cycle."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np

from spsp_ctrl.config.loader import load_scenario
from spsp_ctrl.plant import kernel
from spsp_ctrl.plant.layout import N_COMMAND, N_WORK, C
from spsp_ctrl.plant.model import ALL_EFFECT_NAMES, PlantModel, load_model
from spsp_ctrl.plant.virtual import VirtualPlant
from tools.bench.common import line, load, repeated

CONFIG = Path(__file__).resolve().parents[2] / "config"
CYCLES = 20_000


def main() -> None:
    """Print the figures."""
    model = load_model(CONFIG / "model.yaml")
    scenario = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model

    def cost(plant_model: PlantModel) -> float:
        plant = VirtualPlant(plant_model, scenario, 1000, 1)
        rows = np.repeat(plant._rows[:1], 2, axis=0)
        command = np.zeros(N_COMMAND)
        command[[C.enable, C.pitch_velocity, C.roll_velocity]] = 1.0
        command[C.pitch_speed], command[C.roll_speed] = 3.0, -3.0
        state, out, work = plant.state.copy(), plant.out.copy(), np.zeros(N_WORK)
        begin = time.perf_counter()
        for _ in range(CYCLES):
            kernel.cycle(state, plant.parameters, rows[0], rows[1], command, out, work, plant.substeps, 1e-3, False)
        return (time.perf_counter() - begin) / CYCLES * 1e6

    bare = model.without(*ALL_EFFECT_NAMES)
    print(f"effects: {len(ALL_EFFECT_NAMES)} in one kernel, 10 substeps a cycle; {load()}")
    with_all, _ = repeated(lambda: cost(model))
    without, _ = repeated(lambda: cost(bare))
    print(line("kernel call, all effects", with_all, "us"))
    print(line("kernel call, none", without, "us"))
    print(f"none / all = {statistics.median(without) / statistics.median(with_all):.2f}")


if __name__ == "__main__":
    main()
