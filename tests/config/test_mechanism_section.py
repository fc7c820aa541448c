"""The ``mechanism:`` section: alone or in a rig file, and what it refuses."""

from __future__ import annotations

from math import radians
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import ConfigError, apply_overrides, load_mechanism, load_rig
from spsp_ctrl.config.rig import Mechanism
from spsp_ctrl.control.params import law_params
from spsp_ctrl.mechanism.kinematics import rod_lengths

CONFIG = Path(__file__).parents[2] / "config"
GOOD = {
    "column_height_mm": 265.5,
    "moving_radius_mm": 100.0,
    "pitch_limit_deg": 20.0,
    "roll_limit_deg": 20.0,
    "azimuth_limit_deg": 90.0,
    "stroke_min_mm": -34.1,
    "stroke_max_mm": 34.3,
}


def write(path: Path, schema: str = "spsp-ctrl/mechanism/1", **changes: object) -> Path:
    values = {**GOOD, **changes}
    lines = [f"schema: {schema}", "mechanism:", *(f"  {key}: {value}" for key, value in values.items() if value is not None)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_rig_file_and_mechanism_file() -> None:
    rig = load_mechanism(CONFIG / "rig.yaml").model.mechanism
    assert rig.lengths_m == (0.2655, 0.1, 0.1)
    assert rig.level_m == 0.2655
    large = load_mechanism(CONFIG / "mechanisms" / "large.yaml").model.mechanism
    assert large.lengths_m == (0.62, 0.24, 0.3)
    assert rod_lengths(0.0, 0.0, *large.lengths_m) == pytest.approx((large.level_m,) * 2, rel=1e-15)


def test_the_law_uses_both_radii() -> None:
    loaded = apply_overrides(load_rig(CONFIG / "rig.yaml"), ["mechanism.static_radius_mm=110"])
    params = law_params(loaded.model)
    assert (params.radius_m, params.static_radius_m) == (0.1, 0.11)
    assert params.level_m == pytest.approx(rod_lengths(0.0, 0.0, 0.2655, 0.1, 0.11)[0], rel=1e-15)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"moving_radius_mm": 300.0}, "moving_radius_mm (300) must be smaller than column_height_mm (265.5)"),
        ({"static_radius_mm": 265.5}, "static_radius_mm (265.5) must be smaller than column_height_mm"),
        ({"static_radius_mm": 250.0, "roll_limit_deg": 40.0, "pitch_limit_deg": 40.0}, "roll_limit_deg (40) must be smaller than 39.13"),
        ({"stroke_min_mm": -270.0}, "stroke_min_mm (-270) leaves nothing of a rod of 265.50 mm"),
        ({"stroke_min_mm": 3.0}, "mechanism.stroke_min_mm = 3.0 is out of range"),
        ({"column_height_mm": ".nan"}, "mechanism.column_height_mm"),
        ({"roll_limit_deg": None}, "key 'mechanism.roll_limit_deg' is missing"),
        ({"moving_radius_m": 0.1}, "this quantity is given as 'moving_radius_mm' (mind the unit)"),
    ],
)
def test_impossible_geometry_names_the_field(tmp_path: Path, changes: dict[str, object], says: str) -> None:
    path = write(tmp_path / "m.yaml", **changes)
    with pytest.raises(ConfigError) as caught:
        load_mechanism(path)
    assert says in str(caught.value)
    assert str(caught.value).startswith(f"{path}:")


def test_another_kind_of_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="this is a plant model file, not a mechanism file"):
        load_mechanism(CONFIG / "model.yaml")
    with pytest.raises(ConfigError, match="unknown schema 'spsp-ctrl/mechanism/2'"):
        load_mechanism(write(tmp_path / "m.yaml", "spsp-ctrl/mechanism/2"))
    with pytest.raises(ConfigError, match="this is a mechanism file, not a rig file"):
        load_rig(CONFIG / "mechanisms" / "large.yaml")


def test_limits_short_of_the_singularity_are_accepted() -> None:
    wide = Mechanism(**{**GOOD, "pitch_limit_deg": 40.0, "roll_limit_deg": 40.0, "stroke_min_mm": -70.0, "stroke_max_mm": 70.0})
    assert radians(wide.roll_limit_deg) < 1.0
