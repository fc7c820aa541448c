"""What a simulation of a single axis costs: the unit of work of a diagnosis, which does thousands."""

from __future__ import annotations

import time
from math import pi
from pathlib import Path

import numpy as np

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, N_IN
from spsp_ctrl.plant.axis_model import AxisModel, load_axis_model
from tools.bench.common import line, load, repeated

CONFIG = Path(__file__).resolve().parents[2] / "config"
SECONDS = 24.0


def main() -> None:
    """Print the figures."""
    print(f"axis: {SECONDS:g} s of motion; {load()}")
    for name in ("axis.yaml", "axis-bare.yaml"):
        model = load_axis_model(CONFIG / name)
        t = np.arange(round(SECONDS * model.file.rate_hz)) / model.file.rate_hz
        u = np.zeros((len(t), N_IN))
        u[:, IN.enabled], u[:, IN.screw_c] = 1.0, 20.0
        u[:, IN.command_a], u[:, IN.reference_m] = 0.5 * np.sin(4 * pi * t), 0.01 * (1 - np.cos(2 * pi * t))
        designed = model.parameters()
        everything = designed.copy()
        for h in model.hypotheses().values():
            for free in h.free:
                everything[model.index(free.name)] = free.starts[0]
        steps = f"{model.file.rate_hz:g} Hz, {model.substeps} sub-steps"
        target = "40 ms" if name == "axis.yaml" else ""
        print(line(f"{name}, {steps}, as designed", repeated(lambda m=model, p=designed, v=u: cost(m, p, v))[0], "ms", target))  # type: ignore[misc]
        print(line(f"{name}, every effect of the library", repeated(lambda m=model, p=everything, v=u: cost(m, p, v))[0], "ms"))  # type: ignore[misc]


def cost(model: AxisModel, p: Array, u: Array) -> float:
    """One simulation in ms."""
    begin = time.perf_counter()
    model.simulate(p, u)
    return (time.perf_counter() - begin) * 1e3


if __name__ == "__main__":
    main()
