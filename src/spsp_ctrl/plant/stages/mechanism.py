"""Mechanism stage: rod forces and base motion -> motion of azimuth, pitch and roll.

The moving platform is a rigid body on the U joint, whose centre lies on the azimuth axis and is carried by the base. Newton-Euler about the
(accelerated) joint centre, projected on the three joint axes:

    s_i . (I sum_j s_j q''_j) = Q_i - s_i . (I w'_0 + w x I w + m c x f)

in platform axes, with ``s`` the joint axes, ``w'_0`` the part of the angular acceleration without joint accelerations, and ``f`` the specific
acceleration of the joint centre (acceleration minus gravity). What turns with azimuth but does not tilt adds its own inertia to the azimuth row.
"""

from __future__ import annotations

from math import cos, sin

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects.base import stage
from spsp_ctrl.plant.effects.motor_friction import lugre
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, A, G, S, U, W


@stage
def prepare(x: Array, p: Array, u: Array, w: Array) -> None:
    """Geometry and mass for one cycle: geometric errors, thermal growth and load change slowly."""
    reference = p[G.temperature_reference_c]
    grow_column = 1.0 + p[G.column_expansion_1_k] * (x[S.column_temperature] - reference)
    grow_frame = 1.0 + p[G.frame_expansion_1_k] * (x[S.frame_temperature] - reference)
    w[W.height] = (p[G.column_height_m] + p[G.dh_m]) * grow_column
    w[W.upper] = (p[G.hinge_radius_m] + p[G.dr_upper_m]) * grow_frame
    w[W.lower] = (p[G.hinge_radius_m] + p[G.dr_lower_m]) * grow_frame
    w[W.level] = p[G.column_height_m]
    m = u[U.load_mass]
    cx, cy, cz = p[G.load_cog_x_m], p[G.load_cog_y_m], p[G.load_cog_z_m]
    own_xy, own_z = p[G.load_gyration_xy_m2], p[G.load_gyration_z_m2]
    w[W.ixx] = p[G.plate_ixx_kg_m2] + m * (own_xy + cy * cy + cz * cz)
    w[W.iyy] = p[G.plate_iyy_kg_m2] + m * (own_xy + cx * cx + cz * cz)
    w[W.izz] = p[G.plate_izz_kg_m2] + m * (own_z + cx * cx + cy * cy)
    w[W.ixy] = -m * cx * cy
    w[W.ixz] = -m * cx * cz
    w[W.iyz] = -m * cy * cz
    w[W.mcx] = m * cx
    w[W.mcy] = m * cy
    w[W.mcz] = m * cz + p[G.plate_mass_kg] * p[G.plate_cog_z_m]


@stage
def to_platform(vx: float, vy: float, vz: float, ca: float, sa: float, cp: float, sp: float, cr: float, sr: float) -> tuple[float, float, float]:
    """Turn a vector from base axes into platform axes: Rx(roll) Ry(-pitch) Rz(-azimuth)."""
    x1 = ca * vx + sa * vy
    y1 = -sa * vx + ca * vy
    x2 = cp * x1 - sp * vz
    z2 = sp * x1 + cp * vz
    return x2, cr * y1 - sr * z2, sr * y1 + cr * z2


@stage
def mechanism_step(
    x: Array,
    p: Array,
    u0: Array,
    u1: Array,
    fraction: float,
    w: Array,
    torque_pitch: float,
    torque_roll: float,
    torque_azimuth: float,
    dt: float,
) -> None:
    """Advance the joints by ``dt`` under generalised forces of the rods and the azimuth gear (N m)."""
    az, pitch, roll = x[S.azimuth], x[S.pitch], x[S.roll]
    daz, dp, dr = x[S.azimuth_rate], x[S.pitch_rate], x[S.roll_rate]
    ca, sa = cos(az), sin(az)
    cp, sp = cos(pitch), sin(pitch)
    cr, sr = cos(roll), sin(roll)

    p1 = N_AXIS_PARAMETERS
    g = 1.0 - fraction
    bwx = g * u0[U.base_omega_x] + fraction * u1[U.base_omega_x]
    bwy = g * u0[U.base_omega_y] + fraction * u1[U.base_omega_y]
    bwz = g * u0[U.base_omega_z] + fraction * u1[U.base_omega_z]
    bax = g * u0[U.base_alpha_x] + fraction * u1[U.base_alpha_x]
    bay = g * u0[U.base_alpha_y] + fraction * u1[U.base_alpha_y]
    baz = g * u0[U.base_alpha_z] + fraction * u1[U.base_alpha_z]
    bfx = g * u0[U.base_f_x] + fraction * u1[U.base_f_x]
    bfy = g * u0[U.base_f_y] + fraction * u1[U.base_f_y]
    bfz = g * u0[U.base_f_z] + fraction * u1[U.base_f_z]
    w0x, w0y, w0z = to_platform(bwx, bwy, bwz, ca, sa, cp, sp, cr, sr)
    a0x, a0y, a0z = to_platform(bax, bay, baz, ca, sa, cp, sp, cr, sr)
    fx, fy, fz = to_platform(bfx, bfy, bfz, ca, sa, cp, sp, cr, sr)

    # joint axes in platform axes; roll is (-1, 0, 0), pitch (0, cr, sr)
    zx, zy, zz = -sp, -sr * cp, cr * cp
    jx = zx * daz - dr
    jy = zy * daz + cr * dp
    jz = zz * daz + sr * dp
    wx, wy, wz = w0x + jx, w0y + jy, w0z + jz
    # angular acceleration without joint accelerations
    ax = a0x - (jy * w0z - jz * w0y) - cp * dp * daz
    ay = a0y - (jz * w0x - jx * w0z) + (sr * sp * dp - cr * cp * dr) * daz - sr * dr * dp
    azz = a0z - (jx * w0y - jy * w0x) - (cr * sp * dp + sr * cp * dr) * daz + cr * dr * dp

    ixx, iyy, izz = w[W.ixx], w[W.iyy], w[W.izz]
    ixy, ixz, iyz = w[W.ixy], w[W.ixz], w[W.iyz]
    hx = ixx * wx + ixy * wy + ixz * wz
    hy = ixy * wx + iyy * wy + iyz * wz
    hz = ixz * wx + iyz * wy + izz * wz
    mx, my, mz = w[W.mcx], w[W.mcy], w[W.mcz]
    nx = ixx * ax + ixy * ay + ixz * azz + (wy * hz - wz * hy) + (my * fz - mz * fy)
    ny = ixy * ax + iyy * ay + iyz * azz + (wz * hx - wx * hz) + (mz * fx - mx * fz)
    nz = ixz * ax + iyz * ay + izz * azz + (wx * hy - wy * hx) + (mx * fy - my * fx)

    zp, friction_pitch = lugre(
        x[S.pitch_bristle],
        dp,
        p[A.hf_coulomb_nm],
        p[A.hf_static_nm],
        p[A.hf_stribeck_rad_s],
        p[A.hf_bristle_nm_rad],
        p[A.hf_bristle_damping_nm_s],
        dt,
    )
    zr, friction_roll = lugre(
        x[S.roll_bristle],
        dr,
        p[p1 + A.hf_coulomb_nm],
        p[p1 + A.hf_static_nm],
        p[p1 + A.hf_stribeck_rad_s],
        p[p1 + A.hf_bristle_nm_rad],
        p[p1 + A.hf_bristle_damping_nm_s],
        dt,
    )
    x[S.pitch_bristle] = zp
    x[S.roll_bristle] = zr
    q_pitch = torque_pitch - friction_pitch - p[A.hf_viscous_nm_s] * dp - (cr * ny + sr * nz)
    q_roll = torque_roll - friction_roll - p[p1 + A.hf_viscous_nm_s] * dr + nx
    q_az = torque_azimuth - (zx * nx + zy * ny + zz * nz) - p[G.carrier_izz_kg_m2] * baz

    # mass matrix
    kx = ixx * zx + ixy * zy + ixz * zz
    ky = ixy * zx + iyy * zy + iyz * zz
    kz = ixz * zx + iyz * zy + izz * zz
    m_zz = zx * kx + zy * ky + zz * kz + p[G.carrier_izz_kg_m2]
    m_zp = cr * ky + sr * kz
    m_zr = -kx
    m_pp = cr * cr * iyy + 2.0 * cr * sr * iyz + sr * sr * izz
    m_pr = -(cr * ixy + sr * ixz)
    m_rr = ixx
    c00 = m_pp * m_rr - m_pr * m_pr
    c01 = m_zr * m_pr - m_zp * m_rr
    c02 = m_zp * m_pr - m_zr * m_pp
    inv = 1.0 / (m_zz * c00 + m_zp * c01 + m_zr * c02)
    c11 = m_zz * m_rr - m_zr * m_zr
    c12 = m_zp * m_zr - m_zz * m_pr
    c22 = m_zz * m_pp - m_zp * m_zp
    daz += dt * inv * (c00 * q_az + c01 * q_pitch + c02 * q_roll)
    dp += dt * inv * (c01 * q_az + c11 * q_pitch + c12 * q_roll)
    dr += dt * inv * (c02 * q_az + c12 * q_pitch + c22 * q_roll)
    x[S.azimuth_rate], x[S.pitch_rate], x[S.roll_rate] = daz, dp, dr
    x[S.azimuth] = az + dt * daz
    x[S.pitch] = pitch + dt * dp
    x[S.roll] = roll + dt * dr
