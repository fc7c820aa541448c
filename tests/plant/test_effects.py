"""Every effect: it moves the channels that it should and no other, in any company it stays bounded, and its plain twin agrees."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from math import pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.plant import twin_run

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis import IN, N_IN, OUT, temperature_slope
from spsp_ctrl.plant.axis_model import AXIS_EFFECTS, AxisModel, load_axis_model
from spsp_ctrl.plant.effects import BY_NAME, EFFECTS, HYPOTHESES, Hypothesis
from spsp_ctrl.plant.effects.command_delay import HISTORY, delayed, remember
from spsp_ctrl.plant.effects.friction_asymmetry import level_difference, viscous_difference
from spsp_ctrl.plant.effects.velocity_saturation import folded
from spsp_ctrl.plant.layout import A, L, O

CONFIG = Path(__file__).resolve().parents[2] / "config"
BENCH = load_axis_model(CONFIG / "axis.yaml")
BARE = load_axis_model(CONFIG / "axis-bare.yaml")
PLAIN = BENCH.without("cogging", "backlash", "lead_error", "thermal_expansion", "resolver_error")
"""Friction alone, so that the axis does not run away."""
N, RATE = 1500, 500.0
UNITS = np.array([5e-3, 2 * pi / 16384, 1e-7])
"""One step of each sensor: current (A), resolver (rad), ruler (m)."""
ON_AXIS = {h.name: h for e in AXIS_EFFECTS for h in e.hypotheses if not h.random}

DRIVE, LOAD = "resolver ruler", "current resolver ruler"
MOVES: dict[str, tuple[str, str]] = {
    # name: what it moves under a current command, and under a speed command; nothing else may change by a millionth of a sensor step
    "coulomb_friction": (DRIVE, LOAD),
    "viscous_friction": (DRIVE, LOAD),
    "load_friction": (DRIVE, LOAD),
    "presliding": (DRIVE, LOAD),
    "cogging": (DRIVE, LOAD),
    "backlash": (DRIVE, LOAD),
    "lead_error": (DRIVE, "ruler"),
    "periodic_lead_error": (DRIVE, "ruler"),
    "thermal_expansion": (DRIVE, "ruler"),
    "thermal_lag": (DRIVE, LOAD),
    "resolver_eccentricity": ("resolver", "resolver"),
    "resolver_quantisation": ("resolver", "resolver"),
    "motor_constant_error": (DRIVE, LOAD),
    "torque_offset": (DRIVE, LOAD),
    "torque_ripple": (DRIVE, LOAD),
    "stribeck_friction": (DRIVE, LOAD),
    "friction_asymmetry": (DRIVE, LOAD),
    "command_deadband": (LOAD, LOAD),
    "drive_lag": (LOAD, LOAD),
    "command_delay": (LOAD, LOAD),
    "current_saturation": (LOAD, LOAD),
    "voltage_saturation": (LOAD, LOAD),
    "velocity_saturation": (LOAD, LOAD),
    "axial_compliance": (DRIVE, "ruler"),
    "guide_slope": ("ruler", "ruler"),
    "structural_resonance": ("ruler", "ruler"),
    "clock_skew": (DRIVE, DRIVE),
    "zero_offset": ("resolver", "resolver"),
    "sentinel_ripple": (DRIVE, LOAD),
    "sentinel_parity": (DRIVE, LOAD),
}
WEAK = {"lead_error", "periodic_lead_error", "thermal_expansion", "thermal_lag", "axial_compliance", "clock_skew"}
"""Mechanically coupled a little to every channel: held to move the others by less than two steps under a speed command (which stiffens the motor)."""
SIZES = {"structural_resonance": {"mode_frequency_hz": 25.0}}


def inputs(velocity: bool) -> Array:
    t = np.arange(N) / RATE
    u = np.zeros((N, N_IN))
    u[:, IN.enabled], u[:, IN.ambient_c] = 1.0, 20.0
    u[:, IN.screw_c] = 20.0 + np.where(t > 1, 1 - np.exp(1 - t), 0.0)
    u[:, IN.screw_c_s] = temperature_slope(u[:, IN.screw_c], RATE)
    u[:, IN.load_force_n] = 15 * np.sin(2 * pi * 0.3 * t)
    u[:, IN.velocity_mode] = velocity
    if velocity:
        u[:, IN.command_rad_s] = 60 * np.sin(2 * pi * 0.7 * t) + 40 * np.sin(2 * pi * 2 * t)
    else:
        u[:, IN.command_a] = 0.6 * np.sin(2 * pi * 1.5 * t) + 0.3 * np.sin(2 * pi * 0.7 * t)
    return u


def switched(model: AxisModel, h: Hypothesis) -> tuple[Array, Array]:
    """Parameters without and with the effect."""
    off = model.parameters()
    for name, value in h.along:
        if off[model.index(name)] == 0.0:
            off[model.index(name)] = value
    on = off.copy()
    for free in h.free:
        limits = "saturation" in h.regimes and not h.name.startswith("velocity")
        size = SIZES.get(h.name, {}).get(free.name, free.starts[0 if free.nuisance or limits or h.name.startswith("velocity") else -1])
        on[model.index(free.name)] = size
    return off, on


@pytest.mark.parametrize("name", ON_AXIS)
@pytest.mark.parametrize("velocity", [False, True], ids=["current", "speed"])
def test_effect_moves_its_channels_and_no_other(name: str, velocity: bool) -> None:
    off, on = switched(PLAIN, ON_AXIS[name])
    u = inputs(velocity)
    if velocity and name in ("current_saturation", "voltage_saturation"):
        u[:, IN.command_rad_s] *= 2.5
    moved = np.abs(PLAIN.simulate(on, u) - PLAIN.simulate(off, u))[:, : OUT.load_m + 1].max(axis=0) / UNITS
    wanted = MOVES[name][velocity].split()
    for channel, change in zip(("current", "resolver", "ruler"), moved, strict=True):
        if channel in wanted:
            assert change > 0.9, f"{channel} does not see it: {moved}"
        else:
            assert change < (1e-6 if name not in WEAK else 2.0 if velocity else 1e-3), f"{channel} moves: {moved}"


def test_a_rigid_axis_offers_only_what_can_act_on_it() -> None:
    assert BENCH.hypotheses().keys() - BARE.hypotheses().keys() == {"backlash", "axial_compliance", "voltage_saturation"}
    assert {"coulomb_friction", "torque_ripple", "sentinel_parity"} <= BARE.hypotheses().keys()


def test_the_table_names_every_effect_of_an_axis() -> None:
    assert MOVES.keys() == ON_AXIS.keys()


@pytest.mark.parametrize("model", [BENCH, BARE], ids=["bench", "bare"])
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_any_company_of_effects_stays_bounded(model: AxisModel, data: st.DataObject) -> None:
    p = model.parameters()
    for name in data.draw(st.lists(st.sampled_from([*ON_AXIS]), min_size=1, max_size=12, unique=True)):
        for free in ON_AXIS[name].free:
            low = free.low if free.low > 0.0 or any(s < 0.0 for s in free.starts) else 0.0
            p[model.index(free.name)] = data.draw(st.floats(low, free.high))
        for along, value in ON_AXIS[name].along:
            if p[model.index(along)] == 0.0:
                p[model.index(along)] = value
    u = inputs(data.draw(st.booleans()) and not model.file.bare)[:400]
    u[:, IN.reference_m] = 5e-3 * (1 - np.cos(2 * pi * np.arange(400) / 200))
    y = model.simulate(p, u)
    assert np.isfinite(y).all()
    # what the largest torque gives in this time at the least inertia is about 5 m on the bare axis and the stops on the bench
    assert np.abs(y[:, OUT.travel_m]).max() < (10.0 if model.file.bare else 0.06)
    assert np.abs(y[:, OUT.motor_rad_s]).max() < 3e4


ON_PLATFORM = [h for e in EFFECTS if e.kind != "axis" for h in e.hypotheses if h.name != "imu_delay"]
"""The transport delay of a frame acts in the rig, not in the kernel."""
BELOW: dict[str, float] = {"voltage_limit_v": 1.0, "current_ceiling_a": 0.1, "speed_ceiling_rad_s": 5.0}


@pytest.mark.parametrize("h", ON_PLATFORM, ids=lambda h: h.name)
def test_effect_acts_on_the_platform_too(h: Hypothesis) -> None:
    plain = twin_run.platform_run(100, dict(h.along), 2.0)
    sizes = {free.name: BELOW.get(free.name, free.starts[-1]) for free in h.free}
    changed = twin_run.platform_run(100, dict(h.along) | sizes, 2.0)
    assert np.isfinite(changed).all()
    if not h.random:
        assert np.abs(changed - plain).max() > 1e-6


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_any_company_of_effects_stays_bounded_on_the_platform(data: st.DataObject) -> None:
    effects: dict[str, float] = {}
    for h in data.draw(st.lists(st.sampled_from(ON_PLATFORM), min_size=1, max_size=12, unique=True)):
        signed = {free.name: any(s < 0.0 for s in free.starts) or free.nuisance for free in h.free}
        effects |= {free.name: data.draw(st.floats(free.low if signed[free.name] else max(free.low, 0.0), free.high)) for free in h.free}
    y = twin_run.platform_run(150, effects, data.draw(st.floats(0.0, 6.0)))
    assert np.isfinite(y).all()
    joints = y[:-1, [O.joint_pitch_rad, O.joint_roll_rad]]
    assert np.abs(joints).max() < 0.5, "beyond the stops"


def test_the_plain_twins_agree_with_the_compiled_kernels() -> None:
    plain = subprocess.run(
        [sys.executable, twin_run.__file__],
        env=os.environ | {"SPSP_CTRL_PLAIN": "1", "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert plain.returncode == 0, plain.stderr
    found = json.loads(plain.stdout)
    assert found["compiled"] is False
    for name, y in twin_run.runs().items():
        twin = np.array([float.fromhex(v) for v in found[name]]).reshape(y.shape)
        assert np.ptp(y, axis=0).max() > 0.0
        np.testing.assert_allclose(twin, y, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("h", HYPOTHESES.values(), ids=lambda h: h.name)
def test_hypothesis_is_consistent(h: Hypothesis) -> None:
    effect = next(e for e in EFFECTS if h in e.hypotheses)
    bounds = {q.name: q for e in EFFECTS for q in e.parameters}
    for free in h.free:
        q = bounds[free.name]
        assert free.name in {p.name for p in effect.parameters}
        assert q.low <= free.low < free.high <= q.high
        assert free.starts
        assert all(free.low <= s <= free.high for s in free.starts)
        assert free.nuisance or all(free.starts), "a start of zero has no gradient"
    assert set(h.channels) <= {"current", "resolver", "ruler", "imu", "gyro", "heading"}
    regimes = {"reversal", "speed", "direction", "position", "screw_phase", "motor_phase", "load", "temperature", "saturation", "slope", "always"}
    assert set(h.regimes) <= regimes
    assert set(h.twins) <= {*HYPOTHESES, "geometric_error"}, "a twin that nobody can name"
    assert all(name in bounds and bounds[name].low <= value <= bounds[name].high for name, value in h.along)
    assert not any(HYPOTHESES[t].sentinel for t in h.twins)


def test_every_name_of_the_library_is_there() -> None:
    wanted = (
        "backlash", "axial_compliance", "coulomb_friction", "viscous_friction", "stribeck_friction", "friction_asymmetry",
        "load_friction", "presliding", "torque_offset", "torque_ripple", "cogging", "motor_constant_error", "voltage_saturation",
        "current_saturation", "velocity_saturation", "command_deadband", "drive_lag", "command_delay", "lead_error",
        "periodic_lead_error", "guide_slope", "thermal_expansion", "geometric_error", "zero_offset", "resolver_eccentricity",
        "resolver_quantisation", "resolver_noise", "imu_bias", "imu_scale", "imu_misalignment", "imu_delay", "imu_lag",
        "structural_resonance", "sensor_dropout", "clock_skew",
    )  # fmt: skip
    assert set(wanted) <= HYPOTHESES.keys()
    assert [h.name for h in HYPOTHESES.values() if h.sentinel] == ["sentinel_ripple", "sentinel_parity"]
    assert len(HYPOTHESES) == sum(len(e.hypotheses) for e in EFFECTS)


@given(st.floats(0.0, 7.9e-3), st.integers(0, 19))
def test_delay_is_the_shift_that_it_says(delay: float, step: int) -> None:
    """Commands that rise by one each cycle: the mean over a sub-step is the exact mean of the delayed staircase."""
    period, dt = 1e-3, 5e-5
    x = np.zeros(HISTORY)
    for k in range(20):
        remember(x, 0, float(k))
    got = delayed(x, 0, step * dt, dt, delay, period)
    times = (19 * period + step * dt - delay) + dt * (np.arange(2000) + 0.5) / 2000
    assert got == pytest.approx(np.floor(times / period).mean(), abs=2e-3)


@given(st.floats(-1e3, 1e3), st.floats(-10.0, 10.0), st.floats(0.0, 10.0))
def test_friction_never_drives(speed: float, difference: float, level: float) -> None:
    assert level + level_difference(speed, difference, level) >= 0.0
    assert (viscous_difference(speed, difference, level) + level * speed) * speed >= 0.0


@given(st.floats(-10.0, 10.0), st.floats(-300.0, 300.0), st.floats(1.0, 200.0))
def test_a_speed_limiter_only_takes_away_what_drives(reference: float, speed: float, ceiling: float) -> None:
    left = folded(reference, speed, ceiling)
    assert abs(left) <= abs(reference)
    if reference * speed <= 0.0 or abs(speed) < ceiling:
        assert left == reference
    if reference * speed > 0.0 and abs(speed) > 1.03 * ceiling:
        assert left == 0.0


def test_half_the_readings_are_lost_when_half_are() -> None:
    p = PLAIN.parameters()
    p[L.ruler_lost] = 0.5
    y = PLAIN.simulate(p, inputs(True))
    held = np.mean(np.diff(y[:, OUT.load_m]) == 0.0)
    assert 0.45 < held < 0.55
    assert np.mean(np.diff(y[:, OUT.motor_rad]) == 0.0) < 0.01, "the resolver's are not"


def test_effects_of_one_kind_are_refused_in_the_other() -> None:
    assert BY_NAME["guide_slope"].kind == "axis"
    assert BY_NAME["imu_scale"].kind == "platform"
    assert {e.name for e in AXIS_EFFECTS} >= {e.name for e in EFFECTS if e.kind == "axis"}
    assert A.gap_m < L.moving_mass_kg


def test_every_name_has_its_paragraph() -> None:
    page = (CONFIG.parent / "docs" / "effects.md").read_text(encoding="utf-8")
    headings = [line.removeprefix("### ") for line in page.splitlines() if line.startswith("### ")]
    assert sorted(headings) == sorted(HYPOTHESES)
    assert all(f"`{e.name}`" in page for e in EFFECTS if not e.hypotheses)
