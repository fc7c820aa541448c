"""The blind exam of the whole rig: same seed same case, a mechanism of its own that agrees with the paper, points on hand-made answers."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spsp_ctrl.mechanism.kinematics import jacobian, rod_lengths
from tools.blind_exam import platform_machine as machine
from tools.blind_exam.platform import SETS, draw, figures, made, score
from tools.blind_exam.platform_physics import N_LEG, L, R, legs

NOMINAL = machine.nominal()


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_leg_vectors_give_the_lengths_of_the_paper(pitch: float, roll: float) -> None:
    sizes = [float(NOMINAL[i] + NOMINAL[d]) for i, d in ((R.height, R.dh), (R.upper, R.dru), (R.lower, R.drl))]
    own = legs.py_func(NOMINAL, pitch, roll)
    lengths = rod_lengths(pitch, roll, *sizes)
    assert own[:2] == pytest.approx(lengths, rel=1e-12)
    assert own[2:] == pytest.approx(jacobian(pitch, roll, *lengths, *sizes), rel=1e-9, abs=1e-12)
    level = sqrt(NOMINAL[R.height] ** 2 + (NOMINAL[R.upper] - NOMINAL[R.lower]) ** 2)
    assert level == pytest.approx(0.2655, abs=1e-9)


@pytest.mark.parametrize("group", SETS)
def test_same_seed_same_machine(group: str) -> None:
    for index in range(3):
        one, other = draw(group, 5, index), draw(group, 5, index)
        assert one == other
        assert np.array_equal(made(*one)[0], made(*other)[0])
    assert draw(group, 5, 0)[0] != draw(group, 6, 0)[0]


def test_a_round_of_single_effects_meets_each_of_them_once_and_each_changes_the_machine() -> None:
    kinds = machine.LIBRARY
    drawn = [draw("single", 1, i) for i in range(len(kinds))]
    assert {items[0].name for _, items in drawn} == set(kinds)
    for build, items in drawn:
        with_it, late, said = made(build, items)
        assert said[0]
        assert late > 0.0 or not np.array_equal(with_it, made(build, ())[0])


def test_an_effect_of_one_leg_leaves_the_other_alone() -> None:
    p, q = NOMINAL.copy(), NOMINAL.copy()
    machine.LIBRARY["backlash"].apply(q, 1, 1.0, np.random.default_rng(1))
    changed = np.flatnonzero(p != q)
    assert list(changed) == [N_LEG + L.gap]


def _said(name: str, where: str, verdict: str = "explained", **values: float) -> dict[str, object]:
    effect: dict[str, object] = {"name": name, "where": where, "class": [{"name": name, "weight": 1.0}]}
    effect["parameters"] = {k: {"value": v, "unit": "m", "sigma": None} for k, v in values.items()}
    return {"verdict": verdict, "effects": [effect], "unexplained": [], "gap": {}}


def test_a_name_is_right_only_at_its_place() -> None:
    hidden = [{"effect": "backlash", "where": "roll", "severity": 1.0, "values": {"gap": 4e-5}, "floors": 9.0, "detectable": True}]
    right = score(hidden, _said("backlash", "roll", gap=4.4e-5))
    assert (right["first_right"], right["where_right"], right["exact"], right["recall"]) == (True, True, True, [1, 1])
    assert right["errors"] == [pytest.approx(0.1)]
    wrong = score(hidden, _said("backlash", "pitch", gap=4e-5))
    assert (wrong["first_right"], wrong["where_right"], wrong["exact"], wrong["recall"]) == (True, False, False, [0, 1])
    other = score(hidden, _said("torque_offset", "roll"))
    assert (other["first_right"], other["misnamed"]) == (False, True)
    assert not score(hidden, _said("torque_offset", "roll", "partly-explained"))["misnamed"]
    rows = [{"group": "single", "seconds": 9.0, **r} for r in (right, wrong, other)]
    assert figures(rows)["single: first name right, of detectable"].startswith("2/3")
