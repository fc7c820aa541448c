"""The virtual bench of a single axis: a model under a motion, read as real sensors read, as samples for a log. Deterministic for a seed."""

from __future__ import annotations

from math import floor, pi

import numpy as np

from spsp_ctrl.messages import AxisSample
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, N_OUT, OUT, axis_cycle, axis_read, rest_state
from spsp_ctrl.plant.axis_controller import cascade_step
from spsp_ctrl.plant.axis_model import AxisModel
from spsp_ctrl.plant.layout import A, L

IDEAL_COUNTS = 4294967296.0


def bench_samples(model: AxisModel, u: Array, seed: int, *, p: Array | None = None, x0: Array | None = None) -> list[AxisSample]:
    """Samples of one session under the inputs ``u`` (``axis.IN``), with noise, counts and ruler steps of the model (or of ``p``)."""
    p = model.parameters() if p is None else p
    y = model.simulate(p, u, x0)
    rng = np.random.Generator(np.random.PCG64(seed))
    return _samples(model, p, u, y, rng.standard_normal((len(u), 3)))


def closed_loop_samples(model: AxisModel, u: Array, seed: int, *, p: Array | None = None) -> list[AxisSample]:
    """The same with the cascade of the model closed over the readings as they are logged, noise and counts included: its commands replay exactly.

    Slower than ``bench_samples`` (about 10 us a cycle). Without a cascade in the model the commands of ``u`` act.
    """
    p = model.parameters() if p is None else p.copy()
    if p[L.loop] == 0.0:
        return bench_samples(model, u, seed, p=p)
    rng = np.random.Generator(np.random.PCG64(seed))
    noise = rng.standard_normal((len(u), 3))
    x = rest_state(p, u, float(u[0, IN.reference_m]))
    y = np.zeros((len(u), N_OUT))
    per_rad = (p[A.resolver_counts] or IDEAL_COUNTS) / (2.0 * pi)
    travel = p[A.screw_lead_m] / (2.0 * pi * p[A.gear_ratio])
    span, read = int(p[L.rate_span]), np.zeros(len(u))
    period = model.period_s
    for k in range(len(u)):
        axis_read(x, p, k, y[k])
        if p[L.loop] == 2.0:
            read[k] = floor((y[k, OUT.motor_rad] + p[A.res_noise_rad] * noise[k, 1]) * per_rad + 0.5) / per_rad * travel
        else:
            read[k] = _stepped(y[k, OUT.load_m] + p[L.ruler_noise_m] * noise[k, 2], p[L.ruler_step_m])
        before = read[max(0, k - span)]
        reference, rate = u[k, IN.reference_m], u[k, IN.reference_m_s]
        command = cascade_step(reference, rate, read[k], before, span * period, p[L.kp_1_s], p[L.kv], p[L.feedforward], p[L.limit])
        y[k, OUT.command_a] = command
        y[k, OUT.force_n] = axis_cycle(x, p, u[k], command, k, model.substeps, period)
    return _samples(model, p, u, y, noise)


def _stepped(value: float, step: float) -> float:
    return step * floor(value / step + 0.5) if step > 0.0 else value


def _samples(model: AxisModel, p: Array, u: Array, y: Array, noise: Array) -> list[AxisSample]:
    """Readings of a simulation as real sensors give them."""
    current = y[:, OUT.current_a] + p[A.current_noise_a] * noise[:, 0]
    per_rad = (p[A.resolver_counts] or IDEAL_COUNTS) / (2.0 * pi)
    counts = np.floor((y[:, OUT.motor_rad] + p[A.res_noise_rad] * noise[:, 1]) * per_rad + 0.5)
    load = y[:, OUT.load_m] + p[L.ruler_noise_m] * noise[:, 2]
    if p[L.ruler_step_m] > 0.0:
        load = p[L.ruler_step_m] * np.floor(load / p[L.ruler_step_m] + 0.5)
    period_ns = 1e9 / model.file.rate_hz
    velocity = u[:, IN.velocity_mode] != 0.0
    return [
        AxisSample(
            stamp_ns=round(k * period_ns),
            cycle=k,
            enabled=bool(u[k, IN.enabled]),
            velocity_mode=bool(velocity[k]),
            reference_m=float(u[k, IN.reference_m]),
            reference_m_s=float(u[k, IN.reference_m_s]),
            command_a=0.0 if velocity[k] else float(y[k, OUT.command_a]),
            command_rad_s=float(u[k, IN.command_rad_s]),
            current_a=float(current[k]),
            bus_voltage_v=float(p[A.bus_voltage_v]),
            resolver_counts=int(counts[k]),
            load_m=float(load[k]),
            load_force_n=float(u[k, IN.load_force_n]),
            load_mass_kg=float(u[k, IN.load_mass_kg]),
            screw_c=float(u[k, IN.screw_c]),
            ambient_c=float(u[k, IN.ambient_c]),
        )
        for k in range(len(u))
    ]
