"""Frames, signs and the rotations between them: the one place of the signs.

Carrier (base) frame: x forward, y left, z up; every rotation is right-handed. ``pitch`` is the paper's theta_x,
``roll`` its theta_y. The chain, each matrix turning components of the frame on its right into the frame on its left::

    inertial <- carrier (base) <- azimuth Rz(azimuth) <- tilt Ry(pitch) Rx(-roll) <- IMU (its mounting)

Tilt in this order, with this one minus sign, is what Eqs (9) and (10) of the paper describe for a pitch leg at (+r, 0,
0) and a roll leg at (0, +r, 0). Because of it the ZYX Euler angles of the platform are (heading, pitch, -roll): see
:func:`roll_from_imu`.

Scalar functions of ``math`` only: the control loop calls them as they are, and numba compiles them as they are (each is
free of calls to the others, but for :func:`imu_attitude`). A matrix is a tuple of nine floats, row by row. Angles in
rad, rates in rad/s.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]

IDENTITY: Matrix = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def roll_from_imu(imu_roll: float) -> float:
    """Platform roll (positive: the left side goes down) from the roll of an IMU (positive: the left side goes up)."""
    return -imu_roll


def imu_roll_from_roll(roll: float) -> float:
    """Inverse of :func:`roll_from_imu`: the right-handed turn about x that belongs to a roll (or to its rate)."""
    return -roll


def wrap_angle(angle: float) -> float:
    """The same direction in (-pi, pi]; exact for an angle already there.

    An infinity or a NaN gives NaN and never an endless loop, so that bad data reaches the check for finite values.
    """
    if -pi < angle <= pi:
        return angle
    wrapped = angle % (2.0 * pi)
    return wrapped - 2.0 * pi if wrapped > pi else wrapped


def multiply(a: Matrix, b: Matrix) -> Matrix:
    """Product ``a b``."""
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = a
    b0, b1, b2, b3, b4, b5, b6, b7, b8 = b
    return (
        a0 * b0 + a1 * b3 + a2 * b6,
        a0 * b1 + a1 * b4 + a2 * b7,
        a0 * b2 + a1 * b5 + a2 * b8,
        a3 * b0 + a4 * b3 + a5 * b6,
        a3 * b1 + a4 * b4 + a5 * b7,
        a3 * b2 + a4 * b5 + a5 * b8,
        a6 * b0 + a7 * b3 + a8 * b6,
        a6 * b1 + a7 * b4 + a8 * b7,
        a6 * b2 + a7 * b5 + a8 * b8,
    )


def transpose(a: Matrix) -> Matrix:
    """Transpose: the inverse of a rotation."""
    return (a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8])


def apply(a: Matrix, v: Vector) -> Vector:
    """Product ``a v``: components of ``v`` in the frame on the left of ``a``."""
    x, y, z = v
    return (a[0] * x + a[1] * y + a[2] * z, a[3] * x + a[4] * y + a[5] * z, a[6] * x + a[7] * y + a[8] * z)


def rotation_from_euler(yaw: float, pitch: float, imu_roll: float) -> Matrix:
    """``Rz(yaw) Ry(pitch) Rx(imu_roll)``: body to reference from ZYX Euler angles, as an IMU gives them."""
    cy, sy = cos(yaw), sin(yaw)
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(imu_roll), sin(imu_roll)
    return (
        cy * cp,
        cy * sp * sr - sy * cr,
        cy * sp * cr + sy * sr,
        sy * cp,
        sy * sp * sr + cy * cr,
        sy * sp * cr - cy * sr,
        -sp,
        cp * sr,
        cp * cr,
    )


def euler_from_rotation(r: Matrix) -> Vector:
    """ZYX Euler angles (yaw, pitch, imu_roll) of a rotation; pitch in [-pi/2, pi/2].

    With the x axis on the vertical yaw and roll are one angle: all of it is given to yaw, roll is 0.
    """
    # the cosine of pitch from two elements, not asin: full accuracy also near +-90 degrees
    level = sqrt(r[0] * r[0] + r[3] * r[3])
    if level < 1e-12:
        return atan2(-r[1], r[4]), atan2(-r[6], level), 0.0
    return atan2(r[3], r[0]), atan2(-r[6], level), atan2(r[7], r[8])


def joint_rotation(pitch: float, roll: float) -> Matrix:
    """Tilt ``Ry(pitch) Rx(-roll)``: moving platform to static platform."""
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    return (cp, -sp * sr, sp * cr, 0.0, cr, sr, -sp, -cp * sr, cp * cr)


def attitude(heading: float, pitch: float, roll: float) -> Matrix:
    """``Rz(heading) Ry(pitch) Rx(-roll)``.

    Platform to inertial for a heading, pitch and roll in space; platform to base for azimuth, joint pitch and joint
    roll.
    """
    cy, sy = cos(heading), sin(heading)
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    return (
        cy * cp,
        -cy * sp * sr - sy * cr,
        cy * sp * cr - sy * sr,
        sy * cp,
        -sy * sp * sr + cy * cr,
        sy * sp * cr + cy * sr,
        -sp,
        -cp * sr,
        cp * cr,
    )


def imu_attitude(base: Matrix, azimuth: float, pitch: float, roll: float, mounting: Matrix = IDENTITY) -> Matrix:
    """The whole chain: IMU to inertial.

    ``base`` is base to inertial, ``mounting`` IMU to platform. Calls other functions of this module, so it is for plain
    Python only.
    """
    return multiply(multiply(base, attitude(azimuth, pitch, roll)), mounting)


def joint_angles(base: Matrix, heading: float, pitch: float, roll: float) -> Vector:
    """The chain backwards: joint angles (azimuth, pitch, roll) for a heading, pitch and roll in space.

    ``base`` is base to inertial. Exact: ``base^T attitude(heading, pitch, roll)`` is split into Rz, Ry, Rx. The joint
    pitch is in [-pi/2, pi/2]; at +-pi/2 (far outside the travel) azimuth and roll are one angle, and their split is
    arbitrary.
    """
    cy, sy = cos(heading), sin(heading)
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    # images of the platform axes in space
    x0, x1, x2 = cy * cp, sy * cp, -sp
    y0, y1, y2 = -cy * sp * sr - sy * cr, -sy * sp * sr + cy * cr, -cp * sr
    z0, z1, z2 = cy * sp * cr - sy * sr, sy * sp * cr + cy * sr, cp * cr
    # ... in base axes: the whole x axis, the z components of the others
    jx = base[0] * x0 + base[3] * x1 + base[6] * x2
    jy = base[1] * x0 + base[4] * x1 + base[7] * x2
    jz = base[2] * x0 + base[5] * x1 + base[8] * x2
    kz = base[2] * y0 + base[5] * y1 + base[8] * y2
    lz = base[2] * z0 + base[5] * z1 + base[8] * z2
    return atan2(jy, jx), atan2(-jz, sqrt(jx * jx + jy * jy)), atan2(-kz, lz)


def joint_axes(pitch: float, roll: float) -> tuple[Vector, Vector, Vector]:
    """Unit vectors of the azimuth, pitch and roll joint in platform axes."""
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    return (-sp, -sr * cp, cr * cp), (0.0, cr, sr), (-1.0, 0.0, 0.0)


def joint_rates_to_body(pitch: float, roll: float, pitch_rate: float, roll_rate: float, azimuth_rate: float) -> Vector:
    """Angular velocity of the platform relative to the base, platform axes."""
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    return (
        -sp * azimuth_rate - roll_rate,
        -sr * cp * azimuth_rate + cr * pitch_rate,
        cr * cp * azimuth_rate + sr * pitch_rate,
    )


def body_to_joint_rates(pitch: float, roll: float, wx: float, wy: float, wz: float) -> Vector:
    """Joint rates (pitch, roll, azimuth) from the angular velocity of the platform relative to the base, platform axes.

    Inverse of :func:`joint_rates_to_body`. Singular at pitch = +-pi/2, far outside the travel.
    """
    cr, sr = cos(roll), sin(roll)
    azimuth_rate = (cr * wz - sr * wy) / cos(pitch)
    return cr * wy + sr * wz, -(wx + sin(pitch) * azimuth_rate), azimuth_rate


def body_to_joint_accels(
    pitch: float,
    roll: float,
    pitch_rate: float,
    roll_rate: float,
    azimuth_rate: float,
    ax: float,
    ay: float,
    az: float,
) -> Vector:
    """Joint accelerations (pitch, roll, azimuth) from the angular acceleration of the platform relative to the base,
    platform axes (the time derivative of the components that :func:`joint_rates_to_body` gives).

    Singular at pitch = +-pi/2, far outside the travel.
    """
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    # what the turning of the joint axes contributes at constant joint rates
    bx = ax + cp * pitch_rate * azimuth_rate
    by = ay + (cr * cp * roll_rate - sr * sp * pitch_rate) * azimuth_rate + sr * roll_rate * pitch_rate
    bz = az + (sr * cp * roll_rate + cr * sp * pitch_rate) * azimuth_rate - cr * roll_rate * pitch_rate
    azimuth_accel = (cr * bz - sr * by) / cp
    return cr * by + sr * bz, -(bx + sp * azimuth_accel), azimuth_accel


def joint_accels_to_body(
    pitch: float,
    roll: float,
    pitch_rate: float,
    roll_rate: float,
    azimuth_rate: float,
    pitch_accel: float,
    roll_accel: float,
    azimuth_accel: float,
) -> Vector:
    """Time derivative of the components that :func:`joint_rates_to_body` gives; inverse of
    :func:`body_to_joint_accels`."""
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    return (
        -sp * azimuth_accel - roll_accel - cp * pitch_rate * azimuth_rate,
        -sr * cp * azimuth_accel
        + cr * pitch_accel
        - (cr * cp * roll_rate - sr * sp * pitch_rate) * azimuth_rate
        - sr * roll_rate * pitch_rate,
        cr * cp * azimuth_accel
        + sr * pitch_accel
        - (sr * cp * roll_rate + cr * sp * pitch_rate) * azimuth_rate
        + cr * roll_rate * pitch_rate,
    )


def body_to_tilt_rates(pitch: float, roll: float, wx: float, wy: float, azimuth_rate: float) -> tuple[float, float]:
    """Joint rates (pitch, roll) that give the platform ``wx`` and ``wy`` while azimuth turns at a given rate.

    ``wz`` is then what it becomes. Singular at roll = +-pi/2, far outside the travel.
    """
    pitch_rate = (wy + azimuth_rate * sin(roll) * cos(pitch)) / cos(roll)
    return pitch_rate, -(wx + azimuth_rate * sin(pitch))


def body_to_tilt_motion(
    pitch: float, roll: float, wx: float, wy: float, azimuth_rate: float, ax: float, ay: float
) -> tuple[float, float, float, float, float, float, float]:
    """:func:`body_to_tilt_rates` for rates and, at no azimuth rate, for accelerations; and the cosine of pitch, cosine and sine of roll.

    Each to the last bit what that function gives (a test holds that), with a third of its sines: for the loop.
    """
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    return (
        (wy + azimuth_rate * sr * cp) / cr,
        -(wx + azimuth_rate * sp),
        # an azimuth rate of zero still decides the sign of a zero
        (ay + 0.0 * sr * cp) / cr,
        -(ax + 0.0 * sp),
        cp,
        cr,
        sr,
    )


def body_to_tilt_accels(
    pitch: float,
    roll: float,
    pitch_rate: float,
    roll_rate: float,
    azimuth_rate: float,
    ax: float,
    ay: float,
    azimuth_accel: float,
) -> tuple[float, float]:
    """Joint accelerations (pitch, roll) that give the platform ``ax`` and ``ay`` (derivatives of ``wx`` and ``wy``) while
    azimuth moves by itself; to :func:`body_to_tilt_rates` as :func:`body_to_joint_accels` is to
    :func:`body_to_joint_rates`.
    """
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)
    bx = ax + cp * pitch_rate * azimuth_rate
    by = ay + (cr * cp * roll_rate - sr * sp * pitch_rate) * azimuth_rate + sr * roll_rate * pitch_rate
    return (by + sr * cp * azimuth_accel) / cr, -(bx + sp * azimuth_accel)


def euler_rates_to_body(
    imu_roll: float, pitch: float, imu_roll_rate: float, pitch_rate: float, yaw_rate: float
) -> Vector:
    """Angular velocity in body axes from ZYX Euler angles and their rates.

    Roll and its rate are in the sense of the IMU: see :func:`imu_roll_from_roll`.
    """
    cr, sr = cos(imu_roll), sin(imu_roll)
    cp = cos(pitch)
    return (
        imu_roll_rate - yaw_rate * sin(pitch),
        pitch_rate * cr + yaw_rate * sr * cp,
        yaw_rate * cr * cp - pitch_rate * sr,
    )
