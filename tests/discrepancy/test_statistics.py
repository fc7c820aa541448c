"""Laws of the numbers that a judgement rests on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.discrepancy.statistics import blocks, correlation_length, effective_size, holm
from spsp_ctrl.discrepancy.variables import pair, place, values_of


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_holm_never_sharpens_and_keeps_the_order(p: list[float]) -> None:
    adjusted = holm(p)
    assert all(a >= b for a, b in zip(adjusted, p, strict=True))
    order = np.argsort(p, kind="stable")
    assert all(adjusted[i] <= adjusted[j] + 1e-15 for i, j in pairwise(order))
    assert all(a <= min(1.0, len(p) * b) + 1e-12 or a <= max(adjusted) for a, b in zip(adjusted, p, strict=True))


@given(st.integers(10, 5000), st.integers(1, 400))
def test_blocks_cover_a_record_once(n: int, length: int) -> None:
    parts = blocks(n, length)
    assert parts[0][0] == 0
    assert parts[-1][1] == n
    assert all(a[1] == b[0] for a, b in pairwise(parts))


def test_correlated_samples_count_for_fewer() -> None:
    rng = np.random.default_rng(1)
    white = rng.standard_normal(20000)
    slow = np.convolve(white, np.ones(50) / 50, "valid")
    assert correlation_length(white) < 1.5
    assert 30 < correlation_length(slow) < 80
    assert effective_size(slow) < 0.05 * effective_size(white)


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_amplitude_and_phase_survive_the_pair(c: float, s: float) -> None:
    p = np.zeros(4)
    variables = pair("x", 1, 2, 5.0, 0.1, p)
    q = place(p, variables, np.array([c, s]))
    assert q[1] >= 0.0
    assert np.allclose(values_of(q, variables), [c, s], atol=1e-12)
