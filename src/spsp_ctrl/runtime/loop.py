"""The loop: tick -> read -> step -> write -> record, the same for every clock and every rig."""

from __future__ import annotations

import time
import traceback
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees
from typing import NamedTuple, Protocol

from spsp_ctrl.control.watch import Reason
from spsp_ctrl.messages import Command, Control, Measurement, Mode, OperatorRequest, Timing, Truth
from spsp_ctrl.rig.base import Rig
from spsp_ctrl.runtime.clock import Clock
from spsp_ctrl.runtime.cycle import Controller, CycleState, step
from spsp_ctrl.safety.faults import BY_ID, BY_NUMBER
from spsp_ctrl.safety.steps import LOST as STEPS_LOST
from spsp_ctrl.safety.steps import Means

OPERATOR_HZ = 50
STATUS_HZ = 5
READY = int(Mode.READY)
_EXCEPTION = BY_ID["exception"]
_new = tuple.__new__


class CycleRecorder(Protocol):
    """Where the records go. None of these may wait in real time, or raise."""

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        """One cycle."""
        ...

    def event(self, stamp_ns: int, level: str, id: str, text: str) -> None:
        """Something happened."""
        ...

    def operator(self, request: OperatorRequest) -> None:
        """The operator asked for something."""
        ...


class NullRecorder:
    """Records nothing."""

    def record_cycle(self, measurement: Measurement, control: Control, timing: Timing, truth: Truth | None) -> None:
        """Drop it."""

    def event(self, stamp_ns: int, level: str, id: str, text: str) -> None:
        """Drop it."""

    def operator(self, request: OperatorRequest) -> None:
        """Drop it."""


class Operator(Protocol):
    """The operator channel: keys of the live screen, signals, later a socket."""

    def poll(self, now_ns: int) -> tuple[OperatorRequest, ...]:
        """Requests since the last call, without waiting."""
        ...


StatusSink = Callable[[Measurement, Control, Timing, Truth | None], None]
"""Called a few times a second with what a live screen shows."""


@dataclass(slots=True)
class LoopResult:
    """How a loop ended."""

    ended: str
    """``completed``, ``interrupted``, ``fault: ID``, ``stopped: deadline missed`` or ``stopped: no log``."""
    cycles: int = 0
    last_ns: int = 0
    skipped: int = 0
    skipped_stamps_ns: array[int] = field(default_factory=lambda: array("q"))
    events: list[dict[str, object]] = field(default_factory=list)
    """All but the skips, of which a long run on a busy machine has many."""


class Policy(NamedTuple):
    """What ends a run under control, beside its duration, the operator and the faults."""

    stop_on_miss: bool = False
    """A cycle could not begin within its period."""
    stop_on_log_failure: bool = False
    """The log cannot be written any more."""


GO_ON = Policy()


class Interrupts:
    """Ctrl-C, SIGTERM and SIGHUP: the first asks for a controlled stop, the second ends at once."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, *_: object) -> None:
        """Signal handler."""
        self.count += 1


def run_loop(
    rig: Rig,
    clock: Clock,
    controller: Controller,
    state: CycleState,
    duration_ns: int,
    recorder: CycleRecorder,
    operator: Operator | None = None,
    status: StatusSink | None = None,
    interrupts: Interrupts | None = None,
    rate_hz: int = 1000,
    *,
    policy: Policy = GO_ON,
    log_problem: Callable[[], str] | None = None,
) -> LoopResult:
    """Run until ``duration_ns`` of control time has passed, then stop under control. Every exception ends in ``rig.stop()``.

    ``log_problem`` is asked now and then what is wrong with the log (empty: nothing).
    After the duration (or an interrupt) the platform is braked and disabled before the loop returns.
    """
    period_ns = round(1e9 / rate_hz)
    operator_every = max(1, rate_hz // OPERATOR_HZ)
    status_every = max(1, rate_hz // STATUS_HZ)
    result = LoopResult("completed")
    interrupts = interrupts or Interrupts()
    mode = -1
    law_step = 0
    step_alarms = 0
    last_ns = -period_ns
    ending = ""
    log_failed = False
    now = time.perf_counter_ns
    record_ns = 0
    line_notes = getattr(rig, "notes", None)

    def event(level: str, id: str, text: str, stamp_ns: int) -> None:
        if id != "skip":
            result.events.append({"stamp_ns": stamp_ns, "level": level, "id": id, "text": text})
        recorder.event(stamp_ns, level, id, text)

    try:
        clock.start()
        while True:
            cycle, now_ns, lateness_ns, skipped = clock.tick()
            begin = now()
            dt = (now_ns - last_ns) * 1e-9
            measurement = rig.read(now_ns)
            after_read = now()

            requests: tuple[OperatorRequest, ...] = ()
            if operator is not None and cycle % operator_every == 0:
                requests = operator.poll(now_ns)
            if not ending:
                if interrupts.count:
                    ending = "interrupted"
                elif now_ns >= duration_ns:
                    ending = "completed"
                elif skipped and policy.stop_on_miss and mode >= READY:
                    ending = "stopped: deadline missed"
                elif log_failed and policy.stop_on_log_failure:
                    ending = "stopped: no log"
                if ending:
                    requests = (*requests, OperatorRequest(now_ns, "stop", 0.0, ending))
            for request in requests:
                recorder.operator(request)
            control, state = step(state, controller, measurement, requests, now_ns, dt)
            after_control = now()

            sent: Command = rig.write(control.command, now_ns)
            if sent is not control.command:
                control = control._replace(command=sent)
            after_write = now()

            if line_notes is not None:
                for level, id, text in line_notes():
                    event(level, id, text, now_ns)
            if skipped:
                result.skipped += skipped
                result.skipped_stamps_ns.append(now_ns)
                event("warning", "skip", f"{skipped} cycle(s) skipped", now_ns)
            if log_problem is not None and not log_failed and cycle % operator_every == 0:
                problem = log_problem()
                if problem:
                    log_failed = True
                    then = "the platform is stopped" if policy.stop_on_log_failure else "control goes on without it"
                    event("error", "log-failed", f"the log is not complete: {problem}; {then}", now_ns)
            if control.law_step != law_step:
                law_step = control.law_step
                why = Reason(control.law_reason).name.lower()
                event("warning", "law-fallback", f"a plainer law has taken over ({why}); see control.watch in the rig file", now_ns)
            if state.steps.alarms != step_alarms:
                step_alarms = state.steps.alarms
                how = "heading against count" if state.steps.means == Means.HEADING else "zero switch"
                text = f"{STEPS_LOST.text} (seen by {how}, {degrees(abs(state.steps.size_rad)):.2f} deg). Check: {STEPS_LOST.check}"
                event("warning", STEPS_LOST.id, text, now_ns)
            if control.mode != mode:
                _report_mode(event, mode, control)
                mode = control.mode
            timing: Timing = _new(
                Timing,
                (
                    now_ns,
                    cycle,
                    lateness_ns,
                    skipped,
                    after_read - begin,
                    after_control - after_read,
                    after_write - after_control,
                    record_ns,
                    after_write - begin,
                ),
            )
            truth = rig.truth()
            before_record = now()
            recorder.record_cycle(measurement, control, timing, truth)
            record_ns = now() - before_record
            last_ns = now_ns
            result.cycles += 1
            if status is not None and cycle % status_every == 0:
                status(measurement, control, timing, truth)
            if interrupts.count > 1:
                ending = "interrupted"
                break
            if mode == Mode.FAULT and not ending and operator is None:
                break
            if ending and mode in (Mode.DISARMED, Mode.READY, Mode.FAULT):
                break
        rig.stop()
        result.ended = ending or "completed"
        if mode == Mode.FAULT and state.supervisor.fault is not None:
            result.ended = f"fault: {state.supervisor.fault.id}"
    except BaseException as error:
        rig.stop()
        text = f"{_EXCEPTION.text}: {error!r}"
        event("error", _EXCEPTION.id, text + "\n" + traceback.format_exc(), max(last_ns, 0))
        result.ended = f"fault: {_EXCEPTION.id}"
        if not isinstance(error, Exception):
            raise
    finally:
        result.last_ns = last_ns
    return result


def _report_mode(event: Callable[[str, str, str, int], None], before: int, control: Control) -> None:
    name = Mode(control.mode).name
    if control.fault and control.mode in (Mode.FAULT, Mode.STOPPING):
        fault = BY_NUMBER[control.fault]
        event("error", fault.id, f"{name}: {fault.text}. Check: {fault.check}", control.stamp_ns)
    else:
        text = name if before < 0 else f"{Mode(before).name} -> {name}"
        event("info", "mode", text, control.stamp_ns)
