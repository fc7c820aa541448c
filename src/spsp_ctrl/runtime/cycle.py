"""One cycle of the controller as a pure step: judge -> estimate -> reference -> decide -> control -> command.

The same function serves the loop in real time, the loop in lock-step and the replay of a log: everything it needs is in its arguments.
"""

from __future__ import annotations

from typing import NamedTuple

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import ReferencePlan
from spsp_ctrl.control import estimator, law, watch
from spsp_ctrl.control.estimator import EstimatorState
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
    ReferenceKind,
)
from spsp_ctrl.safety import judge as judging
from spsp_ctrl.safety import steps, supervisor
from spsp_ctrl.safety.faults import BY_ID
from spsp_ctrl.safety.judge import JudgeLimits, judge_limits
from spsp_ctrl.safety.steps import StepLimits, StepState
from spsp_ctrl.safety.supervisor import SupervisorParams, SupervisorState, supervisor_params

_GATES = {Mode.ALIGNING: Gate.ALIGN, Mode.ACTIVE: Gate.ACTIVE, Mode.STOPPING: Gate.STOP}
GATES: tuple[int, ...] = tuple(int(_GATES.get(mode, Gate.OFF)) for mode in sorted(Mode))
"""What the law may do, by mode. Plain ints in a tuple: an enum as a dictionary key costs half a microsecond."""
_OFF = int(Gate.OFF)
_ACTIVE = int(Gate.ACTIVE)
_INERTIAL = int(ReferenceKind.INERTIAL)
_NO_VERBS: frozenset[str] = frozenset()
_new = tuple.__new__
_NOT_FINITE = BY_ID["not-finite"]
_IMU_STALE = BY_ID["imu-stale"]
_TRAVEL_SWITCH = BY_ID["travel-switch"]
_USABLE = (None, _IMU_STALE, _TRAVEL_SWITCH)
"""Faults in which actuators can still be believed, so that the estimate goes on and braking works."""
_NO_ESTIMATE: Estimate = _new(Estimate, ((0.0,) * (len(Estimate._fields) - 1) + (False,)))
_NO_AXIS: AxisTerms = _new(AxisTerms, ((0.0,) * (len(AxisTerms._fields) - 1) + (0,)))
_NO_AZIMUTH: AzimuthTerms = _new(AzimuthTerms, ((0.0,) * (len(AzimuthTerms._fields) - 1) + (0,)))


class Controller(NamedTuple):
    """What is constant in a session."""

    laws: tuple[LawParams, ...]
    """The configured law and the plainer ones behind it."""
    watch: WatchParams
    judge: JudgeLimits
    supervisor: SupervisorParams
    steps: StepLimits


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


def controller(config: RigConfig) -> Controller:
    """Constants from the rig file."""
    return Controller(law_ladder(config), watch_params(config), judge_limits(config), supervisor_params(config), steps.step_limits(config))


def start(config: RigConfig, plan: ReferencePlan) -> CycleState:
    """Before the first measurement."""
    params = law_params(config)
    source = ReferenceSource(
        plan,
        heading_rate_limit_rad_s=0.8 * params.azimuth_rate_rad_s,
        heading_accel_limit_rad_s2=0.5 * params.azimuth_accel_rad_s2,
    )
    return CycleState(None, _NO_ESTIMATE, law.START, supervisor.START, watch.START, 0, 0, source, 0, steps.START)


def step(
    state: CycleState, c: Controller, m: Measurement, requests: tuple[OperatorRequest, ...], now_ns: int, dt: float
) -> tuple[Control, CycleState]:
    """One cycle at SYNC ``now_ns``, ``dt`` s after the previous one. Returns the log record with the command in it."""
    t_s = now_ns * 1e-9
    p = c.laws[state.law_step]
    fault = judging.judge(m, c.judge, now_ns)

    est, estimate = state.estimator, state.estimate
    if fault in _USABLE:
        if est is None:
            est = estimator.start(m, p)
        estimate, est = estimator.step(est, p, m, state.law.gap_pitch, state.law.gap_roll, now_ns, dt)
        if not judging.estimate_is_finite(estimate):
            fault, estimate, est = _NOT_FINITE, state.estimate, state.estimator

    source = state.reference
    verbs = _NO_VERBS
    if requests:
        verbs = frozenset(request.verb for request in requests)
        for request in requests:
            if request.verb == "heading":
                source = source.with_heading(t_s, request.value)
    reference = source.at(t_s)

    if reference.kind == _INERTIAL:
        error_pitch = reference.pitch_rad - estimate.platform_pitch_rad
        error_roll = reference.roll_rad - estimate.platform_roll_rad
    else:
        error_pitch = reference.pitch_rad - estimate.joint_pitch_rad
        error_roll = reference.roll_rad - estimate.joint_roll_rad
    tilt_error = max(abs(error_pitch), abs(error_roll))
    last = state.law
    rod_speed = max(abs(last.axis_pitch.rod_speed), abs(last.axis_roll.rod_speed))
    sup = supervisor.step(state.supervisor, c.supervisor, fault, tilt_error, rod_speed, verbs, dt)
    gate = GATES[sup.mode]

    (pitch, roll, azimuth), law_state = law.step(last, p, estimate, reference, dt, gate)
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
        sup = supervisor.step(state.supervisor, c.supervisor, _NOT_FINITE, tilt_error, rod_speed, verbs, dt)
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
            law_state = law.reseed(law_state, c.laws[law_step], estimate)
    number = sup.fault.number if sup.fault is not None else 0
    control: Control = _new(
        Control, (now_ns, m.cycle, sup.mode, number, law_step, law_reason, estimate, reference, pitch, roll, azimuth, command)
    )
    counted = steps.step(state.steps, c.steps, m)
    return control, _new(CycleState, (est, estimate, law_state, sup, watching, law_step, law_reason, source, seq + 1, counted))
