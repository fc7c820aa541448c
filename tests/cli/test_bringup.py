"""``check``, ``scan`` and the stages of ``run``: exit codes, what is asked on hardware, what is refused."""

from __future__ import annotations

import json
import os
import re
import shutil
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from spsp_ctrl.cli import bringup, cli

ROOT = Path(__file__).parents[2]


def call(*words: str) -> Result:
    return CliRunner().invoke(cli, list(words))


@pytest.fixture
def hardware(tmp_path: Path) -> Iterator[Path]:
    """A rig file with `world: hardware` whose ports are pseudo-terminals with nobody at the other end."""
    pairs = [os.openpty() for _ in range(2)]
    for _, slave in pairs:
        tty.setraw(slave)
    text = (ROOT / "hil" / "rig-hardware.yaml").read_text(encoding="utf-8")
    text = text.replace("/dev/spsp-imu", os.ttyname(pairs[0][1])).replace("/dev/spsp-stepper", os.ttyname(pairs[1][1]))
    text, count = re.subn(r"\{interface: socketcan, channel: can0", f"{{interface: udp_multicast, channel: 239.75.1.{os.getpid() % 250 + 2}", text)
    assert count == 1
    text = text.replace("scenario: swing-2dof.yaml", f"scenario: {ROOT / 'hil' / 'swing-2dof.yaml'}")
    (tmp_path / "rig.yaml").write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "hil" / "model.yaml", tmp_path)
    yield tmp_path / "rig.yaml"
    for pair in pairs:
        for fd in pair:
            os.close(fd)


def test_check_says_ready_or_what_is_missing(tmp_path: Path, hardware: Path) -> None:
    done = call("check", "--config", str(ROOT / "config" / "rig.yaml"), "--runs", str(tmp_path))
    assert (done.exit_code, done.output.splitlines()[-1]) == (0, "ready")
    done = call("check", "--config", str(ROOT / "hil" / "rig-hardware.yaml"), "--runs", str(tmp_path), "--json")
    found = json.loads(done.output)
    assert (done.exit_code, found["ready"]) == (3, False)
    assert {row["what"] for row in found["rows"] if row["state"] == "FAIL"} == {"bus can0", "line imu", "line stepper"}
    done = call("check", "--config", str(hardware), "--set", "rig.can.can0.bitrate=125000", "--runs", str(tmp_path))
    assert done.exit_code == 3
    assert "rig.can.can0.bitrate" in done.output
    assert call("check", "--config", str(tmp_path / "none.yaml")).exit_code == 2


def test_scan_needs_something_to_scan(tmp_path: Path) -> None:
    assert call("scan").exit_code == 2
    done = call("scan", "--config", str(ROOT / "config" / "rig.yaml"))
    assert (done.exit_code, "simulated inside the process" in done.output) == (3, True)
    done = call("scan", "--serial", "/dev/tty-none")
    assert (done.exit_code, "no such port" in done.output) == (3, True)
    assert call("scan", "--serial", "/dev/tty-none@fast").exit_code == 2
    done = call("scan", "--interface", "virtual", "--channel", "empty-bus", "--json")
    assert json.loads(done.output) == {"refused": 0, "found": []}


def test_hardware_asks_before_it_opens_anything(hardware: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("spsp_ctrl.devices.transport.opening.open_can", lambda *words: opened.append(words[0]))
    words = ("run", "--config", str(hardware), "--out", str(tmp_path / "out"), "--no-screen")
    done = call(*words)
    assert done.exit_code == 2
    assert "nobody is there to answer; give --yes" in done.output

    class Terminal:
        @staticmethod
        def isatty() -> bool:
            return True

    asked: list[str] = []

    def say_no(question: str, **more: Any) -> bool:
        asked.append(question)
        return False

    monkeypatch.setattr(bringup.sys, "stdin", Terminal())
    monkeypatch.setattr(bringup.click, "confirm", say_no)
    with pytest.raises(SystemExit) as ended:
        bringup.confirm("Stage 1 of 2: go on?", False)
    assert ended.value.code == 2
    assert asked == ["Stage 1 of 2: go on?"]
    bringup.confirm("Stage 1 of 2: go on?", True)
    assert len(asked) == 1
    assert not opened
    assert not (tmp_path / "out").exists()


def test_the_second_question_names_the_limits_and_a_no_lets_go(hardware: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = bringup.load(hardware, ())
    calls: list[str] = []

    class Rig:
        def stop(self) -> None:
            calls.append("stop")

        def close(self) -> None:
            calls.append("close")

    def refuse(question: str, yes: bool) -> None:
        calls.append(question)
        raise SystemExit(2)

    monkeypatch.setattr(bringup, "confirm", refuse)
    with pytest.raises(SystemExit):
        bringup.before_power(config, Rig(), False, 0.1, False)  # type: ignore[arg-type]
    assert "limits at 10 %" in calls[0]
    assert f"{config.limits.current_a:g} A" in calls[0]
    assert calls[1:] == ["stop", "close"]
    bringup.before_power(config, Rig(), True, None, False)  # type: ignore[arg-type]
    assert len(calls) == 3


def test_devices_that_do_not_answer_end_the_run_before_a_folder_exists(hardware: Path, tmp_path: Path) -> None:
    done = call("run", "--config", str(hardware), "--yes", "--out", str(tmp_path / "out"), "--no-screen")
    assert done.exit_code == 3
    for text in ("drive_pitch: node 1 does not answer", "imu: not one byte has arrived", "azimuth: the stepper module at address 1 does not answer"):
        assert text in done.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["0", "200%", "abc", "nan", "0.5%"])
def test_a_limit_is_a_share(text: str) -> None:
    assert call("run", "--config", str(ROOT / "config" / "rig.yaml"), "--limit", text).exit_code == 2


def test_a_simulated_run_keeps_its_limit_and_never_moves_without_enable(tmp_path: Path) -> None:
    common = ("run", "--config", str(ROOT / "config" / "rig.yaml"), "--fast", "--duration", "1", "--json")
    tenth = call(*common, "--limit", "10%", "--out", str(tmp_path / "tenth"))
    assert tenth.exit_code in (0, 3)
    resolved = (tmp_path / "tenth" / "rig.yaml").read_text(encoding="utf-8")
    from spsp_ctrl.config.loader import load_rig

    full = load_rig(ROOT / "config" / "rig.yaml").model.limits
    assert f"current_a: {0.1 * full.current_a:g}" in resolved.replace(f"{0.1 * full.current_a!r}", f"{0.1 * full.current_a:g}")
    assert call(*common, "--no-enable", "--out", str(tmp_path / "still")).exit_code == 0
    from spsp_ctrl.recording.reader import read_log

    rows = read_log(tmp_path / "still" / "run.mcap").topics["/control"]
    assert len(rows) > 900
    assert not rows["command.enable"].any()
    assert call(*common, "--dry-run").exit_code == 3
