"""The supervisor: modes, first fault latched, released only by a fresh request. A pure step that sees of a fault only its reaction.

``DISARMED -> HOMING -> READY -> ALIGNING -> ACTIVE -> STOPPING -> DISARMED``, and ``FAULT`` from anywhere. ``HOMING`` is left out where azimuth is
known (``supervisor.homing: none``, or found before).
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
_HOMING_FAILED = BY_ID["homing-failed"]
_ABSENT = BY_ID["operator-absent"]

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
    homing: bool = False
    """Azimuth must be homed before the rig is ready."""
    homing_timeout_s: float = 60.0
    operator_timeout_s: float = float("inf")


def supervisor_params(config: RigConfig) -> SupervisorParams:
    """Convert once."""
    s = config.supervisor
    return SupervisorParams(
        s.auto_arm,
        radians(s.align_tolerance_deg),
        s.align_timeout_s,
        radians(s.tilt_fault_deg),
        s.stop_timeout_s,
        s.homing == "azimuth",
        s.homing_timeout_s,
        s.operator_timeout_s or float("inf"),
    )


class SupervisorState(NamedTuple):
    """Mode, time in it, time for which its exit condition has held, and the latched first fault."""

    mode: Mode
    in_mode_s: float
    held_s: float
    fault: Fault | None
    armed_once: bool
    homed: bool = False
    absent_s: float = 0.0
    """Time since the operator was last heard of."""


class Homing(NamedTuple):
    """How homing stands."""

    found: bool
    failed: bool


START = SupervisorState(Mode.DISARMED, 0.0, 0.0, None, False)
NOT_HOMING = Homing(False, False)
_MOVING = (Mode.HOMING, Mode.ALIGNING, Mode.ACTIVE)
_new = tuple.__new__


def step(
    state: SupervisorState,
    p: SupervisorParams,
    fault: Fault | None,
    tilt_error_rad: float,
    rod_speed_m_s: float,
    verbs: frozenset[str],
    dt: float,
    homing: Homing = NOT_HOMING,
) -> SupervisorState:
    """One cycle: faults first, then requests, then progress.

    ``fault`` is the gravest of this cycle, ``tilt_error_rad`` the larger of the two attitude (or joint) errors, ``rod_speed_m_s`` the largest
    demanded speed (zero means that braking is done), ``verbs`` what was asked for in this cycle (``present``: the operator is there), ``homing`` how
    far homing is.
    """
    mode, in_mode, held, latched, armed_once, homed, absent = state
    in_mode += dt
    absent = 0.0 if verbs else absent + dt
    moving = mode in _MOVING
    if mode is Mode.ACTIVE and fault is None and not verbs and tilt_error_rad <= p.tilt_fault_rad and absent <= p.operator_timeout_s:
        return _new(SupervisorState, (mode, in_mode, 0.0, None, armed_once, homed, absent))
    stop = "stop" in verbs or "disarm" in verbs
    if fault is not None and fault.reaction == Reaction.HOLD and (moving or mode == Mode.STOPPING):
        fault = None
    if moving and fault is None:
        fault = _own(mode, in_mode, tilt_error_rad, absent, homing, p)

    def to(mode: Mode, held_s: float = 0.0, fault: Fault | None = None, armed: bool = True) -> SupervisorState:
        return SupervisorState(mode, 0.0, held_s, fault, armed, homed, absent)

    def stay(held_s: float = 0.0) -> SupervisorState:
        return SupervisorState(mode, in_mode, held_s, latched, armed_once, homed, absent)

    if mode == Mode.STOPPING:
        if in_mode > p.stop_timeout_s:
            return to(Mode.FAULT, fault=latched or _STOP_TIMEOUT)
        if fault is not None and fault.reaction == Reaction.FREE:
            return to(Mode.FAULT, fault=latched or fault)
        if rod_speed_m_s < STANDSTILL_M_S:
            latched = latched or fault
            return to(Mode.FAULT if latched is not None else Mode.DISARMED, fault=latched)
        return stay()._replace(fault=latched or fault)
    if mode == Mode.FAULT:
        if "reset" in verbs and fault is None:
            return to(Mode.DISARMED)
        return stay()
    if fault is not None:
        if not moving:
            # a bad signal only keeps the rig from becoming ready
            return SupervisorState(Mode.DISARMED, in_mode if mode == Mode.DISARMED else 0.0, 0.0, None, armed_once, homed, absent)
        return to(Mode.FAULT if fault.reaction == Reaction.FREE else Mode.STOPPING, fault=fault)
    if stop and moving:
        return to(Mode.STOPPING)
    arm = ("arm" in verbs or (p.auto_arm and not armed_once)) and not stop
    if mode == Mode.DISARMED:
        held += dt
        if held < READY_AFTER_S:
            return stay(held)
        if homed or not p.homing:
            return to(Mode.READY, armed=armed_once)
        # homing moves, so it takes a request of its own; auto_arm goes on to arming afterwards
        if (arm or "home" in verbs) and not stop:
            return to(Mode.HOMING, armed=armed_once)
        return stay(held)
    if mode == Mode.HOMING:
        if homing.found:
            return SupervisorState(Mode.READY, 0.0, 0.0, None, armed_once, True, absent)
        return stay()
    if mode == Mode.READY:
        if arm:
            return to(Mode.ALIGNING)
        if "home" in verbs and p.homing and not stop:
            return SupervisorState(Mode.HOMING, 0.0, 0.0, None, armed_once, False, absent)
        return stay()
    if mode == Mode.ALIGNING:
        held = held + dt if tilt_error_rad < p.align_tolerance_rad else 0.0
        if held >= ALIGNED_FOR_S:
            return to(Mode.ACTIVE)
        return stay(held)
    return stay()


def _own(mode: Mode, in_mode_s: float, tilt_error_rad: float, absent_s: float, homing: Homing, p: SupervisorParams) -> Fault | None:
    """What the supervisor itself finds wrong with a moving rig."""
    if mode == Mode.ACTIVE and tilt_error_rad > p.tilt_fault_rad:
        return _LOST
    if mode == Mode.ALIGNING and in_mode_s > p.align_timeout_s:
        return _ALIGN_TIMEOUT
    if mode == Mode.HOMING and (homing.failed or in_mode_s > p.homing_timeout_s):
        return _HOMING_FAILED
    if absent_s > p.operator_timeout_s:
        return _ABSENT
    return None
