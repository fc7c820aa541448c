"""The report as a whole: complete, self-contained, robust against missing and broken data."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spsp_ctrl.messages import ReferenceKind
from spsp_ctrl.report.data import ARCMIN_PER_RAD, RunData, Signals
from spsp_ctrl.report.run_report import write_report

Maker = Callable[..., tuple[RunData, dict[str, Any]]]
VOID = {"meta", "br", "link", "img", "input", "hr"}


class Balanced(HTMLParser):
    """Fails on tags that are not closed in order; collects text and references."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_data(self, data: str) -> None:
        if "script" not in self.open and "style" not in self.open:
            self.text.append(data)


def render(tmp_path: Path, data: RunData, summary: dict[str, Any]) -> tuple[str, Balanced]:
    out = tmp_path / "report.html"
    write_report(out, data, summary)
    html = out.read_text(encoding="utf-8")
    parser = Balanced()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    for svg in re.findall(r"<svg xmlns.*?</svg>(?=<p|</div)", html, flags=re.S):
        ET.fromstring(svg)
        assert not re.search(r'="[^"]*\b(nan|inf)\b', svg)
    assert parser.references == []
    assert set(re.findall(r"https?://[^\s\"'<)]+", html)) <= {"http://www.w3.org/2000/svg"}
    assert "url(" not in html
    assert "@import" not in html
    return html, parser


def test_full_report_has_every_section(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic()
    html, parser = render(tmp_path, data, summary)
    text = " ".join(parser.text)
    for phrase in (
        "Held level", "swing table", "Attitude error", "Rod travel", "Rod speed", "motor current",
        "Backlash compensation",
        "Thermal compensation", "Heading error", "Azimuth joint", "Lateness", "Compute time", "p99.9", "SCHED_FIFO 80",
        "heading 30.0°, from keys", "ALIGNING -> ACTIVE", "seed", "spsp-ctrl 0.1.0", "column_height_mm",
    ):  # fmt: skip
        assert phrase in text, phrase
    assert html.count('class="plot') >= 13
    assert "prefers-color-scheme:dark" in html
    assert "@media print" in html


def test_sixty_seconds_at_one_kilohertz_stay_small(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic(duration_s=60.0, rate_hz=1000)
    render(tmp_path, data, summary)
    assert (tmp_path / "report.html").stat().st_size < 1_500_000


def test_without_truth_the_page_says_so(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic(truth=False)
    html, parser = render(tmp_path, data, summary)
    text = " ".join(parser.text)
    assert "holds no true states" in text
    assert "No swing-table attitude" in text
    assert "platform, estimated" in text
    assert '<i class="base' not in html


def test_encoders_stand_in_for_missing_truth(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic(truth=False)
    data.topics["/measurement"]["base.seq"] = 1
    html, _ = render(tmp_path, data, summary)
    assert "No swing-table attitude" not in html
    assert '<i class="base' in html


def test_failed_run_is_not_called_level(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic(bad=True)
    _, parser = render(tmp_path, data, summary)
    text = " ".join(parser.text)
    assert "Stopped by a fault: IMU silent" in text
    assert "Held level" not in text
    assert "✗ fail" in text
    assert "† skips" in text
    assert "no IMU frame" in text
    assert "cycles skipped at 5 times" in text


@pytest.mark.parametrize(
    ("change", "headline"),
    [
        ({}, "Held level"),
        ({"ended": "interrupted"}, "Interrupted; all rows passed up to then"),
        ({"acceptance": []}, "Completed; no acceptance rows to judge"),
        ({"acceptance": [{"name": "x", "value": 3, "limit": 2, "pass": False}]}, "Not accepted: 1 acceptance row of 1"),
        (
            {"acceptance": [{"name": "x", "value": 1, "limit": 2, "pass": True, "touched_by_skips": True}]},
            "Held level; some rows touched by skipped cycles",
        ),
    ],
)
def test_headline(tmp_path: Path, synthetic: Maker, change: dict[str, Any], headline: str) -> None:
    data, summary = synthetic(duration_s=7.0)
    _, parser = render(tmp_path, data, summary | change)
    assert headline in " ".join(parser.text)


def test_joint_reference_is_judged_on_joints_and_not_called_level(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic(duration_s=7.0)
    control, truth = data.topics["/control"], data.topics["/truth"]
    control["reference.kind"] = ReferenceKind.JOINT
    control["reference.pitch_rad"] = 0.1
    control["estimate.joint_pitch_rad"] = 0.1 - 1.0 / ARCMIN_PER_RAD
    truth["joint_pitch_rad"] = 0.1 - 2.0 / ARCMIN_PER_RAD
    signals = Signals(data)
    for true, expected in ((False, 1.0), (True, 2.0)):
        error = signals.error("pitch", true)
        assert error is not None
        assert np.allclose(error.y * ARCMIN_PER_RAD, expected)
    _, parser = render(tmp_path, data, summary)
    assert "Held level" not in " ".join(parser.text)


def test_heading_error_is_wrapped(synthetic: Maker) -> None:
    data, _ = synthetic(duration_s=1.0)
    data.topics["/control"]["reference.heading_rad"] = np.pi - 0.001
    data.topics["/control"]["estimate.heading_rad"] = -np.pi + 0.001
    error = Signals(data).error("heading", true=False)
    assert error is not None
    assert np.allclose(error.y, -0.002)


def test_rod_speed_is_the_travel_over_the_window(synthetic: Maker) -> None:
    data, _ = synthetic(duration_s=2.0)
    t = data.topics["/control"]["stamp_ns"] * 1e-9
    data.topics["/control"]["estimate.rod_roll_m"] = 0.02 * t
    speed = Signals(data).rod_speed("roll")
    assert speed is not None
    assert np.allclose(speed.y, 0.02)


def test_time_of_day_stamps_start_at_zero(synthetic: Maker) -> None:
    data, _ = synthetic(duration_s=2.0)
    for topic in data.topics.values():
        topic["stamp_ns"] += 1_700_000_000_000_000_000
    pitch = Signals(data).platform("pitch")
    assert pitch is not None
    assert pitch.t_s[0] == 0.0
    assert np.allclose(np.diff(pitch.t_s), 0.002)


@pytest.mark.parametrize("kind", ["nothing", "empty arrays", "one cycle", "nan", "foreign topics"])
def test_broken_data_still_gives_a_report(tmp_path: Path, synthetic: Maker, kind: str) -> None:
    data, summary = synthetic(duration_s=0.5)
    if kind == "nothing":
        data, summary = RunData({}), {}
    elif kind == "empty arrays":
        data = RunData({name: topic[:0] for name, topic in data.topics.items()})
    elif kind == "one cycle":
        data = RunData({name: topic[:1] for name, topic in data.topics.items()})
    elif kind == "nan":
        for topic in data.topics.values():
            for name in topic.dtype.names or ():
                if topic.dtype[name] == np.float64:
                    topic[name] = np.nan
        summary["error_arcmin"]["pitch"]["true_max"] = float("nan")
    else:
        data = RunData({"/other": np.zeros(3, dtype=[("stamp_ns", "i8"), ("x", "f8")])})
    render(tmp_path, data, summary)


def test_hostile_text_is_escaped(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic(duration_s=0.5)
    evil = '<script>alert(1)</script>"&'
    summary |= {"scenario": evil, "rig": evil, "law": evil, "ended": evil, "realtime_granted": {evil: evil}}
    summary["acceptance"] = [{"name": evil, "value": 1.0, "limit": 2.0, "unit": evil, "pass": True}]
    events = [{"stamp_ns": 0, "id": evil, "text": evil + "\n" + evil, evil: evil}]
    hostile = RunData(data.topics, events, {evil: {evil: evil}}, {evil: evil})
    html, _ = render(tmp_path, hostile, summary)
    assert "<script>alert" not in html


def test_limits_come_from_the_rig_file_only(tmp_path: Path, synthetic: Maker) -> None:
    data, summary = synthetic(duration_s=4.0)
    with_file, _ = render(tmp_path, data, summary)
    without, _ = render(tmp_path, RunData(data.topics), summary)
    assert ">34.3</text>" in with_file
    assert ">34.3</text>" not in without
    assert "The limit of ±6 A" in with_file
    broken, _ = render(tmp_path, RunData(data.topics, attachments={"rig.yaml": "a: [", "x": "- 1"}), summary)
    assert ">34.3</text>" not in broken
