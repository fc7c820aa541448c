"""Colour of noise, what hides behind it, and what held-out motion confirms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.discrepancy.confirming import confirm
from spsp_ctrl.discrepancy.features import basis, since_reversal
from spsp_ctrl.discrepancy.statistics import correlation_length, rms
from spsp_ctrl.discrepancy.whitening import colour, colours, judged, log_likelihood


def ar1(n: int, pole: float, seed: int) -> np.ndarray:
    noise, out = np.random.default_rng(seed).standard_normal(n), np.zeros(n)
    for k in range(1, n):
        out[k] = pole * out[k - 1] + noise[k]
    return out


@given(pole=st.floats(0.0, 0.95), seed=st.integers(0, 50))
def test_the_filter_makes_white_of_unit_variance(pole: float, seed: int) -> None:
    noise = 3e-4 * ar1(4000, pole, seed)
    white = colour(noise)
    out = white.apply(noise)[10:]
    assert rms(out) == pytest.approx(1.0, abs=0.08)
    assert correlation_length(out) < 1.6
    assert white.innovation == pytest.approx(3e-4, rel=0.08)


def test_an_outlier_does_not_set_the_colour() -> None:
    noise = ar1(4000, 0.5, 1)
    hit = noise.copy()
    hit[100::500] += 1e3
    assert colour(hit).innovation < 2.0 * colour(noise).innovation


def test_a_slow_effect_hides_behind_its_own_colour_and_not_behind_that_of_the_noise() -> None:
    """A wave of 35 times the noise foretells itself; without what the motion can do, only the noise is left to whiten by."""
    t = np.linspace(0.0, 1.0, 6000)
    wave = np.sin(2 * np.pi * t)
    noise = np.random.default_rng(2).standard_normal(6000)
    before, half, none = {"a": noise + 35 * wave}, {"a": noise + 17 * wave}, {"a": noise}
    own = [log_likelihood(r, {})["a"] for r in (before, half, none)]
    assert own[1] - own[0] < 20, "half of it gone gains nothing"
    motion = {"a": basis(np.stack([np.ones_like(t), wave, np.cos(2 * np.pi * t)], axis=1))}
    white = colours(before, {}, motion)
    known = [judged(r, white)["a"] for r in (before, half, none)]
    assert known[1] - known[0] > 1000
    assert known[2] - known[1] > 1000


@given(factor=st.floats(-1.0, 2.0), seed=st.integers(0, 20))
def test_held_out_motion_gives_the_share_of_the_effect_that_is_there(factor: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    effect = ar1(6000, 0.9, seed + 100)
    before = {"a": rng.standard_normal(6000) + factor * effect}
    told = confirm(before, {"a": before["a"] - effect}, {})
    assert told.factor == pytest.approx(factor, abs=max(6 * told.sigma, 0.06))
    assert told.expected > 20


def test_motion_that_does_not_show_the_effect_cannot_tell() -> None:
    before = {"a": np.random.default_rng(1).standard_normal(2000)}
    assert confirm(before, before, {}).expected == 0.0
    weak = confirm(before, {"a": before["a"] - 1e-3 * ar1(2000, 0.5, 3)}, {})
    assert weak.expected < 1.0


def test_a_bristle_is_full_at_the_reversal_and_gone_after_its_reach() -> None:
    travel = np.concatenate([np.linspace(0, 1, 500), np.linspace(1, 0, 500)])
    side = np.concatenate([np.ones(500), -np.ones(500)])
    trace = since_reversal(travel, side, 0.01)
    assert abs(trace[490]) < 0.01
    assert abs(trace[500]) > 1.5
    assert abs(trace[600]) < 0.01
