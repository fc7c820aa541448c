"""The kernel: one control cycle of the whole rig, sub-stepped (semi-implicit Euler), deterministic.

``cycle`` advances the flat state from one control instant to the next; ``rollout`` does so for many with recorded commands. Everything is in
``plant.layout``; the state can be read and set between cycles, so a simulation can start from anywhere.
"""

from __future__ import annotations

from math import pi

from spsp_ctrl.mechanism import kinematics
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.compile import compiled, entry
from spsp_ctrl.plant.effects.imu_error import quantise
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_AXIS_STATE, A, C, G, O, S, U, W, X
from spsp_ctrl.plant.stages.azimuth import azimuth_step
from spsp_ctrl.plant.stages.drive import command_path, drive_step, take_command
from spsp_ctrl.plant.stages.mechanism import mechanism_step, prepare
from spsp_ctrl.plant.stages.sensors import attitude_step, axis_sensors, azimuth_sensors, imu_sample
from spsp_ctrl.plant.stages.thermal import thermal_step
from spsp_ctrl.plant.stages.transmission import free_travel, rod_force, stop_force

ENCODER_STEP_RAD = 2.0 * pi / 2**20
"""20-bit encoders of the swing table."""

rod_lengths = compiled(kinematics.rod_lengths)
jacobian = compiled(kinematics.jacobian)


@entry
def cycle(
    x: Array, p: Array, u0: Array, u1: Array, command: Array, out: Array, w: Array, substeps: int, period: float, imu_due: bool
) -> None:
    """Advance the rig by one cycle of ``period`` s under ``command`` and write what is true and sensed at its end to ``out``.

    ``u0`` and ``u1`` are the inputs at the start and the end; base motion is interpolated between them, noise is that of the end.
    ``w`` is scratch space of ``N_WORK`` numbers.
    """
    dt = period / substeps
    x1, p1 = N_AXIS_STATE, N_AXIS_PARAMETERS
    prepare(x, p, u0, w)
    height, upper, lower, level = w[W.height], w[W.upper], w[W.lower], w[W.level]
    heat_pitch = 0.0
    heat_roll = 0.0
    enable = command[C.enable]
    force_pitch = 0.0
    force_roll = 0.0
    take_command(x, 0, p, 0, command[C.pitch_current], command[C.pitch_speed])
    take_command(x, x1, p, p1, command[C.roll_current], command[C.roll_speed])
    for i in range(substeps):
        pitch, roll = x[S.pitch], x[S.roll]
        l1, l2 = rod_lengths(pitch, roll, height, upper, lower)
        j11, j21, j22 = jacobian(pitch, roll, l1, l2, height, upper, lower)
        dp, dr = x[S.pitch_rate], x[S.roll_rate]
        rod1, rod1_rate = l1 - level, j11 * dp
        rod2, rod2_rate = l2 - level, j21 * dp + j22 * dr
        t1, g1 = free_travel(x, 0, p, 0)
        t2, g2 = free_travel(x, x1, p, p1)
        force_pitch = rod_force(t1, g1 * x[X.speed], rod1, rod1_rate, p, 0)
        force_roll = rod_force(t2, g2 * x[x1 + X.speed], rod2, rod2_rate, p, p1)
        push1 = force_pitch + stop_force(rod1, rod1_rate, p, 0) + u0[U.rod_force_pitch]
        push2 = force_roll + stop_force(rod2, rod2_rate, p, p1) + u0[U.rod_force_roll]
        current, speed = command_path(x, 0, p, 0, command[C.pitch_current], command[C.pitch_speed], i * dt, dt, period)
        heat_pitch += drive_step(x, 0, p, 0, enable, command[C.pitch_velocity], current, speed, force_pitch, g1, dt)
        current, speed = command_path(x, x1, p, p1, command[C.roll_current], command[C.roll_speed], i * dt, dt, period)
        heat_roll += drive_step(x, x1, p, p1, enable, command[C.roll_velocity], current, speed, force_roll, g2, dt)
        torque_azimuth = azimuth_step(x, p, enable, command[C.azimuth_rate], dt)
        fraction = (i + 0.5) / substeps
        mechanism_step(x, p, u0, u1, fraction, w, push1 * j11 + push2 * j21, push2 * j22, torque_azimuth, dt)
    thermal_step(x, p, u1, heat_pitch / substeps, heat_roll / substeps, period)
    attitude_step(x, p, u1, out, 0.0, period)
    if imu_due:
        imu_sample(x, p, u1, out)
    observe(x, p, u1, out, w, force_pitch, force_roll)


@compiled
def observe(x: Array, p: Array, u: Array, out: Array, w: Array, force_pitch: float, force_roll: float) -> None:
    """Write the remaining truths and the readings of actuators and azimuth."""
    x1, p1 = N_AXIS_STATE, N_AXIS_PARAMETERS
    l1, l2 = rod_lengths(x[S.pitch], x[S.roll], w[W.height], w[W.upper], w[W.lower])
    level = w[W.level]
    out[O.joint_pitch_rad], out[O.joint_roll_rad], out[O.azimuth_rad] = x[S.pitch], x[S.roll], x[S.azimuth]
    out[O.joint_pitch_rate_rad_s] = x[S.pitch_rate]
    out[O.joint_roll_rate_rad_s] = x[S.roll_rate]
    out[O.azimuth_rate_rad_s] = x[S.azimuth_rate]
    out[O.rod_pitch_m], out[O.rod_roll_m] = l1 - level, l2 - level
    out[O.screw_pitch_m] = free_travel(x, 0, p, 0)[0]
    out[O.screw_roll_m] = free_travel(x, x1, p, p1)[0]
    out[O.rod_force_pitch_n], out[O.rod_force_roll_n] = force_pitch, force_roll
    out[O.motor_pitch_rate_rad_s], out[O.motor_roll_rate_rad_s] = x[X.speed], x[x1 + X.speed]
    out[O.current_pitch_a], out[O.current_roll_a] = x[X.current], x[x1 + X.current]
    out[O.screw_pitch_c], out[O.screw_roll_c] = x[X.screw_temperature], x[x1 + X.screw_temperature]
    out[O.column_c], out[O.frame_c] = x[S.column_temperature], x[S.frame_temperature]
    for i in range(3):
        angle = u[U.base_pitch + i]
        out[O.base_pitch_rad + i] = angle
        out[O.encoder_pitch + i] = quantise(angle, ENCODER_STEP_RAD)
    axis_sensors(x, p, u, 0, out)
    axis_sensors(x, p, u, 1, out)
    azimuth_sensors(x, p, out)
    stop = 0.0
    if l1 - level > p[A.rod_max_m] or l1 - level < p[A.rod_min_m]:
        stop += 1.0
    if l2 - level > p[p1 + A.rod_max_m] or l2 - level < p[p1 + A.rod_min_m]:
        stop += 2.0
    if abs(x[S.azimuth]) > p[G.az_stop_rad]:
        stop += 4.0
    out[O.end_stop] = stop


@entry
def start(x: Array, p: Array, u: Array, out: Array, w: Array) -> None:
    """Sensor states and outputs for a state that was just set: lags start without a transient."""
    prepare(x, p, u, w)
    attitude_step(x, p, u, out, 1.0, 1.0)
    imu_sample(x, p, u, out)
    observe(x, p, u, out, w, 0.0, 0.0)


@entry
def rollout(
    x: Array, p: Array, u: Array, commands: Array, outs: Array, w: Array, substeps: int, period: float, imu_every: int, first: int
) -> None:
    """Many cycles with recorded commands: ``u`` has one row more than ``commands`` and ``outs``; ``first`` is the number of the first row."""
    for k in range(commands.shape[0]):
        if k > 0:
            outs[k, :] = outs[k - 1, :]
        cycle(x, p, u[k], u[k + 1], commands[k], outs[k], w, substeps, period, (first + k + 1) % imu_every == 0)
