"""Kinematics of the U-RPS/UPS stage: Eqs (9) and (10) of the paper, their closed-form inverse and their Jacobian.

Scalar functions of ``math`` only: the control loop calls them as they are, the plant compiles them, and
``numpy.vectorize``-style use goes through the same formula. The upper and the lower hinge radius are separate arguments, since their
errors count very differently (the paper's r is both).

Attitude of the moving platform: ``R = Ry(pitch) Rx(-roll)``, pitch leg at (+r, 0, 0), roll leg at (0, +r, 0), z up
(see ``mechanism.frames``). A positive angle lowers its leg's hinge: rods get shorter.

Lengths in m, angles in rad.
"""

from __future__ import annotations

from math import acos, atan2, cos, sin, sqrt


def rod_lengths(
    pitch_rad: float, roll_rad: float, height_m: float, upper_m: float, lower_m: float
) -> tuple[float, float]:
    """Lengths of the pitch and the roll leg, Eqs (9) and (10)."""
    square = upper_m * upper_m + lower_m * lower_m + height_m * height_m
    cos_p = cos(pitch_rad)
    l1_sq = square - 2.0 * upper_m * (lower_m * cos_p + height_m * sin(pitch_rad))
    l2_sq = square - 2.0 * upper_m * (lower_m * cos(roll_rad) + height_m * sin(roll_rad) * cos_p)
    return sqrt(l1_sq), sqrt(l2_sq)


def attitude_from_rods(
    l1_m: float, l2_m: float, height_m: float, upper_m: float, lower_m: float
) -> tuple[float, float]:
    """Pitch and roll from the rod lengths: each equation reads ``A cos + B sin = C``, pitch first.

    Raises ``ValueError`` (math domain) where no attitude has these lengths.
    """
    square = upper_m * upper_m + lower_m * lower_m + height_m * height_m
    a = 2.0 * upper_m * lower_m
    b = 2.0 * upper_m * height_m
    pitch = atan2(b, a) - acos((square - l1_m * l1_m) / sqrt(a * a + b * b))
    b *= cos(pitch)
    roll = atan2(b, a) - acos((square - l2_m * l2_m) / sqrt(a * a + b * b))
    return pitch, roll


def jacobian(
    pitch_rad: float, roll_rad: float, l1_m: float, l2_m: float, height_m: float, upper_m: float, lower_m: float
) -> tuple[float, float, float]:
    """Partial derivatives (dl1/dpitch, dl2/dpitch, dl2/droll) in m/rad; dl1/droll is zero.

    These are Eqs (A4), (A5) with the factor r that the printed (A5) lacks in two places.
    """
    sin_p, cos_p = sin(pitch_rad), cos(pitch_rad)
    sin_r, cos_r = sin(roll_rad), cos(roll_rad)
    j11 = upper_m * (lower_m * sin_p - height_m * cos_p) / l1_m
    j21 = upper_m * height_m * sin_r * sin_p / l2_m
    j22 = upper_m * (lower_m * sin_r - height_m * cos_r * cos_p) / l2_m
    return j11, j21, j22
