"""Fire at every target and print one line for each: ``python -m tools.fuzz --shots 1000000 [--only NAME] [--seed 1]``."""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from math import sqrt
from random import Random

from tools.fuzz.devices import device_targets
from tools.fuzz.hosts import EXPECTED, Target, accepted, host_targets


def fire(target: Target, shots: int, seed: int) -> int:
    """Number of exceptions that escaped; the first is printed with the shot that found it."""
    rng = Random(seed)
    escaped = 0
    for number in range(shots):
        try:
            target.shot(rng)
        except Exception:
            escaped += 1
            if escaped == 1:
                print(f"{target.name}: shot {number} of seed {seed}", file=sys.stderr)
                traceback.print_exc()
    return escaped


def main() -> int:
    """Exit code 1 when a promise is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shots", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    bad = 0
    print(f"{'target':28} {'shots':>9} {'exceptions':>10} {'wrong':>6} {'samples':>9} {'lost':>6} {'both':>5} {'us/shot':>8}")
    for target in [*host_targets(), *device_targets()]:
        if given.only not in target.name:
            continue
        start = time.perf_counter()
        escaped = fire(target, given.shots, given.seed)
        each = (time.perf_counter() - start) / given.shots * 1e6
        c = target.count
        counts = f"{c['wrong']:6} {c['samples']:9} {c['lost']:6} {c['both lost']:5}"
        print(f"{target.name:28} {given.shots:9} {escaped:10} {counts} {each:8.1f}", flush=True)
        for text in [t for t in c if t.startswith("wrong: ")]:
            print(f"    {text}")
        bad += escaped + c["wrong"]
    for kind, share in EXPECTED.items():
        if given.only not in kind:
            continue
        passed, mean = accepted(kind, given.shots, given.seed), given.shots * share
        sigmas = (passed - mean) / sqrt(mean)
        print(f"{kind}: {passed} of {given.shots} contents by chance pass the checksum; theory {mean:.1f}; {sigmas:+.2f} sigma")
        bad += abs(sigmas) > 5.0
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
