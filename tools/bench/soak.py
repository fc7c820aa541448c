"""A long run in real time under load: is memory flat, do the counters agree, is the log whole?

``python -m tools.bench.soak [--minutes 30] [--load 2] [--out DIR]``; the load is ``stress-ng`` where it is installed, else loops of Python; nice 19.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message

from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.experiments.session import interruptible, spin_ns, wishes
from spsp_ctrl.messages import Control, Measurement, Mode, Timing, Truth
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.recording.reader import records
from spsp_ctrl.recording.schema import CYCLIC, TOPICS
from spsp_ctrl.recording.writer import Recorder
from spsp_ctrl.rig.simulated import SimulatedRig
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.clock import MonotonicClock
from spsp_ctrl.runtime.loop import run_loop
from spsp_ctrl.runtime.realtime import RealTime

CONFIG = Path(__file__).resolve().parents[2] / "config"
WARM_UP_SHARE, WARM_UP_S = 0.2, 60.0
LIMIT_KIB = 1024.0
BLOCK_KIB = 64.0 / 1024.0
"""A block of Python's allocator: a float takes 24 bytes, the tuples of a cycle 100 to 300."""
PAGE_KIB = os.sysconf("SC_PAGE_SIZE") // 1024


@contextmanager
def load(workers: int) -> Iterator[str]:
    """So many busy processes at nice 19 for the time of the block."""
    stress = shutil.which("stress-ng")
    commands = [[stress, "--cpu", str(workers), "--quiet"]] if stress else [[sys.executable, "-c", "while True: pass"]] * workers
    processes = [subprocess.Popen(["nice", "-n", "19", *command]) for command in commands if workers]
    try:
        yield f"{workers} x {'stress-ng --cpu' if stress else 'a loop of Python'}, nice 19"
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def resident_kib(pid: int | str = "self") -> int:
    """Private memory of a process in RAM: what it shares (the ring, the libraries) is counted apart by the kernel."""
    fields = Path(f"/proc/{pid}/statm").read_text().split()
    return (int(fields[1]) - int(fields[2])) * PAGE_KIB


_MALL_INFO = ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost")


class _MallInfo(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in _MALL_INFO]


# once: every CDLL makes a class, and what a class leaves behind is not collected while the loop runs
_mallinfo = ctypes.CDLL(None).mallinfo2
_mallinfo.restype = _MallInfo


def allocated_kib() -> float:
    """What this process has asked of the C allocator and not given back: with touched memory a leak would stay below the resident size for long."""
    return float(_mallinfo().uordblks) / 1024.0


def soak(seconds: float, folder: Path, workers: int) -> dict[str, Any]:
    """Run, then read the log; the figures, with a list of what is not as it should be under ``wrong``."""
    config = load_rig(CONFIG / "rig.yaml").model
    scenario = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model
    rig = SimulatedRig(config, load_model(CONFIG / "model.yaml"), scenario, 1, real_time=True)
    rig.open()
    recorder = Recorder(folder / "run.mcap", real_time=True, metadata={"run": {"kind": "soak"}})
    clock = MonotonicClock(round(1e9 / config.rate_hz), spin_ns=spin_ns(config))
    samples: list[tuple[float, int, int, float, float]] = []
    writer = recorder.pid
    active = 0

    def look(measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        nonlocal active
        active += control.mode == Mode.ACTIVE
        if not samples or measurement.stamp_ns * 1e-9 - samples[-1][0] >= max(1.0, seconds / 600.0):
            samples.append((measurement.stamp_ns * 1e-9, resident_kib(), resident_kib(writer), allocated_kib(), sys.getallocatedblocks() * BLOCK_KIB))

    gc.collect()
    begin = time.monotonic()
    load_before = os.getloadavg()[0]
    with load(workers) as what, interruptible() as interrupts, RealTime(wishes(config.realtime)) as realtime:
        result = run_loop(
            rig,
            clock,
            cycle.controller(config),
            cycle.start(config, scenario.reference),
            round(seconds * 1e9),
            recorder,
            status=look,
            interrupts=interrupts,
            rate_hz=config.rate_hz,
            log_problem=lambda: recorder.problem,
        )
    wall_s = time.monotonic() - begin
    load_after = os.getloadavg()[0]
    stats = recorder.close()
    log = read_back(folder / "run.mcap")
    warm = min(WARM_UP_S, WARM_UP_SHARE * seconds)
    steady = [s for s in samples if s[0] >= warm]
    growth = [float(max(s[k] for s in steady) - steady[0][k]) for k in (1, 2, 3, 4)] if steady else [float("nan")] * 4
    figures: dict[str, Any] = {
        "seconds": seconds,
        "wall_s": wall_s,
        "ended": result.ended,
        "load": what,
        "load_average": [load_before, load_after],
        "granted": realtime.granted,
        "cycles": result.cycles,
        "skipped": result.skipped,
        "skip_events": len(result.skipped_stamps_ns),
        "records": stats.records,
        "lost": stats.lost,
        "problem": stats.problem,
        "active_looks": active,
        "growth_kib": {"controller": growth[0], "log writer": growth[1], "C heap in use": growth[2], "Python objects": growth[3]},
        "memory_kib": {"controller": steady[0][1], "log writer": steady[0][2]} if steady else {},
        "log": log,
        "log_mib": (folder / "run.mcap").stat().st_size / 2**20,
    }
    figures["wrong"] = judge(figures, seconds, config.rate_hz)
    return figures


def read_back(path: Path) -> dict[str, Any]:
    """Counts and continuity of the log, read record by record (a long log does not fit into memory)."""
    channels: dict[int, str] = {}
    count: Counter[str] = Counter()
    gaps = disorder = skipped = 0
    last: dict[str, tuple[int, int]] = {}
    lateness: list[int] = []
    compute: list[int] = []
    problem, cycle_at = "", -1
    for record in records(path):
        if isinstance(record, str):
            problem = record
        elif isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            topic = channels[record.channel_id]
            count[topic] += 1
            if topic in CYCLIC:
                sequence, stamp = last.get(topic, (-1, -1))
                gaps += record.sequence != sequence + 1
                disorder += record.log_time <= stamp
                last[topic] = (record.sequence, record.log_time)
                if topic == "/timing":
                    timing = TOPICS[topic].decode(record.data)
                    skipped += timing.skipped
                    cycle_at = timing.cycle
                    lateness.append(timing.lateness_ns)
                    compute.append(timing.compute_ns)
    return {
        "problem": problem,
        "messages": dict(count),
        "gaps": gaps,
        "out_of_order": disorder,
        "skipped": skipped,
        "last_cycle": cycle_at,
        "lateness_us": quantiles(lateness),
        "compute_us": quantiles(compute),
    }


def quantiles(values_ns: list[int]) -> dict[str, float]:
    """p50, p99, p99.9 and max in us."""
    ordered = sorted(values_ns)
    if not ordered:
        return {}
    shares = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
    return {name: ordered[min(len(ordered) - 1, int(q * len(ordered)))] * 1e-3 for name, q in shares.items()}


def judge(f: dict[str, Any], seconds: float, rate_hz: int) -> list[str]:
    """What is not as it should be."""
    wrong = []
    log, messages = f["log"], f["log"]["messages"]

    def hold(condition: bool, text: str) -> None:
        if not condition:
            wrong.append(text)

    hold(f["ended"] == "completed", f"ended: {f['ended']}")
    hold(f["lost"] == 0 and not f["problem"], f"{f['lost']} records lost ({f['problem']})")
    hold(log["problem"] == "", f"the log: {log['problem']}")
    hold(all(messages.get(topic) == f["cycles"] for topic in CYCLIC), f"cycles {f['cycles']}, messages {messages}")
    hold(sum(messages.values()) == f["records"], f"records {f['records']}, messages {sum(messages.values())}")
    hold(log["gaps"] == log["out_of_order"] == 0, f"{log['gaps']} gaps, {log['out_of_order']} out of order")
    hold(log["skipped"] == f["skipped"], f"skipped {f['skipped']}, in the log {log['skipped']}")
    hold(f["cycles"] + f["skipped"] == log["last_cycle"] + 1, f"cycles {f['cycles']} + skipped {f['skipped']}, last cycle {log['last_cycle']}")
    hold(log["last_cycle"] >= seconds * rate_hz, f"last cycle {log['last_cycle']}")
    for name, growth in f["growth_kib"].items():
        hold(growth < LIMIT_KIB, f"memory of the {name} grew by {growth:.0f} KiB")
    hold(f["active_looks"] > 0, "never ACTIVE")
    return wrong


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--load", type=int, default=os.cpu_count() or 2)
    parser.add_argument("--out", type=Path, help="keep the log in this folder")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        figures = soak(options.minutes * 60.0, folder, options.load)
    print(json.dumps(figures, indent=2))
    print("\n".join(figures["wrong"]) or "all as it should be")
    raise SystemExit(1 if figures["wrong"] else 0)


if __name__ == "__main__":
    main()
