"""The rig simulated along a log: recorded commands act, and a slow loop keeps the motors at the recorded angles.

What that loop has to add is the torque that the model lacks, so nothing drifts however long the log, and every effect acts at the right place.
Temperatures are those of the log; the stepper counts what its driver counted.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from spsp_ctrl.plant import kernel
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.compile import entry
from spsp_ctrl.plant.effects.resolver_error import eccentric
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_AXIS_STATE, N_OUTPUT, N_STATE, N_WORK, A, C, G, O, S, U, W, X
from spsp_ctrl.plant.stages.mechanism import prepare, to_platform
from spsp_ctrl.plant.stages.transmission import free_travel

TARGETS = ("pitch_angle", "pitch_speed", "roll_angle", "roll_speed", "step_angle", "screw_pitch_c", "screw_roll_c", "column_c", "frame_c",
           "azimuth", "azimuth_rate")  # fmt: skip
"""Columns of what is followed, one row for each SYNC: motor side in rad and rad/s, degC; the azimuth joint where it is led."""
TRACKED = (
    "command_pitch", "command_roll", "current_pitch", "current_roll", "motor_pitch", "motor_roll", "imu_roll", "imu_pitch", "imu_yaw", "gyro_x",
    "gyro_y", "gyro_z", "joint_pitch", "joint_roll", "azimuth",
)  # fmt: skip
"""Columns of the outcome at each SYNC, A, rad and rad/s: command in force, current, motor as the resolver reads it, IMU, true joints."""
N_TRACKED = len(TRACKED)


@entry
def track(
    x: Array, p: Array, u: Array, commands: Array, targets: Array, gains: Array, y: Array, out: Array, w: Array, substeps: int, period: float,
    led: bool,
) -> None:  # fmt: skip
    """Fill ``y`` (n, ``N_TRACKED``) from state ``x`` at the first SYNC. ``commands[k]`` acts from SYNC k on; ``u`` and ``targets`` have n rows.

    ``led``: the azimuth joint moves as in ``targets``, for its gear rattles in its play and no two simulations of that agree; else it is driven.
    ``gains``: position gain in 1/s and speed gain in A s/rad of either motor, gain of the step count in 1/s, step of one count in rad.
    """
    n = y.shape[0]
    x1 = N_AXIS_STATE
    command = np.zeros(commands.shape[1])
    for k in range(n):
        for j in range(commands.shape[1]):
            command[j] = commands[k, j]
        t = targets[k]
        for axis in range(2):
            xb, pb = axis * x1, axis * N_AXIS_PARAMETERS
            angle = x[xb + X.angle]
            reading = eccentric(
                angle, angle, p[pb + A.res_first_rad], p[pb + A.res_first_phase_rad], p[pb + A.res_second_rad], p[pb + A.res_second_phase_rad]
            )
            y[k, 4 + axis] = reading
            command[C.pitch_current + axis * (C.roll_current - C.pitch_current)] += gains[2 * axis + 1] * (
                gains[2 * axis] * (t[2 * axis] - reading) + t[2 * axis + 1] - x[xb + X.speed]
            )
        if led:
            gear = p[G.az_gear_ratio]
            x[S.azimuth], x[S.azimuth_rate] = t[9], t[10]
            x[S.rotor_angle], x[S.rotor_rate] = t[9] * gear, t[10] * gear
            x[S.step_angle], x[S.step_rate] = t[9] * gear, t[10] * gear
            command[C.azimuth_rate] = t[10]
        behind = 0.0 if led else t[4] - x[S.step_angle]
        if behind > gains[5] or behind < -gains[5]:
            command[C.azimuth_rate] += gains[4] * behind / p[G.az_gear_ratio]
        y[k, 0], y[k, 1] = command[C.pitch_current], command[C.roll_current]
        y[k, 2], y[k, 3] = x[X.current], x[x1 + X.current]
        for j in range(6):
            y[k, 6 + j] = out[O.imu_roll + j]
        y[k, 12], y[k, 13], y[k, 14] = x[S.pitch], x[S.roll], x[S.azimuth]
        if k + 1 < n:
            x[X.screw_temperature], x[x1 + X.screw_temperature] = t[5], t[6]
            x[S.column_temperature], x[S.frame_temperature] = t[7], t[8]
            kernel.cycle(x, p, u[k], u[k + 1], command, out, w, substeps, period, True)


def state_at(p: Array, u: Array, target: Array) -> Array:
    """The rig at rest with the motors at the angles of ``target``: gravity loads the screws, gaps are closed by it."""
    x, w = np.zeros(N_STATE), np.zeros(N_WORK)
    x[X.angle], x[N_AXIS_STATE + X.angle] = target[0], target[2]
    x[S.rotor_angle] = x[S.step_angle] = target[4]
    x[S.azimuth] = target[4] / p[G.az_gear_ratio]
    x[X.screw_temperature], x[N_AXIS_STATE + X.screw_temperature], x[S.column_temperature], x[S.frame_temperature] = target[5:9]
    prepare(x, p, u, w)
    geometry = (w[W.height], w[W.upper], w[W.lower])
    push = [0.0, 0.0]
    for _ in range(6):
        rods = []
        for axis in range(2):
            pb = axis * N_AXIS_PARAMETERS
            back = push[axis] / p[pb + A.axial_stiffness_n_m] + 0.5 * p[pb + A.gap_m] * float(np.sign(push[axis]))
            rods.append(free_travel(x, axis * N_AXIS_STATE, p, pb)[0] - back)
        for _ in range(8):
            l1, l2 = kernel.rod_lengths(x[S.pitch], x[S.roll], *geometry)
            j11, j21, j22 = kernel.jacobian(x[S.pitch], x[S.roll], l1, l2, *geometry)
            dp = (rods[0] - (l1 - w[W.level])) / j11
            x[S.pitch] += dp
            x[S.roll] += (rods[1] - (l2 - w[W.level]) - j21 * dp) / j22
        sp, cp, sr, cr = sin(x[S.pitch]), cos(x[S.pitch]), sin(x[S.roll]), cos(x[S.roll])
        ca, sa = cos(x[S.azimuth]), sin(x[S.azimuth])
        f = to_platform(u[U.base_f_x], u[U.base_f_y], u[U.base_f_z], ca, sa, cp, sp, cr, sr)
        nx, ny, nz = np.cross([w[W.mcx], w[W.mcy], w[W.mcz]], f)
        push[1] = -nx / j22
        push[0] = (cr * ny + sr * nz - push[1] * j21) / j11
    return x


def run_along(p: Array, u: Array, commands: Array, targets: Array, gains: Array, substeps: int, period: float, led: bool) -> Array:
    """All cycles of a log; columns ``TRACKED``."""
    y, out, w = np.zeros((len(commands), N_TRACKED)), np.zeros(N_OUTPUT), np.zeros(N_WORK)
    x = state_at(p, u[0], targets[0])
    kernel.start(x, p, u[0], out, w)
    track(x, p, u, commands, targets, gains, y, out, w, substeps, period, led)
    return y
