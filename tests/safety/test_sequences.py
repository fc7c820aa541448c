"""Random sequences of faults, requests and modes through the whole controller: its promises hold in every cycle. 10^5 with ``-m sequences``."""

from __future__ import annotations

import math
from functools import cache
from random import Random
from typing import Any

import pytest
from tests.safety.toy import CONFIG, CONTROLLER, DT, PERIOD_NS, P, moments, run

from spsp_ctrl.messages import Command, Measurement, Mode, OperatorRequest
from spsp_ctrl.runtime import cycle
from spsp_ctrl.safety.faults import BY_NUMBER, FAULTS, Reaction

MOMENTS = cache(moments)
MOVING = (Mode.HOMING, Mode.ALIGNING, Mode.ACTIVE, Mode.STOPPING)
NUMBERS = (math.nan, math.inf, -math.inf, 0.0, 1e30, -1e30, 0.3, -0.3, 5.0, 100.0)
VERBS = ("arm", "disarm", "stop", "reset", "home", "present")
LIMITED_M_S = CONFIG.limits.rod_speed_mm_s * 1e-3


def disturbed(m: Measurement, frozen: Measurement, random: Random) -> Measurement:
    """One sample of a measurement hurt in one way: frozen, another number, another stamp, sequence or flag."""
    place = random.randrange(2, 9)
    sample: Any = m[place]
    how = random.random()
    if how < 0.3:
        row = list(m)
        row[place] = frozen[place]
        return Measurement(*row)
    field = random.randrange(len(sample))
    value = sample[field]
    if isinstance(value, bool):
        value = not value
    elif isinstance(value, int):
        value = value + random.choice((1, -1, 1000, -1000, 10**9, -(10**9), 20_000_000))
    else:
        value = random.choice((*NUMBERS, value + random.choice((0.01, -0.01))))
    row = list(m)
    row[place] = sample._replace(**{sample._fields[field]: value})
    return Measurement(*row)


def request(now_ns: int, random: Random) -> OperatorRequest:
    """Any request that passes the boundary of the operator channel."""
    kind = random.random()
    if kind < 0.6:
        return OperatorRequest(now_ns, random.choice(VERBS), 0.0, "test")
    if kind < 0.7:
        return OperatorRequest(now_ns, "heading", random.uniform(-3.2, 3.2), "test")
    if kind < 0.8:
        return OperatorRequest(now_ns, "target", random.uniform(-3.2, 3.2), "test", random.uniform(-0.5, 0.5))
    if kind < 0.9:
        return OperatorRequest(now_ns, random.choice(("jog-pitch", "jog-roll")), random.uniform(-0.08, 0.08), "test")
    return OperatorRequest(now_ns, "fault", float(random.choice(FAULTS).number), "loop")


def keeps_limits(command: Command, before: Command) -> None:
    assert all(math.isfinite(value) for value in command)
    assert abs(command.pitch_current_a) <= P.current_a
    assert abs(command.roll_current_a) <= P.current_a
    assert abs(command.azimuth_rate_rad_s) <= P.azimuth_rate_rad_s + 1e-12
    if command.enable and before.enable:
        # acceleration, except where travel brakes harder
        assert abs(command.azimuth_rate_rad_s) <= abs(before.azimuth_rate_rad_s) + P.azimuth_accel_rad_s2 * 10 * DT + 1e-9


def walk(seed: int, cycles: int = 24) -> set[int]:
    """One sequence; returns the modes it went through."""
    random = Random(seed)
    toy, state = random.choice(list(MOMENTS().values()))
    toy = toy.copy(seed)
    modes = {int(state.supervisor.mode)}
    frozen: Measurement | None = None
    hurting = random.random() < 0.8
    now = toy.k * PERIOD_NS
    before = toy.last
    for _ in range(cycles):
        m = toy.read()
        frozen = frozen or m
        if hurting and random.random() < 0.5:
            m = disturbed(m, frozen, random)
        requests = tuple(request(now, random) for _ in range(random.choice((0, 0, 0, 1, 1, 2))))
        latched, was = state.supervisor.fault, state.supervisor.mode
        dt = DT * random.choice((1, 1, 1, 1, 1, 1, 1, 2, 7))
        now += round(dt * 1e9)
        toy.k = now // PERIOD_NS
        control, state = cycle.step(state, CONTROLLER, m, requests, now, dt)
        command, mode = control.command, Mode(control.mode)
        modes.add(int(mode))
        keeps_limits(command, before)
        # no motion while disarmed: no power, no numbers
        assert command.enable == (mode in MOVING)
        if not command.enable:
            assert (command.pitch_current_a, command.roll_current_a, command.azimuth_rate_rad_s) == (0.0, 0.0, 0.0)
        # nothing starts to move but by arming a ready rig
        if mode in MOVING and was not in MOVING:
            assert was in (Mode.READY, Mode.DISARMED)
            assert any(r.verb in ("arm", "home") for r in requests)
        # the first cause is kept until a reset
        if latched is not None and was in (Mode.STOPPING, Mode.FAULT) and not any(r.verb == "reset" for r in requests):
            assert control.fault == latched.number
        if mode == Mode.FAULT:
            assert control.fault in BY_NUMBER
        # what cannot be braked through frees the drives in this very cycle
        if any(r.verb == "fault" and BY_NUMBER[int(r.value)].reaction == Reaction.FREE for r in requests):
            assert not command.enable
        toy.write(command)
        before = command
    return modes


def test_moments_cover_the_modes() -> None:
    assert MOMENTS().keys() >= {Mode.DISARMED, Mode.READY, Mode.ALIGNING, Mode.ACTIVE, Mode.STOPPING}


def test_the_toy_runs_for_seconds_without_an_alarm() -> None:
    toy, state = MOMENTS()[Mode.ACTIVE]
    control, state = run(toy.copy(3), state, 3000)
    assert (control.mode, control.fault, state.said) == (Mode.ACTIVE, 0, 0)


def test_random_sequences_keep_every_promise() -> None:
    modes = set().union(*(walk(seed) for seed in range(400)))
    assert modes >= {int(m) for m in Mode} - {int(Mode.HOMING)}


@pytest.mark.sequences
@pytest.mark.parametrize("part", range(20))
def test_a_hundred_thousand_random_sequences(part: int) -> None:
    for seed in range(1000 + 5000 * part, 1000 + 5000 * (part + 1)):
        try:
            walk(seed)
        except AssertionError as error:
            raise AssertionError(f"seed {seed}") from error


@pytest.mark.parametrize("pushed_rad", [30.0, -45.0])
def test_rearmed_after_a_push_by_hand_it_follows_the_aligning_profile(pushed_rad: float) -> None:
    """During FAULT somebody turns the motors; after reset and arm the joints move no faster than in ALIGNING, from where they are."""
    toy, state = MOMENTS()[Mode.ACTIVE]
    toy = toy.copy(5)
    for k in range(1400):
        if 100 <= k < 600:  # by hand, smoothly
            part = (1.0 - math.cos(2.0 * math.pi * (k - 100) / 500.0)) / 500.0
            toy.pitch += pushed_rad * part
            toy.roll -= 0.5 * pushed_rad * part
        m = toy.read()
        verb = {0: "fault", 700: "reset", 900: "arm"}.get(k)
        requests = (OperatorRequest(m.stamp_ns, verb, 42.0, "test"),) if verb else ()
        control, state = cycle.step(state, CONTROLLER, m, requests, m.stamp_ns, DT)
        toy.write(control.command)
        if k == 899:
            assert control.mode == Mode.READY
            start = toy.joints()
        if k >= 900:
            assert control.mode in (Mode.ALIGNING, Mode.ACTIVE)
            elapsed = (k - 899) * DT
            joints = toy.joints()
            for now, then in zip(joints, start, strict=True):
                assert abs(now - then) <= P.align_rate_rad_s * elapsed * 1.1 + math.radians(0.1)
                assert abs(now) <= abs(then) + math.radians(0.1)  # towards level, never away from it
