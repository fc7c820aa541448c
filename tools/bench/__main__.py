"""``python -m tools.bench [NAME ...]``: run the benchmarks; without a name all but ``experiments``, ``punctual`` and
``soak``, which take minutes."""

from __future__ import annotations

import sys

from tools.bench import axis, bench_experiments, effects, loop, monte_carlo, punctual, soak

BENCHES = {"loop": loop.main, "effects": effects.main, "axis": axis.main, "monte_carlo": monte_carlo.main, "experiments": bench_experiments.main}
LONG = {"punctual": punctual.main, "soak": soak.main}
"""These take their own arguments, and minutes; only when named alone."""


def main() -> None:
    """Entry point."""
    if sys.argv[1:2] and sys.argv[1] in LONG:
        LONG[sys.argv.pop(1)]()
        return
    wanted = sys.argv[1:] or [name for name in BENCHES if name != "experiments"]
    for name in wanted:
        if name not in BENCHES:
            raise SystemExit(f"no benchmark {name!r}; there are: {', '.join([*BENCHES, *LONG])}")
        BENCHES[name]()


if __name__ == "__main__":
    main()
