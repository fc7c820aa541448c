"""Resolver and drive of one actuator: what is believed, what is carried on, and when which fault is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import exp, nan, pi
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.messages import DriveSample, ResolverSample
from spsp_ctrl.safety import axis
from spsp_ctrl.safety.axis import AxisLimits, AxisState, Told, axis_limits, used_resolver

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
DT, MS = 1e-3, 1_000_000
COUNT = 2.0 * pi / 2**14


def limits() -> AxisLimits:
    return axis_limits(RIG, RIG.pitch_actuator)


RESTING = Told(0.0, 0.0, False, True)


class Line:
    """One actuator whose samples are made by the test; every cycle 1 ms."""

    def __init__(self, p: AxisLimits | None = None, start: int = 0) -> None:
        self.p = p or limits()
        self.state: AxisState = axis.START
        self.k = start
        self.counts = 1000.0

    def step(self, speed_counts: float = 0.0, *, told: Told = RESTING, fault: str | None = None, **changes: object) -> None:
        now = self.k * MS
        self.counts += speed_counts
        resolver = ResolverSample(now, self.k, round(self.counts), 0)
        drive = DriveSample(now, self.k, told.enable, 0, told.current_a, 24.0)
        if "resolver" in changes:
            resolver = changes["resolver"](resolver) if callable(changes["resolver"]) else changes["resolver"]  # type: ignore[assignment]
        if "drive" in changes:
            drive = changes["drive"](drive) if callable(changes["drive"]) else changes["drive"]  # type: ignore[assignment]
        found, self.state = axis.step(self.state, self.p, resolver, drive, told, now, DT)
        assert (found.id if found else None) == fault, (self.k, self.state)
        self.k += 1

    def until(self, most: int, step: Callable[[], None]) -> int:
        """Cycles until a fault is named."""
        for n in range(most):
            try:
                step()
            except AssertionError:
                return n + 1
        return -1


ON = Told(0.0, 0.0, True, True)


def moving(speed_counts: float, current_a: float = 0.0) -> Told:
    return Told(speed_counts * COUNT / DT, current_a, True, True)


def test_constants_from_the_rig_file() -> None:
    p = limits()
    assert p.stale_ns == 5 * MS
    assert p.coast == 5
    assert p.per_ns == pytest.approx(1e-6)
    assert p.rad_per_count == pytest.approx(COUNT)
    assert p.reach_counts_cycle2 == pytest.approx(1.9 * 0.05 * 6.0 / 2e-5 / COUNT * 1e-6)
    assert p.jump_counts_cycle2 == pytest.approx(3.0 * 0.05 * 6.0 / 2e-5 / COUNT * 1e-6)
    assert p.jump_counts == 20.0
    assert p.noise_counts2 == 625.0
    assert p.follow_keep == pytest.approx(exp(-0.01))
    assert p.noise_share == pytest.approx(1.0 - exp(-0.02))
    assert p.current_share == pytest.approx(1.0 - exp(-0.05))
    assert p.over_a == 7.5
    assert p.current_error_a == 0.75
    assert p.current_power_a2 == 2.25
    assert p.torque_mode
    assert (p.supply_min_v, p.supply_max_v) == (18.0, 30.0)
    assert p.density_s == pytest.approx(0.02)
    assert (p.state_ns, p.over_ns, p.supply_ns, p.converter_ns) == (20 * MS, 3 * MS, 20 * MS, 2 * MS)
    coarse = RIG.pitch_actuator.model_copy(update={"resolver_bits": 12, "mode": "velocity"})
    q = axis_limits(RIG, coarse)
    assert (q.jump_counts, q.noise_counts2, q.torque_mode) == (5.0, 625.0 / 16.0, False)
    strong = axis_limits(RIG.model_copy(update={"limits": RIG.limits.model_copy(update={"current_a": 12.0})}), RIG.pitch_actuator)
    assert (strong.over_a, strong.current_error_a, strong.current_power_a2) == (15.0, 1.5, 9.0)


def test_a_healthy_axis_says_nothing_standing_moving_and_turning_round() -> None:
    line = Line()
    speed = 0.0
    for k in range(2000):
        speed += 4.0 if (k // 60) % 4 in (0, 3) else -4.0
        line.step(speed, told=moving(speed, 1.0))
    assert line.state.bad == 0
    assert used_resolver(line.state, line.p, line.k * MS) == line.state.resolver
    assert line.state.resolver.counts == round(line.counts)


def test_missing_angles_are_carried_on_and_then_stale() -> None:
    line = Line()
    for _ in range(10):
        line.step(200.0, told=moving(200.0))
    frozen = line.state.resolver
    for n in range(1, 6):
        line.step(200.0, told=moving(200.0), resolver=frozen)
        assert line.state.bad == n
        used = used_resolver(line.state, line.p, (line.k - 1) * MS)
        assert (used.counts, used.stamp_ns, used.seq, used.status) == (round(line.counts), (line.k - 1) * MS, frozen.seq, 0)
    line.step(200.0, told=moving(200.0), resolver=frozen, fault="resolver-stale")
    line.step(200.0, told=moving(200.0))
    assert line.state.bad == 0
    assert line.state.step == pytest.approx(200.0)


def test_a_late_angle_is_stale_although_it_is_new() -> None:
    line = Line()
    for _ in range(20):
        line.step()
    line.step(resolver=lambda r: r._replace(stamp_ns=r.stamp_ns - 6 * MS), fault="resolver-stale")
    other = Line()
    for _ in range(20):
        other.step()
    other.step(resolver=lambda r: r._replace(stamp_ns=r.stamp_ns - 5 * MS + MS))


def test_no_angle_at_all_and_one_from_the_future_are_stale() -> None:
    Line().step(resolver=ResolverSample(0, -1, 0, 0), fault="resolver-stale")
    line = Line()
    for _ in range(3):
        line.step()
    line.step(resolver=lambda r: r._replace(stamp_ns=r.stamp_ns + MS))
    assert line.state.bad == 1
    assert line.state.known == 2


def test_without_a_motion_the_last_angle_is_used_as_it_is() -> None:
    line = Line()
    line.step()
    first = line.state.resolver
    assert line.state.known == 1
    line.step(resolver=first)
    assert line.state.bad == 1
    assert used_resolver(line.state, line.p, line.k * MS) == first


def test_converter_bits_are_judged_before_the_angle() -> None:
    line = Line()
    for _ in range(10):
        line.step(50.0, told=moving(50.0))
    for fault in (None, None, "resolver-fault", "resolver-fault"):
        line.step(50.0, told=moving(50.0), resolver=lambda r: r._replace(status=4, counts=99), fault=fault)
        assert used_resolver(line.state, line.p, (line.k - 1) * MS).counts == round(line.counts)
    line.step(50.0, told=moving(50.0))
    assert line.state.converter_since == 0
    # from the very first cycle on
    begin = Line()
    for _ in range(3):
        begin.step(resolver=lambda r: r._replace(status=1))
    assert begin.state.converter_since == 1
    begin.step(resolver=lambda r: r._replace(status=1), fault="resolver-fault")


def test_a_jump_is_carried_over_and_named_when_it_stays() -> None:
    reach = limits().jump_counts + limits().jump_counts_cycle2
    line = Line()
    for _ in range(5):
        line.step()
    line.step(resolver=lambda r: r._replace(counts=r.counts + int(reach)))
    assert line.state.bad == 0
    line = Line()
    for _ in range(5):
        line.step()
    for n in range(1, 4):
        line.step(resolver=lambda r: r._replace(counts=r.counts + 4000))
        assert line.state.bad == n
        assert used_resolver(line.state, line.p, (line.k - 1) * MS).counts == 1000
    line.step()
    assert line.state.bad == 0
    for fault in (None,) * 5 + ("resolver-jump", None):
        line.step(resolver=lambda r: r._replace(counts=r.counts + 4000), fault=fault)
    # a rig at rest is judged anew from there, and motion takes two angles
    assert line.state.resolver.counts == 5000
    assert line.state.known == 2
    below = Line()
    for _ in range(5):
        below.step()
    below.step(resolver=lambda r: r._replace(counts=r.counts - int(reach) - 1))
    assert below.state.bad == 1
    allowed = Line()
    for _ in range(5):
        allowed.step()
    still = allowed.state.resolver
    allowed.step(resolver=still)
    # after a missing frame the motor may have come further: with the square of the time
    allowed.step(resolver=lambda r: r._replace(counts=r.counts + int(limits().jump_counts + 4.0 * limits().jump_counts_cycle2)))
    assert allowed.state.bad == 0
    assert allowed.state.step == pytest.approx((20.0 + 4.0 * limits().jump_counts_cycle2) / 2.0, abs=0.5)


def test_an_angle_that_repeats_while_the_motor_is_told_to_turn_is_stuck() -> None:
    line = Line()
    for _ in range(5):
        line.step(told=ON)
    slow = Told(10.0, 0.0, True, True)
    cycles = line.until(100, lambda: line.step(told=slow))
    assert cycles == 16  # 0.15 rad at 10 rad/s
    line = Line()
    # disabled, it may be told what it likes
    assert line.until(100, lambda: line.step(told=Told(10.0, 0.0, False, True))) == -1
    assert line.state.idle_rad == 0.0
    backwards = Line()
    assert backwards.until(100, lambda: backwards.step(told=Told(-10.0, 0.0, True, True))) in (15, 16, 17)
    live = Line()
    # one count is enough to show life, for as long as the following error allows
    assert live.until(100, lambda: live.step((-1.0) ** live.k, told=slow)) == -1


def test_following_error_grows_with_speed() -> None:
    line = Line()
    for _ in range(5):
        line.step(told=ON)
    told = Told(100.0, 0.0, True, True)
    total, n = 0.0, 0
    while abs(total) <= 1.5 + 0.02 * 100.0:
        n += 1
        got = 20.0 * n if n < 5 else 100.0
        total = total * exp(-0.01) + 0.1 - round(got) * COUNT
    assert line.until(300, lambda: line.step(min(20.0 * (line.k - 4), 100.0), told=told)) == pytest.approx(n, abs=1)
    # with power off nobody follows
    free = Line()
    assert free.until(300, lambda: free.step(5.0, told=Told(100.0, 0.0, False, True))) == -1
    assert free.state.follow_rad == 0.0
    # nor while the power stage is just being switched
    fresh = Line()
    assert fresh.until(100, lambda: fresh.step(5.0, told=Told(100.0, 0.0, True, False))) == -1
    # over missing frames it follows as it did
    gap = Line()
    for _ in range(10):
        gap.step(26.0, told=moving(26.0))
    frozen = gap.state.resolver
    before = gap.state.follow_rad
    for _ in range(4):
        gap.step(26.0, told=moving(26.0), resolver=frozen)
    assert gap.state.follow_rad == pytest.approx(before * exp(-0.04), abs=1e-6)


def test_noise_that_no_acceleration_explains() -> None:
    reach = limits().reach_counts_cycle2
    for size, named in ((54.0, False), (58.0, True)):
        line = Line()

        def shaken(r: ResolverSample, size: float = size) -> ResolverSample:
            return r._replace(counts=r.counts + round((size / 2.0) * (-1.0) ** r.seq))

        cycles = line.until(400, lambda line=line, shaken=shaken: line.step(told=ON, resolver=shaken))
        # its step of 2 a is also the motion, of which a quarter is left to the stamp; the second difference of an alternation of +-a is 4 a
        assert (cycles > 0) == named == (1.75 * size - reach > 25.0), size
    steps = Line()
    noisy = steps.until(400, lambda: steps.step(told=ON, resolver=lambda r: r._replace(counts=r.counts + (58 if r.seq % 2 else 0))))
    assert 40 < noisy < 150
    quiet = Line()
    assert quiet.until(400, lambda: quiet.step(told=ON, resolver=lambda r: r._replace(counts=r.counts + (54 if r.seq % 2 else 0)))) == -1


def test_density_of_missing_frames() -> None:
    def every(line: Line, n: int, drop: int) -> None:
        frozen = line.state.resolver
        line.step(told=ON, **({"resolver": frozen} if line.k % n < drop else {}))

    line = Line(start=10)
    assert line.until(2000, lambda: every(line, 7, 1)) == -1  # 14 %
    dense = Line(start=10)
    cycles = dense.until(2000, lambda: every(dense, 7, 3))
    assert 40 < cycles < 100
    drives = Line(start=10)
    last = DriveSample(0, 0, True, 0, 0.0, 24.0)

    def lost(line: Line, n: int, drop: int) -> None:
        line.step(told=ON, drive=lambda d: last._replace(seq=line.state.drive_seq, stamp_ns=d.stamp_ns) if line.k % n < drop else d)

    assert drives.until(2000, lambda: lost(drives, 7, 1)) == -1
    thin = Line(start=10)
    assert 40 < thin.until(2000, lambda: lost(thin, 7, 3)) < 100
    assert 0.0 <= drives.state.drive_gap_s < 0.02


def test_drive_stale_fault_code_and_state() -> None:
    line = Line()
    line.step()
    old = DriveSample(0, 0, False, 0, 0.0, 24.0)
    for _ in range(5):
        line.step(drive=old)
    line.step(drive=old, fault="drive-stale")
    Line().step(drive=DriveSample(0, -1, False, 0, 0.0, 24.0), fault="drive-stale")
    Line().step(drive=lambda d: d._replace(fault_code=0x2310), fault="drive-fault")
    for told in (ON, Told(0.0, 0.0, False, True)):
        slow = Line(start=1)
        assert slow.until(200, lambda s=slow, t=told: s.step(told=t, drive=lambda d: d._replace(enabled=not t.enable))) == 151
        other = Line()
        other.step(told=told)
        assert other.until(50, lambda other=other, told=told: other.step(told=told, drive=lambda d: d._replace(enabled=not told.enable))) == 21
        switching = Line()
        unsettled = told._replace(settled=False)
        assert switching.until(50, lambda s=switching, t=unsettled: s.step(told=t, drive=lambda d: d._replace(enabled=not t.enable))) == -1
    again = Line()
    again.step(told=ON)
    for _ in range(15):
        again.step(told=ON, drive=lambda d: d._replace(enabled=False))
    again.step(told=ON)
    assert again.until(50, lambda: again.step(told=ON, drive=lambda d: d._replace(enabled=False))) == 21


def test_currents() -> None:
    for sign in (1.0, -1.0):
        over = Line(start=1)
        assert over.until(20, lambda over=over, sign=sign: over.step(drive=lambda d: d._replace(current_a=sign * 7.6))) == 4
        under = Line(start=1)
        assert under.until(20, lambda under=under, sign=sign: under.step(drive=lambda d: d._replace(current_a=sign * 7.4))) == -1
        off = Line()
        cycles = off.until(200, lambda off=off, sign=sign: off.step(told=moving(0.0, 1.0), drive=lambda d: d._replace(current_a=1.0 + sign * 1.0)))
        assert cycles == 28  # 20 ms * ln(1 / 0.25)
        close = Line()
        nearly = moving(0.0, 1.0)
        assert close.until(300, lambda c=close, s=sign, t=nearly: c.step(told=t, drive=lambda d: d._replace(current_a=1.0 + s * 0.74))) == -1
    # disturbed without a mean
    rough = Line()
    assert rough.until(200, lambda: rough.step(told=ON, drive=lambda d: d._replace(current_a=2.0 * (-1.0) ** d.seq))) == 17  # 20 ms * ln(4 / 1.75)
    mild = Line()
    assert mild.until(300, lambda: mild.step(told=ON, drive=lambda d: d._replace(current_a=1.4 * (-1.0) ** d.seq))) == -1
    # a drive in velocity mode makes its own current; one without power, or just switched, has none
    own = Line(replace(limits(), torque_mode=False))
    assert own.until(200, lambda: own.step(told=ON, drive=lambda d: d._replace(current_a=2.0))) == -1
    for told in (Told(0.0, 2.0, False, True), Told(0.0, 2.0, True, False)):
        idle = Line()
        assert idle.until(200, lambda idle=idle, told=told: idle.step(told=told, drive=lambda d: d._replace(current_a=0.0))) == -1
    # what is off although told on is no measurement of the current, but the sums stay
    flickering = Line()
    for _ in range(10):
        flickering.step(told=moving(0.0, 2.0), drive=lambda d: d._replace(current_a=1.0))
    kept = flickering.state.current_error_a
    flickering.step(told=moving(0.0, 2.0), drive=lambda d: d._replace(current_a=0.0, enabled=False))
    assert flickering.state.current_error_a == kept < -0.3
    flickering.step(told=Told(0.0, 0.0, False, True))
    assert (flickering.state.current_error_a, flickering.state.current_power_a2) == (0.0, 0.0)


def test_supply_and_finite_numbers() -> None:
    for volts, cycles in ((17.9, 21), (18.0, -1), (30.0, -1), (30.1, 21)):
        line = Line(start=1)
        assert line.until(60, lambda line=line, volts=volts: line.step(drive=lambda d: d._replace(bus_voltage_v=volts))) == cycles
    dip = Line(start=1)
    for _ in range(15):
        dip.step(drive=lambda d: d._replace(bus_voltage_v=10.0))
    dip.step()
    for _ in range(15):
        dip.step(drive=lambda d: d._replace(bus_voltage_v=10.0))
    for change in ({"current_a": nan}, {"bus_voltage_v": nan}):
        bad = Line()
        bad.step()
        good = bad.state.drive
        bad.step(drive=lambda d, change=change: d._replace(**change), fault="not-finite")
        assert bad.state.drive == good


def test_the_first_of_several_is_named() -> None:
    line = Line()
    line.step(resolver=ResolverSample(0, -1, 0, 0), drive=lambda d: d._replace(fault_code=1), fault="resolver-stale")


def test_the_start_knows_nothing() -> None:
    s = axis.START
    assert (s.resolver.seq, s.drive_seq, s.seq, s.drive) == (-1, -1, -1, None)
    assert {s.step, s.noise_counts2, s.idle_rad, s.follow_rad, s.resolver_gap_s, s.drive_gap_s, s.current_error_a, s.current_power_a2} == {0.0}
    assert {s.known, s.bad, s.doubted, s.converter_since, s.state_since, s.over_since, s.supply_since} == {0}
    line = Line(start=5)
    line.step()
    assert (line.state.step, line.state.known, line.state.bad, line.state.resolver_gap_s) == (0.0, 1, 0, 0.0)
    line.step(30.0)
    assert line.state.step == pytest.approx(30.0)
    assert line.state.known == 2
    line.step(30.0)
    assert line.state.known == 2
    assert line.state.noise_counts2 == pytest.approx(0.0, abs=1e-12)


def test_after_a_jump_that_stays_the_memory_is_new() -> None:
    line = Line()
    for _ in range(5):
        line.step(40.0, told=moving(40.0))
    for fault in (None,) * 5 + ("resolver-jump",):
        line.step(resolver=lambda r: r._replace(counts=r.counts + 9000), fault=fault)
    assert (line.state.step, line.state.known, line.state.bad, line.state.doubted) == (0.0, 1, 0, 0)
    assert line.state.resolver.counts == round(line.counts) + 9000
    # the bucket has counted the doubted ones, and leaks
    full = line.state.resolver_gap_s
    assert full == pytest.approx(6e-3)
    line.step(resolver=lambda r: r._replace(counts=r.counts + 9000))
    assert line.state.resolver_gap_s == pytest.approx(full - 0.15 / 0.85 * DT)
    while line.state.resolver_gap_s > 0.0:
        line.step(resolver=lambda r: r._replace(counts=r.counts + 9000))
    assert line.state.resolver_gap_s == 0.0


def test_an_old_sequence_is_not_new_and_doubt_counts_only_what_came() -> None:
    line = Line()
    for _ in range(5):
        line.step()
    line.step(resolver=lambda r: r._replace(seq=r.seq - 1))
    assert (line.state.bad, line.state.doubted, line.state.seq) == (1, 0, 4)
    line.step(resolver=lambda r: r._replace(counts=99999))
    assert (line.state.bad, line.state.doubted, line.state.seq) == (2, 1, 6)
    line.step(resolver=lambda r: r._replace(counts=99999, seq=6))
    assert (line.state.bad, line.state.doubted) == (3, 1)
    line.step()
    assert (line.state.bad, line.state.doubted) == (0, 0)


def test_conditions_start_anew_after_a_good_cycle() -> None:
    for change in ({"current_a": 9.0}, {"bus_voltage_v": 5.0}):
        line = Line()
        for _ in range(3):
            line.step(drive=lambda d, c=change: d._replace(**c))
        assert max(line.state.over_since, line.state.supply_since) == 1
        line.step()
        assert (line.state.over_since, line.state.supply_since, line.state.state_since) == (0, 0, 0)
    line = Line()
    line.step(told=ON, drive=lambda d: d._replace(enabled=False))
    assert line.state.state_since == 1
    line.step(told=ON)
    assert line.state.state_since == 0
