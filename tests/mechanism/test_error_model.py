"""Error model: linear against exact, against Eq (11), against closed forms, and the sensitivities of single hinge co-ordinates."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.config.error_sources import ELEMENTARY, ERROR_SOURCES, PAPER
from spsp_ctrl.mechanism.eq11 import equation_11, printed_roll_pole
from spsp_ctrl.mechanism.error_model import (
    Materials,
    elementary,
    error_sources,
    exact_error,
    level_length,
    sensitivity,
    zeroed_sensitivity,
    zeroing,
)
from spsp_ctrl.mechanism.kinematics import attitude_from_rods, jacobian, rod_lengths

PAPER_LENGTHS = (0.2655, 0.1, 0.1)
OTHER_LENGTHS = (0.62, 0.24, 0.3)
ARCMIN = 60.0 * 180.0 / np.pi
SQUARE = np.meshgrid(*[np.radians(np.linspace(-20.0, 20.0, 9))] * 2, indexing="ij")
STEP = {"m": 1e-5, "rad": 1e-4, "K": 1.0}
angle = st.floats(-radians(20.0), radians(20.0))


@pytest.mark.parametrize("lengths", [PAPER_LENGTHS, (0.4, 0.15, 0.15)])
def test_linear_model_is_equation_11(lengths: tuple[float, float, float]) -> None:
    known = error_sources(lengths)
    ours = sensitivity(*SQUARE, lengths, [known[name] for name in PAPER])
    for unit in (1.0, 1e-3):  # corrected, it is homogeneous
        np.testing.assert_allclose(ours, equation_11(*SQUARE, lengths[0], lengths[1], "corrected", unit), rtol=0.0, atol=1e-12 * np.abs(ours).max())


def test_rod_sensitivity_is_the_inverse_jacobian() -> None:
    known = error_sources(OTHER_LENGTHS)
    pitch, roll = 0.2, -0.3
    j11, j21, j22 = jacobian(pitch, roll, *rod_lengths(pitch, roll, *OTHER_LENGTHS), *OTHER_LENGTHS)
    inverse = np.linalg.inv([[j11, 0.0], [j21, j22]])
    # the platform goes to where the longer rod would have been commanded: back
    np.testing.assert_allclose(sensitivity(pitch, roll, OTHER_LENGTHS, [known["dl1"], known["dl2"]]), inverse, rtol=1e-12, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(pitch=angle, roll=angle, height=st.floats(0.2, 0.4), upper=st.floats(0.08, 0.15), lower=st.floats(0.08, 0.15), data=st.data())
def test_linear_against_exact(pitch: float, roll: float, height: float, upper: float, lower: float, data: st.DataObject) -> None:
    lengths = (height, upper, lower)
    known = error_sources(lengths)
    values = {name: data.draw(st.floats(-1.0, 1.0), label=name) * (3e-5 if kind.si_unit == "m" else 1e-4) for name, kind in ELEMENTARY.items()}
    matrix = sensitivity(pitch, roll, lengths, [known[name] for name in values])
    linear = matrix @ np.array(list(values.values()))
    # second order: sum of all displacements over the smallest length, squared
    bound = 40.0 * (sum(abs(v) if ELEMENTARY[n].si_unit == "m" else 0.3 * abs(v) for n, v in values.items()) / min(lengths)) ** 2
    assert np.abs(exact_error(pitch, roll, lengths, values) - linear).max() <= bound + 1e-12


@pytest.mark.parametrize("name", ERROR_SOURCES)
def test_difference_of_exact_converges_to_linear(name: str) -> None:
    source = error_sources(OTHER_LENGTHS)[name]
    step = STEP[source.si_unit]
    both = [exact_error(*SQUARE, OTHER_LENGTHS, elementary([(source, sign * step)])) for sign in (1.0, -1.0)]
    linear = sensitivity(*SQUARE, OTHER_LENGTHS, [source])[:, 0] * step
    np.testing.assert_allclose((both[0] - both[1]) / 2.0, linear, atol=1e-10)


def test_exact_model_is_the_closed_form() -> None:
    h, r, _ = PAPER_LENGTHS
    dl1, dl2, dr, dh = 7e-5, -7e-5, 1e-5, 5e-5
    known = error_sources(PAPER_LENGTHS)
    pitch, roll = 0.3, -0.2
    l1, l2 = rod_lengths(pitch, roll, h, r, r)
    closed = attitude_from_rods(l1 + dl1, l2 + dl2, h + dh, r + dr, r + dr)
    found = exact_error(pitch, roll, PAPER_LENGTHS, elementary([(known[n], v) for n, v in zip(PAPER, (dl1, dl2, dr, dh), strict=True)]))
    np.testing.assert_allclose(found, np.array(closed) - (pitch, roll), atol=1e-13)


# section 3.2 of the reproduction: arcmin per 10 um (0.1 mrad): at level pitch, roll; at most pitch, roll over the square
HINGES = {
    "dr": (0.0, 0.0, 0.126, 0.145),
    "upper_radius": (0.0, 0.0, 0.135, 0.157),
    "lower_radius": (0.0, 0.0, 0.010, 0.012),
    "a1_y": (0.0, 0.0, 0.118, 0.018),
    "a2_x": (0.0, 0.0, 0.0, 0.156),
    "b1_y": (0.0, 0.0, 0.0, 0.0),
    "b2_x": (0.0, 0.0, 0.0, 0.020),
    "a1_z": (0.344, 0.0, 0.344, 0.050),
    "a2_z": (0.0, 0.344, 0.0, 0.344),
    "b1_z": (-0.344, 0.0, 0.369, 0.057),
    "b2_z": (0.0, -0.344, 0.0, 0.401),
    "u_z": (0.344, 0.344, 0.369, 0.458),
    "u_x": (0.0, 0.0, 0.010, 0.022),
    "u_y": (0.0, 0.0, 0.0, 0.010),
    "u_offset": (0.344, 0.344, 0.344, 0.423),
}


@pytest.mark.parametrize("name", HINGES)
def test_single_hinge_coordinates(name: str) -> None:
    source = error_sources(PAPER_LENGTHS)[name]
    both = [exact_error(*SQUARE, PAPER_LENGTHS, elementary([(source, sign * 1e-5)])) for sign in (1.0, -1.0)]
    found = (both[0] - both[1]) / 2.0 * ARCMIN
    level = found[:, 4, 4]
    assert (*level, *np.abs(found).max(axis=(1, 2))) == pytest.approx(HINGES[name], abs=5.1e-4)


def test_upper_and_lower_radius_against_each_other() -> None:
    known = error_sources(PAPER_LENGTHS)
    matrix = sensitivity(*SQUARE, PAPER_LENGTHS, [known["upper_radius"], known["lower_radius"]]) * 1e-5 * ARCMIN
    assert np.abs(matrix[:, 0] - matrix[:, 1]).max(axis=(1, 2)) == pytest.approx((0.145, 0.169), abs=5e-4)


def test_out_of_square_axes() -> None:
    source = error_sources(PAPER_LENGTHS)["u_square"]
    found = exact_error(*SQUARE, PAPER_LENGTHS, elementary([(source, 1e-4)])) * ARCMIN
    assert np.abs(found[0]).max() < 1e-3
    assert np.abs(found[1]).max() == pytest.approx(0.0013, abs=5e-5)
    assert np.abs(found[:, 4, 4]).max() < 1e-12


def test_thermal_sources() -> None:
    h, r, _ = PAPER_LENGTHS
    steel = error_sources(PAPER_LENGTHS)
    # Eq (13): 265.5 mm, 11.5 ppm/K, 10 K are 30.5 um, 1.05 arcmin at level
    level = sensitivity(0.0, 0.0, PAPER_LENGTHS, [steel["screw_temperature"]])[:, 0] * 10.0 * ARCMIN
    np.testing.assert_allclose(level, -1.05, atol=0.005)
    # everything of one material only changes its scale
    assert np.abs(sensitivity(0.0, 0.0, PAPER_LENGTHS, [steel["temperature"]])).max() * ARCMIN < 1e-12
    # an aluminium column turns the sign round: 61 um against 30.5 um
    mixed = error_sources(PAPER_LENGTHS, Materials(h, column_1_k=23e-6))
    whole = sensitivity(0.0, 0.0, PAPER_LENGTHS, [mixed["temperature"]])[:, 0]
    np.testing.assert_allclose(whole, 11.5e-6 * h / r, rtol=1e-9)


def test_uniform_growth_of_one_material_changes_nothing_but_the_commanded_rods() -> None:
    """All lengths times 1 + x and the rods' commanded travel unscaled: at level exactly nothing."""
    steel = error_sources(PAPER_LENGTHS)
    found = exact_error(0.0, 0.0, PAPER_LENGTHS, elementary([(steel["temperature"], 50.0)]))
    assert np.abs(found).max() < 1e-13


@pytest.mark.parametrize("name", [n for n in ERROR_SOURCES if n not in ("dl1", "dl2")])
def test_zeroing_at_level(name: str) -> None:
    known = error_sources(OTHER_LENGTHS)
    source = known[name]
    errors = elementary([(source, STEP[source.si_unit])])
    for rod, correction in zip(("dl1", "dl2"), zeroing(errors, OTHER_LENGTHS), strict=True):
        errors[rod] = errors.get(rod, 0.0) + correction
    assert np.abs(exact_error(0.0, 0.0, OTHER_LENGTHS, errors)).max() < 1e-13
    rods = [known["dl1"], known["dl2"]]
    linear = zeroed_sensitivity(
        sensitivity(*SQUARE, OTHER_LENGTHS, [source]),
        sensitivity(0.0, 0.0, OTHER_LENGTHS, [source]),
        sensitivity(*SQUARE, OTHER_LENGTHS, rods),
        sensitivity(0.0, 0.0, OTHER_LENGTHS, rods),
    )
    found = exact_error(*SQUARE, OTHER_LENGTHS, errors)
    np.testing.assert_allclose(found, linear[:, 0] * STEP[source.si_unit], atol=2e-8)


def test_impossible_errors_are_refused() -> None:
    with pytest.raises(ValueError, match="errors too large"):
        exact_error(0.3, 0.3, PAPER_LENGTHS, {"dl1": 0.3})


def test_printed_forms() -> None:
    """The misprint acts on roll alone; its pole lies where the denominator vanishes."""
    true, mm = (equation_11(*SQUARE, 0.2655, 0.1, form, 1e-3) for form in ("corrected", "printed"))  # type: ignore[arg-type]
    np.testing.assert_array_equal(true[0], mm[0])
    assert np.degrees(printed_roll_pole(0.0, 0.2655, 0.1, 1e-3)) == pytest.approx(1.52, abs=0.005)
    level = [equation_11(0.0, 0.0, 0.2655, 0.1, "printed", unit)[1, 1] * 2e-5 * ARCMIN for unit in (1e-3, 1.0)]
    assert level == pytest.approx([-68.75, -0.0688], rel=1e-3)


def test_rod_length_at_level() -> None:
    assert level_length(PAPER_LENGTHS) == 0.2655
    assert level_length(OTHER_LENGTHS) == pytest.approx(np.hypot(0.62, 0.06))
