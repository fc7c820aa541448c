"""The systemd unit, udev rules and limits of hil/: well-formed, and judged by systemd and udev themselves where they are installed."""

from __future__ import annotations

import configparser
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from spsp_ctrl.cli import cli

SYSTEM = Path(__file__).resolve().parents[2] / "hil" / "system"


def test_the_unit_calls_commands_that_exist_and_never_restarts() -> None:
    unit = configparser.ConfigParser(strict=False, interpolation=None, delimiters=("=",), comment_prefixes=("#",))
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(SYSTEM / "spsp-ctrl.service", encoding="utf-8")
    service = unit["Service"]
    assert service["Restart"] == "no"
    assert "LimitRTPRIO" in service
    for key in ("ExecStartPre", "ExecStart"):
        _, name, *words = service[key].split()
        options = {o for p in cli.commands[name].params for o in p.opts}
        assert {w for w in words if w.startswith("-")} <= options, service[key]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze on this computer")
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    text = (SYSTEM / "spsp-ctrl.service").read_text(encoding="utf-8").replace("/opt/spsp-ctrl/bin/spsp-ctrl", "/bin/true")
    (tmp_path / "spsp-ctrl.service").write_text(text, encoding="utf-8")
    done = subprocess.run(["systemd-analyze", "verify", str(tmp_path / "spsp-ctrl.service")], capture_output=True, text=True, check=False, timeout=30)
    assert "Unknown" not in done.stderr
    assert not re.search(r"spsp-ctrl\.service:\d+:", done.stderr), done.stderr


def test_each_rule_matches_and_sets_something() -> None:
    for line in (SYSTEM / "99-spsp-ctrl.rules").read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        parts = re.findall(r'([A-Z_]+(?:\{[A-Za-z_]+\})?)(==|\+=|=)"([^"]*)"', line)
        assert ", ".join(f'{k}{o}"{v}"' for k, o, v in parts) == line
        assert {o for _, o, _ in parts} & {"=="}
        assert {o for _, o, _ in parts} & {"=", "+="}


def test_limits_are_for_the_priority_that_rig_files_ask_for() -> None:
    from spsp_ctrl.config.loader import load_rig

    rows = [line.split() for line in (SYSTEM / "90-spsp-ctrl.conf").read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    limits = {row[2]: row[3] for row in rows}
    assert limits["memlock"] == "unlimited"
    assert int(limits["rtprio"]) >= load_rig(SYSTEM.parent / "rig-hardware.yaml").model.realtime.priority
