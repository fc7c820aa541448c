"""Import maps: what is shipped loads; what is wrong is said with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from spsp_ctrl.config.import_map import TARGETS, leaves, si_unit
from spsp_ctrl.config.loader import ConfigError, load_import_map
from spsp_ctrl.config.units import UNITS

FOLDER = Path(__file__).parents[2] / "config" / "import"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_maps_load(path: Path) -> None:
    assert load_import_map(path).model.columns


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("{source: demand_mm, unit: mm}", "{source: demand_mm, unit: mA}", 11, "unit 'mA' does not fit reference_m; use one of: m, mm, um"),
        ("    load_m:", "    lod_m:", 15, "/axis has no field 'lod_m'; did you mean 'load_m'?"),
        ("unit: A}", "unit: V}", 12, "command_unit"),
        ("    ambient_c: {value: 21.5, unit: degC}\n", "", 10, "not said where these come from: ambient_c"),
        ("  /axis:\n    enabled", "  /axes:\n    enabled", 18, "no such topic here; use one of: /axis, /measurement, /control"),
        ("enabled: {value: 1}", "enabled: {value: 2}", 19, "enabled is a flag: 0 or 1"),
        ("enabled: {value: 1}", "load_m: {value: 1, unit: m}", 19, "given as a column and as a constant"),
        ("enabled: {value: 1}", "stamp_ns: {value: 1, unit: s}", 19, "made from the sample time"),
        ("sign: -1}", "sign: -2}", 15, "sign"),
        ("sign: -1}", "scale: 0}", 15, "a scale of 0 throws the column away"),
        ("unit: um,", "unit: micron,", 15, "unknown unit 'micron'"),
        ("{source: time_ms, unit: ms, max_jitter: 0.05}", "{unit: ms}", 8, "no sample time"),
        ("from_s: 3.0, to_s: 6.0", "from_s: 2.0, to_s: 6.0", 1, "begins at 2 s, before 'sine' ends at 3 s"),
        ("from_s: 3.0, to_s: 6.0", "from_s: 7.0, to_s: 6.0", 29, "must be smaller than to_s"),
        ("controller: {kind: recorded}", "controller: {kind: cascade, kp_1_s: 1}", 30, "kv"),
        ("controller: {kind: recorded}", "held: [imu]", 30, "held: 'imu' is no sample with columns; those are: none"),
        ("schema: spsp-ctrl/import-map/1", "schema: spsp-ctrl/rig/1", 4, "this is a rig file, not an import map"),
    ],
)  # fmt: skip
def test_mistakes_are_named_with_their_line(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    text = (FOLDER / "bench-csv.yaml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "map.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_import_map(path)
    first = str(caught.value).splitlines()[0]
    assert first.startswith(f"{path}:{line}:"), first
    assert words in str(caught.value)


def test_every_field_has_a_unit_that_a_map_can_write() -> None:
    known = {si for si, _ in UNITS.values()} | {"m/rad"}  # no unit but SI for the levers: they are never imported in another
    for topic, cls in TARGETS.items():
        for name, _ in leaves(cls):
            assert si_unit(name) in known, f"{topic} {name}"
