"""Runs of both kernels with every effect on, printed as hex floats: what the compiled kernel and its plain-Python twin must agree on.

``python tests/plant/twin_run.py``; with ``SPSP_CTRL_PLAIN=1`` nothing is compiled.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from spsp_ctrl.plant import kernel
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, N_IN
from spsp_ctrl.plant.axis_model import AXIS_EFFECTS, load_axis_model
from spsp_ctrl.plant.compile import IS_COMPILED
from spsp_ctrl.plant.effects import EFFECTS
from spsp_ctrl.plant.layout import (
    AXIS_PARAMETERS,
    GLOBAL_PARAMETERS,
    N_AXIS_PARAMETERS,
    N_COMMAND,
    N_INPUT,
    N_OUTPUT,
    N_STATE,
    N_WORK,
    C,
    G,
    L,
    S,
    U,
    X,
)
from spsp_ctrl.plant.model import load_model

CONFIG = Path(__file__).resolve().parents[2] / "config"
KNOWN = {q.name for effect in AXIS_EFFECTS for q in effect.parameters}


def sizes() -> dict[str, float]:
    """Every parameter of every hypothesis at its first start."""
    return {free.name: free.starts[0] for effect in EFFECTS for h in effect.hypotheses for free in h.free}


def axis_run(name: str, cycles: int) -> Array:
    """The single axis under a fast command, with a load, in both command modes."""
    model = load_axis_model(CONFIG / name)
    p = model.parameters()
    for parameter, value in sizes().items():
        if parameter in KNOWN:
            p[model.index(parameter)] = value
    u = np.zeros((cycles, N_IN))
    k = np.arange(cycles)
    u[:, IN.enabled] = 1.0
    u[:, IN.velocity_mode] = k >= cycles // 2
    u[:, IN.reference_m] = 1e-3 * (1.0 - np.cos(0.3 * k))
    u[:, IN.command_a], u[:, IN.command_rad_s] = 0.4 * np.sin(0.5 * k), 30.0 * np.sin(0.4 * k)
    u[:, IN.load_force_n], u[:, IN.load_mass_kg], u[:, IN.screw_c] = 8.0, 1.5, 24.0
    if name == "axis-bare.yaml":
        u[:, IN.velocity_mode] = 0.0
        p[L.limit] = 10.0
    return model.simulate(p, u)


def platform_run(cycles: int, effects: dict[str, float], current_a: float = 0.4) -> Array:
    """The platform on a still base, both legs driven: outputs, and the state at the end."""
    p = load_model(CONFIG / "model.yaml").parameters()
    place = {q.name: i for i, q in enumerate(AXIS_PARAMETERS)}
    rig = {q.name: 2 * N_AXIS_PARAMETERS + i for i, q in enumerate(GLOBAL_PARAMETERS)}
    for parameter, value in effects.items():
        if parameter in place:
            p[place[parameter]] = p[N_AXIS_PARAMETERS + place[parameter]] = value
        elif parameter in rig:
            p[rig[parameter]] = value
    rows = np.zeros((cycles + 1, N_INPUT))
    rows[:, U.base_r00] = rows[:, U.base_r11] = rows[:, U.base_r22] = 1.0
    rows[:, U.base_f_z], rows[:, U.load_mass], rows[:, U.ambient] = 9.80665, 7.0, 25.0
    x, out, w = np.zeros(N_STATE), np.zeros(N_OUTPUT), np.zeros(N_WORK)
    x[X.screw_temperature] = x[S.column_temperature] = x[S.frame_temperature] = p[G.temperature_reference_c]
    kernel.start(x, p, rows[0], out, w)
    commands, outs = np.zeros((cycles, N_COMMAND)), np.zeros((cycles, N_OUTPUT))
    k = np.arange(cycles)
    commands[:, C.enable] = commands[:, C.roll_velocity] = 1.0
    commands[:, C.pitch_current], commands[:, C.roll_speed] = current_a * np.sin(0.5 * k), 30.0 * np.sin(0.4 * k)
    commands[:, C.azimuth_rate] = 0.1
    outs[0] = out
    kernel.rollout(x, p, rows, commands, outs, w, 10, 1e-3, 5, 0)
    return np.vstack([outs, np.resize(x, N_OUTPUT)])


def runs() -> dict[str, Array]:
    """All of them, short enough for plain Python."""
    return {"axis.yaml": axis_run("axis.yaml", 40), "axis-bare.yaml": axis_run("axis-bare.yaml", 60), "model.yaml": platform_run(30, sizes())}


if __name__ == "__main__":
    print(json.dumps({"compiled": IS_COMPILED} | {n: [float(v).hex() for v in y.ravel()] for n, y in runs().items()}))
