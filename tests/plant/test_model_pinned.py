"""The plant as designed is the parameter table of the control study, every row of it (values written here, with the row's name).

Where the model splits a row (plate and load, gear and stop) the row is checked on what comes out of the parts.
"""

from __future__ import annotations

from math import radians, sqrt
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_WORK, A, G, S, U, W
from spsp_ctrl.plant.layout import N_INPUT as INPUTS
from spsp_ctrl.plant.layout import N_STATE as STATES
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.plant.stages.mechanism import prepare

ROOT = Path(__file__).resolve().parents[2]
P = load_model(ROOT / "config" / "model.yaml").parameters()
ARCMIN = radians(1.0 / 60.0)

PER_AXIS = {
    "screw lead": (A.screw_lead_m, 4e-3),
    "gear ratio": (A.gear_ratio, 3.0),
    "rotor + train inertia at motor": (A.rotor_inertia_kg_m2, 2.0e-5),
    "Kt = Ke": (A.torque_constant_nm_a, 0.05),
    "R": (A.resistance_ohm, 0.5),
    "current-loop lag": (A.current_lag_s, 0.3e-3),
    "current limit": (A.current_limit_a, 6.0),
    "bus": (A.bus_voltage_v, 24.0),
    "cogging": (A.cogging_nm, 2e-3),
    "cogging order": (A.cogging_order, 12.0),
    "motor-side friction Tc": (A.mf_coulomb_nm, 10e-3),
    "motor-side friction Ts": (A.mf_static_nm, 14e-3),
    "motor-side friction B": (A.mf_viscous_nm_s, 4e-5),
    "Stribeck speed": (A.mf_stribeck_rad_s, 6.0),
    "sigma0": (A.mf_bristle_nm_rad, 1.5),
    "sigma1": (A.mf_bristle_damping_nm_s, 2e-3),
    "load-dependent friction": (A.mf_load_factor, 0.35),
    "axial stiffness (one side)": (A.axial_stiffness_n_m, 8e6),
    "contact damping": (A.contact_damping_n_s_m, 1400.0),
    "total gap at the rod": (A.gap_m, 12e-6),
    "hinge + guide friction Coulomb": (A.hf_coulomb_nm, 1.1),
    "hinge + guide friction static": (A.hf_static_nm, 1.3),
    "presliding stiffness": (A.hf_bristle_nm_rad, 9000.0),
    "viscous hinge": (A.hf_viscous_nm_s, 0.6),
    "lead error 1x": (A.lead_first_m, 2.5e-6),
    "lead error 2x": (A.lead_second_m, 0.8e-6),
    "lead/parallelism slope": (A.lead_slope, -0.30e-3),
    "thermal (Eq 13), coefficient": (A.screw_expansion_1_k, 11.5e-6),
    "thermal (Eq 13), l0": (A.screw_length_m, 0.25),
    "resolver, 14 bit": (A.resolver_counts, 2.0**14),
    "resolver, 1x harmonic": (A.res_first_rad, 4.0 * ARCMIN),
    "resolver, 2x harmonic": (A.res_second_rad, 5.0 * ARCMIN),
}
RIG = {
    "h": (G.column_height_m, 0.2655),
    "r": (G.hinge_radius_m, 0.1),
    "dr, upper": (G.dr_upper_m, 5e-6),
    "dr, lower": (G.dr_lower_m, 5e-6),
    "dh": (G.dh_m, 20e-6),
    "IMU attitude, step": (G.imu_step_rad, 0.1 * ARCMIN),
    "IMU attitude, noise": (G.imu_noise_rad, 0.04 * ARCMIN),
    "IMU attitude, lag": (G.imu_attitude_lag_s, 4e-3),
    "IMU delay": (G.imu_delay_s, 5e-3),
    "IMU rate": (G.imu_rate_hz, 200.0),
    "IMU slow error, pitch bias": (G.imu_pitch_bias_rad, 0.20 * ARCMIN),
    "IMU slow error, roll bias": (G.imu_roll_bias_rad, -0.20 * ARCMIN),
    "IMU slow error, drift": (G.imu_drift_rad, 0.08 * ARCMIN),
    "IMU slow error, drift time": (G.imu_drift_time_s, 60.0),
    "gyro noise": (G.gyro_noise_rad_s, 1.5 * ARCMIN),
    "gyro step": (G.gyro_step_rad_s, 0.06 * ARCMIN),
    "gyro lag": (G.imu_gyro_lag_s, 2e-3),
    "swing-table axis to U joint": (G.swing_arm_m, 0.45),
}


@pytest.mark.parametrize("row", PER_AXIS)
def test_actuator_row(row: str) -> None:
    index, value = PER_AXIS[row]
    assert P[index] == pytest.approx(value, rel=1e-12)
    assert P[N_AXIS_PARAMETERS + index] == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("row", RIG)
def test_rig_row(row: str) -> None:
    index, value = RIG[row]
    assert P[index] == pytest.approx(value, rel=1e-12)


def test_zero_offset_rods() -> None:
    assert P[A.zero_offset_m] == pytest.approx(8e-6)
    assert P[N_AXIS_PARAMETERS + A.zero_offset_m] == pytest.approx(-8e-6)


def test_gyro_bias_row() -> None:
    assert [abs(P[G.gyro_bias_x_rad_s + i]) for i in range(3)] == pytest.approx([0.05 * ARCMIN] * 3)


def test_mass_rows_come_out_of_plate_and_load() -> None:
    """Moving mass 15 kg incl. 7 kg load; Ixx, Iyy, Izz 0.177, 0.198, 0.237; centre of gravity 50 mm up, 2.5 mm aside."""
    import numpy as np

    parameters = P.copy()
    x, u, w = np.zeros(STATES), np.zeros(INPUTS), np.zeros(N_WORK)
    x[S.column_temperature] = x[S.frame_temperature] = parameters[G.temperature_reference_c]
    u[U.load_mass] = load_scenario(ROOT / "config" / "experiments" / "swing-2dof.yaml").model.load.mass_kg
    assert u[U.load_mass] == 7.0
    prepare(x, parameters, u, w)
    mass = parameters[G.plate_mass_kg] + u[U.load_mass]
    assert mass == 15.0
    assert w[[W.ixx, W.iyy, W.izz]] == pytest.approx([0.177, 0.198, 0.237], abs=5e-4)
    assert w[[W.mcx, W.mcy, W.mcz]] / mass == pytest.approx([2.5e-3, 2.5e-3, 50e-3], rel=2e-3)


def test_stroke_and_stops() -> None:
    """Stroke of +-20 deg (-34.12 / +34.26 mm): the controller keeps -34.1 / +34.3, the hard stops stand 1 mm further out."""
    mechanism = load_rig(ROOT / "config" / "rig.yaml").model.mechanism
    assert (mechanism.stroke_min_mm, mechanism.stroke_max_mm) == (-34.1, 34.3)
    for first in (0, N_AXIS_PARAMETERS):
        assert P[first + A.rod_min_m] == pytest.approx(-35.1e-3)
        assert P[first + A.rod_max_m] == pytest.approx(35.3e-3)


def test_derived_figures_of_the_table() -> None:
    """444 kg at the rod, 105 Hz with locked rotor, 57.5 um for 20 K, 1.3 arcmin and 0.08 um of a resolver count, presliding of 12 um."""
    pitch = P[A.screw_lead_m] / (2.0 * 3.141592653589793)
    assert P[A.rotor_inertia_kg_m2] * (P[A.gear_ratio] / pitch) ** 2 == pytest.approx(444.0, rel=2e-3)
    lever = P[G.hinge_radius_m]
    assert sqrt(P[A.axial_stiffness_n_m] * lever**2 / 0.18) / 6.283185307 == pytest.approx(105.0, rel=0.03)
    assert 20.0 * P[A.screw_expansion_1_k] * P[A.screw_length_m] == pytest.approx(57.5e-6)
    assert 360.0 * 60.0 / P[A.resolver_counts] == pytest.approx(1.3, abs=0.03)
    assert P[A.screw_lead_m] / P[A.gear_ratio] / P[A.resolver_counts] == pytest.approx(0.08e-6, rel=0.03)
    assert P[A.hf_coulomb_nm] / P[A.hf_bristle_nm_rad] * lever == pytest.approx(12e-6, rel=0.03)


def test_base_roughness_row() -> None:
    roughness = load_scenario(ROOT / "config" / "experiments" / "swing-2dof.yaml").model.base.roughness
    assert (roughness.rms_arcmin, roughness.low_hz, roughness.high_hz) == (0.05, 2.0, 10.0)
