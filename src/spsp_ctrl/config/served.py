"""Plant server file: whose devices it plays, and in which motion. Everything else stands in the rig file, so that both ends fit."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from spsp_ctrl.config.strict import Strict

SERVED_SCHEMA = "spsp-ctrl/served/1"


class ServedFile(Strict):
    """What ``spsp-ctrl plant serve`` plays."""

    schema_: Literal["spsp-ctrl/served/1"] = Field(alias="schema")
    rig: str
    """Rig file with `world: served`, relative to this file: its buses, lines and devices are played."""
    scenario: str
    """Scenario file, relative to this file: motion of the base, load, temperature."""
