"""The supervisor: modes, first fault latched, released only by a fresh request. A pure step.

``DISARMED -> READY -> ALIGNING -> ACTIVE -> STOPPING -> DISARMED``, and ``FAULT`` from anywhere. (``HOMING`` exists as a mode; the virtual rig is
referenced when it starts.)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import Mode
from spsp_ctrl.safety.faults import BY_ID, Fault, Reaction

_LOST = BY_ID["attitude-lost"]
_ALIGN_TIMEOUT = BY_ID["align-timeout"]
_STOP_TIMEOUT = BY_ID["stop-timeout"]

READY_AFTER_S = 0.1
"""Signals must have been good for this long before the rig counts as ready."""
ALIGNED_FOR_S = 0.3
STANDSTILL_M_S = 1e-4


@dataclass(frozen=True, slots=True)
class SupervisorParams:
    """From the rig file."""

    auto_arm: bool
    align_tolerance_rad: float
    align_timeout_s: float
    tilt_fault_rad: float
    stop_timeout_s: float


def supervisor_params(config: RigConfig) -> SupervisorParams:
    """Convert once."""
    s = config.supervisor
    return SupervisorParams(
        s.auto_arm, radians(s.align_tolerance_deg), s.align_timeout_s, radians(s.tilt_fault_deg), s.stop_timeout_s
    )


class SupervisorState(NamedTuple):
    """Mode, time in it, time for which its exit condition has held, and the latched first fault."""

    mode: Mode
    in_mode_s: float
    held_s: float
    fault: Fault | None
    armed_once: bool


START = SupervisorState(Mode.DISARMED, 0.0, 0.0, None, False)


_MOVING = (Mode.ALIGNING, Mode.ACTIVE)
_new = tuple.__new__


def step(
    state: SupervisorState,
    p: SupervisorParams,
    fault: Fault | None,
    tilt_error_rad: float,
    rod_speed_m_s: float,
    verbs: frozenset[str],
    dt: float,
) -> SupervisorState:
    """One cycle: faults first, then requests, then progress.

    ``fault`` comes from the judge, ``tilt_error_rad`` is the larger of the two attitude (or joint) errors, ``rod_speed_m_s`` the larger of the two
    demanded rod speeds (zero means that braking is done), ``verbs`` what the operator asked for in this cycle.
    """
    mode, in_mode, held, latched, armed_once = state
    in_mode += dt
    if mode is Mode.ACTIVE and fault is None and not verbs and tilt_error_rad <= p.tilt_fault_rad:
        return _new(SupervisorState, (mode, in_mode, 0.0, None, armed_once))
    moving = mode in _MOVING
    stop = "stop" in verbs or "disarm" in verbs
    if mode == Mode.ACTIVE and fault is None and tilt_error_rad > p.tilt_fault_rad:
        fault = _LOST
    if mode == Mode.ALIGNING and fault is None and in_mode > p.align_timeout_s:
        fault = _ALIGN_TIMEOUT
    if mode == Mode.STOPPING and in_mode > p.stop_timeout_s:
        return SupervisorState(Mode.FAULT, 0.0, 0.0, latched or _STOP_TIMEOUT, armed_once)

    if fault is not None:
        if moving:
            if fault.reaction == Reaction.SLOW_STOP:
                return SupervisorState(Mode.STOPPING, 0.0, 0.0, latched or fault, armed_once)
            return SupervisorState(Mode.FAULT, 0.0, 0.0, latched or fault, armed_once)
        if mode == Mode.STOPPING:
            if fault.reaction == Reaction.FREE:
                return SupervisorState(Mode.FAULT, 0.0, 0.0, latched or fault, armed_once)
        elif mode == Mode.FAULT:
            return SupervisorState(mode, in_mode, 0.0, latched, armed_once)
        else:
            # not moving: a bad signal only keeps the rig from becoming ready
            return SupervisorState(Mode.DISARMED, in_mode if mode == Mode.DISARMED else 0.0, 0.0, latched, armed_once)

    if mode == Mode.FAULT:
        if "reset" in verbs:
            return SupervisorState(Mode.DISARMED, 0.0, 0.0, None, True)
        return SupervisorState(mode, in_mode, 0.0, latched, armed_once)
    if stop and moving:
        return SupervisorState(Mode.STOPPING, 0.0, 0.0, latched, True)
    if mode == Mode.STOPPING:
        if rod_speed_m_s < STANDSTILL_M_S:
            after = Mode.FAULT if latched is not None else Mode.DISARMED
            return SupervisorState(after, 0.0, 0.0, latched, True)
        return SupervisorState(mode, in_mode, 0.0, latched, armed_once)
    if mode == Mode.DISARMED:
        held += dt
        if held >= READY_AFTER_S:
            return SupervisorState(Mode.READY, 0.0, 0.0, None, armed_once)
        return SupervisorState(mode, in_mode, held, latched, armed_once)
    if mode == Mode.READY:
        if ("arm" in verbs or (p.auto_arm and not armed_once)) and not stop:
            return SupervisorState(Mode.ALIGNING, 0.0, 0.0, None, True)
        return SupervisorState(mode, in_mode, 0.0, None, armed_once)
    if mode == Mode.ALIGNING:
        held = held + dt if tilt_error_rad < p.align_tolerance_rad else 0.0
        if held >= ALIGNED_FOR_S:
            return SupervisorState(Mode.ACTIVE, 0.0, 0.0, None, True)
        return SupervisorState(mode, in_mode, held, None, True)
    return SupervisorState(mode, in_mode, 0.0, None, armed_once)
