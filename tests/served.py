"""A served plant and a controller as processes of their own, on buses and ports that no other test uses."""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
HIL = ROOT / "hil"
START_S = 120.0
"""The first start compiles the plant."""


def settings(folder: Path, *, interface: str = "udp_multicast") -> list[str]:
    """``--set`` words for one session."""
    channel = f"239.74.{secrets.randbelow(200) + 20}.{secrets.randbelow(250) + 2}" if interface == "udp_multicast" else str(folder / "can0")
    own = {"rig.can.can0.interface": interface, "rig.can.can0.channel": channel, "rig.truth": str(folder / "truth")}
    own |= {f"rig.serial.{name}.port": str(folder / name) for name in ("imu", "stepper")}
    return [f"{key}={value}" for key, value in own.items()]


def start(*words: str) -> subprocess.Popen[str]:
    """``spsp-ctrl`` with these words."""
    command = [sys.executable, "-c", "from spsp_ctrl.cli import main; main()", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True)


def sets(own: list[str]) -> list[str]:
    """The words for the command line."""
    return [word for text in own for word in ("--set", text)]


@contextmanager
def plant(own: list[str], *more: str) -> Iterator[subprocess.Popen[str]]:
    """``plant serve`` that is ready."""
    process = start("plant", "serve", "--config", str(HIL / "rig-plant.yaml"), "--json", *sets(own), *more)
    assert process.stderr is not None
    try:
        begin, said = time.monotonic(), ""
        while not said.startswith("ready"):
            said = process.stderr.readline()
            assert said, f"the plant server ended with {process.wait(5)}"
            assert time.monotonic() - begin < START_S
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def controller(own: list[str], out: Path, duration_s: float, *more: str) -> subprocess.Popen[str]:
    """``run`` against it."""
    words = ["run", "--config", str(HIL / "rig-hil.yaml"), "--no-screen", "--json", "--out", str(out), "--duration", f"{duration_s:g}"]
    return start(*words, *sets(own), *more)


def wait_for(path: Path, size: int, process: subprocess.Popen[str]) -> None:
    """Until a growing file is that large."""
    begin = time.monotonic()
    while not path.exists() or path.stat().st_size < size:
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() - begin < START_S
        time.sleep(0.02)
