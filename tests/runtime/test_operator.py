"""The operator channel: what is understood, refused and answered; a run driven by `ctl` that replays; an absent operator; streams and jogs."""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest
from tests.sessions import RIG, command, one_clear_line

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.config.scenario import ReferencePlan
from spsp_ctrl.control.reference import ReferenceSource
from spsp_ctrl.messages import Mode, OperatorRequest
from spsp_ctrl.recording.reader import read_log
from spsp_ctrl.runtime import operator
from spsp_ctrl.runtime.operator import Judge, Operators, PipeOperator, Refused, SocketOperator, ask

GOOD = [
    ({"verb": "arm"}, ("arm", 0.0, 0.0)),
    ({"verb": "heading", "value": 90.0}, ("heading", math.pi / 2.0, 0.0)),
    ({"verb": "target", "value": 10.0, "rate": -2.0}, ("target", math.radians(10.0), math.radians(-2.0))),
    ({"verb": "jog", "axis": "pitch", "value": -0.5}, ("jog-pitch", math.radians(-0.5), 0.0)),
    ({"verb": "jog", "axis": "azimuth", "value": 1.0}, ("heading", math.radians(1.0), 0.0)),
]
BAD = [
    (b"arm", "not understood"),
    (b"[]", "not understood"),
    (b'{"value": 3}', "not understood"),
    (b'{"verb": "explode"}', "unknown verb"),
    (b'{"verb": ["arm"]}', "unknown verb"),
    (b'{"verb": "heading", "value": "north"}', "must be a number"),
    (b'{"verb": "heading", "value": NaN}', "finite"),
    (b'{"verb": "target", "value": 1, "rate": Infinity}', "finite"),
    (b'{"verb": "heading", "value": 361}', "beyond 360"),
    (b'{"verb": "target", "value": 0, "rate": 31}', "beyond 30"),
    (b'{"verb": "jog", "axis": "yaw", "value": 1}', "unknown axis"),
    (b'{"verb": "jog", "axis": "pitch", "value": 5.1}', "beyond 5"),
]


@pytest.mark.parametrize(("line", "wanted"), GOOD)
def test_requests_in_si(line: dict[str, object], wanted: tuple[str, float, float]) -> None:
    request = Judge("test")(json.dumps(line).encode(), 7)
    assert request.verb == wanted[0]
    assert (request.value, request.rate) == pytest.approx(wanted[1:])
    assert (request.stamp_ns, request.source) == (7, "test")


@pytest.mark.parametrize(("line", "words"), BAD)
def test_what_is_refused_says_why(line: bytes, words: str) -> None:
    with pytest.raises(Refused, match=words):
        Judge("test")(line, 0)


def test_turns_and_jogs_add_up() -> None:
    judge = Judge("test")
    judge(b'{"verb": "heading", "value": 10}', 0)
    assert judge(b'{"verb": "turn", "value": 5}', 0).value == pytest.approx(math.radians(15.0))
    assert judge(b'{"verb": "jog", "axis": "azimuth", "value": -1}', 0).value == pytest.approx(math.radians(14.0))


def test_socket_answers_every_line_and_never_waits(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 120)
    deep.mkdir()
    channel = SocketOperator(deep / operator.SOCKET_NAME)
    assert channel.path.stat().st_mode & 0o077 == 0
    assert channel.poll(0) == ()
    answers: list[dict[str, object]] = []
    client = threading.Thread(target=lambda: answers.extend(ask(channel.path, [{"verb": "arm"}, {"verb": "dance"}, {"verb": "stop"}])))
    client.start()
    taken: list[OperatorRequest] = []
    deadline = time.monotonic() + 20.0
    now = 0
    while client.is_alive() and time.monotonic() < deadline:
        now += 20_000_000
        taken += Operators((channel,)).poll(now)
        time.sleep(0.001)
    client.join(5.0)
    assert [r.verb for r in taken] == ["arm", "stop"]
    assert {r.source for r in taken} == {"ctl"}
    assert [a["ok"] for a in answers] == [True, False, True]
    assert "unknown verb" in str(answers[1]["error"])
    assert channel.rejected == 1
    channel.close()
    assert not channel.path.exists()
    with pytest.raises(FileNotFoundError):
        ask(channel.path, [{"verb": "arm"}])


def test_a_flood_or_a_vanished_client_is_dropped(tmp_path: Path) -> None:
    import socket

    channel = SocketOperator(tmp_path / "s")
    clients = [socket.socket(socket.AF_UNIX) for _ in range(2)]
    for client in clients:
        client.connect(str(channel.path))
    clients[0].send(b"x" * 3000)
    clients[1].close()
    for n in range(6):
        assert channel.poll(n) == ()
        with contextlib.suppress(OSError):
            clients[0].send(b"x" * 3000)
    assert channel._clients == []
    clients[0].close()
    channel.close()


def test_pipe_counts_what_it_drops() -> None:
    read, write = os.pipe()
    pipe = PipeOperator(read, "screen")
    os.write(write, b'{"verb": "stop"}\nnonsense\n{"verb": "arm"')
    assert [r.verb for r in pipe.poll(3)] == ["stop"]
    assert pipe.rejected == 1
    os.write(write, b"}\n")
    assert [r.verb for r in pipe.poll(3)] == ["arm"]
    os.close(write)
    assert pipe.poll(4) == ()
    os.close(read)


def test_a_run_driven_by_ctl_is_logged_and_replays(tmp_path: Path) -> None:
    """Armed by hand, turned, stopped and disarmed through the command; the log replays bit for bit."""
    folder = tmp_path / "run"
    said: list[tuple[int, str]] = []

    def person() -> None:
        deadline = time.monotonic() + 60.0
        while not (folder / "ctl.sock").exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        for words in ("dance", "arm", "jog roll 0.3", "heading 3", "target 4 --rate 0.5", "stop"):
            result = command("ctl", "--run", folder, *words.split())
            said.append((result.exit_code, result.output))
            time.sleep(0.05)

    thread = threading.Thread(target=person)
    thread.start()
    settings = ("--set", "supervisor.auto_arm=false", "--set", "realtime.enabled=false")
    result = command("run", "--config", RIG, "--duration", "4", "--ctl", "--no-screen", *settings, "--out", folder)
    thread.join(30.0)
    assert result.exit_code == 0, result.output
    assert [code for code, _ in said] == [2, 0, 0, 0, 0, 0], said
    events = read_log(folder / "run.mcap").operator
    assert [e["verb"] for e in events][:5] == ["arm", "jog-roll", "heading", "target", "stop"]
    assert events[3]["rate"] == pytest.approx(math.radians(0.5))
    replayed = command("replay", folder / "run.mcap")
    assert "0 differences" in replayed.output
    one_clear_line(command("ctl", "--run", folder, "arm"), 2, "no run answers", "--ctl")


@pytest.mark.parametrize("words", [("jog",), ("heading",), ("heading", "north"), ("arm", "3"), ("target",)])
def test_ctl_refuses_what_it_cannot_send(words: tuple[str, ...]) -> None:
    assert command("ctl", "--run", "/nowhere", *words).exit_code == 2


def source() -> ReferenceSource:
    return ReferenceSource(ReferencePlan(), 0.35, 0.5)


def test_a_stream_is_followed_smoothly_and_then_along_its_line() -> None:
    s = source()
    before = s.at(0.999)
    t, rate = 1.0, math.radians(4.0)
    headings = []
    while t < 6.0:
        if round(t * 1000) % 20 == 0:
            s = s.with_stream(t, math.radians(10.0) + rate * (t - 1.0), rate, 0.5)
        r = s.at(t)
        assert abs(r.heading_rad - before.heading_rad) < 0.45 * 1.1e-3
        assert abs(r.heading_rate_rad_s - before.heading_rate_rad_s) < 1.2e-3  # 0.5 rad/s2, smoothed
        headings.append(r.heading_rad)
        before = r
        t = round(t + 1e-3, 6)
    assert headings[-1] == pytest.approx(math.radians(10.0) + rate * 4.999, abs=1e-4)
    assert before.heading_rate_rad_s == pytest.approx(rate, abs=1e-4)
    # silence: it comes to rest where braking brings it
    assert s.until_s == pytest.approx(5.98 + 0.5)
    t = 6.48
    s = s.stream_ended(t)
    assert s.until_s == math.inf
    r = s.at(t)
    assert r.heading_rate_rad_s == pytest.approx(rate, abs=1e-3)
    rest = s.at(12.0)
    assert rest.heading_rate_rad_s == 0.0
    assert rest.heading_rad - r.heading_rad == pytest.approx(0.5 * rate * rate / 0.5 + 0.1 * rate, abs=2e-3)
    with pytest.raises(ValueError, match="finite"):
        s.with_stream(1.0, math.nan, 0.0, 0.5)


def test_a_heading_ends_a_stream_and_a_stream_goes_the_short_way_round() -> None:
    s = source().with_stream(1.0, math.radians(175.0), math.radians(10.0), 5.0)
    assert s.at(15.0).heading_rad < 0.0  # over 180 deg
    s = s.with_heading(2.0, 0.5)
    assert s.until_s == math.inf
    assert s.at(60.0).heading_rad == pytest.approx(0.5)
    assert s.at(60.0).heading_rate_rad_s == 0.0


def test_jogs_move_a_demand_on_and_add_up() -> None:
    s = source().jogged(1.0, "pitch", 0.01, 0.1, 0.4).jogged(1.1, "pitch", 0.01, 0.1, 0.4).jogged(1.0, "roll", -0.02, 0.1, 0.4)
    assert (s.at(1.0).pitch_rad, s.at(1.0).roll_rad) == (0.0, 0.0)
    assert s.at(5.0).pitch_rad == pytest.approx(0.02)
    assert s.at(5.0).roll_rad == pytest.approx(-0.02)
    rates = [s.at(1.0 + k * 1e-3).pitch_rate_rad_s for k in range(2000)]
    assert 0.02 < max(rates) <= 0.1
    assert max(abs(b - a) for a, b in pairwise(rates)) < 0.41e-3 * 1.1
    with pytest.raises(ValueError, match="finite"):
        s.jogged(1.0, "roll", math.inf, 0.1, 0.4)


def test_the_modes_exist() -> None:
    assert load_rig(RIG).model.supervisor.operator_timeout_s == 0.0
    assert Mode.HOMING in Mode
