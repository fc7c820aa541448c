"""Layout of the flat arrays: parameters, state, inputs, command, output. The one place of every index.

All arrays are float64. Per-actuator blocks come first (pitch, then roll), each of ``N_AXIS_*`` numbers, then the rig's own block.
Indices are constants of namedtuples, which numba compiles as literals: ``p[base + A.gap_m]``.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any

from spsp_ctrl.messages import Truth
from spsp_ctrl.plant.effects import EFFECTS
from spsp_ctrl.plant.effects.base import Parameter
from spsp_ctrl.plant.effects.command_delay import HISTORY

AXES = ("pitch", "roll")

AXIS_BASE: tuple[Parameter, ...] = (
    Parameter("torque_constant_nm_a", "N m/A", 1e-4, 10.0, "motor torque constant (= back-EMF constant)"),
    Parameter("resistance_ohm", "ohm", 1e-3, 100.0, "winding resistance"),
    Parameter("inductance_h", "H", 1e-6, 1.0, "winding inductance"),
    Parameter("current_lag_s", "s", 1e-5, 0.05, "time constant of the closed current loop"),
    Parameter("current_limit_a", "A", 0.01, 500.0, "current limit of the drive"),
    Parameter("bus_voltage_v", "V", 1.0, 1000.0, "supply voltage: limits what the current loop can apply"),
    Parameter("rotor_inertia_kg_m2", "kg m2", 1e-9, 1.0, "rotor and train, at the motor"),
    Parameter("drive_kp_a_s_rad", "A s/rad", 0.0, 100.0, "speed loop inside the drive (velocity mode)"),
    Parameter("drive_ki_a_rad", "A/rad", 0.0, 1e5, "its integral gain"),
    Parameter("current_noise_a", "A", 0.0, 1.0, "noise of the reported current"),
    Parameter("screw_lead_m", "m", 1e-4, 0.1, "travel per screw turn"),
    Parameter("gear_ratio", "1", 0.1, 1000.0, "motor turns per screw turn"),
    Parameter("axial_stiffness_n_m", "N/m", 1e4, 1e12, "screw, bearing, nut and housing in series"),
    Parameter("contact_damping_n_s_m", "N s/m", 0.0, 1e7, "damping of the loaded flank"),
    Parameter("resolver_counts", "1", 0.0, 1e9, "counts per motor turn"),
    Parameter("rod_min_m", "m", -1.0, 0.0, "hard stop, retraction from level"),
    Parameter("rod_max_m", "m", 0.0, 1.0, "hard stop, extension from level"),
    Parameter("screw_heat_time_s", "s", 1.0, 1e6, "cooling time constant of the screw"),
    Parameter("screw_heat_k_w", "K/W", 0.0, 1e3, "steady temperature rise per watt of friction"),
)

GLOBAL_BASE: tuple[Parameter, ...] = (
    Parameter("column_height_m", "m", 0.01, 5.0, "column height h"),
    Parameter("hinge_radius_m", "m", 0.005, 2.0, "hinge radius r, upper and lower"),
    Parameter("plate_mass_kg", "kg", 0.1, 1000.0, "moving platform without load"),
    Parameter("plate_cog_z_m", "m", -1.0, 1.0, "its centre of gravity above the U joint"),
    Parameter("plate_ixx_kg_m2", "kg m2", 1e-5, 1e3, "its inertia about the U joint"),
    Parameter("plate_iyy_kg_m2", "kg m2", 1e-5, 1e3, "its inertia about the U joint"),
    Parameter("plate_izz_kg_m2", "kg m2", 1e-5, 1e3, "its inertia about the U joint"),
    Parameter("load_cog_x_m", "m", -1.0, 1.0, "centre of gravity of the load"),
    Parameter("load_cog_y_m", "m", -1.0, 1.0, "centre of gravity of the load"),
    Parameter("load_cog_z_m", "m", -1.0, 1.0, "centre of gravity of the load"),
    Parameter("load_gyration_xy_m2", "m2", 0.0, 1.0, "own inertia per mass of the load, about x and y"),
    Parameter("load_gyration_z_m2", "m2", 0.0, 1.0, "own inertia per mass of the load, about z"),
    Parameter("carrier_izz_kg_m2", "kg m2", 1e-4, 1e4, "what turns with azimuth but does not tilt"),
    Parameter("stop_stiffness_n_m", "N/m", 1e4, 1e12, "hard stops of the rods"),
    Parameter("stop_damping_n_s_m", "N s/m", 0.0, 1e8, "their damping"),
    Parameter("swing_arm_m", "m", -5.0, 5.0, "swing-table axis to U joint"),
    Parameter("az_holding_nm", "N m", 1e-3, 100.0, "stepper holding torque"),
    Parameter("az_teeth", "1", 4.0, 400.0, "rotor teeth (full steps per turn / 4)"),
    Parameter("az_microsteps", "1", 1.0, 256.0, "microsteps per full step"),
    Parameter("az_rotor_inertia_kg_m2", "kg m2", 1e-8, 1.0, "stepper rotor and pinion"),
    Parameter("az_rotor_damping_nm_s", "N m s/rad", 0.0, 10.0, "stepper rotor damping"),
    Parameter("az_detent_nm", "N m", 0.0, 10.0, "detent torque, four times per tooth: microstep error"),
    Parameter("az_gear_ratio", "1", 0.1, 1000.0, "motor turns per azimuth turn"),
    Parameter("az_stiffness_nm_rad", "N m/rad", 1.0, 1e9, "gear mesh stiffness at the platform"),
    Parameter("az_damping_nm_s", "N m s/rad", 0.0, 1e5, "gear mesh damping at the platform"),
    Parameter("az_ramp_rad_s2", "rad/s2", 0.01, 1e3, "acceleration ramp of the stepper driver, at the platform"),
    Parameter("az_stop_rad", "rad", 0.1, 6.3, "hard stops at plus and minus this angle"),
    Parameter("az_stop_stiffness_nm_rad", "N m/rad", 1.0, 1e9, "hard stop stiffness"),
    Parameter("az_stop_damping_nm_s", "N m s/rad", 0.0, 1e6, "hard stop damping"),
    Parameter("az_switch_rad", "rad", 0.1, 6.3, "travel switches at plus and minus this angle"),
    Parameter("az_home_half_rad", "rad", 0.0, 0.5, "half width of the photoelectric zero"),
    Parameter("temperature_reference_c", "degC", -40.0, 85.0, "temperature at which lengths are nominal"),
    Parameter("column_heat_time_s", "s", 1.0, 1e6, "time constant of the column temperature"),
    Parameter("frame_heat_time_s", "s", 1.0, 1e6, "time constant of the frame temperature"),
    Parameter("imu_rate_hz", "Hz", 1.0, 2000.0, "IMU frame rate"),
    Parameter("imu_delay_s", "s", 0.0, 0.1, "IMU transport delay"),
    Parameter("imu_attitude_lag_s", "s", 0.0, 0.1, "lag of the attitude output"),
    Parameter("imu_gyro_lag_s", "s", 0.0, 0.1, "lag of the gyro output"),
)

AXIS_PARAMETERS = AXIS_BASE + tuple(q for e in EFFECTS if e.per_axis for q in e.parameters)
GLOBAL_PARAMETERS = GLOBAL_BASE + tuple(q for e in EFFECTS if not e.per_axis and e.kind != "axis" for q in e.parameters)


def _indices(type_name: str, names: tuple[str, ...], start: int = 0) -> Any:
    return namedtuple(type_name, names)(*range(start, start + len(names)))


N_AXIS_PARAMETERS = len(AXIS_PARAMETERS)
A: Any = _indices("AxisParameter", tuple(q.name for q in AXIS_PARAMETERS))
G: Any = _indices("GlobalParameter", tuple(q.name for q in GLOBAL_PARAMETERS), 2 * N_AXIS_PARAMETERS)
N_PARAMETERS = 2 * N_AXIS_PARAMETERS + len(GLOBAL_PARAMETERS)

# ---- a single axis: the parameters above (its actuator is the first), then its own ---------------------------------------
LOAD_BASE: tuple[Parameter, ...] = (
    Parameter("moving_mass_kg", "kg", 1e-3, 1e5, "carriage and what moves with it, without the known added mass"),
    Parameter("ruler_step_m", "m", 0.0, 1e-3, "resolution of the ruler"),
    Parameter("ruler_noise_m", "m", 0.0, 1e-3, "noise of the ruler, standard deviation"),
)
LOAD_SWITCHES = ("rigid", "loop", "kp_1_s", "kv", "feedforward", "limit", "rate_span")
"""Set by the kind of model and its controller: screw and load move as one; loop 0 none, 1 on the ruler, 2 on the resolver; its gains."""
LOAD_EFFECTS: tuple[Parameter, ...] = tuple(q for e in EFFECTS if not e.per_axis and e.kind == "axis" for q in e.parameters)
L: Any = _indices("LoadParameter", (*(q.name for q in LOAD_BASE + LOAD_EFFECTS), *LOAD_SWITCHES), N_PARAMETERS)
N_LOAD_MODEL = N_PARAMETERS + len(L)

# ---- state ---------------------------------------------------------------------------------------------------------------
AXIS_STATE: tuple[tuple[str, str, str], ...] = (
    ("current", "A", "motor current"),
    ("angle", "rad", "motor angle, zero at level"),
    ("speed", "rad/s", "motor speed"),
    ("bristle", "rad", "LuGre bristle of the motor-side friction"),
    ("drive_integral", "A", "integral of the drive's own speed loop (velocity mode)"),
    ("screw_temperature", "degC", "screw temperature"),
    ("lag_current", "A", "current command after the drive lag"),
    ("lag_speed", "rad/s", "speed command after the drive lag"),
    *((f"past_current_{i}", "A", f"current command of {i} cycles ago (command delay)") for i in range(HISTORY)),
    *((f"past_speed_{i}", "rad/s", f"speed command of {i} cycles ago") for i in range(HISTORY)),
)
RIG_STATE: tuple[tuple[str, str, str], ...] = (
    ("azimuth", "rad", "azimuth joint"),
    ("pitch", "rad", "pitch joint"),
    ("roll", "rad", "roll joint"),
    ("azimuth_rate", "rad/s", "its rate"),
    ("pitch_rate", "rad/s", "its rate"),
    ("roll_rate", "rad/s", "its rate"),
    ("pitch_bristle", "rad", "hinge friction bristle"),
    ("roll_bristle", "rad", "hinge friction bristle"),
    ("azimuth_bristle", "rad", "azimuth bearing bristle"),
    ("step_rate", "rad/s", "commanded rate of the stepper field, motor side"),
    ("step_angle", "rad", "commanded angle of the stepper field, motor side"),
    ("rotor_angle", "rad", "stepper rotor angle"),
    ("rotor_rate", "rad/s", "its rate"),
    ("column_temperature", "degC", "column temperature"),
    ("frame_temperature", "degC", "frame temperature"),
    ("lag_roll", "rad", "IMU attitude after its lag"),
    ("lag_pitch", "rad", "IMU attitude after its lag"),
    ("lag_yaw", "rad", "IMU attitude after its lag"),
    ("in_roll", "rad", "true IMU attitude at the previous cycle (input of the lag)"),
    ("in_pitch", "rad", "true IMU attitude at the previous cycle"),
    ("in_yaw", "rad", "true IMU attitude at the previous cycle, unwrapped"),
    ("lag_gyro_x", "rad/s", "gyro after its lag"),
    ("lag_gyro_y", "rad/s", "gyro after its lag"),
    ("lag_gyro_z", "rad/s", "gyro after its lag"),
    ("in_gyro_x", "rad/s", "true IMU rate at the previous cycle"),
    ("in_gyro_y", "rad/s", "true IMU rate at the previous cycle"),
    ("in_gyro_z", "rad/s", "true IMU rate at the previous cycle"),
    ("drift_roll", "rad", "slow attitude wander"),
    ("drift_pitch", "rad", "slow attitude wander"),
    ("drift_yaw", "rad", "heading wander"),
    ("level_roll", "rad", "levelling error"),
    ("level_pitch", "rad", "levelling error"),
)
N_AXIS_STATE = len(AXIS_STATE)
X: Any = _indices("AxisState", tuple(s[0] for s in AXIS_STATE))
S: Any = _indices("RigState", tuple(s[0] for s in RIG_STATE), 2 * N_AXIS_STATE)
N_STATE = 2 * N_AXIS_STATE + len(RIG_STATE)

LOAD_STATE: tuple[tuple[str, str, str], ...] = (
    ("travel", "m", "load"),
    ("rate", "m/s", "its rate"),
    ("guide", "m", "bristle of the guide friction"),
    ("mode", "m", "structural mode"),
    ("mode_rate", "m/s", "its rate"),
    ("held_resolver", "rad", "last resolver reading that arrived"),
    ("held_ruler", "m", "last ruler reading that arrived"),
    *((f"position_{i}", "m", f"position that the cascade read {i} cycles ago") for i in range(1, 5)),
)
Y: Any = _indices("LoadState", tuple(s[0] for s in LOAD_STATE), N_AXIS_STATE)
N_LOAD_STATE = N_AXIS_STATE + len(LOAD_STATE)
"""A single axis: the numbers of its actuator, then its own."""

# ---- inputs of one control instant ---------------------------------------------------------------------------------------
N_BASE = 18
"""Rotation, angular velocity and acceleration, specific acceleration; the three axis angles follow."""
INPUTS: tuple[tuple[str, str, str], ...] = (
    *((f"base_r{i}{j}", "1", "base to inertial rotation") for i in range(3) for j in range(3)),
    *((f"base_omega_{c}", "rad/s", "base angular velocity, base axes") for c in "xyz"),
    *((f"base_alpha_{c}", "rad/s2", "base angular acceleration, base axes") for c in "xyz"),
    *((f"base_f_{c}", "m/s2", "specific acceleration of the U joint, base axes") for c in "xyz"),
    *((f"base_{c}", "rad", "axis angle of the swing table") for c in ("pitch", "roll", "yaw")),
    ("load_mass", "kg", "mass on the platform"),
    ("ambient", "degC", "surroundings"),
    ("heater_on", "1", "non-zero: screws are held at heater_c"),
    ("heater_c", "degC", "heater temperature"),
    ("rod_force_pitch", "N", "outer force on the pitch rod, positive pulls it out"),
    ("rod_force_roll", "N", "outer force on the roll rod"),
    ("noise_resolver_pitch", "1", "standard normal"),
    ("noise_resolver_roll", "1", "standard normal"),
    ("noise_current_pitch", "1", "standard normal"),
    ("noise_current_roll", "1", "standard normal"),
    *((f"noise_imu_{c}", "1", "standard normal") for c in ("roll", "pitch", "yaw")),
    *((f"noise_gyro_{c}", "1", "standard normal") for c in "xyz"),
    *((f"noise_drift_{c}", "1", "standard normal") for c in ("roll", "pitch", "yaw")),
)
U: Any = _indices("Input", tuple(s[0] for s in INPUTS))
N_INPUT = len(INPUTS)
N_NOISE = sum(1 for s in INPUTS if s[0].startswith("noise_"))

# ---- command that acts during one cycle ----------------------------------------------------------------------------------
COMMAND = ("enable", "pitch_velocity", "pitch_current", "pitch_speed", "roll_velocity", "roll_current", "roll_speed", "azimuth_rate")
C: Any = _indices("CommandRow", COMMAND)
N_COMMAND = len(COMMAND)

# ---- output at the end of a cycle: truth first, in the order of messages.Truth -------------------------------------------
TRUTH = Truth._fields[2:]
SENSED = (
    "counts_pitch",
    "counts_roll",
    "measured_current_pitch",
    "measured_current_roll",
    "bus_voltage_pitch",
    "bus_voltage_roll",
    "microsteps",
    "microstep_rate",
    "left_switch",
    "right_switch",
    "home_switch",
    "column_c",
    "frame_c",
    "imu_roll",
    "imu_pitch",
    "imu_yaw",
    "gyro_x",
    "gyro_y",
    "gyro_z",
    "encoder_pitch",
    "encoder_roll",
    "encoder_yaw",
)
O: Any = _indices("Output", TRUTH + SENSED)  # noqa: E741
N_TRUTH = len(TRUTH)
N_OUTPUT = N_TRUTH + len(SENSED)

# ---- what is constant over one cycle: geometry and mass ------------------------------------------------------------------
WORK = ("height", "upper", "lower", "level", "ixx", "iyy", "izz", "ixy", "ixz", "iyz", "mcx", "mcy", "mcz")
W: Any = _indices("Work", WORK)
N_WORK = len(WORK)
