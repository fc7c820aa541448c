"""The single axis: against closed forms, its two forms against each other, shooting against one run, the cascade against its replay."""

from __future__ import annotations

import os
from math import pi
from pathlib import Path

import numpy as np
import pytest

from spsp_ctrl.config.loader import ConfigError
from spsp_ctrl.messages import AxisSample
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, N_IN, OUT, inputs_from, rest_state, temperature_slope
from spsp_ctrl.plant.axis_bench import bench_samples
from spsp_ctrl.plant.axis_controller import replay
from spsp_ctrl.plant.axis_model import AXIS_EFFECTS, AxisModel, load_axis_model
from spsp_ctrl.plant.layout import A, L, X, Y
from spsp_ctrl.recording.axis_writer import AxisLog
from spsp_ctrl.recording.reader import read_log

CONFIG = Path(__file__).resolve().parents[2] / "config"
BENCH = load_axis_model(CONFIG / "axis.yaml")
BARE = load_axis_model(CONFIG / "axis-bare.yaml")
NAMES = tuple(entry.effect for entry in BENCH.file.effects)
IDEAL = BENCH.without(*NAMES)


def still(n: int, **columns: float | Array) -> Array:
    u = np.zeros((n, N_IN))
    u[:, IN.enabled] = 1.0
    u[:, IN.screw_c] = u[:, IN.ambient_c] = 20.0
    for name, value in columns.items():
        u[:, getattr(IN, name)] = value
    return u


def chirp(n: int, rate: float, amplitude: float) -> Array:
    t = np.arange(n) / rate
    return np.asarray(amplitude * np.sin(2 * pi * (0.5 * t + 0.8 * t * t)))


def emps_like(n: int = 3000) -> Array:
    """A reference of half-cosines, 30 mm there and back."""
    t = np.arange(n) / BARE.file.rate_hz
    return still(n, reference_m=0.015 * (1 - np.cos(2 * pi * t / 1.5)), reference_m_s=0.02 * pi * np.sin(2 * pi * t / 1.5))


def test_a_bare_mass_under_a_constant_command_accelerates_as_newton_says() -> None:
    p = BARE.parameters()
    p[L.loop] = 0.0
    y = BARE.simulate(p, still(200, command_a=2.0))
    t = np.arange(200) / BARE.file.rate_hz
    assert y[:, OUT.load_m] == pytest.approx(0.5 * (2.0 * 35.15 / 95.1) * t**2, rel=0.01, abs=2e-7)


def test_added_mass_and_outer_force_act() -> None:
    p = BARE.parameters()
    p[L.loop] = 0.0
    cases: tuple[dict[str, float], ...] = ({}, {"load_mass_kg": 95.1}, {"load_force_n": 35.15})
    plain, heavy, pushed = (BARE.simulate(p, still(100, command_a=2.0, **case))[-1, OUT.travel_m] for case in cases)
    assert heavy == pytest.approx(plain / 2, rel=1e-6)
    assert pushed == pytest.approx(plain / 2, rel=5e-3)


def test_a_stiff_full_axis_moves_like_a_rigid_one() -> None:
    p = IDEAL.parameters()
    u = still(500, command_a=chirp(500, 500.0, 0.25))
    elastic = IDEAL.simulate(p, u)
    q = p.copy()
    q[L.rigid] = 1.0
    rigid = IDEAL.simulate(q, u)
    span = np.ptp(rigid[:, OUT.load_m])
    assert span > 1e-3
    assert np.abs(elastic[:, OUT.load_m] - rigid[:, OUT.load_m]).max() < 5e-3 * span


def test_velocity_mode_follows_its_command() -> None:
    y = BENCH.simulate(BENCH.parameters(), still(500, velocity_mode=1.0, command_rad_s=30.0))
    assert y[-100:, OUT.motor_rad_s].mean() == pytest.approx(30.0, rel=0.01)
    travel = 30.0 / BENCH.file.actuator["gear_ratio"].value * 4e-3 / (2 * pi)
    assert np.polyfit(np.arange(200) / 500, y[-200:, OUT.travel_m], 1)[0] == pytest.approx(travel, rel=0.05)


def test_shooting_from_the_states_of_a_run_gives_that_run() -> None:
    p = BENCH.parameters()
    for name, value in (("command_delay_s", 3e-3), ("drive_lag_s", 1e-3), ("mode_frequency_hz", 30.0), ("mode_gain", 0.1), ("ruler_lost", 0.1)):
        p[BENCH.index(name)] = value
    u = still(600, command_a=chirp(600, 500.0, 0.6))
    y, states = BENCH.trace(p, u)
    at = np.array([0, 117, 300, 450])
    assert np.array_equal(BENCH.windows(p, u, states[at], at), y)
    assert np.array_equal(BENCH.simulate(p, u[117:], states[117], first=117), y[117:])
    assert np.array_equal(BENCH.simulate(p, u), y)


@pytest.mark.parametrize("with_load", [False, True], ids=["driven", "read"])
@pytest.mark.parametrize("model", [BENCH, BARE], ids=["bench", "bare"])
def test_start_states_from_readings_come_close_to_the_true_ones(model: AxisModel, with_load: bool) -> None:
    p = model.parameters()
    p[L.guide_slope], p[A.res_second_rad], p[A.res_second_phase_rad] = 2e-3, 5e-3, 0.4
    n = 1500
    u = still(n, command_a=chirp(n, model.file.rate_hz, 0.6)) if model is BENCH else emps_like(n)
    y, states = model.trace(p, u)
    at = np.arange(100, n, 100)
    u[:, IN.command_a] = y[:, OUT.command_a]
    load = (y[at, OUT.load_m], states[at, Y.rate]) if with_load else ()
    starts = model.start_states(p, u, at, y[at, OUT.motor_rad], states[at, X.speed], states[at, X.current], *load)
    shot = model.windows(p, u, starts, at)
    for channel in (OUT.load_m, OUT.motor_rad):
        error = np.abs(shot[100:, channel] - y[100:, channel]).max()
        assert error < 0.01 * np.ptp(y[:, channel])


DATA = Path(os.environ.get("SPSP_CTRL_DATA", CONFIG.parents[1] / "shared" / "data")) / "emps" / "DATA_EMPS.mat"


@pytest.mark.skipif(not DATA.is_file(), reason="no EMPS recording (folder named by SPSP_CTRL_DATA)")
def test_the_published_model_of_a_real_axis_closes_the_loop_as_published() -> None:
    """EMPS: the cascade replays to the encoder's resolution, and the published friction leaves 4.55 % of the force in closed loop."""
    from scipy.io import loadmat

    record = {name: np.asarray(value, np.float64).ravel() for name, value in loadmat(DATA).items() if not name.startswith("__")}
    c = BARE.file.controller
    again = replay(record["qg"], np.zeros_like(record["qg"]), record["qm"], 1000.0, kp=c.kp_1_s, kv=c.kv, limit=c.limit, rate_span=c.rate_span)
    assert float(np.std((again - record["vir"])[5:])) < 4e-3, "volt; one count of the encoder is 6 mV here"
    p, to_motor = BARE.parameters(), BARE.travel_per_rad
    bare = p.copy()
    p[A.mf_coulomb_nm], p[A.mf_viscous_nm_s], p[A.torque_offset_nm] = 20.39 * to_motor, 203.5 * to_motor**2, -3.165 * to_motor
    p[A.mf_bristle_nm_rad], p[A.mf_bristle_damping_nm_s] = 1.5, 2e-3
    u = still(len(record["qg"]), reference_m=record["qg"], command_a=record["vir"])
    speed, place = np.polyfit(np.arange(6) / 1000.0, record["qm"][:6], 1)
    start = BARE.start_states(p, u, np.array([0]), np.array([place / to_motor]), np.array([speed / to_motor]), record["vir"][:1])[0]

    def missed(parameters: Array) -> float:
        error = BARE.simulate(parameters, u, start, first=1)[:, OUT.command_a] - record["vir"]
        return float(np.sqrt(np.mean(error**2) / np.mean(record["vir"] ** 2)))

    assert missed(bare) == pytest.approx(0.696, abs=0.01)
    assert missed(p) == pytest.approx(0.0455, abs=0.001)


def test_the_cascade_in_the_loop_is_its_replay() -> None:
    p = BARE.parameters()
    u = emps_like()
    y = BARE.simulate(p, u)
    c = BARE.file.controller
    again = replay(u[:, IN.reference_m], u[:, IN.reference_m_s], y[:, OUT.load_m], 1000.0, kp=c.kp_1_s, kv=c.kv, limit=c.limit, rate_span=c.rate_span)
    assert np.abs(y[:, OUT.command_a]).max() > 0.5
    assert again == pytest.approx(y[:, OUT.command_a], rel=1e-9, abs=1e-9)
    assert np.abs(y[:, OUT.load_m] - u[:, IN.reference_m]).max() < 2e-3, "the loop follows"


def test_a_cascade_on_the_resolver_follows_too() -> None:
    p = BARE.parameters()
    p[L.loop] = 2.0
    u = emps_like()
    y = BARE.simulate(p, u)
    assert np.abs(y[:, OUT.load_m] - u[:, IN.reference_m]).max() < 2e-3


def test_rest_state_stays_at_rest_under_a_weight() -> None:
    p = BENCH.parameters()
    u = still(500, load_force_n=20.0)
    x = rest_state(p, u, 0.01)
    x[X.current] = 0.0
    y = BENCH.simulate(p, u, x)
    assert abs(y[-1, OUT.travel_m] - 0.01) < 2e-6, "friction of the motor holds a 20 N weight"
    assert y[-1, OUT.force_n] == pytest.approx(20.0, abs=3.6), "guide friction takes a part"


def test_samples_of_the_bench_go_through_a_log_into_inputs(tmp_path: Path) -> None:
    u = still(300, command_a=chirp(300, 500.0, 0.5), screw_c=np.asarray(20.0 + 0.01 * np.arange(300)))
    rows = bench_samples(BENCH, u, seed=4)
    assert rows == bench_samples(BENCH, u, seed=4)
    assert rows != bench_samples(BENCH, u, seed=5)
    with AxisLog(tmp_path / "a.mcap", rate_hz=500, controller="recorded") as log:
        log.samples(rows)
    back = inputs_from(read_log(tmp_path / "a.mcap").topics["/axis"], 500.0)
    assert np.array_equal(back[:, : IN.screw_c_s], u[:, : IN.screw_c_s])
    assert back[100:-300, IN.screw_c_s] == pytest.approx(5.0)
    y = BENCH.simulate(BENCH.parameters(), u)
    counts = np.array([row.resolver_counts for row in rows])
    assert counts * 2 * pi / 16384 == pytest.approx(y[:, OUT.motor_rad], abs=1e-3)
    assert isinstance(rows[0], AxisSample)


def test_slope_of_a_stepped_temperature_is_smooth() -> None:
    reading = np.round((20.0 + np.arange(5000) / 5000) / 0.1) * 0.1
    slope = temperature_slope(reading, 500.0)
    assert np.abs(slope[1000:-1000] - 0.1).max() < 0.06


def test_axis_yaml_has_the_actuator_of_the_platform() -> None:
    from spsp_ctrl.plant.model import load_model

    platform = load_model(CONFIG / "model.yaml")
    assert BENCH.file.actuator == platform.file.actuator
    entries = {e.effect: e.parameters for e in platform.file.effects}
    for entry in BENCH.file.effects:
        if entry.effect in entries:
            assert entry.parameters == entries[entry.effect]
    q = platform.parameters()
    p = BENCH.parameters()
    for name in ("gap_m", "mf_coulomb_nm", "lead_first_m", "axial_stiffness_n_m"):
        assert p[BENCH.index(name)] == q[getattr(A, name)]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("effect: backlash", "effect: imu_bias", "acts on a platform, not on a single axis"),
        ("effect: backlash", "effect: backlsh", "did you mean 'backlash'"),
        ("gap: {value: 12.0, unit: um", "gap: {value: 12.0, unit: kg", "does not fit"),
        ("gap: {value: 12.0", "gap: {value: 1e6", "is outside"),
        ("moving_mass:", "moving_mas:", "did you mean 'moving_mass'"),
        ("kind: none", "kind: cascade", "a cascade needs kp_1_s and kv"),
    ],
)
def test_mistakes_are_named_with_their_place(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    text = (CONFIG / "axis.yaml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as raised:
        load_axis_model(path)
    assert any(complaint in p.message and p.line > 1 for p in raised.value.problems)


def test_an_effect_without_meaning_on_a_bare_axis_is_refused(tmp_path: Path) -> None:
    text = (CONFIG / "axis-bare.yaml").read_text(encoding="utf-8")
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace("effects: []", "effects:\n  - effect: backlash\n    parameters: {gap: {value: 5, unit: um}}\n"), encoding="utf-8")
    with pytest.raises(ConfigError, match="has no meaning on a rigid mass"):
        load_axis_model(path)


def test_every_effect_of_an_axis_is_listed_once() -> None:
    assert {"backlash", "guide_slope", "clock_skew", "torque_offset"} <= {e.name for e in AXIS_EFFECTS}
    assert not {"hinge_friction", "imu_bias", "azimuth_backlash"} & {e.name for e in AXIS_EFFECTS}
