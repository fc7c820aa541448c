"""What a motion could do to a reading, whatever the cause: smooth functions of place, speed, direction, phase, load, warmth and reversals.

A residual without them is noise: its colour whitens fits and judges names. How much of a residual they hold says whether anything is left to name.
"""

from __future__ import annotations

import numpy as np

from spsp_ctrl.discrepancy.replica import Replica, smooth
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import A

MOTOR_ORDERS = (0.5, 1.0, 2.0, 4.0, 6.0, 12.0)
SCREW_ORDERS = (1.0, 2.0, 3.0)
REVERSAL_SHARES = (0.0005, 0.005, 0.05)
"""Travel after a reversal over which a trace of it fades, as shares of the whole travel."""


def features(one: Replica) -> Array:
    """One row for each cycle, columns of about unit size."""
    rate, rows, p = one.record.rate_hz, one.record.rows, one.model.parameters()
    motor = one.measured["motor"] if np.ptp(one.measured["motor"]) > 0 else one.measured["load"] / one.travel_per_rad
    half = max(1, round(0.008 * rate))
    angle = smooth(motor, half)
    travel = angle * one.travel_per_rad
    speed = smooth(np.gradient(travel) * rate, half)
    accel = smooth(np.gradient(speed) * rate, half)
    at = _unit(travel)
    top = max(float(np.max(np.abs(speed))), 1e-12)
    side = np.tanh(speed / (0.01 * top))
    slow = np.exp(-((speed / (0.05 * top)) ** 2)) * side
    columns = [np.ones(len(at)), at, at**2, at**3, speed / top, np.abs(speed) / top, (speed / top) ** 2 * side, slow, side, side * at, _unit(accel)]
    for orders, angles in ((MOTOR_ORDERS, angle), (SCREW_ORDERS, angle / float(p[A.gear_ratio] or 1.0))):
        for order in orders:
            columns += [np.sin(order * angles), np.cos(order * angles)]
    for name in ("load_force_n", "load_mass_kg", "screw_c", "ambient_c"):
        values = np.asarray(rows[name], np.float64)
        if np.ptp(values) > 1e-9:
            u = _unit(smooth(values, max(1, round(0.15 * rate))))
            columns += [u, u * at, u * side, _unit(smooth(np.gradient(u), max(1, round(0.5 * rate))))]
    for share in REVERSAL_SHARES:
        columns.append(since_reversal(travel, side, share * max(float(np.ptp(travel)), 1e-12)))
    command = _unit(np.asarray(rows["command_a"], np.float64))
    columns += [command, _unit(np.gradient(smooth(command, 2)))]
    return np.asarray(np.nan_to_num(np.stack(columns, axis=1)), np.float64)


def since_reversal(travel: Array, side: Array, reach: float) -> Array:
    """A bristle: what is left of the last reversal, from -1 to 1 with the direction, gone after ``reach``."""
    out, value = np.zeros(len(travel)), 0.0
    fade = np.exp(-np.abs(np.diff(travel, prepend=travel[0])) / reach)
    for k in range(len(travel)):
        value = side[k] + (value - side[k]) * fade[k]
        out[k] = value
    return np.asarray(side - out, np.float64)


def _unit(values: Array) -> Array:
    centred = values - np.mean(values)
    size = float(np.max(np.abs(centred)))
    return np.asarray(centred / size if size > 0.0 else centred)


def basis(matrix: Array) -> Array:
    """Orthonormal columns that span those of ``matrix``."""
    norms = np.linalg.norm(matrix, axis=0)
    u, s, _ = np.linalg.svd(matrix[:, norms > 0] / norms[norms > 0], full_matrices=False)
    return np.asarray(u[:, s > 1e-6 * s[0]]) if len(s) else np.zeros((len(matrix), 0))
