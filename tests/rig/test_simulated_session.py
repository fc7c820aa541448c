"""A simulated session constructs simulated devices only, and proves it: no driver of a port or bus is even loaded, no device file is opened."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import can
import cantools
import pytest

from spsp_ctrl.recording.traces import export_trace, import_trace

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


WATCHED = {"code": 0, "devices": [], "ports": []}


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


@pytest.fixture(scope="module")
def encoded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log of a short run with every byte encoded, inside one process that was watched."""
    folder = tmp_path_factory.mktemp("encoded")
    assert outcome(in_process(folder), folder / "run") == WATCHED
    return folder / "run" / "run.mcap"


def test_neither_simulated_rig_touches_a_port(tmp_path: Path, encoded: Path) -> None:
    assert encoded.is_file()
    assert outcome(ROOT / "config" / "rig.yaml", tmp_path / "plant") == WATCHED


def test_the_trace_of_a_run_is_read_by_tools_of_the_field(tmp_path: Path, encoded: Path) -> None:
    """Run with every byte encoded, export its bus, read it with python-can and the shipped DBC: one SYNC and one status of each drive a cycle."""
    out = tmp_path / "trace.log"
    count, bus, problem = export_trace(encoded, None, "candump", out)
    assert (bus, problem) == ("can0", "")
    base = cantools.database.load_file(ROOT / "hil" / "devices" / "can0.dbc")
    seen: Counter[str] = Counter()
    with can.LogReader(out) as reader:
        for message in reader:
            seen["frames"] += 1
            if message.arbitration_id in base._frame_id_to_message:
                found = base.get_message_by_frame_id(message.arbitration_id)
                seen[found.name] += 1
                if found.name == "drive_pitch_status":
                    assert set(found.decode(message.data)) == {"statusword", "position", "torque"}
    assert seen["frames"] == count
    assert seen["sync"] >= 200
    for name in ("drive_pitch_status", "drive_roll_status", "drive_pitch_command", "drive_roll_command"):
        assert abs(seen[name] - seen["sync"]) <= 2, seen
    assert import_trace(out, None, tmp_path / "back.mcap") == {"can0": count}
