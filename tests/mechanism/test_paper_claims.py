"""The table of claims: its numbers to the last digit, its verdicts, and the committed page."""

from __future__ import annotations

from pathlib import Path

import pytest

from spsp_ctrl.mechanism.paper_claims import Claim, paper_claims
from spsp_ctrl.report.paper_page import claims_lines, claims_page

PAGE = Path(__file__).parents[2] / "docs/paper-claims.md"


@pytest.fixture(scope="module")
def claims() -> dict[str, Claim]:
    rows = paper_claims()
    assert len({c.id for c in rows}) == len(rows)
    return {c.id: c for c in rows}


NUMBERS = {
    "table1-stroke": {"at_plus_20_deg_mm": (-34.123, 5e-4), "at_minus_20_deg_mm": (34.263, 5e-4)},
    "5a-pitch": {"pitch_min": (-0.715, 5e-4), "pitch_max": (-0.688, 5e-4)},
    "5a-roll": {"roll_min": (-0.059, 5e-4), "roll_max": (0.059, 5e-4)},
    "5b-roll": {"roll_min": (-0.749, 5e-4), "roll_max": (-0.688, 5e-4)},
    "6a-roll": {"roll_min": (-0.126, 5e-4), "roll_max": (0.125, 5e-4)},
    "6a-pitch": {"pitch_min": (-0.092, 5e-4), "pitch_max": (0.092, 5e-4)},
    "6b-roll": {"roll_min": (0.342, 5e-4), "roll_max": (0.404, 5e-4), "roll_mean": (0.361, 5e-4)},
    "6b-pitch": {"pitch_min": (0.344, 5e-4), "pitch_max": (0.357, 5e-4)},
    "7-all": {"pitch_max": (0.450, 5e-4), "roll_max": (0.519, 5e-4)},
    "8-A": {"pitch_dl1_arcmin_per_mm": (-36.95, 5.1e-3), "roll_dh_arcmin_per_mm": (45.79, 5.1e-3)},
    "8-B": {"pitch_dr_arcmin_per_mm": (12.47, 5.1e-3), "roll_dl2_arcmin_per_mm": (-38.13, 5.1e-3)},
    "9-C": {"roll_dl1_arcmin_per_mm": (4.27, 5.1e-3), "roll_dh_arcmin_per_mm": (33.82, 5.1e-3)},
    "9-D": {"roll_dl1_arcmin_per_mm": (5.63, 5.1e-3), "roll_dr_arcmin_per_mm": (-14.51, 5.1e-3)},
    "8-9-linear": {"difference_max": (0.123, 5e-4)},
    "10-motion": {"pitch_max": (0.81, 5e-3), "roll_max": (0.92, 5e-3)},
    "table4-signs": {"pitch_max": (0.865, 5e-4), "roll_max": (1.066, 5e-4)},
    "table4-worst": {"pitch_max": (4.559, 5e-4), "roll_max": (5.645, 5e-4)},
    "table4-rss": {"pitch_max": (3.180, 5e-4), "roll_max": (3.649, 5e-4)},
    "table4-uniform": {"beyond_3_arcmin_percent": (26.5, 0.2)},
    "table4-normal": {"beyond_3_arcmin_percent": (1.86, 0.05)},
}

VERDICTS = {
    "not reproduced": {"2.2-eq6", "5a-asymmetry", "5b-roll", "6a-pitch"},
    "contradicted": {
        "2.2-eq1-axis",
        "2.2-eq1-home",
        "2.2-rps-wrench",
        "eq8",
        "A5-pitch",
        "A5-roll",
        "5b-small",
        "6a-more",
        "6b-pitch",
        "6b-small",
        "8-9-radius",
        "table4-worst",
        "table4-rss",
        "table4-uniform",
        "table4-normal",
        "table4-radius",
    },
}


@pytest.mark.parametrize("row", NUMBERS)
def test_numbers(claims: dict[str, Claim], row: str) -> None:
    for name, (value, tolerance) in NUMBERS[row].items():
        assert claims[row].corrected.values[name] == pytest.approx(value, abs=tolerance)


def test_verdicts(claims: dict[str, Claim]) -> None:
    """Claims that the model contradicts are marked so: nothing is tuned to 0.9' or to the symmetric 0.2'."""
    for verdict, expected in VERDICTS.items():
        assert {c.id for c in claims.values() if c.verdict == verdict} == expected
    assert claims["5b-roll"].claimed == {"roll_arcmin": 0.9}
    assert claims["6b-pitch"].claimed == {"pitch_arcmin": 0.2}


def test_printed_forms(claims: dict[str, Claim]) -> None:
    roll = claims["5b-roll"]
    assert roll.printed_mm is not None
    assert roll.printed_mm.values == pytest.approx({"pole_deg": 1.52}, abs=5e-3)
    assert roll.printed_m is not None
    assert roll.printed_m.values == pytest.approx({"roll_min": -0.082, "roll_max": -0.065}, abs=5e-4)
    a5 = claims["A5-roll"]
    assert a5.printed_mm is not None
    assert a5.printed_mm.values["ratio_at_level"] == pytest.approx(0.01)


def test_committed_page_is_the_generated_one(claims: dict[str, Claim]) -> None:
    text = claims_page(list(claims.values()))
    assert PAGE.read_text(encoding="utf-8") == text, "run: spsp-ctrl mechanism paper --markdown docs/paper-claims.md"


def test_text(claims: dict[str, Claim]) -> None:
    lines = claims_lines(list(claims.values()))
    assert "NOT REPRODUCED  3.2, Fig 5b: dl2 = 0.02 mm: roll error about 0.9′" in lines
    assert "corrected: roll −0.749 … −0.688′" in "\n".join(lines)
    assert lines[-1].startswith(f"{len(claims)} claims: ")
