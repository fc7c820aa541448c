"""``spsp-ctrl mechanism errors|tolerance|budget|paper``: what the commands print, write and refuse."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result

from spsp_ctrl.cli import cli
from spsp_ctrl.config.loader import load_tolerances

ROOT = Path(__file__).parents[2]
RIG, LARGE = str(ROOT / "config/rig.yaml"), str(ROOT / "config/mechanisms/large.yaml")
TABLE_2, TABLE_4, HINGES = (str(ROOT / f"config/tolerances/{name}.yaml") for name in ("table2", "table4", "hinges"))
TRANSMISSION = str(ROOT / "config/tolerances/transmission.yaml")


def call(*arguments: str) -> Result:
    return CliRunner().invoke(cli, ["mechanism", *arguments], catch_exceptions=False)


def result_of(*arguments: str) -> dict[str, Any]:
    done = call(*arguments, "--json")
    assert done.exit_code == 0, done.output
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_sources() -> None:
    rows = {row["source"]: row for row in result_of("errors", "sources", "-c", RIG)["sources"]}
    assert rows["u_z"]["max_roll_arcmin"] == pytest.approx(0.458, abs=5e-4)
    assert rows["column_temperature"]["per"] == "1 K"
    text = call("errors", "sources", "-c", LARGE).output
    assert "±18° × ±25°" in text
    assert "platform axis of the U joint above its column axis" in text


def test_dynamic() -> None:
    found = result_of("errors", "dynamic", "-c", RIG)
    cases = {case["case"]: case for case in found["cases"]}
    assert cases["dl2"]["roll"]["peak_arcmin"] == pytest.approx(0.749, abs=5e-4)
    assert cases["all together"]["roll"]["peak_arcmin"] == pytest.approx(0.519, abs=5e-4)
    assert found == result_of("errors", "dynamic", "-c", RIG, "--file", TABLE_2)
    assert found == result_of("errors", "dynamic", "-c", RIG, "--pitch", "15/4", "--roll", "20/8")
    four = result_of("errors", "dynamic", "-c", RIG, "--file", TABLE_4)
    assert four["worst_signs"] == pytest.approx({"pitch_peak_arcmin": 4.380, "roll_peak_arcmin": 4.958}, abs=5e-4)
    one = result_of("errors", "dynamic", "-c", RIG, "--source", "dh=-0.01mm")
    assert one["cases"][0]["pitch"]["max_arcmin"] == pytest.approx(-0.344, abs=5e-4)
    assert "worst_signs" not in one
    assert "u_square = 0.2 mrad" in call("errors", "dynamic", "-c", RIG, "--source", "u_square=0.2 mrad").output


def test_static() -> None:
    found = result_of("errors", "static", "-c", RIG)
    assert [p["point"] for p in found["points"]] == ["A", "B", "C", "D"]
    dh = found["sources"][3]
    assert dh["points"][0]["roll_arcmin_per_mm"] == pytest.approx(45.79, abs=5e-3)
    assert dh["sizes_um"] == pytest.approx([10, 30, 50, 80, 100, 150, 300, 500])
    at = result_of("errors", "static", "-c", RIG, "--at", "0", "0", "--at", "12", "-8", "--source", "a1_z=80um", "--source", "temperature")
    assert at["sources"][0]["sizes_um"] == pytest.approx([10 * k for k in range(1, 9)])
    assert at["sources"][0]["points"][0]["pitch_exact_arcmin"][0] == pytest.approx(0.344, abs=5e-4)
    assert at["sources"][1]["sizes_k"][-1] == 50.0


def test_check() -> None:
    found = result_of("tolerance", "check", "-c", RIG, "-f", TABLE_4, "--units", "20000")
    assert found["worst_case"]["roll_arcmin"] == pytest.approx(5.645, abs=5e-4)
    assert found["all_positive"]["pitch_arcmin"] == pytest.approx(0.865, abs=5e-4)
    assert found["rss"]["roll_arcmin"] == pytest.approx(3.649, abs=5e-4)
    assert found["monte_carlo"]["uniform"]["beyond"] == pytest.approx(0.265, abs=0.015)
    assert not found["worst_case"]["passes"]
    assert found["relax_first"][0]["sources"] == ["dr"]
    assert sum(row["percent"] for row in found["shares"]) == pytest.approx(100.0)
    assert found == result_of("tolerance", "check", "-c", RIG, "-f", TABLE_4, "--units", "20000")
    zeroed = result_of("tolerance", "check", "-c", RIG, "-f", TABLE_4, "--units", "20000", "--zeroed")
    assert zeroed["worst_case"]["roll_arcmin"] == pytest.approx(3.359, abs=5e-4)
    assert zeroed["worst_case_without_zeroing"]["roll_arcmin"] == pytest.approx(5.645, abs=5e-4)


def test_check_says_whether_the_requirement_is_kept() -> None:
    arguments = ("tolerance", "check", "-c", RIG, "-f", TABLE_4, "--units", "20000")
    assert call(*arguments, "--require", "worst").exit_code == 1
    assert call(*arguments, "--require", "yield").exit_code == 1
    done = call(*arguments, "--requirement-arcmin", "5.7", "--require", "worst")
    assert done.exit_code == 0
    assert "requirement 5.7′" in done.output
    assert "NOT KEPT" not in done.output
    # a smaller workspace is a smaller error
    small = result_of(*arguments, "--set", "mechanism.pitch_limit_deg=5", "--set", "mechanism.roll_limit_deg=5")
    assert small["worst_case"]["roll_arcmin"] < 4.5


def test_allocate_writes_a_file_that_passes(tmp_path: Path) -> None:
    path = tmp_path / "allocated.yaml"
    found = result_of("tolerance", "allocate", "-c", RIG, "-f", TABLE_4, "--units", "20000", "--write", str(path))
    assert found["worst_case_exact_arcmin"] <= 3.0
    assert found["relax_first"] == ["dr"]
    limits = {row["source"]: row["limit"] for row in found["limits"]}
    assert limits["dl1"] == limits["dl2"] < 40.0
    assert limits["dr"] > 30.0
    written = {e.source: e.limit for e in load_tolerances(path).model.tolerances}
    assert written["dr"] == pytest.approx(1e-3 * limits["dr"])
    done = call("tolerance", "check", "-c", RIG, "-f", str(path), "--units", "20000", "--require", "worst")
    assert done.exit_code == 0, done.output
    before = path.read_bytes()
    again = call("tolerance", "allocate", "-c", RIG, "-f", TABLE_4, "--units", "20000", "--write", str(path))
    assert again.exit_code == 2
    assert "exists already" in again.output
    assert path.read_bytes() == before


def test_allocate_by_yield_and_with_costs() -> None:
    rss = result_of("tolerance", "allocate", "-c", RIG, "-f", TABLE_4, "--units", "50000", "--by", "yield", "--yield", "95")
    assert 0.03 < rss["beyond"] <= 0.05
    plain = result_of("tolerance", "allocate", "-c", RIG, "-f", TABLE_4, "--units", "20000")
    dear = result_of("tolerance", "allocate", "-c", RIG, "-f", TABLE_4, "--units", "20000", "--cost", "dh=5")
    assert dear["limits"][3]["limit"] > 1.3 * plain["limits"][3]["limit"]
    text = call("tolerance", "allocate", "-c", LARGE, "-f", HINGES, "--units", "20000", "--requirement-arcmin", "2").output
    assert "relax u_square first" in text


def test_budget() -> None:
    found = result_of("budget", "-c", RIG, "-f", TRANSMISSION)
    assert found["passes"]
    assert found["worst"]["rod_um"] == pytest.approx(sum(row["rod_um"] for row in found["rows"]))
    rows = {row["name"]: row for row in found["rows"]}
    assert rows["screw clearance"]["roll_by_roll_rod_arcmin"] == pytest.approx(8.0 * 0.04013, abs=5e-4)
    assert "kept in the worst case" in call("budget", "-c", RIG, "-f", TRANSMISSION).output


def test_paper(tmp_path: Path) -> None:
    page = tmp_path / "claims.md"
    found = result_of("paper", "--out", str(tmp_path), "--markdown", str(page))
    rows = {row["id"]: row for row in found["claims"]}
    assert rows["5b-roll"]["claimed"] == {"roll_arcmin": 0.9}
    assert rows["5b-roll"]["verdict"] == "not reproduced"
    assert rows["6b-pitch"]["verdict"] == "contradicted"
    assert sum(found["verdicts"].values()) == len(rows)
    assert page.read_text(encoding="utf-8") == (ROOT / "docs/paper-claims.md").read_text(encoding="utf-8")
    for number in range(5, 11):
        assert ElementTree.parse(tmp_path / f"fig{number:02d}.svg").getroot().tag.endswith("svg")


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("errors", "dynamic", "-c", RIG), "errors-dynamic"),
        (("errors", "dynamic", "-c", RIG, "--source", "dr=10um"), "errors-dynamic"),
        (("errors", "static", "-c", RIG), "errors-static"),
        (("tolerance", "check", "-c", RIG, "-f", HINGES, "--units", "5000"), "tolerance-check"),
        (("budget", "-c", RIG, "-f", TRANSMISSION), "budget"),
    ],
)
def test_pictures(arguments: tuple[str, ...], name: str, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        assert result_of(*arguments, "--out", str(tmp_path / folder))["picture"] == str(tmp_path / folder / f"{name}.svg")
    first, second = ((tmp_path / folder / f"{name}.svg").read_bytes() for folder in ("a", "b"))
    assert first == second
    assert ElementTree.fromstring(first).tag.endswith("svg")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("errors", "sources", "-c", "nowhere.yaml"), "nowhere.yaml: no such file"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1=20"), "the value has no unit, e.g. dl1=20um"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1=20arcmin"), "unit 'arcmin' does not fit here; use one of: m, mm, um"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1=x"), "is not a number with its unit"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1"), "--source dl1 needs a size here"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1=0um"), "must not be 0"),
        (("errors", "dynamic", "-c", RIG, "--source", "b1_w=1um"), "unknown error source 'b1_w'; did you mean 'b1_"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1=1um", "--source", "dl1=2um"), "--source dl1 is given twice"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1=1um", "--file", TABLE_2), "leave --source away"),
        (("errors", "dynamic", "-c", RIG, "--source", "dl1=200mm"), "errors too large"),
        (("errors", "dynamic", "-c", RIG, "--pitch", "25/4"), "25.000 deg is beyond pitch_limit_deg = 20"),
        (("errors", "static", "-c", RIG, "--at", "25", "0"), "rig.yaml:17:3: unreachable pose"),
        (("errors", "static", "-c", RIG, "--at", "nan", "0"), "not a finite number"),
        (("tolerance", "check", "-c", RIG, "-f", TABLE_2), "table2.yaml:1:1: no requirement"),
        (("tolerance", "check", "-c", RIG, "-f", RIG), "this is a rig file, not a tolerance file"),
        (("tolerance", "check", "-c", RIG, "-f", TABLE_4, "--requirement-arcmin", "nan"), "not a finite number"),
        (("tolerance", "check", "-c", RIG, "-f", TABLE_4, "--units", "10"), "--units"),
        (("tolerance", "allocate", "-c", RIG, "-f", TABLE_4, "--cost", "dx=2"), "expected NAME=WEIGHT with a source of the file"),
        (("tolerance", "allocate", "-c", RIG, "-f", TABLE_4, "--cost", "dr=0"), "a weight is a number above 0"),
        (("budget", "-c", RIG, "-f", TABLE_4), "this is a tolerance file, not a transmission file"),
    ],
)
def test_wrong_input_is_one_clear_line(arguments: tuple[str, ...], says: str) -> None:
    done = call(*arguments)
    assert done.exit_code == 2, done.output
    assert says in " ".join(done.output.split())
    assert "Traceback" not in done.output


def test_an_impossible_allocation_names_what_is_left(tmp_path: Path) -> None:
    path = tmp_path / "tight.yaml"
    path.write_text(
        "schema: spsp-ctrl/tolerances/1\nrequirement: {value: 1, unit: arcmin}\n"
        "tolerances:\n  - {source: dl1, limit: 0.07, unit: mm, min: 0.05}\n  - {source: dh, limit: 0.05, unit: mm}\n"
    )
    done = call("tolerance", "allocate", "-c", RIG, "-f", str(path), "--units", "2000")
    assert done.exit_code == 2
    assert "the requirement cannot be kept: with every limit at its least the error is still 1.84" in done.output


@pytest.mark.parametrize(
    "command",
    [
        ("errors", "sources"),
        ("errors", "dynamic"),
        ("errors", "static"),
        ("tolerance", "check"),
        ("tolerance", "allocate"),
        ("budget",),
        ("paper",),
    ],
)
def test_help_has_an_example(command: tuple[str, ...]) -> None:
    assert f"Example: spsp-ctrl mechanism {' '.join(command)} " in " ".join(call(*command, "--help").output.split())
