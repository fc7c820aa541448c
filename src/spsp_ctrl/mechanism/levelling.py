"""Joint angles that put the platform at a tilt in space on a tilted base, whatever azimuth does. Scalar, exact."""

from __future__ import annotations

from math import asin, atan2, cos, sin, sqrt

from spsp_ctrl.mechanism.frames import Vector


def tilt_joints(
    base_pitch: float, base_roll: float, azimuth: float, pitch_ref: float, roll_ref: float
) -> tuple[float, float]:
    """Joint (pitch, roll) in rad for a platform (pitch, roll) in space, given the base tilt and the azimuth joint.

    Azimuth is an input, not a result: the tilt joints level the platform at the azimuth that there is. Solves
    ``Ry(pitch) Rx(-roll) v = Rz(-azimuth) u`` with the vertical ``v`` in platform and ``u`` in base axes. Raises ``ValueError`` (math
    domain) when no joint pitch gives the wanted platform pitch, which takes tilts far beyond the travel.
    """
    cb = cos(base_pitch)
    ux, uy, gz = -sin(base_pitch), -sin(base_roll) * cb, cos(base_roll) * cb
    ca, sa = cos(azimuth), sin(azimuth)
    gx, gy = ca * ux + sa * uy, ca * uy - sa * ux
    vx = -sin(pitch_ref)
    across = sqrt(gx * gx + gz * gz)
    pitch = atan2(gx, gz) - asin(vx / across)
    # the vertical's share across pitch and roll axis; roll_ref turns it further
    return pitch, atan2(gy, sqrt(across * across - vx * vx)) + roll_ref


def platform_tilt(
    base_pitch: float, base_roll: float, azimuth: float, joint_pitch: float, joint_roll: float
) -> tuple[float, float]:
    """Platform (pitch, roll) in space for a base tilt and the joints: the inverse of :func:`tilt_joints`."""
    cb = cos(base_pitch)
    ux, uy, gz = -sin(base_pitch), -sin(base_roll) * cb, cos(base_roll) * cb
    ca, sa = cos(azimuth), sin(azimuth)
    gx, gy = ca * ux + sa * uy, ca * uy - sa * ux
    cp, sp = cos(joint_pitch), sin(joint_pitch)
    vx, z = cp * gx - sp * gz, sp * gx + cp * gz
    cr, sr = cos(joint_roll), sin(joint_roll)
    return -asin(min(1.0, max(-1.0, vx))), -atan2(cr * gy - sr * z, sr * gy + cr * z)


def base_rate_on_platform(
    base_pitch: float,
    base_roll: float,
    pitch_rate: float,
    roll_rate: float,
    yaw_rate: float,
    azimuth: float,
    joint_pitch: float,
    joint_roll: float,
) -> Vector:
    """Angular velocity of the base in platform axes, from its tilt, its Euler rates and the joints.

    Linear in the rates: with accelerations in their place it gives the angular acceleration without its (small) gyroscopic part.
    """
    cp, sp = cos(base_pitch), sin(base_pitch)
    cr, sr = cos(base_roll), sin(base_roll)
    # base axes: ZYX Euler rates with the right-handed roll -base_roll
    wx = -roll_rate - yaw_rate * sp
    wy = pitch_rate * cr - yaw_rate * sr * cp
    wz = yaw_rate * cr * cp + pitch_rate * sr
    ca, sa = cos(azimuth), sin(azimuth)
    x, y = ca * wx + sa * wy, ca * wy - sa * wx
    cp, sp = cos(joint_pitch), sin(joint_pitch)
    x, z = cp * x - sp * wz, sp * x + cp * wz
    cr, sr = cos(joint_roll), sin(joint_roll)
    return x, cr * y - sr * z, sr * y + cr * z


def base_motion_on_platform(
    base_pitch: float,
    base_roll: float,
    pitch_rate: float,
    roll_rate: float,
    yaw_rate: float,
    pitch_accel: float,
    roll_accel: float,
    azimuth: float,
    joint_pitch: float,
    joint_roll: float,
) -> tuple[float, float, float, float, float]:
    """:func:`base_rate_on_platform` for the rates (x, y, z) and for the accelerations without yaw (x, y), to the last bit (a test holds that) and
    with half of its sines: for the loop."""
    cp, sp = cos(base_pitch), sin(base_pitch)
    cr, sr = cos(base_roll), sin(base_roll)
    srcp, crcp = sr * cp, cr * cp
    wx = -roll_rate - yaw_rate * sp
    wy = pitch_rate * cr - yaw_rate * sr * cp
    wz = yaw_rate * cr * cp + pitch_rate * sr
    # a yaw acceleration of zero still decides the sign of a zero
    ax = -roll_accel - 0.0 * sp
    ay = pitch_accel * cr - 0.0 * srcp
    az = 0.0 * crcp + pitch_accel * sr
    ca, sa = cos(azimuth), sin(azimuth)
    cp, sp = cos(joint_pitch), sin(joint_pitch)
    cr, sr = cos(joint_roll), sin(joint_roll)
    x, y = ca * wx + sa * wy, ca * wy - sa * wx
    x, z = cp * x - sp * wz, sp * x + cp * wz
    u, v = ca * ax + sa * ay, ca * ay - sa * ax
    u, w = cp * u - sp * az, sp * u + cp * az
    return x, cr * y - sr * z, sr * y + cr * z, u, cr * v - sr * w
