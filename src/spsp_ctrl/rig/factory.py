"""From a rig file to a rig. Only what is needed is imported: a run on hardware never loads the plant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from spsp_ctrl.config.rig import BusDriver, RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.rig.base import Rig, RigError


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
    driver = config.rig
    if isinstance(driver, BusDriver) and driver.world != "in_process":
        from spsp_ctrl.rig.wires import open_wires

        if not real_time:
            raise RigError(f"a rig on wires (`world: {driver.world}`) runs in real time only; leave --fast away")
        rig = open_wires(config, driver)
        if driver.truth is not None:
            rig.see_truth(Path(driver.truth))
        return rig
    from spsp_ctrl.plant.model import load_model

    model = load_model(model_path)
    announce("preparing the rig (the first start compiles the plant, about 10 s) ...")
    if isinstance(driver, BusDriver):
        from spsp_ctrl.rig.bus import BusRig
        from spsp_ctrl.rig.world import LockstepWorld

        if real_time:
            raise RigError("simulated devices in this process run in lock-step only; give --fast, or serve them with `spsp-ctrl plant serve`")
        world = LockstepWorld(config, driver, model, scenario, seed)
        can = {name: world.can(name) for name in driver.can}
        return BusRig(config, can, {name: world.line(name) for name in driver.serial}, world.truth, world.warm_up)
    from spsp_ctrl.rig.simulated import SimulatedRig

    return SimulatedRig(config, model, scenario, seed, real_time=real_time)
