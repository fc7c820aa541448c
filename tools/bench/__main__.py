"""``python -m tools.bench [NAME ...]``: run the benchmarks; without a name all but ``experiments``, which takes minutes."""

from __future__ import annotations

import sys

from tools.bench import axis, bench_experiments, effects, loop, monte_carlo

BENCHES = {"loop": loop.main, "effects": effects.main, "axis": axis.main, "monte_carlo": monte_carlo.main, "experiments": bench_experiments.main}


def main() -> None:
    """Entry point."""
    wanted = sys.argv[1:] or [name for name in BENCHES if name != "experiments"]
    for name in wanted:
        if name not in BENCHES:
            raise SystemExit(f"no benchmark {name!r}; there are: {', '.join(BENCHES)}")
        BENCHES[name]()


if __name__ == "__main__":
    main()
