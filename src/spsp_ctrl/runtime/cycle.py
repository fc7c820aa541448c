"""One cycle of the controller as a pure step: judge -> estimate -> reference -> decide -> control -> command.

The same function serves the loop in real time, the loop in lock-step and the replay of a log: everything it needs is in its arguments.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import ReferencePlan
from spsp_ctrl.control import estimator, homing, law, watch
from spsp_ctrl.control.estimator import EstimatorState
from spsp_ctrl.control.homing import HomingState, Phase
from spsp_ctrl.control.law import Gate, LawState
from spsp_ctrl.control.params import LawParams, WatchParams, law_ladder, law_params, watch_params
from spsp_ctrl.control.reference import ReferenceSource
from spsp_ctrl.control.watch import WatchState
from spsp_ctrl.messages import (
    AxisTerms,
    AzimuthTerms,
    Command,
    Control,
    Estimate,
    Measurement,
    Mode,
    OperatorRequest,
    Reference,
    ReferenceKind,
)
from spsp_ctrl.safety import consistency, steps, supervisor
from spsp_ctrl.safety import judge as judging
from spsp_ctrl.safety.faults import BY_ID, BY_NUMBER, Fault, Reaction, graver
from spsp_ctrl.safety.judge import JudgeLimits, JudgeState, judge_limits
from spsp_ctrl.safety.steps import StepLimits, StepState
from spsp_ctrl.safety.supervisor import NOT_HOMING, Homing, SupervisorParams, SupervisorState, supervisor_params
from spsp_ctrl.safety.temperature import SHARES

_GATES = {Mode.HOMING: Gate.HOME, Mode.ALIGNING: Gate.ALIGN, Mode.ACTIVE: Gate.ACTIVE, Mode.STOPPING: Gate.STOP}
GATES: tuple[int, ...] = tuple(int(_GATES.get(mode, Gate.OFF)) for mode in sorted(Mode))
"""What the law may do, by mode. Plain ints in a tuple: an enum as a dictionary key costs half a microsecond."""
_OFF, _STOP, _SLOW = int(Gate.OFF), int(Gate.STOP), int(Gate.SLOW)
_ACTIVE = int(Gate.ACTIVE)
_HOMING = Mode.HOMING
_INERTIAL = int(ReferenceKind.INERTIAL)
_NO_VERBS: frozenset[str] = frozenset()
_INTERNAL = ("fault",)
_ARM_M = 0.1
"""Azimuth stands when its rate times this is below the standstill of a rod: 0.06 deg/s."""
_new = tuple.__new__
_NOT_FINITE, _COMMAND = BY_ID["not-finite"], BY_ID["command-not-finite"]
_TRAVEL_SWITCH = BY_ID["travel-switch"]
_FOUND, _FAILED = int(Phase.FOUND), int(Phase.FAILED)
_NO_ESTIMATE: Estimate = _new(Estimate, ((0.0,) * (len(Estimate._fields) - 1) + (False,)))
_NO_AXIS: AxisTerms = _new(AxisTerms, ((0.0,) * (len(AxisTerms._fields) - 1) + (0,)))
_NO_AZIMUTH: AzimuthTerms = _new(AzimuthTerms, ((0.0,) * (len(AzimuthTerms._fields) - 1) + (0,)))


class Controller(NamedTuple):
    """What is constant in a session."""

    laws: tuple[tuple[LawParams, ...], ...]
    """The configured law and the plainer ones behind it, each with the current limits of ``safety.temperature.SHARES``."""
    watch: WatchParams
    judge: JudgeLimits
    supervisor: SupervisorParams
    steps: StepLimits
    homing_rate_rad_s: float
    target_timeout_s: float


class CycleState(NamedTuple):
    """Memory of the controller between cycles."""

    estimator: EstimatorState | None
    estimate: Estimate
    law: LawState
    supervisor: SupervisorState
    watch: WatchState
    law_step: int
    law_reason: int
    reference: ReferenceSource
    seq: int
    steps: StepState
    judge: JudgeState
    homing: HomingState
    zero: int
    """Count of the stepper at zero, found by homing."""
    said: int
    """Faults of this cycle that do not stop a run, as bits ``1 << number``."""


def controller(config: RigConfig) -> Controller:
    """Constants from the rig file."""
    laws = tuple(tuple(replace(p, current_a=share * p.current_a) for share in SHARES) for p in law_ladder(config))
    s = config.supervisor
    return Controller(
        laws,
        watch_params(config),
        judge_limits(config),
        supervisor_params(config),
        steps.step_limits(config),
        radians(s.homing_rate_deg_s),
        s.target_timeout_s,
    )


def start(config: RigConfig, plan: ReferencePlan) -> CycleState:
    """Before the first measurement."""
    params = law_params(config)
    source = ReferenceSource(
        plan,
        heading_rate_limit_rad_s=0.8 * params.azimuth_rate_rad_s,
        heading_accel_limit_rad_s2=0.5 * params.azimuth_accel_rad_s2,
    )
    return CycleState(
        None, _NO_ESTIMATE, law.START, supervisor.START, watch.START, 0, 0, source, 0, steps.START, judging.START, homing.START, 0, 0
    )


def _asked(
    source: ReferenceSource, requests: tuple[OperatorRequest, ...], c: Controller, t_s: float
) -> tuple[ReferenceSource, frozenset[str], Fault | None]:
    """Requests of this cycle: the demand after them, their verbs, and a fault that was seen outside the measurement."""
    verbs = frozenset(request.verb for request in requests if request.verb not in _INTERNAL)
    fault: Fault | None = None
    p = c.laws[0][0]
    for request in requests:
        if request.verb == "heading":
            source = source.with_heading(t_s, request.value)
        elif request.verb == "target":
            source = source.with_stream(t_s, request.value, request.rate, c.target_timeout_s)
        elif request.verb in ("jog-pitch", "jog-roll"):
            source = source.jogged(t_s, request.verb[4:], request.value, p.align_rate_rad_s, 4.0 * p.align_rate_rad_s)
        elif request.verb == "fault":
            fault = graver(fault, BY_NUMBER.get(int(request.value)))
    return source, verbs, fault


def step(
    state: CycleState, c: Controller, m: Measurement, requests: tuple[OperatorRequest, ...], now_ns: int, dt: float
) -> tuple[Control, CycleState]:
    """One cycle at SYNC ``now_ns``, ``dt`` s after the previous one. Returns the log record with the command in it."""
    t_s = now_ns * 1e-9
    before = state.supervisor
    mode = before.mode
    raw = m
    found, m, judged = judging.judge(state.judge, c.judge, m, before.homed or not c.supervisor.homing, now_ns, dt)
    p = c.laws[state.law_step][judged.temperature.share]
    if state.zero:
        m = m._replace(azimuth=m.azimuth._replace(microsteps=m.azimuth.microsteps - state.zero))
    searching, home = state.homing, NOT_HOMING
    if mode is _HOMING:
        if found.azimuth is _TRAVEL_SWITCH:
            found = found._replace(azimuth=None)
        searching = homing.step(searching, raw.azimuth)
        # found is found once azimuth stands again
        standing = state.law.azimuth_rate == 0.0 and raw.azimuth.rate_microsteps_s == 0.0
        home = Homing(searching.phase == _FOUND and standing, searching.phase == _FAILED)

    est, estimate = state.estimator, state.estimate
    apart: Fault | None = None
    consistent = judged.consistency
    if judged.pitch.known and judged.roll.known:
        if est is None:
            est = estimator.start(m, p)
        estimate, est = estimator.step(est, p, m, state.law.gap_pitch, state.law.gap_roll, now_ns, dt)
        if judging.estimate_is_finite(estimate):
            base = est.base
            innovation_sq = base.pitch_innovation * base.pitch_innovation + base.roll_innovation * base.roll_innovation
            apart, consistent = consistency.step(consistent, c.judge.consistency, estimate, innovation_sq, now_ns)
        else:
            apart, estimate, est = _NOT_FINITE, state.estimate, state.estimator
    fault: Fault | None = None
    said = 0
    everything: tuple[Fault | None, ...] = (*found, apart)
    if everything != _NOTHING:
        fault, said = judging.gravest(everything), judging.bits(everything)

    source = state.reference
    verbs = _NO_VERBS
    if requests:
        source, verbs, outside = _asked(source, requests, c, t_s)
        if outside is not None:
            fault, said = graver(outside, fault), said | 1 << outside.number
    if t_s > source.until_s:
        source = source.stream_ended(t_s)
    reference = source.at(t_s)

    if reference.kind == _INERTIAL:
        error_pitch = reference.pitch_rad - estimate.platform_pitch_rad
        error_roll = reference.roll_rad - estimate.platform_roll_rad
    else:
        error_pitch = reference.pitch_rad - estimate.joint_pitch_rad
        error_roll = reference.roll_rad - estimate.joint_roll_rad
    tilt_error = max(abs(error_pitch), abs(error_roll))
    last = state.law
    speed = max(abs(last.axis_pitch.rod_speed), abs(last.axis_roll.rod_speed), _ARM_M * abs(last.azimuth_rate))
    sup = supervisor.step(before, c.supervisor, fault, tilt_error, speed, verbs, dt, home)
    zero = state.zero
    if sup.mode != mode:
        if sup.mode == Mode.HOMING:
            searching = homing.START
        elif sup.homed and not before.homed:
            zero = searching.zero
            est = None
    gate = GATES[sup.mode]
    asked: Reference = reference
    if gate == _STOP and sup.fault is not None and sup.fault.reaction == Reaction.SLOW_STOP:
        gate = _SLOW
    elif sup.mode is _HOMING:
        rate = 0.0 if searching.phase == _FOUND else searching.direction * c.homing_rate_rad_s
        asked = reference._replace(heading_rate_rad_s=rate)

    (pitch, roll, azimuth), law_state = law.step(last, p, estimate, asked, dt, gate)
    seq = state.seq
    current_pitch = pitch.accel_ff_a + pitch.friction_ff_a if p.pitch.velocity_mode else pitch.u_a
    current_roll = roll.accel_ff_a + roll.friction_ff_a if p.roll.velocity_mode else roll.u_a
    command: Command = _new(
        Command,
        (
            now_ns,
            seq,
            gate != _OFF,
            current_pitch,
            pitch.motor_speed_ref_rad_s,
            current_roll,
            roll.motor_speed_ref_rad_s,
            azimuth.rate_rad_s,
        ),
    )
    if not judging.command_is_finite(command):
        sup = supervisor.step(before, c.supervisor, _COMMAND, tilt_error, speed, verbs, dt, home)
        said |= 1 << _COMMAND.number
        pitch, roll, azimuth, law_state = _NO_AXIS, _NO_AXIS, _NO_AZIMUTH, law.START
        command = Command(now_ns, seq, False, 0.0, 0.0, 0.0, 0.0, 0.0)
    law_step, law_reason, watching = state.law_step, state.law_reason, state.watch
    if gate == _ACTIVE and est is not None:
        base = est.base
        innovation_sq = base.pitch_innovation * base.pitch_innovation + base.roll_innovation * base.roll_innovation
        reason, watching = watch.step(
            watching, c.watch, pitch.u_a, roll.u_a, innovation_sq, estimate.attitude_dt_s > 0.0, dt
        )
        if reason and law_step + 1 < len(c.laws):
            law_step, law_reason, watching = law_step + 1, reason, watch.START
            law_state = law.reseed(law_state, c.laws[law_step][0], estimate)
    number = sup.fault.number if sup.fault is not None else 0
    control: Control = _new(
        Control, (now_ns, m.cycle, sup.mode, number, law_step, law_reason, estimate, reference, pitch, roll, azimuth, command)
    )
    counted = steps.step(state.steps, c.steps, m)
    speeds = (pitch.motor_speed_ref_rad_s, roll.motor_speed_ref_rad_s)
    judged = _new(JudgeState, (*judged[:5], consistent, judged.late_s, command, judged.last, *speeds, judged.turned_rad))
    return control, _new(
        CycleState,
        (est, estimate, law_state, sup, watching, law_step, law_reason, source, seq + 1, counted, judged, searching, zero, said),
    )


_NOTHING: tuple[Fault | None, ...] = (*judging.NOTHING, None)
