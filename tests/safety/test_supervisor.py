"""The supervisor, walked exhaustively: every state and input that matters, checked against its promises."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from itertools import product

from spsp_ctrl.messages import Mode
from spsp_ctrl.safety import supervisor
from spsp_ctrl.safety.faults import BY_ID, BY_NUMBER, FAULTS, Reaction
from spsp_ctrl.safety.supervisor import START, SupervisorParams, SupervisorState, step

PARAMS = SupervisorParams(False, 0.01, 1.0, 0.1, 0.5)
DT = 0.1
SOFT, HARD = BY_ID["imu-stale"], BY_ID["resolver-fault"]
VERBS = [frozenset(), frozenset({"arm"}), frozenset({"stop"}), frozenset({"reset"}), frozenset({"arm", "stop"})]
MOVING = (Mode.ALIGNING, Mode.ACTIVE, Mode.STOPPING)


def rounded(state: SupervisorState) -> SupervisorState:
    return state._replace(in_mode_s=min(round(state.in_mode_s, 1), 1.2), held_s=min(round(state.held_s, 1), 0.4))


def test_every_reachable_state_keeps_the_promises() -> None:
    seen = {START}
    queue = deque([START])
    visited_modes = set()
    while queue:
        state = queue.popleft()
        for fault, tilt, speed, verbs in product((None, SOFT, HARD), (0.0, 0.05, 0.2), (0.0, 0.02), VERBS):
            after = step(state, PARAMS, fault, tilt, speed, verbs, DT)
            moving_before, moving_after = state.mode in MOVING, after.mode in MOVING
            visited_modes.add(after.mode)
            # nothing begins to move without a fresh request, and never in a cycle with a fault
            if moving_after and not moving_before:
                assert state.mode == Mode.READY
                assert "arm" in verbs
                assert "stop" not in verbs
                assert fault is None
            # a fault that cannot be braked through frees the drives in the same cycle
            if fault is HARD:
                assert not moving_after
            # a stop request is never ignored by a moving rig
            if "stop" in verbs and state.mode in (Mode.ALIGNING, Mode.ACTIVE):
                assert after.mode in (Mode.STOPPING, Mode.FAULT)
            # the first cause is kept until a reset
            if state.fault is not None and state.mode in (Mode.FAULT, Mode.STOPPING) and "reset" not in verbs:
                assert after.fault == state.fault
            if state.mode == Mode.FAULT and after.mode != Mode.FAULT:
                assert "reset" in verbs
                assert after.mode == Mode.DISARMED
            # braking ends in time
            if after.mode == Mode.STOPPING:
                assert after.in_mode_s <= PARAMS.stop_timeout_s + DT
            key = rounded(after)
            if key not in seen:
                seen.add(key)
                queue.append(key)
    assert visited_modes == set(Mode) - {Mode.HOMING}


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


def test_attitude_lost_brakes_and_ends_in_fault() -> None:
    state = SupervisorState(Mode.ACTIVE, 1.0, 0.0, None, True)
    state = step(state, PARAMS, None, 0.2, 0.05, frozenset(), DT)
    assert (state.mode, state.fault) == (Mode.STOPPING, BY_ID["attitude-lost"])
    state = step(state, PARAMS, None, 0.2, 0.0, frozenset(), DT)
    assert (state.mode, state.fault) == (Mode.FAULT, BY_ID["attitude-lost"])


def test_fault_table_is_sound() -> None:
    assert len(BY_ID) == len(BY_NUMBER) == len(FAULTS)
    assert 0 not in BY_NUMBER
    for fault in FAULTS:
        assert fault.text
        assert fault.check
        assert fault.reaction in Reaction
    assert supervisor.READY_AFTER_S > 0.0
