"""The platform of the exam: two screw legs, a U joint, a stepper in series, an IMU. Written apart from ``plant/``: nothing of it is imported.

Position Verlet at 20 kHz; LuGre bristles of the motors advanced exactly over a step; hinges and azimuth bearing of Maxwell-slip elements; flanks that
push and never pull; joint forces from leg vectors and a Newton-Euler recursion written here. SI throughout.
"""

from __future__ import annotations

import math
from collections import namedtuple
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEPS = 20
"""Integration steps in a cycle of 1 ms."""
ELEMENTS = 4
_LEG = (
    "inertia", "kt", "current_lag", "current_limit", "lead", "gear", "stiffness", "damping", "counts", "gap", "coulomb", "static", "stribeck_speed",
    "viscous", "bristle", "bristle_damping", "load_factor", "cogging", "cogging_order", "offset", "ripple", "ripple_order", "ripple_phase", "slope",
    "first", "first_phase", "second", "second_phase", "third", "zero", "expansion", "ecc1", "ecc1_phase", "ecc2", "ecc2_phase", "ecc4",
    "resolver_noise", "current_noise", "hinge_coulomb", "hinge_stiffness", "hinge_viscous", "delay", "lag", "place_friction", "drag", "cubic",
    "bump", "bump_at", "asymmetry",
)  # fmt: skip
_RIG = (
    "height", "upper", "lower", "dh", "dru", "drl", "mass_z", "ixx", "iyy", "izz", "load", "cog_x", "cog_y", "cog_z", "own_xy", "own_z",
    "carrier_izz", "az_holding", "az_teeth", "az_microsteps", "az_inertia", "az_damping", "az_detent", "az_gear", "az_stiffness",
    "az_mesh_damping", "az_ramp",
    "az_gap", "az_coulomb", "az_bristle", "az_viscous", "attitude_lag", "gyro_lag", "imu_noise", "imu_step", "gyro_noise", "gyro_step",
    "imu_roll_bias", "imu_pitch_bias", "imu_yaw_bias", "gyro_bias_x", "gyro_bias_y", "gyro_bias_z", "mount_x", "mount_y", "mount_z",
    "roll_scale", "pitch_scale",
    "drift", "drift_time", "walk", "yaw_drift", "levelling", "acceleration_leak", "colour", "play_of_imu", "wobble", "wobble_order",
)  # fmt: skip
L: Any = namedtuple("L", _LEG)(*range(len(_LEG)))
R: Any = namedtuple("R", _RIG)(*range(2 * len(_LEG), 2 * len(_LEG) + len(_RIG)))
N_LEG = len(_LEG)
N = 2 * N_LEG + len(_RIG)
LEG_NAMES, RIG_NAMES = _LEG, _RIG

# state: per leg angle, speed, current, bristle, lagged command, elements; then azimuth, pitch, roll, rates, rotor, field, IMU
PER_LEG = 5 + ELEMENTS
AZ, PITCH, ROLL, DAZ, DPITCH, DROLL, ROTOR, DROTOR, FIELD, FIELD_RATE = range(2 * PER_LEG, 2 * PER_LEG + 10)
AZ_ELEMENTS = 2 * PER_LEG + 10
IMU = AZ_ELEMENTS + ELEMENTS
"""Lagged roll, pitch, yaw; gyro; wander of roll, pitch, yaw; levelling of roll, pitch; last coloured noise of the three."""
N_STATE = IMU + 14
GRAVITY = 9.80665


@njit(cache=True)
def _slip(state: Array, at: int, move: float, level: float, stiffness: float) -> float:
    """Maxwell-slip elements: each a spring that slides at its share of the level."""
    force = 0.0
    for e in range(ELEMENTS):
        share = (e + 1.0) / 10.0  # 1/10, 2/10, 3/10, 4/10: soft yielding
        top = level * share
        f = state[at + e] + stiffness * move / ELEMENTS
        f = min(max(f, -top), top)
        state[at + e] = f
        force += f
    return force


@njit(cache=True)
def _flanks(gap: float, distance: float, rate: float, stiffness: float, damping: float) -> float:
    """Nut between two flanks."""
    if distance > 0.5 * gap:
        return float(max(0.0, stiffness * (distance - 0.5 * gap) + damping * rate))
    if distance < -0.5 * gap:
        return float(min(0.0, stiffness * (distance + 0.5 * gap) + damping * rate))
    return 0.0


@njit(cache=True)
def legs(p: Array, pitch: float, roll: float) -> tuple[float, float, float, float, float]:
    """Lengths of both legs and their derivatives (pitch leg by pitch; roll leg by pitch and roll), from the vectors between their ends."""
    h, u, low = p[R.height] + p[R.dh], p[R.upper] + p[R.dru], p[R.lower] + p[R.drl]
    cp, sp, cr, sr = math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    ax, az = u * cp - low, h - u * sp
    l1 = math.hypot(ax, az)
    d1 = (ax * (-u * sp) + az * (-u * cp)) / l1
    bx, by, bz = -u * sp * sr, u * cr - low, h - u * cp * sr
    l2 = math.sqrt(bx * bx + by * by + bz * bz)
    d2p = (bx * (-u * cp * sr) + bz * (u * sp * sr)) / l2
    d2r = (bx * (-u * sp * cr) + by * (-u * sr) + bz * (-u * cp * cr)) / l2
    return l1, l2, d1, d2p, d2r


@njit(cache=True)
def _travel(p: Array, b: int, angle: float, warm: float) -> tuple[float, float]:
    screw = angle / p[b + L.gear]
    base = p[b + L.lead] / (2.0 * math.pi)
    way = base * screw
    t = way * (1.0 + p[b + L.slope]) + p[b + L.cubic] * way**3 + p[b + L.zero] + p[b + L.expansion] * warm
    g = base * (1.0 + p[b + L.slope] + 3.0 * p[b + L.cubic] * way * way)
    t += p[b + L.first] * math.sin(screw + p[b + L.first_phase]) + p[b + L.second] * math.sin(2.0 * screw + p[b + L.second_phase])
    t += p[b + L.third] * math.sin(3.0 * screw)
    g += p[b + L.first] * math.cos(screw + p[b + L.first_phase]) + 2.0 * p[b + L.second] * math.cos(2.0 * screw + p[b + L.second_phase])
    g += 3.0 * p[b + L.third] * math.cos(3.0 * screw)
    return t, g / p[b + L.gear]


@njit(cache=True)
def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def _turn(az: float, pitch: float, roll: float) -> Array:
    """Platform axes in base axes, by columns: Rz Ry Rx(-roll), multiplied out step by step."""
    ca, sa, cp, sp, cr, sr = math.cos(az), math.sin(az), math.cos(pitch), math.sin(pitch), math.cos(roll), math.sin(roll)
    z = np.array([[ca, -sa, 0.0], [sa, ca, 0.0], [0.0, 0.0, 1.0]])
    y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    x = np.array([[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]])
    whole: Array = z @ y @ x
    return whole


@njit(cache=True)
def _inertia(p: Array) -> tuple[Array, Array]:
    m, x, y, z = p[R.load], p[R.cog_x], p[R.cog_y], p[R.cog_z]
    i = np.zeros((3, 3))
    i[0, 0] = p[R.ixx] + m * (p[R.own_xy] + y * y + z * z)
    i[1, 1] = p[R.iyy] + m * (p[R.own_xy] + x * x + z * z)
    i[2, 2] = p[R.izz] + m * (p[R.own_z] + x * x + y * y)
    i[0, 1] = i[1, 0] = -m * x * y
    i[0, 2] = i[2, 0] = -m * x * z
    i[1, 2] = i[2, 1] = -m * y * z
    return i, np.array([m * x, m * y, m * z + p[R.mass_z]])


@njit(cache=True)
def cycle(s: Array, p: Array, base: Array, enable: float, currents: Array, rate: float, warm: Array, steps: int, period: float) -> None:
    """One control cycle. ``base``: rows at its start and end of rotation (9), rate (3), acceleration (3)."""
    dt = period / steps
    inertia, moment = _inertia(p)
    level = math.sqrt((p[R.upper] - p[R.lower]) ** 2 + p[R.height] ** 2)
    q = np.zeros((3, 4))
    for i in range(steps):
        # half drift
        for leg in range(2):
            s[leg * PER_LEG] += 0.5 * dt * s[leg * PER_LEG + 1]
        for j in range(3):
            s[AZ + j] += 0.5 * dt * s[DAZ + j]
        s[ROTOR] += 0.5 * dt * s[DROTOR]
        pitch, roll = s[PITCH], s[ROLL]
        l1, l2, d1, d2p, d2r = legs(p, pitch, roll)
        force = np.zeros(2)
        for leg in range(2):
            b, a = leg * N_LEG, leg * PER_LEG
            speed, angle = s[a + 1], s[a]
            way, gain = _travel(p, b, angle, warm[leg])
            rod = (l1 if leg == 0 else l2) - level
            rod_rate = d1 * s[DPITCH] if leg == 0 else d2p * s[DPITCH] + d2r * s[DROLL]
            f = _flanks(p[b + L.gap], way - rod, gain * speed - rod_rate, p[b + L.stiffness], p[b + L.damping])
            force[leg] = f
            wanted = currents[leg] if enable > 0.0 else 0.0
            if p[b + L.lag] > 0.0:
                s[a + 4] += (1.0 - math.exp(-dt / p[b + L.lag])) * (wanted - s[a + 4])
                wanted = s[a + 4]
            wanted = min(max(wanted, -p[b + L.current_limit]), p[b + L.current_limit])
            s[a + 2] += (1.0 - math.exp(-dt / p[b + L.current_lag])) * (wanted - s[a + 2])
            load = f * gain
            slow = math.exp(-abs(speed / p[b + L.stribeck_speed]))
            top = p[b + L.coulomb] + (p[b + L.static] - p[b + L.coulomb]) * slow * slow + p[b + L.load_factor] * abs(load)
            top *= 1.0 + p[b + L.place_friction] * math.sin(0.31 * angle)
            top += p[b + L.bump] * math.exp(-(((way - p[b + L.bump_at]) / 1e-3) ** 2))
            top += p[b + L.asymmetry] * (1.0 if speed > 0.0 else -1.0) if abs(speed) > 1e-3 else 0.0
            top = max(top, 1e-6)
            k = p[b + L.bristle]
            bristle = s[a + 3]
            if abs(speed) > 1e-9:  # exact for constant speed over the step
                steady = top / k * (1.0 if speed > 0.0 else -1.0)
                new = steady + (bristle - steady) * math.exp(-k * abs(speed) * dt / top)
            else:
                new = bristle
            friction = k * 0.5 * (new + bristle) + p[b + L.bristle_damping] * (new - bristle) / dt + p[b + L.viscous] * speed
            friction += p[b + L.drag] * speed * abs(speed)
            s[a + 3] = new
            ripple = p[b + L.cogging] * math.sin(p[b + L.cogging_order] * angle) + p[b + L.offset]
            ripple += p[b + L.ripple] * math.sin(p[b + L.ripple_order] * angle + p[b + L.ripple_phase]) + 4e-5 * math.sin(6.0 * angle)
            s[a + 1] += dt * (p[b + L.kt] * s[a + 2] - friction - load - ripple) / p[b + L.inertia]
        # stepper
        gear = p[R.az_gear]
        target = rate * gear if enable > 0.0 else 0.0
        change = p[R.az_ramp] * gear * dt
        s[FIELD_RATE] += min(max(target - s[FIELD_RATE], -change), change)
        s[FIELD] += dt * s[FIELD_RATE]
        micro = 2.0 * math.pi / (4.0 * p[R.az_teeth] * p[R.az_microsteps])
        shown = micro * math.floor(s[FIELD] / micro + 0.5)
        mesh = _flanks(p[R.az_gap], s[ROTOR] / gear - s[AZ], s[DROTOR] / gear - s[DAZ], p[R.az_stiffness], p[R.az_mesh_damping])
        pull = p[R.az_holding] * math.sin(p[R.az_teeth] * (shown - s[ROTOR])) - p[R.az_detent] * math.sin(4.0 * p[R.az_teeth] * s[ROTOR])
        s[DROTOR] += dt * (pull - p[R.az_damping] * (s[DROTOR] - s[FIELD_RATE]) - mesh / gear) / p[R.az_inertia]
        bearing = _slip(s, AZ_ELEMENTS, s[DAZ] * dt, p[R.az_coulomb], p[R.az_bristle]) + p[R.az_viscous] * s[DAZ]
        # platform
        g = (i + 0.5) / steps
        mean = (1.0 - g) * base[0] + g * base[1]
        turn = _turn(s[AZ], pitch, roll).T
        w0, a0, f0 = turn @ mean[9:12], turn @ mean[12:15], turn @ mean[15:18]
        axes = np.zeros((3, 3))  # rows: azimuth, pitch, roll axis in platform axes
        cr, sr = math.cos(roll), math.sin(roll)
        axes[0] = turn @ np.array([0.0, 0.0, 1.0])
        axes[1] = np.array([0.0, cr, sr])
        axes[2] = np.array([-1.0, 0.0, 0.0])
        rates = np.array([s[DAZ], s[DPITCH], s[DROLL]])
        own = axes[0] * rates[0] + axes[1] * rates[1] + axes[2] * rates[2]
        w = w0 + own
        bias = a0 - _cross(own, w0)
        for j in range(3):
            for k2 in range(j + 1, 3):
                bias -= _cross(axes[k2] * rates[k2], axes[j] * rates[j])
        torque = inertia @ bias + _cross(w, inertia @ w) + _cross(moment, f0)
        hinge_p = _slip(s, 5, s[DPITCH] * dt, p[L.hinge_coulomb], p[L.hinge_stiffness]) + p[L.hinge_viscous] * s[DPITCH]
        hinge_r = _slip(s, PER_LEG + 5, s[DROLL] * dt, p[N_LEG + L.hinge_coulomb], p[N_LEG + L.hinge_stiffness])
        hinge_r += p[N_LEG + L.hinge_viscous] * s[DROLL]
        given = np.array([mesh - bearing - p[R.carrier_izz] * mean[14], force[0] * d1 + force[1] * d2p - hinge_p, force[1] * d2r - hinge_r])
        for j in range(3):
            for k2 in range(3):
                q[j, k2] = axes[j] @ (inertia @ axes[k2])
            q[j, 3] = given[j] - axes[j] @ torque
        q[0, 0] += p[R.carrier_izz]
        acceleration = np.linalg.solve(q[:, :3].copy(), q[:, 3].copy())
        for j in range(3):
            s[DAZ + j] += dt * acceleration[j]
        # half drift
        for leg in range(2):
            s[leg * PER_LEG] += 0.5 * dt * s[leg * PER_LEG + 1]
        for j in range(3):
            s[AZ + j] += 0.5 * dt * s[DAZ + j]
        s[ROTOR] += 0.5 * dt * s[DROTOR]


@njit(cache=True)
def imu(s: Array, p: Array, row: Array, normal: Array, period: float, frame_due: bool, start: bool, out: Array) -> None:
    """Lags in every cycle; a frame (roll, pitch, yaw, gyro) into ``out`` when it is due. ``normal``: nine standard normal numbers."""
    whole = row[:9].copy().reshape(3, 3) @ _turn(s[AZ], s[PITCH], s[ROLL])
    roll, pitch, yaw = math.atan2(whole[2, 1], whole[2, 2]), -math.asin(min(max(whole[2, 0], -1.0), 1.0)), math.atan2(whole[1, 0], whole[0, 0])
    turn = _turn(s[AZ], s[PITCH], s[ROLL]).T
    w = turn @ row[9:12] + turn @ np.array([0.0, 0.0, 1.0]) * s[DAZ]
    w += np.array([0.0, math.cos(s[ROLL]), math.sin(s[ROLL])]) * s[DPITCH] + np.array([-1.0, 0.0, 0.0]) * s[DROLL]
    mount = np.array([p[R.mount_x], p[R.mount_y], p[R.mount_z]])
    seen = np.array([roll + mount[0] + mount[2] * pitch, pitch + mount[1] - mount[2] * roll, yaw + mount[2]])
    w = w - _cross(mount, w)
    if start:
        s[IMU : IMU + 3], s[IMU + 3 : IMU + 6] = seen, w
    while seen[2] - s[IMU + 2] > math.pi:
        seen[2] -= 2.0 * math.pi
    while seen[2] - s[IMU + 2] < -math.pi:
        seen[2] += 2.0 * math.pi
    fine = 8
    for _ in range(fine):  # explicit and fine, the input held: half a cycle late, which the lag takes up
        for j in range(3):
            s[IMU + j] += period / fine / max(p[R.attitude_lag] - 0.5 * period, 1e-4) * (seen[j] - s[IMU + j])
            s[IMU + 3 + j] += period / fine / max(p[R.gyro_lag] - 0.5 * period, 1e-4) * (w[j] - s[IMU + 3 + j])
    if p[R.levelling] > 0.0:
        world = row[:9].copy().reshape(3, 3) @ row[15:18]
        c, sn = math.cos(yaw), math.sin(yaw)
        s[IMU + 10] += period / p[R.levelling] * (-(c * world[0] + sn * world[1]) / GRAVITY - s[IMU + 10])
        s[IMU + 9] += period / p[R.levelling] * ((-sn * world[0] + c * world[1]) / GRAVITY - s[IMU + 9])
    if not frame_due:
        return
    dt = 5.0 * period
    keep = math.exp(-dt / p[R.drift_time])
    for j in range(2):
        s[IMU + 6 + j] = keep * s[IMU + 6 + j] + p[R.drift] * math.sqrt(1.0 - keep * keep) * normal[6 + j]
    s[IMU + 8] += p[R.yaw_drift] * dt + p[R.walk] * math.sqrt(dt) * normal[8]
    c = p[R.colour]
    for j in range(3):
        s[IMU + 11 + j] = c * s[IMU + 11 + j] + math.sqrt(1.0 - c * c) * normal[j]
    leak = p[R.acceleration_leak] * row[15]
    wobble = p[R.wobble] * math.sin(p[R.wobble_order] * s[AZ])
    values = np.array([
        (1.0 + p[R.roll_scale]) * s[IMU] + p[R.imu_roll_bias] + s[IMU + 6] + s[IMU + 9] + leak,
        (1.0 + p[R.pitch_scale]) * s[IMU + 1] + p[R.imu_pitch_bias] + s[IMU + 7] + s[IMU + 10] + p[R.play_of_imu] * math.tanh(s[IMU + 4] / 0.01),
        s[IMU + 2] + p[R.imu_yaw_bias] + s[IMU + 8] + wobble,
    ])  # fmt: skip
    values[2] = (values[2] + math.pi) % (2.0 * math.pi) - math.pi
    for j in range(3):
        out[j] = p[R.imu_step] * round((values[j] + p[R.imu_noise] * s[IMU + 11 + j]) / p[R.imu_step])
        bias = p[R.gyro_bias_x + j]
        out[3 + j] = p[R.gyro_step] * round((s[IMU + 3 + j] + bias + p[R.gyro_noise] * normal[3 + j]) / p[R.gyro_step])
