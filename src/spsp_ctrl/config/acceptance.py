"""Acceptance rows of a scenario file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from spsp_ctrl.config.strict import Strict

Law = Literal["cascade", "stabiliser"]


class Acceptance(Strict):
    """One row of the verdict: a figure of the summary against bounds.

    In an experiment the row is judged on every run it applies to (all repeats, the named law and variants, all of them when none is named), and the
    worst value counts. ``across`` with ``order`` turns it into a shape claim: the figure must rise or fall from variant to variant by ``margin``.
    """

    name: str
    """What the row is called in tables."""
    value: str
    """Dotted path in ``summary.json``, e.g. ``error_arcmin.pitch.imu_max``."""
    limit: float | None = Field(default=None, ge=0.0)
    """Bound of the magnitude."""
    min: float | None = None
    max: float | None = None
    unit: str = ""
    paper: str = ""
    """What the paper states, in its words or numbers."""
    requirement: str = ""
    """What the paper requires of the machine, where that differs."""
    note: str = ""
    law: Law | None = None
    variant: str | tuple[str, ...] = ()
    motion: str = ""
    """One of `motions`; all of them when absent."""
    relative_to: str = ""
    """A variant: the figure is divided by that variant's and given in per cent."""
    across: tuple[str, ...] = ()
    """Variants in order."""
    order: Literal["rising", "falling"] = "rising"
    margin: float = Field(default=0.0, ge=0.0)
    """Smallest step from one of ``across`` to the next."""

    @model_validator(mode="after")
    def _bounded(self) -> Acceptance:
        given = [name for name in ("limit", "min", "max") if getattr(self, name) is not None]
        if self.across:
            if given or len(self.across) < 2:
                raise ValueError("a row with `across` names at least two variants and has `order` and `margin` instead of limit, min or max")
        elif not given:
            raise ValueError("a row needs a bound: limit (of the magnitude), min or max")
        elif "limit" in given and len(given) > 1:
            raise ValueError("give either limit (of the magnitude) or min and max")
        elif self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min ({self.min:g}) must not be above max ({self.max:g})")
        return self

    @property
    def variants(self) -> tuple[str, ...]:
        """Variants it applies to; empty means all."""
        if isinstance(self.variant, tuple):
            return self.variant
        return (self.variant,)


AcceptanceRows = Annotated[tuple[Acceptance, ...], Field(max_length=80)]
