"""Replay: recorded inputs through the same law, commands compared bit for bit.

With the law's own digest in the log equal to that of this program every difference counts. With another digest the comparison is
to 1e-9 relative, and the result says so.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.messages import Command, Control, Measurement, Mode, OperatorRequest
from spsp_ctrl.runtime import cycle

RELATIVE = 1e-9


@dataclass(frozen=True, slots=True)
class Difference:
    """The first place where recorded and replayed differ."""

    time_s: float
    cycle: int
    signal: str
    recorded: float
    replayed: float

    def __str__(self) -> str:
        return (
            f"first difference at {self.time_s:.3f} s (cycle {self.cycle}) in {self.signal}: "
            f"recorded {self.recorded!r}, replayed {self.replayed!r}"
        )


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """Outcome of a replay."""

    cycles: int
    active_cycles: int
    differing_cycles: int
    first: Difference | None
    exact: bool
    """True: compared bit for bit; False: to 1e-9, since the log comes from another build of the law."""
    log_problem: str = ""
    """Why the log could not be read to its end; empty for a complete log."""

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return asdict(self)


def replay(
    config: RigConfig,
    scenario: Scenario,
    records: Iterable[tuple[Measurement, Control]],
    requests: Iterable[OperatorRequest],
    *,
    exact: bool,
    progress: Callable[[int], None] = lambda cycles: None,
) -> ReplayResult:
    """Feed recorded measurements and operator requests to a fresh controller and compare commands, mode and fault."""
    by_stamp: defaultdict[int, list[OperatorRequest]] = defaultdict(list)
    for request in requests:
        by_stamp[request.stamp_ns].append(request)
    controller = cycle.controller(config)
    state = cycle.start(config, scenario.reference)
    last_ns = -round(1e9 / config.rate_hz)
    first: Difference | None = None
    cycles = active = differing = 0
    for measurement, recorded in records:
        now_ns = measurement.stamp_ns
        dt = (now_ns - last_ns) * 1e-9
        last_ns = now_ns
        control, state = cycle.step(state, controller, measurement, tuple(by_stamp.pop(now_ns, ())), now_ns, dt)
        difference = _compare(recorded, control, exact)
        if difference is not None:
            differing += 1
            first = first or difference
        cycles += 1
        active += recorded.mode == Mode.ACTIVE
        if cycles % 1000 == 0:
            progress(cycles)
    return ReplayResult(cycles, active, differing, first, exact)


def _compare(recorded: Control, replayed: Control, exact: bool) -> Difference | None:
    if recorded.command == replayed.command and recorded.mode == replayed.mode and recorded.fault == replayed.fault:
        return None
    pairs: list[tuple[str, float, float]] = [("mode", recorded.mode, int(replayed.mode)), ("fault", recorded.fault, replayed.fault)]
    pairs += [
        (f"command.{name}", a, b)
        for name, a, b in zip(Command._fields, recorded.command, replayed.command, strict=True)
    ]
    for name, a, b in pairs:
        if a == b or (not exact and abs(a - b) <= RELATIVE * max(abs(a), abs(b))):
            continue
        return Difference(recorded.stamp_ns * 1e-9, recorded.cycle, name, float(a), float(b))
    return None
