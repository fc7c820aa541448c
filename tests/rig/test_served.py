"""The plant in a process of its own: a session over multicast and pseudo-terminals, and either side killed."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from tests import served

from spsp_ctrl.devices import canopen_host as canopen
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices.cia402_host import state_of
from spsp_ctrl.devices.families.base import MASTER
from spsp_ctrl.devices.transport.opening import open_can
from spsp_ctrl.experiments.replaying_raw import replay_raw
from spsp_ctrl.messages import Mode
from spsp_ctrl.recording.reader import read_log

pytestmark = pytest.mark.realtime

pytest.importorskip("msgpack", reason="python-can's udp_multicast needs it")
LOG_BYTES = 400_000
"""About a second of a run."""


@pytest.mark.parametrize("interface", ["udp_multicast", "slcan"])
def test_a_session_over_real_transports(tmp_path: Path, interface: str) -> None:
    """Armed, aligned, active, stopped; every device identified; true states in the log; the plant starts anew for the next controller."""
    own = served.settings(tmp_path, interface=interface)
    with served.plant(own):
        for k in range(2 if interface == "slcan" else 1):
            for attempt in range(3):
                out = tmp_path / f"run{k}-{attempt}"
                process = served.controller(own, out, 2.0, "--set", "supervisor.signal_timeout_ms=200", "--set", "supervisor.imu_timeout_ms=300")
                told, complaint = process.communicate(timeout=90)
                if process.returncode != 3 or "-density" not in json.loads(told)["ended"]:
                    break  # a computer without real time may lose its core for so long that frames bunch up, which is rightly a fault
            assert process.returncode == 0, complaint + told
            assert json.loads(told)["ended"] == "completed"
            log = read_log(out / "run.mcap")
            assert log.complete
            modes = set(log.topics["/control"]["mode"].tolist())
            assert {int(Mode.READY), int(Mode.ALIGNING), int(Mode.ACTIVE)} <= modes
            measured, true = log.topics["/measurement"], log.topics["/truth"]
            counts = measured["resolver_pitch.counts"][-500:]
            screw = true["screw_pitch_m"][-500:]
            assert abs(counts * 4e-3 / (3 * 16384) - screw).max() < 1e-3, "another leg answers"
            assert measured["temperature.seq"].max() >= 10
            assert measured["azimuth.seq"].max() >= 40
            assert abs(measured["base.roll_rad"] - true["base_roll_rad"]).max() < 0.02
            decoded = replay_raw(out / "run.mcap", lambda done, total: None)
            assert (decoded.first, decoded.cycles) == ("", len(measured))
            assert decoded.frames > 4 * len(measured)


def test_drives_stop_when_the_controller_is_killed(tmp_path: Path) -> None:
    """Kill -9 of a moving controller: quick stop within 100 ms of its last heartbeat; the log is readable up to 0.1 s before."""
    own = served.settings(tmp_path)
    with served.plant(own):
        process = served.controller(own, tmp_path / "run", 30.0, "--set", "supervisor.signal_timeout_ms=200")
        channel = own[1].partition("=")[2]
        bus = open_can("udp_multicast", channel, 1_000_000)
        served.wait_for(tmp_path / "run" / "run.mcap", LOG_BYTES, process)
        bus.poll(0)
        killed_ns = time.monotonic_ns()
        process.kill()
        process.communicate()
        last_beat, alarms = 0, {}
        begin = time.monotonic()
        while len(alarms) < 2 and time.monotonic() - begin < 2.0:
            for t, identifier, data in bus.poll(0):
                if identifier == C.HEARTBEAT + MASTER:
                    last_beat = t
                for node in (1, 2):
                    found = canopen.read_emergency((identifier, data), node)
                    if found is not None and found.code == C.EMCY_HEARTBEAT:
                        alarms.setdefault(node, t)
            time.sleep(0.002)
        assert alarms.keys() == {1, 2}
        after_ms = [(t - (last_beat or killed_ns)) * 1e-6 for t in alarms.values()]
        assert max(after_ms) <= 100.0, after_ms
        for node in (1, 2):
            bus.send([canopen.read(node, C.STATUSWORD, 0)])
            word = None
            begin = time.monotonic()
            while word is None and time.monotonic() - begin < 2.0:
                answers = [canopen.answer((identifier, data), node) for _, identifier, data in bus.poll(0)]
                word = next((int.from_bytes(a.data, "little") for a in answers if a is not None), None)
                time.sleep(0.002)
            assert word is not None
            assert state_of(word) is C.QUICK_STOP_ACTIVE
        bus.close()
    log = read_log(tmp_path / "run" / "run.mcap")
    origin = int(log.metadata["clock"]["monotonic_ns"])
    missing_s = (killed_ns - origin - int(log.topics["/measurement"]["stamp_ns"][-1])) * 1e-9
    assert missing_s <= 0.1


def test_controller_is_safe_when_the_plant_is_killed(tmp_path: Path) -> None:
    """Kill -9 of the plant: a fault within three cycles of the declared age, which says what to check; exit code 3."""
    own = served.settings(tmp_path)
    with served.plant(own) as server:
        process = served.controller(own, tmp_path / "run", 30.0)
        served.wait_for(tmp_path / "run" / "run.mcap", LOG_BYTES, process)
        killed_ns = time.monotonic_ns()
        server.kill()
        told, _ = process.communicate(timeout=60)
    assert process.returncode == 3
    assert json.loads(told)["ended"].startswith("fault")
    log = read_log(tmp_path / "run" / "run.mcap")
    measured, control = log.topics["/measurement"], log.topics["/control"]
    if int(control["stamp_ns"][-1]) + int(log.metadata["clock"]["monotonic_ns"]) < killed_ns:
        pytest.skip("too busy a computer: the plant was late by more than the age limit before it was killed")
    too_old = measured["stamp_ns"] - measured["resolver_pitch.stamp_ns"] > 40_000_000
    assert np.count_nonzero(too_old & (control["fault"] == 0)) <= 3, "cycles beyond the declared age without a fault"
    assert np.count_nonzero(too_old & control["command.enable"]) <= 3, "power on beyond the declared age"
    assert not control["command.enable"][-1]
    texts = [event["text"] for event in log.events if event["level"] == "error"]
    assert any("Check:" in text for text in texts), texts

