"""The plant in continuous time: advanced to any instant, as devices with clocks of their own ask for it."""

from __future__ import annotations

import numpy as np

from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.plant import kernel
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_INPUT, N_NOISE, A
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.plant.virtual import BLOCK, SUBSTEP_S, VirtualPlant

GRID_HZ = 1000
"""Inputs are made at this rate and taken as straight lines between (10 deg in 2 s: 0.001 arcmin)."""
_NOISE = slice(N_INPUT - N_NOISE, N_INPUT)


class NotContinuous(Exception):
    """The model holds an effect that counts in whole cycles."""


class ContinuousPlant(VirtualPlant):
    """``advance_to`` an instant; steps need not be equal. Raises ``NotContinuous`` for a model with a command delay."""

    def __init__(self, model: PlantModel, scenario: Scenario, seed: int) -> None:
        super().__init__(model, scenario, GRID_HZ, seed)
        p = self.parameters
        if p[A.command_delay_s] or p[N_AXIS_PARAMETERS + A.command_delay_s]:
            raise NotContinuous("the effect command_delay counts in whole cycles: it cannot be served in real time; take it out of the model file")
        self.time_s = 0.0
        self._inputs = self._rows[0].copy()

    def advance_to(self, time_s: float, command: Array, imu_due: bool = False) -> Array:
        """The output row at ``time_s`` (or now, if that is past) under ``command``."""
        while True:
            grid_s = (self.cycle + 1) / GRID_HZ
            end_s = min(time_s, grid_s)
            last = end_s >= time_s
            dt = end_s - self.time_s
            if dt > 1e-9:
                self._step(dt, end_s, command, imu_due and last)
            elif imu_due and last:  # the instant has passed already: a frame of now
                self._step(1e-9, self.time_s, command, True)
            if end_s >= grid_s:
                self._next_grid()
            if last:
                return self.out

    def _step(self, dt: float, end_s: float, command: Array, imu_due: bool) -> None:
        row, following = self._rows[self.cycle % BLOCK], self._rows[self.cycle % BLOCK + 1]
        w = end_s * GRID_HZ - self.cycle
        inputs = following.copy() if w >= 1.0 else row + w * (following - row)
        inputs[_NOISE] = following[_NOISE]
        substeps = max(1, int(np.ceil(dt / SUBSTEP_S - 1e-6)))
        kernel.cycle(self.state, self.parameters, self._inputs, inputs, command, self.out, self._work, substeps, dt, imu_due)
        self._inputs = inputs
        self.time_s = max(self.time_s, end_s)

    def _next_grid(self) -> None:
        i = self.cycle % BLOCK
        self.cycle += 1
        if i + 1 == BLOCK:
            self._rows = self._block(self.cycle, self._rows[BLOCK])
