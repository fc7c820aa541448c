"""What decides a command is in the law's digest, and nothing else of the mechanism package is."""

from __future__ import annotations

import subprocess
import sys

import pytest

from spsp_ctrl.plant.compile import MECHANISM_SOURCES
from spsp_ctrl.runtime.identity import LAW_SOURCES

SHOW = "import sys, {module}; print(*sorted(m for m in sys.modules if m.startswith('spsp_ctrl.mechanism.')))"


def used(module: str) -> set[str]:
    run = subprocess.run([sys.executable, "-c", SHOW.format(module=module)], capture_output=True, text=True, check=True)
    return {name.removeprefix("spsp_ctrl.mechanism.") + ".py" for name in run.stdout.split()}


@pytest.mark.parametrize("module", ["spsp_ctrl.control.law", "spsp_ctrl.control.reference", "spsp_ctrl.runtime.cycle", "spsp_ctrl.safety.supervisor"])
def test_the_law_uses_no_mechanism_module_outside_its_digest(module: str) -> None:
    listed = {name.removeprefix("mechanism/") for name in LAW_SOURCES if name.startswith("mechanism/")}
    assert used(module) <= listed


def test_the_plant_uses_no_mechanism_module_outside_its_cache_key() -> None:
    assert used("spsp_ctrl.plant.virtual") | used("spsp_ctrl.plant.swing_table") <= set(MECHANISM_SOURCES)
