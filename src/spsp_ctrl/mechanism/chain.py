"""The inverse problem of the whole chain, carrier -> azimuth -> pitch -> roll: joints, rates and accelerations for a demand in space.

The demand is an attitude ``Rz(heading) Ry(pitch) Rx(-roll)`` in inertial space; platform level on heading psi is
``(psi, 0, 0)``. The carrier is given by its attitude (base to inertial), angular velocity and angular acceleration, both in base
axes, as the swing table and a strap-down IMU give them. Frames and signs: ``mechanism.frames``.

Plain scalar code, served to arrays by ``mechanism.vectorised``. Angles in rad, rates in rad/s, accelerations in rad/s^2.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt
from typing import NamedTuple

from spsp_ctrl.mechanism.frames import (
    Matrix,
    Vector,
    apply,
    body_to_joint_accels,
    body_to_joint_rates,
    body_to_tilt_accels,
    body_to_tilt_rates,
    joint_accels_to_body,
    joint_angles,
    joint_rates_to_body,
    transpose,
)
from spsp_ctrl.mechanism.frames import attitude as rotation


class JointReferences(NamedTuple):
    """What the three joints have to do: angles and rates."""

    azimuth_rad: float
    pitch_rad: float
    roll_rad: float
    azimuth_rad_s: float
    pitch_rad_s: float
    roll_rad_s: float


class JointMotion(NamedTuple):
    """:class:`JointReferences` with accelerations."""

    azimuth_rad: float
    pitch_rad: float
    roll_rad: float
    azimuth_rad_s: float
    pitch_rad_s: float
    roll_rad_s: float
    azimuth_rad_s2: float
    pitch_rad_s2: float
    roll_rad_s2: float


def joint_references(
    base: Matrix,
    base_rate: Vector,
    heading: float,
    pitch: float,
    roll: float,
    heading_rate: float,
    pitch_rate: float,
    roll_rate: float,
) -> JointReferences:
    """Joint angles and rates that give the platform a demanded attitude in space, and its rates, on a moving carrier.

    The platform must turn relative to the base by its own demanded angular velocity less the carrier's. Singular at a joint
    pitch of +-pi/2, far outside the travel.
    """
    azimuth, p, r = joint_angles(base, heading, pitch, roll)
    own = joint_rates_to_body(pitch, roll, pitch_rate, roll_rate, heading_rate)
    carried = apply(transpose(rotation(azimuth, p, r)), base_rate)
    p_rate, r_rate, azimuth_rate = body_to_joint_rates(
        p, r, own[0] - carried[0], own[1] - carried[1], own[2] - carried[2]
    )
    return JointReferences(azimuth, p, r, azimuth_rate, p_rate, r_rate)


def joint_motion(
    base: Matrix,
    base_rate: Vector,
    base_accel: Vector,
    heading: float,
    pitch: float,
    roll: float,
    heading_rate: float,
    pitch_rate: float,
    roll_rate: float,
    heading_accel: float,
    pitch_accel: float,
    roll_accel: float,
) -> JointMotion:
    """:func:`joint_references` with accelerations; ``base_accel`` is the derivative of ``base_rate``.

    With ``w`` the angular velocity relative to the base and ``c`` the carrier's, both in platform axes:
    ``w' = own' - R^T base_accel + w x c``.
    """
    ref = joint_references(base, base_rate, heading, pitch, roll, heading_rate, pitch_rate, roll_rate)
    to_platform = transpose(rotation(ref.azimuth_rad, ref.pitch_rad, ref.roll_rad))
    cx, cy, cz = apply(to_platform, base_rate)
    ax, ay, az = apply(to_platform, base_accel)
    wx, wy, wz = joint_rates_to_body(ref.pitch_rad, ref.roll_rad, ref.pitch_rad_s, ref.roll_rad_s, ref.azimuth_rad_s)
    ox, oy, oz = joint_accels_to_body(
        pitch, roll, pitch_rate, roll_rate, heading_rate, pitch_accel, roll_accel, heading_accel
    )
    p_accel, r_accel, azimuth_accel = body_to_joint_accels(
        ref.pitch_rad,
        ref.roll_rad,
        ref.pitch_rad_s,
        ref.roll_rad_s,
        ref.azimuth_rad_s,
        ox - ax + wy * cz - wz * cy,
        oy - ay + wz * cx - wx * cz,
        oz - az + wx * cy - wy * cx,
    )
    return JointMotion(*ref, azimuth_accel, p_accel, r_accel)


def level_motion(
    base: Matrix,
    base_rate: Vector,
    base_accel: Vector,
    azimuth: float,
    azimuth_rate: float,
    azimuth_accel: float,
) -> JointMotion:
    """Joint motion that holds the platform level while azimuth moves by itself, or stands; the heading becomes what it becomes.

    The platform's normal is the vertical: in the axes behind the azimuth joint it reads ``(sin p cos r, sin r, cos p cos r)``.
    """
    ca, sa = cos(azimuth), sin(azimuth)
    nx, ny, nz = ca * base[6] + sa * base[7], ca * base[7] - sa * base[6], base[8]
    p, r = atan2(nx, nz), atan2(ny, sqrt(nx * nx + nz * nz))
    to_platform = transpose(rotation(azimuth, p, r))
    cx, cy, cz = apply(to_platform, base_rate)
    ax, ay, _ = apply(to_platform, base_accel)
    p_rate, r_rate = body_to_tilt_rates(p, r, -cx, -cy, azimuth_rate)
    wx, wy, wz = joint_rates_to_body(p, r, p_rate, r_rate, azimuth_rate)
    p_accel, r_accel = body_to_tilt_accels(
        p, r, p_rate, r_rate, azimuth_rate, wy * cz - wz * cy - ax, wz * cx - wx * cz - ay, azimuth_accel
    )
    return JointMotion(azimuth, p, r, azimuth_rate, p_rate, r_rate, azimuth_accel, p_accel, r_accel)
