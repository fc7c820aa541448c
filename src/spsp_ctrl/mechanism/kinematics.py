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


def rods_and_jacobian(
    pitch_rad: float, roll_rad: float, height_m: float, upper_m: float, lower_m: float
) -> tuple[float, float, float, float, float]:
    """:func:`rod_lengths` and :func:`jacobian` at one attitude, to the last bit (a test holds that) and with half of their sines: for the loop."""
    sin_p, cos_p = sin(pitch_rad), cos(pitch_rad)
    sin_r, cos_r = sin(roll_rad), cos(roll_rad)
    square = upper_m * upper_m + lower_m * lower_m + height_m * height_m
    l1 = sqrt(square - 2.0 * upper_m * (lower_m * cos_p + height_m * sin_p))
    l2 = sqrt(square - 2.0 * upper_m * (lower_m * cos_r + height_m * sin_r * cos_p))
    return (
        l1,
        l2,
        upper_m * (lower_m * sin_p - height_m * cos_p) / l1,
        upper_m * height_m * sin_r * sin_p / l2,
        upper_m * (lower_m * sin_r - height_m * cos_r * cos_p) / l2,
    )


def jacobian_rate(
    pitch_rad: float,
    roll_rad: float,
    pitch_rad_s: float,
    roll_rad_s: float,
    l1_m: float,
    l2_m: float,
    height_m: float,
    upper_m: float,
    lower_m: float,
) -> tuple[float, float, float]:
    """Time derivative of :func:`jacobian` in m/(rad s): each element is ``numerator / length``, and so is its derivative
    ``(numerator' - element * length') / length``.
    """
    sin_p, cos_p = sin(pitch_rad), cos(pitch_rad)
    sin_r, cos_r = sin(roll_rad), cos(roll_rad)
    j11 = upper_m * (lower_m * sin_p - height_m * cos_p) / l1_m
    j21 = upper_m * height_m * sin_r * sin_p / l2_m
    j22 = upper_m * (lower_m * sin_r - height_m * cos_r * cos_p) / l2_m
    l1_rate = j11 * pitch_rad_s
    l2_rate = j21 * pitch_rad_s + j22 * roll_rad_s
    n11_rate = upper_m * (lower_m * cos_p + height_m * sin_p) * pitch_rad_s
    n21_rate = upper_m * height_m * (cos_r * sin_p * roll_rad_s + sin_r * cos_p * pitch_rad_s)
    n22_rate = upper_m * (
        (lower_m * cos_r + height_m * sin_r * cos_p) * roll_rad_s + height_m * cos_r * sin_p * pitch_rad_s
    )
    return (n11_rate - j11 * l1_rate) / l1_m, (n21_rate - j21 * l2_rate) / l2_m, (n22_rate - j22 * l2_rate) / l2_m


def rod_motion(
    pitch_rad: float,
    roll_rad: float,
    pitch_rad_s: float,
    roll_rad_s: float,
    pitch_rad_s2: float,
    roll_rad_s2: float,
    height_m: float,
    upper_m: float,
    lower_m: float,
) -> tuple[float, float, float, float, float, float]:
    """Lengths (m), speeds (m/s) and accelerations (m/s^2) of both rods, ``(l1, l2, l1', l2', l1'', l2'')``, for a motion of the joints:
    ``l' = J q'`` and ``l'' = J q'' + J' q'``.
    """
    l1, l2 = rod_lengths(pitch_rad, roll_rad, height_m, upper_m, lower_m)
    j11, j21, j22 = jacobian(pitch_rad, roll_rad, l1, l2, height_m, upper_m, lower_m)
    d11, d21, d22 = jacobian_rate(
        pitch_rad, roll_rad, pitch_rad_s, roll_rad_s, l1, l2, height_m, upper_m, lower_m
    )
    return (
        l1,
        l2,
        j11 * pitch_rad_s,
        j21 * pitch_rad_s + j22 * roll_rad_s,
        j11 * pitch_rad_s2 + d11 * pitch_rad_s,
        j21 * pitch_rad_s2 + j22 * roll_rad_s2 + d21 * pitch_rad_s + d22 * roll_rad_s,
    )


def jacobian_gains(j11: float, j21: float, j22: float) -> tuple[float, float]:
    """Largest and smallest singular value (m/rad) of the Jacobian ``((j11, 0), (j21, j22))``.

    The smallest is the rod travel per rad in the worst direction: a rod error counts most there. Their ratio,
    smallest over largest, is the conditioning: 1 in the best case, 0 at a singularity. Without cancellation:
    ``(s1 +- s2)^2 = (|j11| +- |j22|)^2 + j21^2`` and ``s1 s2 = |j11 j22|``.
    """
    total = abs(j11) + abs(j22)
    apart = abs(j11) - abs(j22)
    largest = 0.5 * (sqrt(total * total + j21 * j21) + sqrt(apart * apart + j21 * j21))
    return largest, abs(j11 * j22) / largest
