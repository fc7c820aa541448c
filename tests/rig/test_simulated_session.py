"""A simulated session constructs simulated devices only, and proves it: no driver of a port or bus is even loaded, no device file is opened."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

SCRIPT = """
import builtins, json, os, socket, sys
opened, real_open, real_builtin, real_socket = [], os.open, builtins.open, socket.socket
def watch(path, *more, **named):
    opened.append(str(path)); return real_open(path, *more, **named)
def watch_builtin(path, *more, **named):
    opened.append(str(path)); return real_builtin(path, *more, **named)
class Watched(real_socket):
    def __init__(self, *more, **named):
        opened.append(f"socket {more}{named}"); super().__init__(*more, **named)
os.open, builtins.open, socket.socket = watch, watch_builtin, Watched
from spsp_ctrl.cli import cli
code = None
try:
    cli(["run", "--config", sys.argv[1], "--fast", "--duration", "0.2", "--out", sys.argv[2], "--json"])
except SystemExit as end:
    code = end.code
devices = [p for p in opened if (p.startswith("/dev/") and p not in ("/dev/null", "/dev/urandom")) or p.startswith("socket")]
ports = [m for m in ("serial", "can", "canopen", "spsp_ctrl.devices.transport.python_can", "spsp_ctrl.devices.transport.serial_line",
                     "spsp_ctrl.devices.transport.slcan") if m in sys.modules]
print("\\n--", json.dumps({"code": code, "devices": devices, "ports": ports}))
"""


def outcome(rig: Path, out: Path) -> dict[str, object]:
    words = [sys.executable, "-c", SCRIPT, str(rig), str(out)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=120, env=os.environ)
    assert "\n-- " in done.stdout, done.stdout + done.stderr
    found: dict[str, object] = json.loads(done.stdout.rsplit("\n-- ", 1)[1])
    return found


def in_process(tmp_path: Path) -> Path:
    """The virtual rig with every byte encoded, on buses inside the process."""
    text = (ROOT / "config" / "rig.yaml").read_text(encoding="utf-8")
    section = """rig:
  driver: bus
  world: in_process
  can: {can0: {interface: spsp-lockstep, channel: rig}}
  serial: {imu: {port: spsp-lockstep}, stepper: {port: spsp-lockstep}}
  devices:
    drive_pitch: {bus: can0, node: 1, temperature_object: 8194}
    drive_roll: {bus: can0, node: 2, temperature_object: 8194}
    imu: {serial: imu}
    azimuth: {serial: stepper}
"""
    text, count = re.subn(r"^rig:\n(?:[ #][^\n]*\n)+", section, text, flags=re.M)
    assert count == 1
    folder = tmp_path / "config"
    shutil.copytree(ROOT / "config", folder)
    (folder / "rig.yaml").write_text(text, encoding="utf-8")
    return folder / "rig.yaml"


def test_neither_simulated_rig_touches_a_port(tmp_path: Path) -> None:
    for name, rig in (("plant", ROOT / "config" / "rig.yaml"), ("bytes", in_process(tmp_path))):
        assert outcome(rig, tmp_path / name) == {"code": 0, "devices": [], "ports": []}, name
