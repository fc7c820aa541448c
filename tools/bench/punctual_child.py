"""One timed loop in a process of its own: ``python -m tools.bench.punctual_child JSON``. Writes its figures as JSON to standard output.

``phase`` places its wake-ups within the period on the clock that all processes share, so that two loops on one core do not stand in each other's way.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

from spsp_ctrl.runtime.clock import MonotonicClock
from spsp_ctrl.runtime.realtime import RealTime, Wishes

PERIOD_NS = 1_000_000
WARM_UP = 500


def quantiles(values: array[int]) -> dict[str, float]:
    """In us."""
    ordered = sorted(values)
    n = len(ordered)
    return {name: ordered[min(n - 1, int(q * n))] * 1e-3 for name, q in (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999), ("max", 1.0))}


def align(phase: float) -> None:
    """Return at the given phase of the period."""
    target = round(phase * PERIOD_NS)
    now = time.monotonic_ns()
    due = now - now % PERIOD_NS + target + 5 * PERIOD_NS
    while time.monotonic_ns() < due - 200_000:
        time.sleep(1e-4)
    while time.monotonic_ns() < due:
        pass


def timed(setup: dict[str, Any], work: Callable[[int, int], None]) -> dict[str, Any]:
    """Wake up, work, note; skip counting: a pause is one late wake-up."""
    clock = MonotonicClock(PERIOD_NS, spin_ns=round(setup["spin_us"] * 1e3))
    last = WARM_UP + round(setup["seconds"] * 1e9 / PERIOD_NS)
    late, cost = array("q"), array("q")
    misses = 0
    wishes = Wishes(setup["priority"], setup["cpu"]) if setup["priority"] else None
    with RealTime(wishes) as realtime:
        align(setup["phase"])
        clock.start()
        while True:
            cycle, now_ns, lateness_ns, skipped = clock.tick()
            begin = time.perf_counter_ns()
            work(cycle, now_ns)
            end = time.perf_counter_ns()
            if cycle >= last:
                break
            if cycle >= WARM_UP:
                late.append(lateness_ns + skipped * PERIOD_NS)
                cost.append(end - begin)
                misses += skipped > 0
    return {"wake": quantiles(late), "cost": quantiles(cost), "cycles": len(late), "misses": misses, "granted": realtime.granted}


def whole_cycle(setup: dict[str, Any]) -> dict[str, Any]:
    """The loop of the program on the virtual rig: read, judge, law, write, and the record, with or without a log behind it."""
    from spsp_ctrl.config.loader import load_rig, load_scenario
    from spsp_ctrl.messages import Timing
    from spsp_ctrl.plant.model import load_model
    from spsp_ctrl.recording.writer import Recorder
    from spsp_ctrl.rig.simulated import SimulatedRig
    from spsp_ctrl.runtime.cycle import controller, start, step
    from spsp_ctrl.runtime.loop import NullRecorder

    config_dir = Path(__file__).resolve().parents[2] / "config"
    config = load_rig(config_dir / "rig.yaml").model
    scenario = load_scenario(config_dir / "experiments" / "swing-2dof.yaml").model
    rig = SimulatedRig(config, load_model(config_dir / "model.yaml"), scenario, 1, real_time=True)
    rig.open()
    constants, state = controller(config), start(config, scenario.reference)
    before = -PERIOD_NS
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder) / "run.mcap", real_time=True) if setup["mode"] == "logged" else None
        sink = recorder or NullRecorder()

        def work(cycle: int, now_ns: int) -> None:
            nonlocal state, before
            measurement = rig.read(now_ns)
            control, state = step(state, constants, measurement, (), now_ns, (now_ns - before) * 1e-9)
            rig.write(control.command, now_ns)
            before = now_ns
            sink.record_cycle(measurement, control, Timing(now_ns, cycle, 0, 0, 0, 0, 0, 0, 0), rig.truth())

        result = timed(setup, work)
        if recorder is not None:
            stats = recorder.close()
            result |= {"records": stats.records, "lost": stats.lost}
    return result


def main() -> None:
    """Entry point."""
    setup = json.loads(sys.argv[1])
    if setup["mode"] == "wait":
        result = timed(setup, lambda cycle, now_ns: None)
    elif setup["mode"] == "reference":
        from tools.bench.reference_cycle import build

        reference = build()
        result = timed(setup, lambda cycle, now_ns: reference(cycle))
    else:
        result = whole_cycle(setup)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
