"""The plant against mechanics: energy, momentum, an independent Lagrangian, convergence."""

from __future__ import annotations

from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from spsp_ctrl.config.scenario import BaseMotion, Scenario, Sine
from spsp_ctrl.plant import kernel
from spsp_ctrl.plant.layout import (
    N_AXIS_PARAMETERS,
    N_AXIS_STATE,
    N_COMMAND,
    N_INPUT,
    N_OUTPUT,
    N_STATE,
    N_WORK,
    A,
    C,
    G,
    O,
    S,
    U,
    W,
    X,
)
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.plant.stages.mechanism import mechanism_step, prepare
from spsp_ctrl.plant.stages.transmission import free_travel
from spsp_ctrl.plant.swing_table import SwingTable
from spsp_ctrl.plant.virtual import VirtualPlant

Array = NDArray[np.float64]
MODEL = load_model(Path(__file__).parents[2] / "config" / "model.yaml")
GRAVITY = 9.80665
ARCMIN_RAD = 10800.0 / np.pi


def ideal_parameters() -> Array:
    """The plant without any effect and without damping: nothing may take energy out."""
    p = MODEL.without(*(entry.effect for entry in MODEL.file.effects)).parameters()
    for axis in range(2):
        p[axis * N_AXIS_PARAMETERS + A.contact_damping_n_s_m] = 0.0
    p[G.az_damping_nm_s] = p[G.az_rotor_damping_nm_s] = p[G.az_detent_nm] = 0.0
    p[G.az_microsteps] = 256.0
    return p


def still_input(p: Array) -> Array:
    u = np.zeros(N_INPUT)
    u[U.base_r00] = u[U.base_r11] = u[U.base_r22] = 1.0
    u[U.base_f_z] = GRAVITY
    u[U.load_mass] = 7.0
    u[U.ambient] = p[G.temperature_reference_c]
    return u


def rotation(az: float, pitch: float, roll: float) -> Array:
    rz = np.array([[cos(az), -sin(az), 0], [sin(az), cos(az), 0], [0, 0, 1]])
    ry = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    rx = np.array([[1, 0, 0], [0, cos(roll), sin(roll)], [0, -sin(roll), cos(roll)]])  # Rx(-roll)
    return np.asarray(rz @ ry @ rx)


def inertia(w: Array) -> Array:
    return np.array(
        [[w[W.ixx], w[W.ixy], w[W.ixz]], [w[W.ixy], w[W.iyy], w[W.iyz]], [w[W.ixz], w[W.iyz], w[W.izz]]]
    )


def joint_body_rate(x: Array) -> Array:
    pitch, roll = x[S.pitch], x[S.roll]
    az, dp, dr = x[S.azimuth_rate], x[S.pitch_rate], x[S.roll_rate]
    return np.array(
        [
            -sin(pitch) * az - dr,
            -sin(roll) * cos(pitch) * az + cos(roll) * dp,
            cos(roll) * cos(pitch) * az + sin(roll) * dp,
        ]
    )


def energy(x: Array, p: Array, w: Array, field: float) -> float:
    """Kinetic, gravity, rod springs, gear mesh and magnetic spring, base at rest."""
    wb = joint_body_rate(x)
    total = 0.5 * wb @ inertia(w) @ wb + 0.5 * p[G.carrier_izz_kg_m2] * x[S.azimuth_rate] ** 2
    down = rotation(x[S.azimuth], x[S.pitch], x[S.roll])[2] @ np.array([w[W.mcx], w[W.mcy], w[W.mcz]])
    total += GRAVITY * down
    rods = kernel.rod_lengths(x[S.pitch], x[S.roll], w[W.height], w[W.upper], w[W.lower])
    for axis in range(2):
        xb, pb = axis * N_AXIS_STATE, axis * N_AXIS_PARAMETERS
        total += 0.5 * p[pb + A.rotor_inertia_kg_m2] * x[xb + X.speed] ** 2
        stretch = free_travel(x, xb, p, pb)[0] - (rods[axis] - w[W.level])
        total += 0.5 * p[pb + A.axial_stiffness_n_m] * stretch**2
    total += 0.5 * p[G.az_rotor_inertia_kg_m2] * x[S.rotor_rate] ** 2
    total += 0.5 * p[G.az_stiffness_nm_rad] * (x[S.rotor_angle] / p[G.az_gear_ratio] - x[S.azimuth]) ** 2
    total -= p[G.az_holding_nm] / p[G.az_teeth] * cos(p[G.az_teeth] * (field - x[S.rotor_angle]))
    return float(total)


def energy_drift(substeps: int) -> float:
    """Largest change of total energy over 0.3 s of free motion, as a share of the kinetic energy put in."""
    p = ideal_parameters()
    u = still_input(p)
    x, out, w = np.zeros(N_STATE), np.zeros(N_OUTPUT), np.zeros(N_WORK)
    x[S.pitch], x[S.roll] = 0.05, -0.08
    prepare(x, p, u, w)
    rods = kernel.rod_lengths(x[S.pitch], x[S.roll], w[W.height], w[W.upper], w[W.lower])
    for axis in range(2):
        xb, pb = axis * N_AXIS_STATE, axis * N_AXIS_PARAMETERS
        x[xb + X.angle] = (rods[axis] - w[W.level]) * 2 * np.pi / p[pb + A.screw_lead_m] * p[pb + A.gear_ratio]
        x[xb + X.speed] = 60.0
        x[xb + X.screw_temperature] = p[G.temperature_reference_c]
    x[S.azimuth_rate] = 0.05
    x[S.column_temperature] = x[S.frame_temperature] = p[G.temperature_reference_c]
    command = np.zeros(N_COMMAND)
    start = energy(x, p, w, 0.0)
    put_in = 2 * 0.5 * p[A.rotor_inertia_kg_m2] * 60.0**2
    worst = 0.0
    for _ in range(300):
        kernel.cycle(x, p, u, u, command, out, w, substeps, 1e-3, False)
        worst = max(worst, abs(energy(x, p, w, 0.0) - start))
    return worst / put_in


def test_energy_is_conserved_and_the_error_shrinks_with_the_step() -> None:
    coarse, fine = energy_drift(20), energy_drift(160)
    assert fine < 2e-3
    assert fine < coarse / 4.0


def test_vertical_momentum_is_conserved_without_gear_and_gravity() -> None:
    p = ideal_parameters()
    for axis in range(2):
        p[axis * N_AXIS_PARAMETERS + A.axial_stiffness_n_m] = 0.0
    u = still_input(p)
    u[U.base_f_z] = 0.0
    x, w = np.zeros(N_STATE), np.zeros(N_WORK)
    x[S.pitch], x[S.roll] = 0.1, -0.2
    x[S.azimuth_rate], x[S.pitch_rate], x[S.roll_rate] = 0.5, -0.8, 1.1
    prepare(x, p, u, w)

    def momentum() -> float:
        along = rotation(x[S.azimuth], x[S.pitch], x[S.roll])[2]
        return float(along @ inertia(w) @ joint_body_rate(x) + p[G.carrier_izz_kg_m2] * x[S.azimuth_rate])

    before = momentum()
    for _ in range(20_000):
        mechanism_step(x, p, u, u, 0.0, w, 0.0, 0.0, 0.0, 1e-5)
    assert abs(x[S.roll] - -0.2) > 0.1
    assert momentum() == pytest.approx(before, rel=2e-5)


@pytest.mark.parametrize("order", ["roll_pitch", "pitch_roll"])
def test_joint_accelerations_equal_those_of_a_numerical_lagrangian(order: str) -> None:
    """Moving base, pivot acceleration, off-centre load: every inertial term against finite differences of T - V."""
    motion = BaseMotion(
        axis_order=order,  # type: ignore[arg-type]
        start_s=0.0,
        ramp_s=0.5,
        pitch=(Sine(amplitude_deg=20, period_s=1.0, phase_deg=30),),
        roll=(Sine(amplitude_deg=25, period_s=1.3, phase_deg=-50),),
        yaw=(Sine(amplitude_deg=30, period_s=1.1, phase_deg=10),),
    )
    rate, arm, k = 1_000_000, 0.45, 1_234_567
    table = SwingTable(motion, rate, 3, arm)
    h = 100  # cycles of 1 us: step of the time differences
    rows = {n: table.block(k + n * h, 1)[0] for n in (-2, -1, 0, 1, 2)}
    p = ideal_parameters()
    u = still_input(p)
    u[:18] = rows[0]
    x, w = np.zeros(N_STATE), np.zeros(N_WORK)
    prepare(x, p, u, w)
    q = np.array([0.3, 0.12, -0.21])  # azimuth, pitch, roll
    dq = np.array([0.4, -0.9, 0.7])
    i_u, mc = inertia(w), np.array([w[W.mcx], w[W.mcy], w[W.mcz]])
    mass = u[U.load_mass] + p[G.plate_mass_kg]
    i_c = i_u  # about the joint; kinetic energy below is written about the joint as well

    base = {n: row[:9].reshape(3, 3) for n, row in rows.items()}
    pivot = {n: r @ np.array([0.0, 0.0, arm]) for n, r in base.items()}
    dt = h / rate

    def body_rate(n: int, q: Array, dq: Array) -> Array:
        """Angular velocity in platform axes from the base's own rate and the joints."""
        omega_base = rows[n][9:12]
        y = np.zeros(N_STATE)
        y[S.azimuth], y[S.pitch], y[S.roll] = q
        y[S.azimuth_rate], y[S.pitch_rate], y[S.roll_rate] = dq
        return np.asarray(rotation(*q).T @ omega_base + joint_body_rate(y))

    def pivot_velocity(n: int) -> Array:
        return np.asarray(base[n] @ np.cross(rows[n][9:12], np.array([0.0, 0.0, arm])))

    def lagrangian(n: int, q: Array, dq: Array) -> float:
        r = base[n] @ rotation(*q)
        omega = body_rate(n, q, dq)
        v = pivot_velocity(n)
        kinetic = 0.5 * mass * v @ v + v @ (r @ np.cross(omega, mc)) + 0.5 * omega @ i_c @ omega
        carrier = rows[n][11] + dq[0]
        kinetic += 0.5 * p[G.carrier_izz_kg_m2] * carrier**2
        return float(kinetic - GRAVITY * (mass * pivot[n][2] + (r @ mc)[2]))

    def momentum(n: int, q: Array, dq: Array) -> Array:
        eps = 1e-4
        steps = np.eye(3) * eps
        return np.array([(lagrangian(n, q, dq + s) - lagrangian(n, q, dq - s)) / (2 * eps) for s in steps])

    eps = 1e-4
    steps = np.eye(3) * eps
    force = np.array([(lagrangian(0, q + s, dq) - lagrangian(0, q - s, dq)) / (2 * eps) for s in steps])
    mass_matrix = np.array([(momentum(0, q, dq + s) - momentum(0, q, dq - s)) / (2 * eps) for s in steps])
    along = (momentum(1, q + dq * dt, dq) - momentum(-1, q - dq * dt, dq)) / (2 * dt)
    expected = np.linalg.solve(mass_matrix, force - along)

    x[S.azimuth], x[S.pitch], x[S.roll] = q
    x[S.azimuth_rate], x[S.pitch_rate], x[S.roll_rate] = dq
    step = 1e-7
    mechanism_step(x, p, u, u, 0.0, w, 0.0, 0.0, 0.0, step)
    got = (np.array([x[S.azimuth_rate], x[S.pitch_rate], x[S.roll_rate]]) - dq) / step
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(got, expected, rtol=2e-5, atol=2e-4)


def rollout(substep_s: float) -> Array:
    """Platform angles over 2 s on a swinging base, the drives in velocity mode (an open-loop current pattern drifts by any difference)."""
    scenario = Scenario(
        schema="spsp-ctrl/scenario/1",
        name="convergence",
        base=BaseMotion(start_s=0.0, roll=(Sine(amplitude_deg=10, period_s=2.0),)),
    )
    plant = VirtualPlant(MODEL, scenario, 1000, 5, substep_s)
    track = []
    for k in range(2000):
        command = np.zeros(N_COMMAND)
        command[C.enable] = command[C.pitch_velocity] = command[C.roll_velocity] = 1.0
        command[C.pitch_speed] = 80.0 * sin(2 * np.pi * k / 400)
        command[C.roll_speed] = 60.0 * sin(2 * np.pi * k / 300)
        command[C.azimuth_rate] = 0.05 * sin(2 * np.pi * k / 500)
        out = plant.advance(command)
        track.append((out[O.joint_pitch_rad], out[O.joint_roll_rad], out[O.azimuth_rad]))
    return np.array(track)


def test_result_converges_with_the_step_size() -> None:
    reference = rollout(12.5e-6)
    errors = np.array([np.abs(rollout(dt) - reference).max(axis=0) for dt in (200e-6, 100e-6, 50e-6)]) * ARCMIN_RAD
    tilt = errors[:, :2].max(axis=1)
    assert float(np.ptp(reference[:, 0])) * ARCMIN_RAD > 60.0
    # first order: halving the step halves the error
    assert tilt[1] < 0.65 * tilt[0], errors
    assert tilt[2] < 0.65 * tilt[1], errors
    assert tilt[1] < 0.1, errors
    # the azimuth axis floats in the play of its gear: no step size decides where, but never by more than the play and a little wind-up
    assert errors[:, 2].max() < 1.4 * MODEL.parameters()[G.az_gap_rad] * ARCMIN_RAD
