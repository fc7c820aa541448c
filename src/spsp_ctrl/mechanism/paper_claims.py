"""Every numeric claim of sections 2 and 3 of the paper, beside what its own model gives.

Nothing here is copied from a result: the constants are the paper's inputs (Tables 1 to 4, the motion of section 3.2, the poses of Eq 12) and its
claims; all else is computed, the verdicts too. "Printed" is Eq (11) with (A5) as printed, evaluated in mm or in m (it is not homogeneous).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from spsp_ctrl.mechanism.eq11 import equation_11
from spsp_ctrl.mechanism.vectorised import Array

Verdict = Literal["reproduced", "not reproduced", "contradicted"]
Numbers = dict[str, float]

HEIGHT_M, RADIUS_M = 0.2655, 0.1
"""Tables 1 and 2."""
LENGTHS_M = (HEIGHT_M, RADIUS_M, RADIUS_M)
LIMIT_RAD = float(np.radians(20.0))
TABLE_2_M = (2e-5, 2e-5, 1e-5, 1e-5)
"""dl1, dl2, dr, dh."""
TABLE_4_M = (7e-5, 7e-5, 1e-5, 5e-5)
ARCMIN = float(np.degrees(1.0) * 60.0)
UNITS, SEED = 1_000_000, 1
"""Of the Monte Carlo."""


@dataclass(frozen=True)
class Answer:
    """What one form of the model gives: text for people, numbers (unit in the name) for machines."""

    text: str
    values: Numbers = field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """One row of the table."""

    id: str
    place: str
    """Section, figure, table or equation of the paper."""
    claim: str
    corrected: Answer
    verdict: Verdict
    why: str
    claimed: Numbers = field(default_factory=dict)
    printed_mm: Answer | None = None
    printed_m: Answer | None = None


def verdict(agrees: bool, otherwise: Verdict = "contradicted") -> Verdict:
    """Verdict from a comparison."""
    return "reproduced" if agrees else otherwise


def rounds_to(value: float, claimed: float, digits: int) -> bool:
    """Is a value the claimed one at the precision at which the paper states it."""
    return round(value, digits) == round(claimed, digits)


def residual(value: float) -> str:
    """A difference that is rounding or not; rounding itself differs from machine to machine, so it is not spelt out."""
    return "below 1e-12" if abs(value) < 1e-12 else f"{value:.1e}"


def span(values: Array, unit: str, name: str, digits: int = 3) -> Answer:
    """Range of a curve."""
    low, high = float(values.min()), float(values.max())
    return Answer(f"{name} {low:+.{digits}f} … {high:+.{digits}f}{unit}", {f"{name}_min": low, f"{name}_max": high})


def merge(*answers: Answer) -> Answer:
    """Several answers as one."""
    values: Numbers = {}
    for answer in answers:
        values |= answer.values
    return Answer("; ".join(a.text for a in answers), values)


def sensitivities(pitch_rad: Array | float, roll_rad: Array | float) -> dict[str, Array]:
    """Eq (11) in its three forms, shape (2, 4, *poses), arcmin per m."""
    return {
        "corrected": equation_11(pitch_rad, roll_rad, HEIGHT_M, RADIUS_M, "corrected") * ARCMIN,
        "printed_mm": equation_11(pitch_rad, roll_rad, HEIGHT_M, RADIUS_M, "printed", 1e-3) * ARCMIN,
        "printed_m": equation_11(pitch_rad, roll_rad, HEIGHT_M, RADIUS_M, "printed") * ARCMIN,
    }


def paper_claims(units: int = UNITS, advance: Callable[[int, int], None] = lambda done, total: None) -> list[Claim]:
    """The whole table, in the order of the paper."""
    from spsp_ctrl.mechanism.paper_section2 import section_2, section_31
    from spsp_ctrl.mechanism.paper_section3 import section_33, section_34, section_35
    from spsp_ctrl.mechanism.paper_section32 import section_32

    return [*section_2(), *section_31(), *section_32(), *section_33(), *section_34(units, advance), *section_35()]
