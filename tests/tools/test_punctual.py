"""The paired benchmarks run and say what they must; no figure of this machine is judged here."""

from __future__ import annotations

import pytest

from tools.bench import punctual
from tools.bench.punctual import Row, default_cpu, pooled
from tools.bench.reference_cycle import build


def test_rows_say_whether_must_and_aim_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [Row("a", [0.5, 1.0, 3.0], 1.25, 1.1), Row("b", [1.2], 1.25, 1.1), Row("c", [1.3], 1.25, 1.1), Row("d", [2.0], None, None)]
    punctual.print_rows(rows)
    words = [line.split()[-1] for line in capsys.readouterr().out.splitlines()]
    assert words == ["aim", "must", "MISSED", "2.000]"]


def test_counts_are_pooled() -> None:
    assert pooled([1, 0, 2], [4, 0, 2]) == 0.5
    assert pooled([0], [0]) == 1.0
    assert pooled([1], [0]) == float("inf")


def test_two_loops_share_a_core_and_count_alike() -> None:
    cpu = default_cpu()
    own, frozen = punctual.child("logged", 1.0, cpu, 0.0), punctual.child("reference", 1.0, cpu, 0.5)
    a, b = punctual.result(own), punctual.result(frozen)
    for found in (a, b):
        assert 0 < found["cycles"] <= 1001
        assert 0.0 <= found["wake"]["p50"] <= found["wake"]["p99"] <= found["wake"]["max"]
        assert 0.0 < found["cost"]["p50"] <= found["cost"]["max"]
        assert found["misses"] <= found["cycles"]
    assert a["lost"] == 0
    assert a["records"] >= 4 * a["cycles"]


def test_the_frozen_cycle_stays_what_it_is() -> None:
    """Its state after 200 cycles, so that nobody improves it unnoticed."""
    cycle = build()
    for k in range(200):
        cycle(k)
    held = dict(zip(cycle.__code__.co_freevars, cycle.__closure__ or (), strict=True))  # type: ignore[attr-defined]
    assert held["angles"].cell_contents == pytest.approx([0.0016831724037265042, 0.04044413492576402, 0.018562560842082163], rel=1e-9)
    assert held["rates"].cell_contents == pytest.approx([0.030612686545544852, 0.4098877419458632, 0.17986944325809817], rel=1e-9)
