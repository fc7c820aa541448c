"""Wall time of the tolerance Monte Carlo: 10^6 units of Table 4 over 9 x 9 poses. ``python -m tools.bench.monte_carlo``"""

from __future__ import annotations

import os
import statistics
import time
from math import degrees, radians
from pathlib import Path

from spsp_ctrl.config.loader import load_tolerances
from spsp_ctrl.mechanism.tolerance import Poses, attitude_matrix, monte_carlo, tolerances_of

UNITS, TARGET_S = 1_000_000, 20.0
LENGTHS_M, LIMIT_RAD = (0.2655, 0.1, 0.1), radians(20.0)
SETS = Path(__file__).parents[2] / "config/tolerances"


def main() -> None:
    """Median of five, with the load that stood on the machine."""
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; target {TARGET_S:g} s for {UNITS} units")
    for name in ("table4", "hinges"):
        times = []
        for seed in range(5):
            start = time.perf_counter()
            tolerances = tolerances_of(load_tolerances(SETS / f"{name}.yaml").model, LENGTHS_M)
            matrix = attitude_matrix(tolerances, Poses.grid(LIMIT_RAD, LIMIT_RAD, 9), LENGTHS_M)
            made = monte_carlo(matrix, tolerances, UNITS, seed)
            times.append(time.perf_counter() - start)
        median = statistics.median(times)
        worst = degrees(made.worst_rad[-1]) * 60.0
        print(f"{name}: {len(tolerances)} errors, median {median:.2f} s ({median / TARGET_S:.3f} of the target), worst unit {worst:.2f} arcmin")


if __name__ == "__main__":
    main()
