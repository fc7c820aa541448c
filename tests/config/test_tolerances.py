"""Tolerance and transmission files: every number has a unit, and what is wrong is said with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from spsp_ctrl.config.error_sources import COMBINED, ELEMENTARY, ERROR_SOURCES, PAPER
from spsp_ctrl.config.loader import ConfigError, load_tolerances, load_transmission
from spsp_ctrl.config.units import UNITS
from spsp_ctrl.mechanism.error_model import error_sources
from spsp_ctrl.mechanism.tolerance import materials_of, tolerances_of

HEAD = "schema: spsp-ctrl/tolerances/1\n"
ROOT = Path(__file__).parents[2]


def refused(tmp_path: Path, text: str) -> str:
    path = tmp_path / "t.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_tolerances(path)
    return str(caught.value)


@pytest.mark.parametrize(
    ("entry", "place", "says"),
    [
        ("{source: dl1, limit: 0.07}", "3:5", "limit 0.07 of 'dl1' has no unit; add for instance `unit: mm`"),
        ("{source: dl1, limit: 0.07, unit: arcmin}", "3:32", "unit 'arcmin' does not fit here; use one of: m, mm, um"),
        ("{source: dl1, limit: 0.07, unit: furlong}", "3:32", "unit 'furlong' does not fit here"),
        ("{source: u_square, limit: 1, unit: mm}", "3:34", "use one of: rad, mrad, deg, arcmin, arcsec"),
        ("{source: dl3, limit: 0.07, unit: mm}", "3:6", "unknown error source 'dl3'; did you mean 'dl"),
        ("{source: dl1, limit: -0.07, unit: mm}", "3:19", "it must be > 0"),
        ("{source: dl1, limit: .nan, unit: mm}", "3:19", "finite number"),
        ("{source: dl1, limit: small, unit: mm}", "3:19", "a number is needed"),
        ("{source: dl1, limit: 0.07, unit: mm, minimum: 1}", "3:42", "unknown key 'tolerances.0.minimum'"),
        ("{source: dl1, limit: 0.07, unit: mm, min: 2, max: 1}", "3:5", "min (2) of 'dl1' must not exceed max (1)"),
        ("{source: dl1, limit: 0.07, unit: mm, distribution: gauss}", "3:42", "'uniform' or 'normal'"),
    ],
)
def test_wrong_entries(tmp_path: Path, entry: str, place: str, says: str) -> None:
    message = refused(tmp_path, f"{HEAD}tolerances:\n  - {entry}\n")
    assert f"t.yaml:{place}: " in message, message
    assert says in message, message


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("requirement: 3\ntolerances:\n  - {source: dl1, limit: 1, unit: mm}\n", "t.yaml:2:1: 3 has no unit; write it as {value: 3, unit: ...}"),
        ("requirement: {value: 3}\ntolerances:\n  - {source: dl1, limit: 1, unit: mm}\n", "key 'requirement.unit' is missing"),
        ("requirement: {value: 3, unit: mm}\ntolerances:\n  - {source: dl1, limit: 1, unit: mm}\n", "unit 'mm' does not fit here"),
        ("tolerances: []\n", "t.yaml:2:1: no tolerances; add for instance"),
        ("", "key 'tolerances' is missing"),
        ("tolerances:\n  - {source: dl1, limit: 1, unit: mm}\n  - {source: dl1, limit: 1, unit: mm}\n", "'dl1' is listed twice"),
        (
            "tolerances:\n  - {source: dl1, limit: 1, unit: mm, group: g}\n  - {source: u_yaw, limit: 1, unit: mrad, group: g}\n",
            "group 'g' mixes",
        ),
        ("materials: {screw_expansion: 11.5}\ntolerances:\n  - {source: dl1, limit: 1, unit: mm}\n", "11.5 has no unit"),
        ("materials: {screw_expansion: {value: -1, unit: ppm/K}}\ntolerances:\n  - {source: dl1, limit: 1, unit: mm}\n", "must not be negative"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, says: str) -> None:
    assert says in refused(tmp_path, HEAD + text)


def test_a_file_of_another_kind_is_named() -> None:
    with pytest.raises(ConfigError, match="this is a transmission file, not a tolerance file"):
        load_tolerances(ROOT / "config/tolerances/transmission.yaml")
    with pytest.raises(ConfigError, match="this is a tolerance file, not a transmission file"):
        load_transmission(ROOT / "config/tolerances/table4.yaml")


def test_units_and_materials_come_out_in_si(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(
        HEAD
        + "materials: {column_expansion: {value: 23, unit: ppm/K}, screw_length: {value: 300, unit: mm}}\n"
        + "tolerances:\n  - {source: dl1, limit: 70, unit: um, max: 100, distribution: normal, sigmas: 2}\n"
        + "  - {source: u_tilt, limit: 1, unit: arcmin, fixed: true}\n  - {source: screw_temperature, limit: 10, unit: K}\n"
    )
    lengths = (0.2655, 0.1, 0.1)
    file = load_tolerances(path).model
    assert materials_of(file, lengths).column_1_k == pytest.approx(23e-6)
    rod, tilt, warm = tolerances_of(file, lengths)
    assert (rod.limit, rod.most, rod.least) == pytest.approx((7e-5, 1e-4, None))
    assert (rod.distribution, rod.sigmas) == ("normal", 2.0)
    assert tilt.least == tilt.most == tilt.limit == pytest.approx(2.9089e-4, rel=1e-4)
    assert dict(warm.source.parts)["dl1"] == pytest.approx(0.3 * 11.5e-6)


def test_one_list_of_sources() -> None:
    known = error_sources((0.3, 0.1, 0.12))
    assert list(known) == list(ERROR_SOURCES) == [*ELEMENTARY, *COMBINED]
    assert set(PAPER) <= set(known)
    for source in known.values():
        assert source.parts
        assert {part for part, _ in source.parts} <= set(ELEMENTARY)
        assert UNITS[source.si_unit] == (source.si_unit, 1.0)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("screw_lead: {value: 4, unit: mm}", "screw_lead: 4"), "transmission.yaml:5:1: 4 has no unit"),
        (("pressure_angle: {value: 20, unit: deg}", "pressure_angle: {value: 50, unit: deg}"), "must be below 45 deg"),
        (("gear_ratio: 3", "gear_ratio: 0"), "it must be > 0"),
        (("normal_backlash: {value: 50, unit: um}", "normal_backlash: {value: 50, unit: arcmin}"), "unit 'arcmin' does not fit here"),
    ],
)
def test_wrong_transmission_files(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    text = (ROOT / "config/tolerances/transmission.yaml").read_text()
    assert change[0] in text
    path = tmp_path / "transmission.yaml"
    path.write_text(text.replace(*change))
    with pytest.raises(ConfigError) as caught:
        load_transmission(path)
    assert says in str(caught.value)
