"""Wall time of ``spsp-ctrl experiment all``. Prints the load of the machine beside it; target: 120 s on 2 otherwise idle cores.

``python tools/bench/bench_experiments.py [--runs N] [--jobs N]``
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TARGET_S = 120.0


def main() -> None:
    """Run, time, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_known_args()[0]
    walls = []
    for _ in range(options.runs):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "spsp_ctrl.cli", "experiment", "all", "--out", str(Path(folder) / "all"), "--no-logs"]
            before = os.times()
            start = time.perf_counter()
            done = subprocess.run([*command, "--jobs", str(options.jobs)], stdout=subprocess.DEVNULL, check=False)
            walls.append(time.perf_counter() - start)
            after = os.times()
            used = after.children_user + after.children_system - before.children_user - before.children_system
            if done.returncode:
                sys.exit(f"the experiments ended with {done.returncode}")
        load = os.getloadavg()[0]
        print(f"experiment all: {walls[-1]:.0f} s wall, {used:.0f} s of processor time, {options.jobs} processes, load {load:.1f} at its end")
    median = statistics.median(walls)
    print(f"median of {len(walls)}: {median:.0f} s, {median / TARGET_S:.2f} of the target of {TARGET_S:.0f} s")


if __name__ == "__main__":
    main()
