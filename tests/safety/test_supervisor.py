"""The supervisor, walked exhaustively: every state and input that matters, checked against its promises."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from itertools import product

import pytest

from spsp_ctrl.messages import Mode
from spsp_ctrl.safety import supervisor
from spsp_ctrl.safety.faults import BY_ID, BY_NUMBER, FAULTS, FaultClass, Reaction, graver
from spsp_ctrl.safety.supervisor import NOT_HOMING, START, Homing, SupervisorParams, SupervisorState, step

PARAMS = SupervisorParams(False, 0.01, 1.0, 0.1, 0.5, homing_timeout_s=0.8)
DT = 0.1
NOTE, SOFT, QUICK, HARD = BY_ID["derating"], BY_ID["imu-stale"], BY_ID["rod-travel"], BY_ID["resolver-fault"]
VERBS = [frozenset(v) for v in ((), ("arm",), ("stop",), ("reset",), ("home",), ("disarm",), ("arm", "stop"), ("home", "stop"), ("arm", "reset"))]
HOMINGS = (NOT_HOMING, Homing(True, False), Homing(False, True))
MOVING = (Mode.HOMING, Mode.ALIGNING, Mode.ACTIVE, Mode.STOPPING)
DRIVEN = (Mode.HOMING, Mode.ALIGNING, Mode.ACTIVE)


def rounded(state: SupervisorState) -> SupervisorState:
    """The same state for the machine: times only count up to their limits."""
    return state._replace(
        in_mode_s=min(round(state.in_mode_s, 1), 1.2), held_s=min(round(state.held_s, 1), 0.4), absent_s=min(round(state.absent_s, 1), 0.9)
    )


def promises(p: SupervisorParams, state: SupervisorState, after: SupervisorState, fault: object, verbs: frozenset[str], homing: Homing) -> None:
    moving_before, moving_after = state.mode in MOVING, after.mode in MOVING
    # nothing begins to move without a fresh request, and never in a cycle with a fault
    if moving_after and not moving_before:
        wanted = {"arm"} if after.mode == Mode.ALIGNING else {"arm", "home"}
        assert state.mode in (Mode.READY, Mode.DISARMED)
        assert verbs & wanted
        assert not verbs & {"stop", "disarm"}
        assert fault is None
        assert after.mode == Mode.HOMING or (state.mode == Mode.READY and after.mode == Mode.ALIGNING)
    # a fault that cannot be braked through frees the drives in the same cycle, one that can brakes
    if fault is HARD:
        assert not moving_after
    if fault in (SOFT, QUICK) and state.mode in DRIVEN:
        assert after.mode == Mode.STOPPING
        assert after.fault is fault
    # a note never ends a motion
    if fault is NOTE and state.mode == Mode.ACTIVE and not verbs & {"stop", "disarm"}:
        assert after.mode == Mode.ACTIVE or after.fault in (BY_ID["attitude-lost"], BY_ID["operator-absent"])
    # a stop request is never ignored by a moving rig
    if verbs & {"stop", "disarm"} and state.mode in DRIVEN:
        assert after.mode in (Mode.STOPPING, Mode.FAULT)
    # the first cause is kept until a reset, and only a reset without a present fault releases
    if state.fault is not None and state.mode in (Mode.FAULT, Mode.STOPPING) and "reset" not in verbs:
        assert after.fault == state.fault
    if state.mode == Mode.FAULT and after.mode != Mode.FAULT:
        assert "reset" in verbs
        assert fault is None
        assert after.mode == Mode.DISARMED
        assert after.fault is None
    if after.mode == Mode.FAULT:
        assert after.fault is not None
    if after.mode in (Mode.READY, Mode.ALIGNING, Mode.ACTIVE):
        assert after.fault is None
        assert after.homed or not p.homing
    # ready only through good signals, homed only by finding
    if after.mode == Mode.READY:
        assert fault is None or state.mode != Mode.DISARMED
    if after.homed and not state.homed:
        assert homing.found
        assert state.mode == Mode.HOMING
    if after.mode == Mode.HOMING:
        assert p.homing
    # braking, aligning and homing end in time
    if after.mode == Mode.STOPPING:
        assert after.in_mode_s <= p.stop_timeout_s + DT
    if after.mode == Mode.ALIGNING:
        assert after.in_mode_s <= p.align_timeout_s + DT
    if after.mode == Mode.HOMING:
        assert after.in_mode_s <= p.homing_timeout_s + DT
    if after.mode in DRIVEN:
        assert after.absent_s <= p.operator_timeout_s + 1e-9


@pytest.mark.parametrize("p", [PARAMS, replace(PARAMS, homing=True), replace(PARAMS, operator_timeout_s=0.6)], ids=["plain", "homing", "operator"])
def test_every_reachable_state_keeps_the_promises(p: SupervisorParams) -> None:
    seen = {START}
    queue = deque([START])
    edges = set()
    while queue:
        state = queue.popleft()
        homings = HOMINGS if state.mode == Mode.HOMING else HOMINGS[:1]
        for fault, tilt, speed, verbs, homing in product((None, NOTE, SOFT, QUICK, HARD), (0.0, 0.2), (0.0, 0.02), VERBS, homings):
            after = step(state, p, fault, tilt, speed, verbs, DT, homing)
            promises(p, state, after, fault, verbs, homing)
            edges.add((state.mode, after.mode))
            key = rounded(after)
            if key not in seen:
                seen.add(key)
                queue.append(key)
    M = Mode
    drawn = {
        (M.DISARMED, M.READY), (M.READY, M.ALIGNING), (M.ALIGNING, M.ACTIVE), (M.ALIGNING, M.STOPPING), (M.ALIGNING, M.FAULT), (M.ACTIVE, M.STOPPING),
        (M.ACTIVE, M.FAULT), (M.STOPPING, M.DISARMED), (M.STOPPING, M.FAULT), (M.FAULT, M.DISARMED), (M.READY, M.DISARMED),
    }  # fmt: skip
    if p.homing:
        drawn |= {(M.DISARMED, M.HOMING), (M.HOMING, M.READY), (M.HOMING, M.STOPPING), (M.HOMING, M.FAULT), (M.READY, M.HOMING)}
    assert {e for e in edges if e[0] != e[1]} == drawn


def test_auto_arm_arms_once_and_not_again_after_a_stop() -> None:
    params = replace(PARAMS, auto_arm=True)
    state = START
    modes = []
    for k in range(40):
        verbs = frozenset({"stop"}) if k == 15 else frozenset()
        state = step(state, params, None, 0.0, 0.0, verbs, DT)
        modes.append(state.mode)
    assert Mode.ACTIVE in modes[:15]
    assert modes[-1] == Mode.READY
    assert not set(modes[18:]) & set(MOVING)


def test_auto_arm_homes_first_and_then_arms() -> None:
    params = replace(PARAMS, auto_arm=True, homing=True)
    state, modes = START, []
    for k in range(12):
        state = step(state, params, None, 0.0, 0.0, frozenset(), DT, Homing(k == 5, False))
        modes.append(state.mode)
    order = [m for i, m in enumerate(modes) if i == 0 or m != modes[i - 1]]
    assert order == [Mode.HOMING, Mode.READY, Mode.ALIGNING, Mode.ACTIVE]


def test_ready_takes_good_signals_for_as_long_as_stated() -> None:
    state, dt = START, 0.01
    for _ in range(9):
        state = step(state, PARAMS, None, 0.0, 0.0, frozenset(), dt)
        assert state.mode == Mode.DISARMED
    state = step(state, PARAMS, NOTE, 0.0, 0.0, frozenset(), dt)
    assert state.held_s == 0.0
    cycles = 0
    while state.mode == Mode.DISARMED:
        state = step(state, PARAMS, None, 0.0, 0.0, frozenset(), dt)
        cycles += 1
    assert cycles in (10, 11)
    assert step(state, PARAMS, NOTE, 0.0, 0.0, frozenset({"arm"}), dt).mode == Mode.DISARMED


def test_aligned_must_last() -> None:
    state, dt = SupervisorState(Mode.ALIGNING, 0.0, 0.0, None, True), 0.01
    for tilt in (0.0,) * 29 + (0.01,):
        state = step(state, PARAMS, None, tilt, 0.0, frozenset(), dt)
        assert state.mode == Mode.ALIGNING
    assert state.held_s == 0.0
    cycles = 0
    while state.mode == Mode.ALIGNING:
        state = step(state, PARAMS, None, 0.0, 0.0, frozenset(), dt)
        cycles += 1
    assert cycles in (30, 31)


@pytest.mark.parametrize(
    ("mode", "tilt", "homing", "cycles", "cause"),
    [
        (Mode.ACTIVE, 0.2, NOT_HOMING, 1, "attitude-lost"),
        (Mode.ALIGNING, 0.2, NOT_HOMING, 11, "align-timeout"),
        (Mode.HOMING, 0.2, Homing(False, True), 1, "homing-failed"),
        (Mode.HOMING, 0.2, NOT_HOMING, 9, "homing-failed"),
    ],
)
def test_what_the_supervisor_finds_itself_brakes_and_ends_in_fault(mode: Mode, tilt: float, homing: Homing, cycles: int, cause: str) -> None:
    state = SupervisorState(mode, 0.0, 0.0, None, True)
    for k in range(cycles):
        assert state.mode == mode, k
        state = step(state, replace(PARAMS, homing=True), None, tilt, 0.05, frozenset(), DT, homing)
    assert (state.mode, state.fault) == (Mode.STOPPING, BY_ID[cause])
    # braking goes on as long as there is speed, whatever soft faults come on top, and ends in FAULT with the first cause
    state = step(state, PARAMS, SOFT, 0.2, 0.05, frozenset(), DT)
    assert (state.mode, state.fault) == (Mode.STOPPING, BY_ID[cause])
    state = step(state, PARAMS, None, 0.2, 0.0, frozenset(), DT)
    assert (state.mode, state.fault) == (Mode.FAULT, BY_ID[cause])


def test_a_stop_that_was_asked_for_keeps_the_first_fault_that_comes_while_braking() -> None:
    state = step(SupervisorState(Mode.ACTIVE, 1.0, 0.0, None, True), PARAMS, None, 0.0, 0.05, frozenset({"disarm"}), DT)
    assert (state.mode, state.fault) == (Mode.STOPPING, None)
    state = step(state, PARAMS, SOFT, 0.0, 0.05, frozenset(), DT)
    assert (state.mode, state.fault) == (Mode.STOPPING, SOFT)
    state = step(state, PARAMS, QUICK, 0.0, 0.0, frozenset(), DT)
    assert (state.mode, state.fault) == (Mode.FAULT, SOFT)
    assert step(state, PARAMS, SOFT, 0.0, 0.0, frozenset({"reset"}), DT).mode == Mode.FAULT
    assert step(state, PARAMS, None, 0.0, 0.0, frozenset({"reset"}), DT) == SupervisorState(Mode.DISARMED, 0.0, 0.0, None, True)
    ended = step(SupervisorState(Mode.STOPPING, 0.1, 0.0, None, True), PARAMS, None, 0.0, 0.9e-4, frozenset(), DT)
    assert ended.mode == Mode.DISARMED
    assert step(SupervisorState(Mode.STOPPING, 0.1, 0.0, None, True), PARAMS, None, 0.0, 1.1e-4, frozenset(), DT).mode == Mode.STOPPING
    late = step(SupervisorState(Mode.STOPPING, 0.45, 0.0, None, True), PARAMS, None, 0.0, 0.05, frozenset(), DT)
    assert (late.mode, late.fault) == (Mode.FAULT, BY_ID["stop-timeout"])


def test_the_operator_who_is_needed_must_be_heard() -> None:
    p = replace(PARAMS, operator_timeout_s=0.25)
    state = SupervisorState(Mode.ACTIVE, 1.0, 0.0, None, True)
    for _ in range(10):
        state = step(state, p, None, 0.0, 0.05, frozenset({"present"}), DT)
        state = step(state, p, None, 0.0, 0.05, frozenset(), DT)
        assert state.mode == Mode.ACTIVE
    state = step(state, p, None, 0.0, 0.05, frozenset(), DT)
    assert state.mode == Mode.ACTIVE
    state = step(state, p, None, 0.0, 0.05, frozenset(), DT)
    assert (state.mode, state.fault) == (Mode.STOPPING, BY_ID["operator-absent"])


def test_fault_table_is_sound() -> None:
    assert len(BY_ID) == len(BY_NUMBER) == len(FAULTS)
    assert 0 not in BY_NUMBER
    for fault in FAULTS:
        assert all((fault.text, fault.causes, fault.check, fault.observable))
        assert fault.reaction in Reaction
        assert fault.limit_ms >= fault.debounce_ms >= 0.0
        assert fault.limit_ms > 0.0
        assert (fault.fault_class == FaultClass.NO_ENTRY) == (fault.reaction == Reaction.HOLD)
        assert (fault.fault_class == FaultClass.SOFT) == (fault.reaction == Reaction.SLOW_STOP)
    assert supervisor.READY_AFTER_S > 0.0
    assert graver(None, None) is None
    assert graver(SOFT, HARD) is graver(HARD, SOFT) is HARD
    assert graver(SOFT, BY_ID["imu-range"]) is SOFT
