"""Eq (11) as the paper writes it: ``E = J^-1 K F`` with the derivatives of Appendix A, printed or corrected.

For comparison and tests: designs use ``mechanism.error_model``, which has more errors and needs no equal radii. (A5) prints two derivatives
without a factor r. These forms are not homogeneous, so their result depends on the unit of length: ``unit_m`` is that unit.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from spsp_ctrl.mechanism.vectorised import Array, rod_lengths

Form = Literal["corrected", "printed"]


def equation_11(
    pitch_rad: ArrayLike, roll_rad: ArrayLike, height_m: float, radius_m: float, form: Form, unit_m: float = 1.0
) -> Array:
    """Attitude error per length error, shape (2, 4, *poses), rad/m: columns dl1, dl2, dr, dh, pitch first."""
    pitch, roll = np.broadcast_arrays(np.asarray(pitch_rad, dtype=np.float64), np.asarray(roll_rad, dtype=np.float64))
    h, r = height_m / unit_m, radius_m / unit_m
    l1, l2 = rod_lengths(pitch, roll, h, r, r)
    sx, cx, sy, cy = np.sin(pitch), np.cos(pitch), np.sin(roll), np.cos(roll)
    missing = r if form == "corrected" else 1.0
    f1_pitch = 2.0 * r * r * (sx - h / r * cx)
    f2_pitch = 2.0 * h * missing * sx * sy
    f2_roll = 2.0 * r * r * sy - 2.0 * h * missing * cx * cy
    zero = np.zeros_like(l1)
    k1 = np.stack((2.0 * l1, zero, -(4.0 * r - 4.0 * r * cx - 2.0 * h * sx), -2.0 * (h - r * sx)))
    k2 = np.stack((zero, 2.0 * l2, -(4.0 * r - 4.0 * r * cy - 2.0 * h * cx * sy), -2.0 * (h - r * cx * sy)))
    d_pitch = k1 / f1_pitch
    return np.stack((d_pitch, (k2 - f2_pitch * d_pitch) / f2_roll)) / unit_m


def printed_roll_pole(pitch_rad: ArrayLike, height_m: float, radius_m: float, unit_m: float) -> Array:
    """Roll at which the printed ∂f2/∂θy vanishes: tan roll = h cos(pitch) / r^2, in the unit of length used."""
    pole: Array = np.arctan(height_m / unit_m * np.cos(np.asarray(pitch_rad)) / (radius_m / unit_m) ** 2)
    return pole
