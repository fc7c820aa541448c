"""The plant as one object: parameters, state, inputs in blocks, one call per cycle."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.plant import kernel
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import (
    N_AXIS_PARAMETERS,
    N_AXIS_STATE,
    N_BASE,
    N_COMMAND,
    N_INPUT,
    N_NOISE,
    N_OUTPUT,
    N_STATE,
    N_WORK,
    A,
    G,
    S,
    U,
    W,
    X,
)
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.plant.stages.mechanism import prepare, to_platform
from spsp_ctrl.plant.stages.transmission import free_travel
from spsp_ctrl.plant.swing_table import SwingTable

SUBSTEP_S = 100e-6
"""Integration step: 10 kHz. Halving it twice moves peak errors of the standard runs no more than a change of seed does (tests/plant)."""
BLOCK = 125
"""Cycles for which inputs are made at once: small, since in real time one cycle pays for the whole block (0.3 ms)."""


class VirtualPlant:
    """The plant under a scenario, advanced cycle by cycle. Deterministic for a seed."""

    def __init__(self, model: PlantModel, scenario: Scenario, rate_hz: int, seed: int, substep_s: float = SUBSTEP_S) -> None:
        self.parameters = model.parameters()
        self.rate_hz = rate_hz
        self.period_s = 1.0 / rate_hz
        self.substeps = max(1, round(self.period_s / substep_s))
        self.imu_every = max(1, round(rate_hz / self.parameters[G.imu_rate_hz]))
        self.scenario = scenario
        base_seed, noise_seed = (int(s.generate_state(1)[0]) for s in np.random.SeedSequence(seed).spawn(2))
        self.swing = SwingTable(scenario.base, rate_hz, base_seed, float(self.parameters[G.swing_arm_m]))
        self._rng = np.random.Generator(np.random.PCG64(noise_seed))
        self.cycle = 0
        self._work = np.zeros(N_WORK)
        self.out = np.zeros(N_OUTPUT)
        self._rows = self._block(0)
        self.state = self._initial_state()
        kernel.start(self.state, self.parameters, self._rows[0], self.out, self._work)

    def advance(self, command: Array) -> Array:
        """One cycle under ``command`` (``layout.C``); returns the output row, valid until the next call."""
        i = self.cycle % BLOCK
        self.cycle += 1
        kernel.cycle(
            self.state,
            self.parameters,
            self._rows[i],
            self._rows[i + 1],
            command,
            self.out,
            self._work,
            self.substeps,
            self.period_s,
            self.cycle % self.imu_every == 0,
        )
        if i + 1 == BLOCK:
            self._rows = self._block(self.cycle, self._rows[BLOCK])
        return self.out

    def warm_up(self) -> None:
        """Compile (or load) the kernel without touching the state."""
        kernel.cycle(
            self.state.copy(),
            self.parameters,
            self._rows[0],
            self._rows[1],
            np.zeros(N_COMMAND),
            self.out.copy(),
            self._work.copy(),
            self.substeps,
            self.period_s,
            True,
        )

    def _block(self, first: int, before: Array | None = None) -> Array:
        """Inputs of cycles ``first`` to ``first + BLOCK``; the last row of one block is the first row of the next."""
        rows = np.zeros((BLOCK + 1, N_INPUT))
        rows[:, :N_BASE] = self.swing.block(first, BLOCK + 1)
        rows[:, U.base_pitch : U.base_yaw + 1] = self.swing.angles(first, BLOCK + 1)
        scenario = self.scenario
        rows[:, U.load_mass] = scenario.load.mass_kg
        rows[:, U.ambient] = scenario.temperature.ambient_c
        if scenario.temperature.start_c is not None:
            before_step = np.arange(first, first + BLOCK + 1) < scenario.temperature.step_at_s * self.rate_hz
            rows[before_step, U.ambient] = scenario.temperature.start_c
        warm = scenario.temperature.screw_c
        if warm is not None:
            rows[:, U.heater_c] = warm
            rows[:, U.heater_on] = float(scenario.temperature.hold)
        noise = slice(N_INPUT - N_NOISE, N_INPUT)
        rows[1:, noise] = self._rng.standard_normal((BLOCK, N_NOISE))
        if before is not None:
            rows[0, noise] = before[noise]
        return rows

    def _initial_state(self) -> Array:
        """At rest in the parked pose, screws loaded by gravity."""
        x = np.zeros(N_STATE)
        p, u, w = self.parameters, self._rows[0], self._work
        park = self.scenario.park
        pitch, roll, azimuth = np.radians([park.pitch_deg, park.roll_deg, park.azimuth_deg])
        x[S.pitch], x[S.roll], x[S.azimuth] = pitch, roll, azimuth
        temperature = self.scenario.temperature
        start = temperature.ambient_c if temperature.start_c is None else temperature.start_c
        x[S.column_temperature] = x[S.frame_temperature] = start
        warm = temperature.screw_c
        x[X.screw_temperature] = x[N_AXIS_STATE + X.screw_temperature] = start if warm is None else warm
        x[S.rotor_angle] = x[S.step_angle] = azimuth * p[G.az_gear_ratio]
        prepare(x, p, u, w)
        geometry = (w[W.height], w[W.upper], w[W.lower])
        l1, l2 = kernel.rod_lengths(pitch, roll, *geometry)
        j11, j21, j22 = kernel.jacobian(pitch, roll, l1, l2, *geometry)
        cr, sr = cos(roll), sin(roll)
        f = to_platform(
            u[U.base_f_x], u[U.base_f_y], u[U.base_f_z], cos(azimuth), sin(azimuth), cos(pitch), sin(pitch), cr, sr
        )
        nx, ny, nz = np.cross([w[W.mcx], w[W.mcy], w[W.mcz]], f)
        push2 = -nx / j22
        push1 = (cr * ny + sr * nz - push2 * j21) / j11
        for axis, (rod, push) in enumerate(((l1 - w[W.level], push1), (l2 - w[W.level], push2))):
            xb, pb = axis * N_AXIS_STATE, axis * N_AXIS_PARAMETERS
            target = rod + push / p[pb + A.axial_stiffness_n_m] + 0.5 * p[pb + A.gap_m] * np.sign(push)
            for _ in range(20):
                travel, gain = free_travel(x, xb, p, pb)
                x[xb + X.angle] += (target - travel) / gain
        return x
