"""What the benchmarks share."""

from __future__ import annotations

import gc
import os
import statistics
import time
from collections.abc import Callable, Sequence


def reference_s() -> float:
    """A fixed piece of pure Python (float arithmetic in a loop), timed now: how fast this machine is at this moment."""
    best = float("inf")
    for _ in range(3):
        begin = time.perf_counter()
        x = 0.0
        for i in range(200_000):
            x += i * 0.5
        best = min(best, time.perf_counter() - begin)
    return best


def repeated(work: Callable[[], float], runs: int = 5) -> tuple[list[float], list[float]]:
    """Figures of ``runs`` calls after one that is not counted, each with the reference timed right before it."""
    work()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        references, figures = [], []
        for _ in range(runs):
            references.append(reference_s())
            figures.append(work())
    finally:
        gc.enable()
        gc.unfreeze()
    return figures, references


def line(name: str, figures: Sequence[float], unit: str, target: str = "") -> str:
    """Median and spread."""
    text = f"{name:<52} {statistics.median(figures):9.3g} {unit:<8} [{min(figures):.3g} .. {max(figures):.3g}]"
    return f"{text}  target {target}" if target else text


def load() -> str:
    """Load of the machine, for the record."""
    return f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} processors"
