"""Punctuality in pairs: two programs on one core at one time, skip counting, medians over the pairs. ``python -m tools.bench punctual``

Absolute tails on a shared or virtual machine belong to the machine; the ratios of two programs that meet the same pauses belong to the programs.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from spsp_ctrl.messages import NO_MEASUREMENT
from spsp_ctrl.recording import frames
from spsp_ctrl.recording.ring import TAIL, Ring, create
from spsp_ctrl.recording.schema import CYCLIC, TOPICS
from spsp_ctrl.recording.writer import Recorder
from spsp_ctrl.runtime import latency
from spsp_ctrl.runtime.latency import Setup, default_cpu
from spsp_ctrl.runtime.realtime import RealTime, Wishes
from tools.bench.common import load
from tools.bench.punctual_child import PERIOD_NS
from tools.bench.soak import load as busy

PRIORITY = 80
HALF = 0.5


class Row(NamedTuple):
    """A ratio with what it must keep and what is aimed at."""

    name: str
    ratios: Sequence[float]
    must: float | None
    aim: float | None
    note: str = ""


def child(mode: str, seconds: float, cpu: int, phase: float, priority: int = PRIORITY, spin_us: float = 0.0) -> subprocess.Popen[str]:
    """A timed loop."""
    setup = {"mode": mode, "seconds": seconds, "cpu": cpu, "phase": phase, "priority": priority, "spin_us": spin_us}
    command = [sys.executable, "-m", "tools.bench.punctual_child", json.dumps(setup)]
    if not priority:
        command = ["taskset", "-c", str(cpu), *command]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    """Its figures."""
    out, _ = process.communicate()
    if process.returncode:
        raise SystemExit(f"a timed loop ended with {process.returncode}")
    found: dict[str, Any] = json.loads(out)
    return found


def against_cyclictest(pairs: int, seconds: float, cpu: int, spin_us: float) -> list[dict[str, dict[str, float]]]:
    """Own clock and cyclictest, one level above it, at the same time."""
    found = []
    for _ in range(pairs):
        setup = Setup(seconds, 1000, cpu, PRIORITY, spin_us)
        values, granted, other = latency.run(setup, compare=True)
        if isinstance(other, str):
            raise SystemExit(f"cyclictest: {other}")
        if granted["degraded"]:
            print(f"degraded: {granted['degraded']}")
        period_us = 1000.0
        own, theirs = latency.figures(values, period_us), latency.figures_of_counts(*other, period_us)
        both = (("own", own), ("other", theirs))
        found.append({name: {"p50": w.p50, "p99": w.p99, "p99.9": w.p99_9, "max": w.max, "late": float(w.late)} for name, w in both})
    return found


def pooled(one: Iterable[float], other: Iterable[float]) -> float:
    """Counts are pooled over the pairs: a ratio of small numbers says nothing."""
    a, b = sum(one), sum(other)
    return a / b if b else (1.0 if a == 0 else float("inf"))


def print_rows(rows: list[Row]) -> None:
    """Medians with their spread, and whether must and aim are kept."""
    for row in rows:
        median = statistics.median(row.ratios)
        verdict = ""
        if row.must is not None and row.aim is not None:
            word = "aim" if median <= row.aim else "must" if median <= row.must else "MISSED"
            verdict = f"must {row.must:g} aim {row.aim:g}: {word}"
        print(f"{row.name:<46}{median:8.3f}  [{min(row.ratios):.3f} .. {max(row.ratios):.3f}]  {verdict}  {row.note}", flush=True)


def absolute(name: str, figures: Sequence[dict[str, float]]) -> None:
    """Medians over the pairs, in us."""
    cells = "  ".join(f"{k} {statistics.median(f[k] for f in figures):.1f}" for k in ("p50", "p99", "p99.9", "max"))
    print(f"  {name:<44}{cells} us", flush=True)


def wake_ups(pairs: int, seconds: float, cpu: int) -> None:
    """Sleeping and hybrid clock against cyclictest."""
    for name, spin_us, wanted in (
        ("sleeping", 0.0, {"p50": (1.5, 1.25), "p99": (1.25, 1.1), "p99.9": (1.5, 1.25)}),
        ("hybrid", 100.0, {"p99": (0.25, 0.05), "p99.9": (1.0, 0.7)}),
    ):
        found = against_cyclictest(pairs, seconds, cpu, spin_us)
        rows = [Row(f"{name} wake-up / cyclictest, {q}", [f["own"][q] / f["other"][q] for f in found], *bounds) for q, bounds in wanted.items()]
        late = [[f[who]["late"] for f in found] for who in ("own", "other")]
        rows.append(Row(f"{name}, late cycles / cyclictest's, pooled", [pooled(*late)], 1.25, 1.0, f"{sum(late[0]):g} : {sum(late[1]):g}"))
        print_rows(rows)
        absolute(f"{name} loop", [f["own"] for f in found])
        absolute("cyclictest", [f["other"] for f in found])


def priorities(pairs: int, seconds: float, cpu: int, workers: int) -> None:
    """FIFO against normal scheduling, half a period apart on one core, under load."""
    found = []
    with busy(workers) as what:
        for _ in range(pairs):
            normal, fifo = child("wait", seconds, cpu, HALF, 0), child("wait", seconds, cpu, 0.0)
            found.append((result(fifo), result(normal)))
    misses = [[pair[k]["misses"] for pair in found] for k in (0, 1)]
    counts = f"{sum(misses[0])} : {sum(misses[1])} of {sum(p[0]['cycles'] for p in found)}, with {what}"
    print_rows([
        Row("misses FIFO / normal, pooled", [pooled(*misses)], 0.2, 0.05, counts),
        Row("wake-up p99 FIFO / normal", [f["wake"]["p99"] / n["wake"]["p99"] for f, n in found], None, None),
    ])  # fmt: skip


def logging(pairs: int, seconds: float, cpu: int) -> None:
    """The whole cycle with and without its log, half a period apart on one core."""
    found = []
    for k in range(pairs):
        phases = (0.0, HALF) if k % 2 else (HALF, 0.0)
        logged, bare = (child(mode, seconds, cpu, phase) for mode, phase in zip(("logged", "bare"), phases, strict=True))
        found.append((result(logged), result(bare)))
    lost = sum(pair[0]["lost"] for pair in found)
    print_rows([
        Row("wake-up p99 with log / without", [a["wake"]["p99"] / b["wake"]["p99"] for a, b in found], 1.25, 1.1, f"{lost} records lost"),
        Row("whole cycle p50 with log / without", [a["cost"]["p50"] / b["cost"]["p50"] for a, b in found], None, None),
    ])  # fmt: skip


def cycles(pairs: int, seconds: float, cpu: int) -> None:
    """The whole cycle against the frozen one, half a period apart on one core."""
    found = []
    for k in range(pairs):
        phases = (0.0, HALF) if k % 2 else (HALF, 0.0)
        own, frozen = (child(mode, seconds, cpu, phase) for mode, phase in zip(("logged", "reference"), phases, strict=True))
        found.append((result(own), result(frozen)))
    quantiles = ("p50", "p99", "p99.9")
    print_rows([Row(f"whole cycle / frozen reference, {q}", [a["cost"][q] / b["cost"][q] for a, b in found], None, None) for q in quantiles])
    absolute("whole cycle with log (prototype p50 10-34, p99 41-105)", [f[0]["cost"] for f in found])
    absolute("frozen reference cycle", [f[1]["cost"] for f in found])


def hand_over(cpu: int, blocks: int = 60, size: int = 500) -> None:
    """What handing a record to the log costs the loop, back to back, with its priority."""
    nothing = {name: TOPICS[name].build(tuple(TOPICS[name].layout.unpack(bytes(TOPICS[name].layout.size))[1:])) for name in CYCLIC}
    control, timing, truth = (nothing[name] for name in CYCLIC[1:])
    bytes_of_all = sum(frames.SIZES)
    head = (frames.CYCLE, len(CYCLIC), 0, 0, bytes_of_all)
    frame = frames.FRAME.pack(*head) + bytes(bytes_of_all)
    scratch = bytearray(len(frame))
    whole, pack, hand = [], [], []
    now = time.perf_counter_ns
    unread = Ring(create(16 << 20))  # nobody reads it: it is emptied by hand
    with tempfile.TemporaryDirectory() as folder, RealTime(Wishes(PRIORITY, cpu)):
        recorder = Recorder(Path(folder) / "run.mcap", real_time=False)
        for k in range(blocks):
            time.sleep(0.02)  # the writer empties the ring
            messages = [NO_MEASUREMENT._replace(stamp_ns=(k * size + i) * PERIOD_NS) for i in range(size)]
            begin = now()
            for m in messages:
                recorder.record_cycle(m, control, timing, truth)
            whole.append((now() - begin) / size * 1e-3)
            begin = now()
            for m in messages:
                frames.pack_with_truth(scratch, 0, 0, 0, head, m, control, timing, truth)
            pack.append((now() - begin) / size * 1e-3)
            unread._words[TAIL] = unread._head
            begin = now()
            for _ in messages:
                unread.put(frame)
            hand.append((now() - begin) / size * 1e-3)
        recorder.close()
    verdict = "must 2: " + ("kept" if statistics.median(hand) <= 2.0 else "MISSED")
    fields = sum(len(TOPICS[name].flatten(nothing[name])) for name in CYCLIC)
    for name, figures, text in (
        (f"log hand-over, hot, a record of {len(frame)} B", hand, verdict),
        (f"  packing its {fields} fields", pack, ""),
        ("  both, as the loop calls it", whole, ""),
    ):
        print(f"{name:<46}{statistics.median(figures):8.2f} us  [{min(figures):.2f} .. {max(figures):.2f}]  {text}", flush=True)


PARTS = ("wake", "priority", "logging", "cycle", "hand-over")


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", help=f"of {', '.join(PARTS)}; all when left out")
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--cpu", type=int, default=default_cpu())
    parser.add_argument("--load", type=int, default=2, help="busy processes while FIFO is held against normal scheduling")
    options = parser.parse_args()
    wanted = options.parts or PARTS
    if unknown := set(wanted) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are: {', '.join(PARTS)}")
    print(f"punctuality: {options.pairs} pairs of {options.seconds:g} s at 1 kHz on core {options.cpu}, FIFO {PRIORITY}; {load()}", flush=True)
    sized = (options.pairs, options.seconds, options.cpu)
    if "hand-over" in wanted:
        hand_over(options.cpu)
    if "wake" in wanted:
        wake_ups(*sized)
    if "priority" in wanted:
        priorities(*sized, options.load)
    if "logging" in wanted:
        logging(*sized)
    if "cycle" in wanted:
        cycles(*sized)
    print(load())


if __name__ == "__main__":
    main()
