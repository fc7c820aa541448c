"""The devices of a rig file: what fits is taken, each misfit is named with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from spsp_ctrl.config.loader import ConfigError, load_rig

RIG = (Path(__file__).parents[2] / "config" / "rig.yaml").read_text(encoding="utf-8")
GOOD = """rig:
  driver: bus
  world: served
  can:
    can0: {interface: udp_multicast, channel: 239.74.163.2}
  serial:
    imu: {port: /tmp/imu, baud: 921600}
    stepper: {port: /tmp/stepper}
  devices:
    drive_pitch: {bus: can0, node: 1}
    drive_roll: {bus: can0, node: 2}
    imu: {serial: imu}
    azimuth: {serial: stepper}
"""


def _problems(tmp_path: Path, section: str) -> list[str]:
    begin, end = RIG.index("rig:\n"), RIG.index("mechanism:")
    path = tmp_path / "rig.yaml"
    path.write_text(RIG[:begin] + section + "\n" + RIG[end:], encoding="utf-8")
    try:
        load_rig(path)
    except ConfigError as error:
        return str(error).splitlines()
    return []


def test_a_good_file_is_taken(tmp_path: Path) -> None:
    assert _problems(tmp_path, GOOD) == []


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("driver: bus", "driver: buss", ("rig.driver = 'buss'", "'simulated', 'bus'")),
        ("  driver: bus\n", "", ("key 'rig.driver' is missing",)),
        ("interface: udp", "interfac: udp", ("'rig.can.can0.interfac'; did you mean 'interface'?",)),
        ("node: 2", "node: 1", ("rig.devices.drive_roll.node = 1 is taken by drive_pitch", ":19:29:")),
        ("azimuth: {serial: stepper}", "azimuth: {serial: imu}", ("each needs its own",)),
        ("azimuth: {serial: stepper}", "azimuth: {}", ("either `serial` or `bus`",)),
        ("azimuth: {serial: stepper}", "azimuth: {bus: can0, address: 2}", ("they must differ",)),
        ("imu: {serial: imu}", "imu: {serial: line7}", ("'line7' is none of rig.serial: imu, stepper",)),
        ("port: /tmp/stepper", "port: /tmp/imu", ("is already the line 'imu'",)),
        ("world: served", "world: in_process", ("needs 'spsp-lockstep'",)),
        ("interface: udp_multicast", "interface: spsp-lockstep", ("ends at this process",)),
    ],
)
def test_each_misfit_is_named(tmp_path: Path, old: str, new: str, words: tuple[str, ...]) -> None:
    assert old in GOOD
    found = _problems(tmp_path, GOOD.replace(old, new))
    for word in words:
        assert any(word in line for line in found), found
