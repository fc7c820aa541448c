"""Lost steps seen in the loop: one jump of heading against the count, the vane at another count, and silence for everything that is no loss."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, degrees, pi, radians, sin
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.messages import NO_AZIMUTH, NO_IMU, NO_MEASUREMENT
from spsp_ctrl.safety import steps
from spsp_ctrl.safety.faults import BY_ID, Reaction
from spsp_ctrl.safety.steps import Means, StepState

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
LIMITS = steps.step_limits(RIG)
VANE_DEG = 0.5
Motion = Callable[[float], float]
"""Angle in deg over time in s."""


def play(joint: Motion, yaw: Motion = lambda t: 0.0, lost: Motion = lambda t: 0.0, duration_s: float = 6.0, tilt_deg: float = 0.0) -> StepState:
    """The joint is where the count says, less what was lost; the heading is the carrier's yaw and the joint. 1 kHz, IMU 200 Hz, stepper 100 Hz."""
    state = steps.START
    azimuth, imu = NO_AZIMUTH, NO_IMU
    for cycle in range(round(duration_s * 1000)):
        now_ns, t = cycle * 1_000_000, cycle * 1e-3
        if cycle % 10 == 0:
            rate = (joint(t + 1e-4) - joint(t - 1e-4)) / 2e-4
            count = round(radians(joint(t)) / LIMITS.rad_per_microstep)
            at_home = abs(joint(t) - lost(t)) <= VANE_DEG
            azimuth = azimuth._replace(
                stamp_ns=now_ns, seq=cycle // 10, microsteps=count, rate_microsteps_s=radians(rate) / LIMITS.rad_per_microstep, home_switch=at_home
            )
        if cycle % 5 == 0:
            seen = t - LIMITS.lag_s
            heading = radians(yaw(seen) + joint(seen) - lost(seen))
            imu = imu._replace(stamp_ns=now_ns, seq=cycle // 5, valid=True, yaw_rad=heading, pitch_rad=radians(tilt_deg))
        state = steps.step(state, LIMITS, NO_MEASUREMENT._replace(stamp_ns=now_ns, cycle=cycle, imu=imu, azimuth=azimuth))
    return state


def jump(at_s: float, size_deg: float) -> Motion:
    return lambda t: size_deg if t >= at_s else 0.0


@settings(max_examples=10, deadline=None)
@given(st.floats(1.0, 60.0), st.floats(4.0, 20.0), st.floats(2.0, 12.0), st.floats(3.0, 10.0))
def test_swinging_slewing_and_a_yawing_carrier_are_no_loss(joint_deg: float, joint_s: float, yaw_deg: float, yaw_s: float) -> None:
    joint_deg = min(joint_deg, 24.0 * joint_s / (2.0 * pi))
    yaw_deg = min(yaw_deg, 5.0 * (yaw_s / (2.0 * pi)) ** 2)
    state = play(lambda t: joint_deg * sin(2.0 * pi * t / joint_s + 0.5), lambda t: yaw_deg * cos(2.0 * pi * t / yaw_s))
    assert state.alarms == 0


@settings(max_examples=8, deadline=None)
@given(st.sampled_from([-0.6, -0.3, 0.3, 0.6]), st.floats(1.0, 5.0))
def test_one_slip_of_a_tooth_is_one_alarm_by_the_heading(slip_deg: float, at_s: float) -> None:
    state = play(lambda t: 20.0 + 3.0 * sin(t), lambda t: 8.0 * sin(2.0 * pi * t / 20.0), jump(at_s, slip_deg))
    assert (state.alarms, state.means) == (1, int(Means.HEADING))
    assert degrees(state.size_rad) == pytest.approx(-slip_deg, abs=0.05)


def test_a_loss_that_crept_is_seen_where_the_vane_is_passed() -> None:
    crept = play(lambda t: -6.0 + 3.0 * t, lost=lambda t: min(0.4, 0.2 * t))
    assert (crept.alarms, crept.means) == (1, int(Means.HOME))
    assert degrees(crept.size_rad) == pytest.approx(0.4, abs=0.12)
    assert play(lambda t: -6.0 + 3.0 * t).alarms == 0


def test_turning_back_inside_the_vane_says_nothing_and_neither_does_a_start_on_it() -> None:
    assert play(lambda t: 0.6 - 0.3 * sin(t)).alarms == 0
    assert play(lambda t: 0.3 + 2.0 * t).alarms == 0


def test_a_gap_in_the_frames_and_a_heading_that_turns_over_are_no_jump() -> None:
    assert play(lambda t: 10.0, lambda t: 178.0 + t).alarms == 0
    assert play(lambda t: 10.0, lost=jump(2.0, 0.3), tilt_deg=40.0).alarms == 0


def test_it_warns_and_stops_nothing() -> None:
    assert BY_ID["steps-lost"].reaction == Reaction.HOLD
