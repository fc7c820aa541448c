"""The push-rod bench of Fig 13: one actuator with its own screw, a carriage on a guide, a weight over a pulley, a grating ruler.

Built from the stage functions of the platform (drive, transmission, resolver), so that one model file serves both. What the platform gives to the
rod is replaced by a moving mass: carriage and weight, guide friction, the pull of the weight. The ruler is fixed to the rod.
"""

from __future__ import annotations

from math import floor, pi, sin

import numpy as np

from spsp_ctrl.config.scenario import Bench
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.compile import compiled, entry
from spsp_ctrl.plant.effects.motor_friction import lugre
from spsp_ctrl.plant.effects.resolver_error import resolver_counts
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_AXIS_STATE, N_STATE, A, X
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.plant.stages.drive import drive_step
from spsp_ctrl.plant.stages.transmission import free_travel, rod_force, stop_force

GRAVITY_M_S2 = 9.80665
SUBSTEP_S = 100e-6
PRESLIDING_M = 12e-6
"""Rod travel over which the guide's friction builds up, as at the platform's hinges."""
STATIC_RATIO = 1.2
STRIBECK_M_S = 2e-3

# free numbers of the bench behind the plant's own state: rod position and speed, guide bristle
ROD, ROD_RATE, GUIDE = N_STATE, N_STATE + 1, N_STATE + 2
N_BENCH_STATE = N_STATE + 3


@entry
def bench_cycle(
    x: Array, p: Array, axis: int, speed_ref: float, mass: float, weight: float, guide: float, substeps: int, period: float
) -> float:
    """Advance the bench by one cycle with the drive in velocity mode; returns the last rod force in N."""
    xb, pb = axis * N_AXIS_STATE, axis * N_AXIS_PARAMETERS
    dt = period / substeps
    force = 0.0
    for _ in range(substeps):
        travel, gain = free_travel(x, xb, p, pb)
        rod, rate = x[ROD], x[ROD_RATE]
        force = rod_force(travel, gain * x[xb + X.speed], rod, rate, p, pb)
        drive_step(x, xb, p, pb, 1.0, 1.0, 0.0, speed_ref, force, gain, dt)
        bristle, friction = lugre(
            x[GUIDE], rate, guide, STATIC_RATIO * guide, STRIBECK_M_S, guide / PRESLIDING_M, 0.002 * guide / PRESLIDING_M, dt
        )
        x[GUIDE] = bristle
        rate += dt * (force + stop_force(rod, rate, p, pb) - friction - weight) / mass
        x[ROD_RATE] = rate
        x[ROD] = rod + dt * rate
    return force


@compiled
def grating_counts(rod: float, accuracy: float, period: float, resolution: float) -> float:
    """Reading of the ruler in whole counts: half its accuracy band as a long-wave scale error, then rounding."""
    reading = rod + 0.5 * accuracy * sin(2.0 * pi * rod / period)
    return floor(reading / resolution + 0.5)


class PushRodBench:
    """The bench under its scenario, advanced cycle by cycle. Deterministic for a seed."""

    def __init__(self, model: PlantModel, bench: Bench, rate_hz: int, seed: int, ambient_c: float) -> None:
        self.parameters = model.parameters()
        self.bench = bench
        self.axis = 0 if bench.actuator == "pitch" else 1
        self.period_s = 1.0 / rate_hz
        self.substeps = max(1, round(self.period_s / SUBSTEP_S))
        self.mass_kg = bench.carriage_kg + bench.weight_n / GRAVITY_M_S2
        self.force_n = 0.0
        self._rng = np.random.Generator(np.random.PCG64(seed))
        self._xb, self._pb = self.axis * N_AXIS_STATE, self.axis * N_AXIS_PARAMETERS
        self.state = np.zeros(N_BENCH_STATE)
        x, p = self.state, self.parameters
        x[self._xb + X.screw_temperature] = ambient_c
        x[ROD] = bench.from_mm * 1e-3
        # the weight lies on the flank that carries it
        target = x[ROD] + bench.weight_n / p[self._pb + A.axial_stiffness_n_m] + 0.5 * p[self._pb + A.gap_m]
        for _ in range(20):
            travel, gain = free_travel(x, self._xb, p, self._pb)
            x[self._xb + X.angle] += (target - travel) / gain

    def advance(self, motor_speed_rad_s: float) -> None:
        """One cycle while the screw is turned at ``motor_speed_rad_s``."""
        b = self.bench
        self.force_n = bench_cycle(
            self.state, self.parameters, self.axis, motor_speed_rad_s, self.mass_kg, b.weight_n, b.guide_friction_n, self.substeps, self.period_s
        )

    def resolver(self) -> int:
        """Reading of the resolver converter in counts."""
        p, pb = self.parameters, self._pb
        noise = p[pb + A.res_noise_rad] * float(self._rng.standard_normal())
        return int(
            resolver_counts(
                float(self.state[self._xb + X.angle]),
                p[pb + A.res_first_rad],
                p[pb + A.res_first_phase_rad],
                p[pb + A.res_second_rad],
                p[pb + A.res_second_phase_rad],
                noise,
                p[pb + A.resolver_counts],
                p[pb + A.res_step_rad],
            )
        )

    def grating_m(self) -> float:
        """Reading of the ruler in m."""
        b = self.bench
        resolution = b.grating_resolution_um * 1e-6
        return resolution * grating_counts(self.rod_m, b.grating_accuracy_um * 1e-6, b.grating_period_mm * 1e-3, resolution)

    @property
    def rod_m(self) -> float:
        """True rod travel from level."""
        return float(self.state[ROD])

    @property
    def screw_m(self) -> float:
        """Free travel of the nut."""
        return float(free_travel(self.state, self._xb, self.parameters, self._pb)[0])

    @property
    def motor(self) -> tuple[float, float, float]:
        """Angle in rad, speed in rad/s, current in A of the motor."""
        xb = self._xb
        return float(self.state[xb + X.angle]), float(self.state[xb + X.speed]), float(self.state[xb + X.current])

    @property
    def screw_c(self) -> float:
        """Screw temperature."""
        return float(self.state[self._xb + X.screw_temperature])

    @property
    def bus_voltage_v(self) -> float:
        """Supply."""
        return float(self.parameters[self._pb + A.bus_voltage_v])
