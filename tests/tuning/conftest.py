"""One design for all tests: it takes seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.plant.model import PlantModel, load_model
from spsp_ctrl.tuning.design import Design, design

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture(scope="session")
def rig() -> RigConfig:
    return load_rig(CONFIG / "rig.yaml").model


@pytest.fixture(scope="session")
def model() -> PlantModel:
    return load_model(CONFIG / "model.yaml")


@pytest.fixture(scope="session")
def designed(rig: RigConfig, model: PlantModel) -> Design:
    return design(rig, model)
