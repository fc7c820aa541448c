"""How punctual this machine is: the clock of the loop against ``cyclictest`` on the same core at the same time.

``python -m spsp_ctrl.runtime.latency`` is the measuring process: it loads nothing that computes beside the loop, and writes what it has seen to
standard output. Lateness is counted as ``cyclictest`` counts it: a pause over several periods is *one* late wake-up, its whole length.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from array import array
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from spsp_ctrl.runtime.clock import MonotonicClock
from spsp_ctrl.runtime.realtime import RealTime, Wishes

HISTOGRAM_US = 20_000
GOOD, USABLE, FAILED = "good", "usable", "failed"
WARM_UP_S = 0.2
Counts = dict[int, int]
"""Wake-ups by whole microseconds of lateness."""


class Limits(NamedTuple):
    """A verdict needs p99 and misses within these; ``usable`` has its own, wider ones."""

    p99_share: float = 0.1
    """p99 of the lateness in periods."""
    misses: float = 1e-4
    """Wake-ups later than a whole period, as a share of all."""
    usable_p99_share: float = 0.25
    usable_misses: float = 5e-3


class Setup(NamedTuple):
    """What is measured."""

    seconds: float
    rate_hz: int
    cpu: int
    priority: int = 50
    spin_us: float = 0.0
    real_time: bool = True


@dataclass(frozen=True, slots=True)
class Wake:
    """Figures of the wake-ups of one program, in us."""

    count: int
    p50: float
    p99: float
    p99_9: float
    max: float
    late: int
    """Wake-ups later than a whole period."""

    @property
    def miss_rate(self) -> float:
        """Share of the late ones."""
        return self.late / self.count if self.count else 0.0


def figures(values_us: list[float], period_us: float) -> Wake:
    """From single values."""
    ordered = sorted(values_us)
    n = len(ordered)
    if not n:
        return Wake(0, 0.0, 0.0, 0.0, 0.0, 0)
    p50, p99, p99_9 = (ordered[min(n - 1, int(share * n))] for share in (0.5, 0.99, 0.999))
    return Wake(n, p50, p99, p99_9, ordered[-1], sum(v > period_us for v in ordered))


def figures_of_counts(counts: Counts, longest_us: float, period_us: float) -> Wake:
    """From counts by whole microseconds; each stands in the middle of its bin."""
    n = sum(counts.values())
    if not n:
        return Wake(0, 0.0, 0.0, 0.0, 0.0, 0)
    found: list[float] = []
    passed = 0
    wanted = [min(n - 1, int(share * n)) for share in (0.5, 0.99, 0.999)]
    for value in sorted(counts):
        passed += counts[value]
        while len(found) < 3 and passed > wanted[len(found)]:
            found.append(min(value + 0.5, longest_us))
    p50, p99, p99_9 = found
    return Wake(n, p50, p99, p99_9, longest_us, sum(c for v, c in counts.items() if v >= period_us))


def verdict(wake: Wake, period_us: float, limits: Limits) -> str:
    """``good``, ``usable`` or ``failed``."""
    share = wake.p99 / period_us
    if share <= limits.p99_share and wake.miss_rate <= limits.misses:
        return GOOD
    if share <= limits.usable_p99_share and wake.miss_rate <= limits.usable_misses:
        return USABLE
    return FAILED


def measure_here(setup: Setup) -> tuple[array[int], dict[str, Any]]:
    """Lateness of each wake-up in ns (a skip counts with its whole length), and what was granted. In this process."""
    period_ns = round(1e9 / setup.rate_hz)
    clock = MonotonicClock(period_ns, spin_ns=round(min(setup.spin_us * 1e3, 0.4 * period_ns)))
    first = round(WARM_UP_S * setup.rate_hz)
    last = first + round(setup.seconds * setup.rate_hz)
    found = array("q", bytes(8 * (last - first)))
    n = 0
    with RealTime(Wishes(setup.priority, setup.cpu) if setup.real_time else None) as real_time:
        clock.start()
        while True:
            cycle, _, lateness_ns, skipped = clock.tick()
            if cycle >= last:
                break
            if cycle >= first:
                found[n] = lateness_ns + skipped * period_ns
                n += 1
    return found[:n], real_time.granted


def start(setup: Setup) -> subprocess.Popen[bytes]:
    """The measuring process."""
    command = [sys.executable, "-m", "spsp_ctrl.runtime.latency", json.dumps(setup._asdict())]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def collect(process: subprocess.Popen[bytes]) -> tuple[list[float], dict[str, Any]]:
    """What the measuring process has seen, in us, and what was granted."""
    out, err = process.communicate()
    if process.returncode:
        raise RuntimeError(f"the measuring process ended with {process.returncode}: {err.decode(errors='replace').strip()[-300:]}")
    head, _, data = out.partition(b"\n")
    values = array("q", data)
    return [v * 1e-3 for v in values], json.loads(head)


def start_cyclictest(setup: Setup) -> subprocess.Popen[bytes] | str:
    """``cyclictest`` on the same core, one FIFO level above (so that it wins ties); or why not."""
    program = shutil.which("cyclictest")
    if program is None:
        return "not installed (Debian and Ubuntu: package rt-tests)"
    interval_us = round(1e6 / setup.rate_hz)
    loops = round(setup.seconds * setup.rate_hz)
    command = [
        program, "-q", "-m", "-t1", f"-a{setup.cpu}", f"-p{setup.priority + 1 if setup.real_time else 0}",
        f"-i{interval_us}", f"-l{loops}", f"-h{HISTOGRAM_US}",
    ]  # fmt: skip
    try:
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    except OSError as error:
        return f"cannot be started: {error.strerror}"


def collect_cyclictest(process: subprocess.Popen[bytes] | str) -> tuple[Counts, float] | str:
    """Its histogram and its longest latency in us, or why there is none."""
    if isinstance(process, str):
        return process
    out, err = process.communicate()
    text = out.decode(errors="replace")
    if process.returncode or "Max Latencies" not in text:
        complaint = err.decode(errors="replace").strip() or text.strip() or f"exit {process.returncode}"
        return f"failed: {complaint.splitlines()[-1]}"
    return parse_cyclictest(text)


def parse_cyclictest(text: str) -> tuple[Counts, float]:
    """Histogram and longest latency from the output of ``cyclictest -q -h``. What lies beyond the histogram stands at the longest."""
    counts = {int(us): int(n) for us, n in re.findall(r"^(\d+)\s+(\d+)\s*$", text, re.M) if int(n)}
    longest = _numbers(text, "Max Latencies")
    beyond = _numbers(text, "Histogram Overflows")
    if beyond and beyond[0]:
        counts[longest[0]] = counts.get(longest[0], 0) + beyond[0]
    return counts, float(longest[0])


def _numbers(text: str, name: str) -> list[int]:
    found = re.search(rf"^# {name}:\s*([\d ]+)$", text, re.M)
    return [int(n) for n in found[1].split()] if found else [0]


def summarise(
    setup: Setup, limits: Limits, values_us: list[float], granted: Mapping[str, Any], other: tuple[Counts, float] | str
) -> dict[str, Any]:
    """The result as it is printed with ``--json``."""
    period_us = 1e6 / setup.rate_hz
    own = figures(values_us, period_us)
    result: dict[str, Any] = {
        "verdict": verdict(own, period_us, limits),
        "setup": setup._asdict(),
        "limits": limits._asdict() | {"p99_us": limits.p99_share * period_us, "usable_p99_us": limits.usable_p99_share * period_us},
        "own": asdict(own) | {"miss_rate": own.miss_rate},
        "granted": dict(granted),
    }
    if isinstance(other, str):
        result["cyclictest"] = {"absent": other}
    else:
        theirs = figures_of_counts(*other, period_us)
        result["cyclictest"] = asdict(theirs) | {"miss_rate": theirs.miss_rate}
        result["ratio"] = {k: getattr(own, k) / getattr(theirs, k) for k in ("p50", "p99", "p99_9", "max") if getattr(theirs, k) > 0.0}
    return result


def run(
    setup: Setup, compare: bool, wait: Callable[[subprocess.Popen[bytes]], None] = lambda process: None
) -> tuple[list[float], dict[str, Any], tuple[Counts, float] | str]:
    """Both programs side by side; ``wait`` may show progress until the measuring process has ended its time."""
    other: subprocess.Popen[bytes] | str = start_cyclictest(setup) if compare else "not asked for"
    own = start(setup)
    try:
        wait(own)
        values, granted = collect(own)
        return values, granted, collect_cyclictest(other)
    finally:
        for process in (own, other):
            if not isinstance(process, str) and process.poll() is None:
                process.kill()
                process.communicate()


def default_cpu() -> int:
    """The last core this process may use: interrupts are served by the first ones as a rule."""
    return max(os.sched_getaffinity(0))


def main() -> None:
    """The measuring process."""
    setup = Setup(**json.loads(sys.argv[1]))
    values, granted = measure_here(setup)
    sys.stdout.buffer.write(json.dumps(granted).encode() + b"\n" + values.tobytes())


if __name__ == "__main__":
    main()
