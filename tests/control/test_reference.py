"""The reference plan: limits held, nothing jumps, targets are reached, rates are the derivatives."""

from __future__ import annotations

from itertools import pairwise
from math import degrees, inf, nan, pi, radians
from typing import Literal

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from spsp_ctrl.config.scenario import BaseMotion, Heading, ReferencePlan, Sine
from spsp_ctrl.control.reference import HEADING_SMOOTHING_S, ReferenceSource
from spsp_ctrl.mechanism.frames import wrap_angle
from spsp_ctrl.mechanism.profile import TargetProfile, smooth_ramp
from spsp_ctrl.messages import ReferenceKind
from spsp_ctrl.plant.swing_table import SwingTable

RATE, ACCEL = 0.5, 1.0
JERK = 2.0 * ACCEL / HEADING_SMOOTHING_S
heading_deg = st.floats(-180.0, 180.0)


def source(
    *headings: tuple[float, float],
    kind: Literal["inertial", "joint"] = "inertial",
    rate: float = RATE,
    accel: float = ACCEL,
) -> ReferenceSource:
    plan = ReferencePlan(kind=kind, heading=tuple(Heading(at_s=t, heading_deg=h) for t, h in headings))
    return ReferenceSource(plan, rate, accel)


def turned(a: float, b: float) -> float:
    """The way from ``a`` to ``b``, the short way round."""
    return wrap_angle(b - a)


# --- pitch and roll -------------------------------------------------------------------------------------------------


def test_offsets_and_kind() -> None:
    for name, kind in (("inertial", ReferenceKind.INERTIAL), ("joint", ReferenceKind.JOINT)):
        plan = ReferencePlan.model_validate({"kind": name, "pitch_deg": 3.0, "roll_deg": -4.0})
        reference = ReferenceSource(plan, RATE, ACCEL).at(12.3)
        assert reference == (kind, radians(3.0), radians(-4.0), 0.0, 0.0, 0.0, 0.0)


def test_sines_are_those_of_the_swing_table() -> None:
    """One envelope for both: a platform that copies the table's plan sees the table's angles and rates."""
    pitch = (Sine(amplitude_deg=6.0, period_s=4.0, phase_deg=40.0), Sine(amplitude_deg=1.0, period_s=1.5))
    roll = (Sine(amplitude_deg=15.0, period_s=8.0, phase_deg=-100.0),)
    plan = ReferencePlan(pitch=pitch, roll=roll, start_s=0.7, ramp_s=1.9)
    asked = ReferenceSource(plan, RATE, ACCEL)
    for key, column, sign in (("pitch", 1, 1.0), ("roll", 0, -1.0)):
        motion = BaseMotion.model_validate(
            {"start_s": 0.7, "ramp_s": 1.9, key: [s.model_dump() for s in (pitch if key == "pitch" else roll)]}
        )
        table = SwingTable(motion, 100, seed=0)
        rows, angles = table.block(0, 500), table.angles(0, 500)
        found = [asked.at(k / 100) for k in range(500)]
        expected = angles[:, 0 if key == "pitch" else 1]
        np.testing.assert_allclose([getattr(r, f"{key}_rad") for r in found], expected, atol=1e-15)
        np.testing.assert_allclose(
            [sign * getattr(r, f"{key}_rate_rad_s") for r in found], rows[:, 9 + column], atol=1e-14
        )


@settings(max_examples=100, deadline=None)
@given(
    st.floats(0.0, 12.0),
    st.floats(-20.0, 20.0),
    st.lists(st.tuples(st.floats(-8.0, 8.0), st.floats(0.5, 20.0), st.floats(-180.0, 180.0)), max_size=3),
)
def test_pitch_and_roll_rates_are_the_derivatives(
    t: float, offset_deg: float, waves: list[tuple[float, float, float]]
) -> None:
    sines = tuple(Sine(amplitude_deg=a, period_s=p, phase_deg=f) for a, p, f in waves)
    plan = ReferencePlan(pitch_deg=offset_deg, roll_deg=-offset_deg, pitch=sines, roll=sines[:1], ramp_s=3.0)
    asked = ReferenceSource(plan, RATE, ACCEL)
    h = 1e-4
    before, now, after = asked.at(t - h), asked.at(t), asked.at(t + h)
    assert (after.pitch_rad - before.pitch_rad) / (2.0 * h) == pytest.approx(now.pitch_rate_rad_s, abs=1e-5)
    assert (after.roll_rad - before.roll_rad) / (2.0 * h) == pytest.approx(now.roll_rate_rad_s, abs=1e-5)


def test_offset_alone_until_the_start() -> None:
    plan = ReferencePlan(pitch_deg=2.0, pitch=(Sine(amplitude_deg=5.0, period_s=4.0, phase_deg=90.0),), start_s=1.5)
    asked = ReferenceSource(plan, RATE, ACCEL)
    for t in (0.0, 1.0, 1.5):
        assert (asked.at(t).pitch_rad, asked.at(t).pitch_rate_rad_s) == (radians(2.0), 0.0)
    assert asked.at(4.5).pitch_rad != radians(2.0)


# --- the envelope ---------------------------------------------------------------------------------------------------


def test_envelope_is_exact_at_its_ends_and_the_same_for_arrays() -> None:
    assert smooth_ramp(0.0, 2.0) == (0.0, 0.0, 0.0, 0.0)
    assert smooth_ramp(1.0, 2.0) == (1.0, 0.0, 0.0, 1.0)
    fractions = np.linspace(0.0, 1.0, 1001)
    by_array = np.stack(smooth_ramp(fractions, 2.0), axis=1)
    by_float = np.array([smooth_ramp(float(f), 2.0) for f in fractions])
    np.testing.assert_array_equal(by_array, by_float)
    assert np.all(np.diff(by_array[:, 0]) >= 0.0)


def test_envelope_derivatives() -> None:
    ramp_s, h = 1.7, 1e-4
    t = np.linspace(0.05, 1.6, 200)
    value, rate, accel, integral = (
        np.array(x) for x in zip(*(smooth_ramp(x / ramp_s, ramp_s) for x in t), strict=True)
    )
    ahead = np.array([smooth_ramp((x + h) / ramp_s, ramp_s) for x in t])
    behind = np.array([smooth_ramp((x - h) / ramp_s, ramp_s) for x in t])
    slope = (ahead - behind) / (2.0 * h)
    np.testing.assert_allclose(slope[:, 3], value, atol=1e-7)
    np.testing.assert_allclose(slope[:, 0], rate, atol=1e-7)
    np.testing.assert_allclose(slope[:, 1], accel, atol=1e-6)
    assert integral[0] > 0.0


# --- heading: shape -------------------------------------------------------------------------------------------------


def check_motion(asked: ReferenceSource, begin: float, end: float, rate: float, accel: float) -> None:
    """Limits, continuity and derivatives on a fine grid."""
    step = 2e-3
    n = int((end - begin) / step)
    samples = [asked.at(begin + i * step) for i in range(n)]
    headings = np.unwrap([r.heading_rad for r in samples])
    rates = np.array([r.heading_rate_rad_s for r in samples])
    assert all(-pi < r.heading_rad <= pi for r in samples)
    assert np.abs(rates).max() <= rate * (1.0 + 1e-9)
    # secants of what is limited are limited too
    assert np.abs(np.diff(headings)).max() <= rate * step * (1.0 + 1e-6)
    accels = np.diff(rates) / step
    assert np.abs(accels).max() <= accel * (1.0 + 1e-6)
    jerk = 2.0 * accel / HEADING_SMOOTHING_S
    assert np.abs(np.diff(accels)).max() <= jerk * step * (1.0 + 1e-6) + 1e-9
    # the rate is the derivative: the mean over a step differs from the central difference by the jerk at most
    middle = (headings[2:] - headings[:-2]) / (2.0 * step)
    assert np.abs(middle - rates[1:-1]).max() <= jerk * step * step / 6.0 * 1.01 + 1e-9


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.0, 6.0), heading_deg), min_size=1, max_size=5),
    st.sampled_from(["inertial", "joint"]),
    st.floats(0.1, 1.5),
    st.floats(0.2, 4.0),
)
def test_a_plan_holds_the_limits_and_ends_on_its_last_target(
    headings: list[tuple[float, float]], kind: Literal["inertial", "joint"], rate: float, accel: float
) -> None:
    assume(len({t for t, _ in headings}) == len(headings))
    asked = source(*headings, kind=kind, rate=rate, accel=accel)
    last = max(headings)
    end = 6.0 + 2.0 * pi / rate + 2.0 * rate / accel + rate / accel + HEADING_SMOOTHING_S
    check_motion(asked, 0.0, min(end, 12.0), rate, accel)
    final = asked.at(end)
    assert abs(turned(final.heading_rad, radians(last[1]))) < 1e-12
    assert final.heading_rate_rad_s == 0.0


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(-400.0, 400.0)), min_size=1, max_size=8), st.booleans())
@example([(0.0, 180.0), (0.01, -180.0), (0.01, 0.0), (1.0, 90.0)], False)
@example([(0.5, 1e-7), (0.0, 0.0), (0.0, 90.0)], True)
def test_operator_requests_at_any_time_hold_the_limits_and_do_not_jump(
    requests: list[tuple[float, float]], joint: bool
) -> None:
    asked = source((0.0, 10.0), (0.8, -60.0), kind="joint" if joint else "inertial")
    t = 0.5
    seen = [asked.at(t)]
    for wait, degrees_ in requests:
        step = 2e-3
        for _ in range(int(wait / step)):
            t += step
            seen.append(asked.at(t))
        before = asked.at(t)
        asked = asked.with_heading(t, radians(degrees_))
        after = asked.at(t)
        assert abs(turned(before.heading_rad, after.heading_rad)) < 1e-12
        assert abs(before.heading_rate_rad_s - after.heading_rate_rad_s) < 1e-12
    check_motion(asked, t, t + 3.0, RATE, ACCEL)
    rates = [r.heading_rate_rad_s for r in seen]
    assert max(map(abs, rates)) <= RATE * (1.0 + 1e-9)
    assert all(abs(b - a) <= ACCEL * 2e-3 * (1.0 + 1e-6) for a, b in pairwise(rates))
    final = asked.at(t + 2.0 * pi / RATE + 3.0 * RATE / ACCEL + HEADING_SMOOTHING_S)
    assert abs(turned(final.heading_rad, radians(requests[-1][1]))) < 1e-12
    assert final.heading_rate_rad_s == 0.0


def test_a_move_is_as_fast_as_its_limits_allow() -> None:
    """1 rad at 0.5 rad/s and 1 rad/s2: 1 / 0.5 + 0.5 / 1 s, and the smoothing."""
    asked = source((0.0, 0.0), (1.0, degrees(1.0)))
    arrival = 1.0 + 2.0 + 0.5 + HEADING_SMOOTHING_S
    assert asked.at(1.0).heading_rad == 0.0
    assert asked.at(1.001).heading_rate_rad_s > 0.0
    assert asked.at(arrival - 0.01).heading_rate_rad_s > 0.0
    assert asked.at(arrival + 1e-9).heading_rate_rad_s == 0.0
    assert asked.at(arrival + 1e-9).heading_rad == pytest.approx(1.0, abs=1e-15)
    assert asked.at(2.3).heading_rate_rad_s == pytest.approx(RATE, abs=1e-12)
    # point symmetry of the move about its middle
    assert asked.at(0.5 * (1.0 + arrival)).heading_rad == pytest.approx(0.5, abs=1e-12)


def test_a_short_move_never_cruises() -> None:
    asked = source((0.0, 0.0), (1.0, degrees(0.04)))
    peak = max(asked.at(1.0 + 1e-3 * i).heading_rate_rad_s for i in range(800))
    assert 0.1 < peak < 0.2
    assert asked.at(1.0 + 2.0 * 0.2 + HEADING_SMOOTHING_S + 1e-9).heading_rad == pytest.approx(0.04, abs=1e-15)


# --- heading: what a plan means -------------------------------------------------------------------------------------


def test_the_demand_stands_on_a_target_planned_for_the_start() -> None:
    asked = source((0.0, 35.0))
    for t in (-1.0, 0.0, 0.01, 100.0):
        assert asked.at(t).heading_rad == pytest.approx(radians(35.0), abs=1e-15)
        assert asked.at(t).heading_rate_rad_s == 0.0


def test_a_first_target_later_is_approached_from_zero() -> None:
    asked = source((5.0, 35.0))
    assert asked.at(5.0).heading_rad == 0.0
    assert asked.at(20.0).heading_rad == pytest.approx(radians(35.0), abs=1e-15)
    no_targets = ReferenceSource(ReferencePlan(heading=()), RATE, ACCEL)
    assert no_targets.at(3.0).heading_rad == 0.0


def test_the_order_in_the_file_does_not_matter() -> None:
    one, other = source((0.0, 0.0), (2.0, 40.0), (9.0, -20.0)), source((9.0, -20.0), (0.0, 0.0), (2.0, 40.0))
    assert all(one.at(0.1 * i) == other.at(0.1 * i) for i in range(200))


def test_an_inertial_heading_goes_the_short_way_and_a_joint_azimuth_through_zero() -> None:
    inertial, joint = (source((0.0, 170.0), (1.0, -170.0), kind=kind) for kind in ("inertial", "joint"))
    times = [0.01 * i for i in range(1200)]
    assert min(abs(inertial.at(t).heading_rad) for t in times) > radians(169.9)
    assert min(abs(joint.at(t).heading_rad) for t in times) < radians(1.0)
    for asked in (inertial, joint):
        assert turned(asked.at(60.0).heading_rad, radians(-170.0)) == pytest.approx(0.0, abs=1e-12)


def test_a_request_overrides_the_rest_of_the_plan_and_leaves_the_old_source_alone() -> None:
    plan = source((0.0, 0.0), (5.0, 90.0))
    asked = plan.with_heading(2.0, radians(-30.0))
    assert asked.at(30.0).heading_rad == pytest.approx(radians(-30.0), abs=1e-12)
    assert plan.at(30.0).heading_rad == pytest.approx(radians(90.0), abs=1e-12)
    assert asked.at(3.0)[:3] == plan.at(3.0)[:3]


def test_a_request_while_turning_brakes_and_comes_back() -> None:
    asked = source((0.0, 0.0), (1.0, 90.0)).with_heading(2.5, 0.0)
    assert asked.at(2.5).heading_rate_rad_s > 0.4
    furthest = max(asked.at(2.5 + 0.01 * i).heading_rad for i in range(300))
    assert asked.at(2.5).heading_rad < furthest < asked.at(2.5).heading_rad + 0.3
    assert asked.at(20.0).heading_rad == pytest.approx(0.0, abs=1e-12)


def test_a_stream_of_requests_does_not_grow() -> None:
    profile = TargetProfile.at_rest(0.0, RATE, ACCEL, HEADING_SMOOTHING_S)
    for i in range(2000):
        profile = profile.retargeted(0.01 * i, 0.005 * i)
    in_window = HEADING_SMOOTHING_S / 0.01
    assert len(profile.pieces) <= 4 * (in_window + 2)
    assert profile.at(19.99)[1] == pytest.approx(0.5, rel=0.05), "a stream at the rate limit is followed at it"


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_a_request_that_is_no_angle_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite angle"):
        source((0.0, 0.0)).with_heading(1.0, bad)


@pytest.mark.parametrize(
    ("rate", "accel", "named"), [(0.0, 1.0, "rate limit"), (1.0, -1.0, "acceleration limit"), (inf, 1.0, "rate limit")]
)
def test_limits_must_be_positive(rate: float, accel: float, named: str) -> None:
    with pytest.raises(ValueError, match=f"^{named}"):
        source((0.0, 0.0), rate=rate, accel=accel)
    with pytest.raises(ValueError, match="smoothing time"):
        ReferenceSource(ReferencePlan(), 1.0, 1.0, heading_smoothing_s=nan)
