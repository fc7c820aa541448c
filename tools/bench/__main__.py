"""``python -m tools.bench [NAME ...]``: run the benchmarks (all by default)."""

from __future__ import annotations

import sys

from tools.bench import effects, loop

BENCHES = {"loop": loop.main, "effects": effects.main}


def main() -> None:
    """Entry point."""
    wanted = sys.argv[1:] or list(BENCHES)
    for name in wanted:
        if name not in BENCHES:
            raise SystemExit(f"no benchmark {name!r}; there are: {', '.join(BENCHES)}")
        BENCHES[name]()


if __name__ == "__main__":
    main()
