"""From a rig file to a rig. Only what is needed is imported: a run on hardware never loads the plant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.rig.base import Rig


def build_rig(
    config: RigConfig,
    model_path: Path,
    scenario: Scenario,
    seed: int,
    *,
    real_time: bool,
    announce: Callable[[str], None] = lambda text: None,
) -> Rig:
    """The rig that ``config.rig`` describes. Raises ``ConfigError`` for a bad model file, ``RigError`` when it cannot run like this.

    ``announce`` is told what takes long, once every file has been judged.
    """
    from spsp_ctrl.plant.model import load_model
    from spsp_ctrl.rig.simulated import SimulatedRig

    model = load_model(model_path)
    announce("preparing the rig (the first start compiles the plant, about 10 s) ...")
    rig: Rig = SimulatedRig(config, model, scenario, seed, real_time=real_time)
    if scenario.faults:
        from spsp_ctrl.rig.injection import InjectedRig

        rig = InjectedRig(rig, scenario.faults, seed)
    return rig
