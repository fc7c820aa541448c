"""The watch: what it takes for chatter, what it does not, and when it lets a plainer law in."""

from __future__ import annotations

from math import pi, sin, sqrt
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import apply_overrides, load_rig
from spsp_ctrl.control import watch
from spsp_ctrl.control.params import law_ladder, watch_params
from spsp_ctrl.control.watch import Reason

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml")
P = watch_params(RIG.model)


def judged(amplitude_a: float, hz: float, innovation_rad: float = 0.0, seconds: float = 3.0) -> int:
    state = watch.START
    for k in range(round(seconds * 1000)):
        current = amplitude_a * sin(2 * pi * hz * k / 1000)
        reason, state = watch.step(state, P, current, 0.0, innovation_rad**2, k % 5 == 0, 1e-3)
        if reason:
            return reason
    return 0


@pytest.mark.parametrize("hz", [70.0, 105.0, 160.0])
def test_fast_oscillation_is_chatter_at_its_level(hz: float) -> None:
    assert judged(1.6 * sqrt(2) * 0.2, hz) == Reason.CHATTER
    assert judged(0.8 * sqrt(2) * 0.2, hz) == Reason.NONE


def test_slow_currents_of_any_size_are_no_chatter() -> None:
    assert judged(2.0, 0.5) == Reason.NONE
    assert judged(0.5, 5.0) == Reason.NONE


def test_contradiction_by_the_imu_is_divergence() -> None:
    arcmin = pi / 10800
    assert judged(0.0, 1.0, 40 * arcmin) == Reason.DIVERGENCE
    assert judged(0.0, 1.0, 2 * arcmin) == Reason.NONE


def test_nothing_is_judged_before_one_window_has_passed() -> None:
    state = watch.START
    for k in range(round(P.window_s * 1000) - 1):
        reason, state = watch.step(state, P, 5.0 * (-1) ** k, 0.0, 1.0, True, 1e-3)
        assert reason == Reason.NONE


def test_ladder_ends_in_the_plain_cascade() -> None:
    ladder = law_ladder(apply_overrides(RIG, ["control.stabiliser.performance.enabled=true"]).model)
    assert [p.observe for p in ladder] == [True, True, False]
    assert ladder[0].speed_kp > ladder[1].speed_kp
    assert not ladder[2].feedforward
    assert len(law_ladder(RIG.model)) == 2
    assert len(law_ladder(apply_overrides(RIG, ["control.law=cascade"]).model)) == 1


def test_a_disabled_watch_never_speaks() -> None:
    p = watch_params(apply_overrides(RIG, ["control.watch.enabled=false"]).model)
    state = watch.START
    for k in range(3000):
        reason, state = watch.step(state, p, 5.0 * (-1) ** k, 0.0, 1.0, True, 1e-3)
        assert reason == Reason.NONE
