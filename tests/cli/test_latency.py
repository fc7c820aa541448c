"""``spsp-ctrl latency``: measured on this machine (no figure of which is judged here), read from cyclictest, judged, advised, drawn."""

from __future__ import annotations

import json
import stat
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.sessions import RIG, command, one_clear_line

from spsp_ctrl.report.latency_picture import picture
from spsp_ctrl.runtime import latency, machine
from spsp_ctrl.runtime.latency import FAILED, GOOD, USABLE, Limits, Setup, Wake, figures, figures_of_counts, parse_cyclictest, verdict

CYCLICTEST = """# /dev/cpu_dma_latency set to 0us
# Histogram
000000 000000
000024 000900
000031 000090
000120 000008
# Total: 000000998
# Min Latencies: 00024
# Avg Latencies: 00026
# Max Latencies: 07031
# Histogram Overflows: 00002
# Histogram Overflow at cycle number:
# Thread 0: 00012 00500
"""


def fake_cyclictest(folder: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> Path:
    """A program of that name that notes how it was called."""
    program = folder / "cyclictest"
    program.write_text(f"#!/bin/sh\necho \"$@\" > {folder}/called\n{body}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    return folder / "called"


def test_beside_cyclictest_with_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    called = fake_cyclictest(tmp_path, monkeypatch, f"cat <<'END'\n{CYCLICTEST}END")
    wide = ("--limit-p99", "1e6", "--limit-misses", "100")
    result = command("latency", "-c", RIG, "--duration", "1", "--rate", "500", *wide, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    cpu = data["setup"]["cpu"]
    assert called.read_text().split() == ["-q", "-m", "-t1", f"-a{cpu}", "-p51", "-i2000", "-l500", "-h20000"]
    own, other = data["own"], data["cyclictest"]
    # late wake-ups take the place of those they cover
    assert 1 <= own["count"] <= 500
    assert 0.0 <= own["p50"] <= own["p99"] <= own["p99_9"] <= own["max"]
    assert (other["count"], other["late"], other["max"]) == (1000, 2, 7031.0)
    assert (other["p50"], other["p99"]) == (24.5, 120.5)
    assert data["ratio"]["p50"] == own["p50"] / 24.5
    assert data["granted"]["requested"] is True
    drawn = (tmp_path / "out" / "latency.svg").read_text()
    ET.fromstring(drawn)
    assert "cyclictest" in drawn
    assert "500 Hz" in drawn


def test_text_without_cyclictest_and_a_failed_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    # nothing wakes within 0.1 us in 99 of 100 cases without watching the clock
    result = command("latency", "--duration", "1", "--limit-p99", "0.1", "--limit-misses", "0")
    assert result.exit_code == 1, result.output
    assert "verdict: failed" in result.stdout
    assert "cyclictest: not installed (Debian and Ubuntu: package rt-tests)" in result.stdout
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(("body", "why"), [("echo no permission >&2; exit 1", "failed: no permission"), ("echo hello", "failed: hello")])
def test_a_cyclictest_that_fails_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, why: str) -> None:
    fake_cyclictest(tmp_path, monkeypatch, body)
    setup = Setup(1.0, 100, latency.default_cpu())
    assert latency.collect_cyclictest(latency.start_cyclictest(setup)) == why


def test_wrong_input_is_refused(tmp_path: Path) -> None:
    one_clear_line(command("latency", "-c", tmp_path / "nothing.yaml"), 2, "nothing.yaml")
    assert command("latency", "--set", "rate_hz=500").exit_code == 2
    assert command("latency", "--duration", "nan").exit_code == 2
    assert command("latency", "--duration", "0").exit_code == 2


def test_a_refused_core_is_degraded_with_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    result = command("latency", "--duration", "1", "--cpu", "1023", "--alone", "--limit-p99", "1e6", "--limit-misses", "100")
    assert result.exit_code == 0, result.output
    assert "degraded: cpu refused" in result.stdout
    assert "choose a core that exists" in result.stdout


@given(st.lists(st.integers(0, 30_000), min_size=1, max_size=300))
def test_counts_and_single_values_give_the_same_figures(values: list[int]) -> None:
    period = 1000.0
    exact = figures([float(v) for v in values], period)
    counts: dict[int, int] = {}
    for v in values:
        counts[v] = counts.get(v, 0) + 1
    binned = figures_of_counts(counts, float(max(values)), period)
    assert binned.count == exact.count == len(values)
    assert binned.max == exact.max == max(values)
    for name in ("p50", "p99", "p99_9"):
        assert 0.0 <= getattr(binned, name) - getattr(exact, name) <= 0.5
    assert binned.late == sum(v >= period for v in values)


def test_output_of_cyclictest_is_understood() -> None:
    counts, longest = parse_cyclictest(CYCLICTEST)
    assert counts == {24: 900, 31: 90, 120: 8, 7031: 2}
    assert longest == 7031.0
    assert figures([], 1000.0) == figures_of_counts({}, 0.0, 1000.0) == Wake(0, 0.0, 0.0, 0.0, 0.0, 0)


@pytest.mark.parametrize(
    ("p99", "late", "wanted"),
    [(100.0, 1, GOOD), (100.1, 0, USABLE), (10.0, 2, USABLE), (250.0, 50, USABLE), (250.1, 0, FAILED), (10.0, 51, FAILED)],
)
def test_bands(p99: float, late: int, wanted: str) -> None:
    assert verdict(Wake(10_000, 5.0, p99, 300.0, 9000.0, late), 1000.0, Limits()) == wanted


def test_a_pause_is_one_late_wake_up_with_its_whole_length() -> None:
    """As cyclictest counts: a clock that has slept over three deadlines reports the first of them."""
    values, _ = latency.measure_here(Setup(0.3, 200, latency.default_cpu(), real_time=False))
    assert all(v >= 0 for v in values)
    slots = sum(1 + v // 5_000_000 for v in values)
    assert 58 <= slots <= 62


def machine_files(root: Path, **content: str) -> Path:
    for name, text in content.items():
        path = root / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    return root


def test_facts_and_advice(tmp_path: Path) -> None:
    root = machine_files(
        tmp_path,
        proc__version="Linux version 6.1 PREEMPT_DYNAMIC",
        proc__cpuinfo="flags : fpu hypervisor lm",
        proc__stat="cpu 1 2 3 4 5 6 7 8 0 0\ncpu3 100 0 50 800 10 0 0 40 0 0",
        proc__sys__kernel__sched_rt_runtime_us="950000",
        sys__devices__system__cpu__isolated="",
        sys__devices__system__cpu__cpu3__cpufreq__scaling_governor="powersave",
        sys__devices__system__clocksource__clocksource0__current_clocksource="hpet",
    )
    seen = machine.look(3, root)
    assert (seen.preempt_rt, seen.virtual, seen.governor, seen.clocksource, seen.throttled_us) == (False, True, "powersave", "hpet", 950000)
    assert machine.cpu_times(3, root) == (40, 1000)
    busy = seen._replace(cores=4, load_1min=3.9)
    refused = {"fifo": "refused: x", "memory_locked": "refused: y", "cpu_dma_latency": "refused: z"}
    about = [row["about"] for row in machine.advice(busy, 3, refused, 0.04)]
    assert about == ["priority", "memory", "sleep states", "load", "governor", "isolcpus", "PREEMPT_RT", "host", "clock"]
    assert "isolcpus=3" in next(row["do"] for row in machine.advice(busy, 3, {}, 0.0) if row["about"] == "isolcpus")
    fine = busy._replace(load_1min=0.1, governor="performance", isolated="3", preempt_rt=True, virtual=False, clocksource="tsc")
    assert machine.advice(fine, 3, {}, 0.0) == []
    bare = machine.look(0, tmp_path / "nothing")
    assert (bare.governor, bare.clocksource, bare.throttled_us, bare.isolated) == (None, None, None, "")


def test_picture_of_little_and_of_much() -> None:
    for own, other in (({0.0: 1}, None), ({0.003: 5, 12.0: 900, 54_000.0: 1}, {20.0: 100_000})):
        root = ET.fromstring(picture("a < b", own, other, 1000.0, 100.0, 250.0))
        assert root.tag.endswith("svg")
        assert ("cyclictest" in "".join(root.itertext())) == (other is not None)
