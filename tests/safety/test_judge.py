"""The judge as a whole: what is handed on, which commands a measurement is compared with, and cycles left out."""

from __future__ import annotations

from math import inf, nan
from pathlib import Path

import pytest
from tests.safety.toy import Toy

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.messages import NO_DRIVE, Command, Estimate, Measurement
from spsp_ctrl.safety import judge as judging
from spsp_ctrl.safety.faults import BY_ID, FAULTS, Reaction
from spsp_ctrl.safety.judge import NOTHING, START, JudgeState, bits, gravest, hold_faults, judge, judge_limits

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
MS, DT = 1_000_000, 1e-3
OFF = Command(0, 0, False, 0.0, 0.0, 0.0, 0.0, 0.0)


def begun(cycles: int = 300) -> tuple[Toy, JudgeState]:
    """A rig at rest whose signals have been good for a while."""
    toy, s, p = Toy(), START._replace(last=OFF, before=OFF), judge_limits(RIG)
    for _ in range(cycles):
        m = toy.read()
        found, used, s = judge(s, p, m, True, m.stamp_ns, DT)
        toy.write(OFF)
    assert found == NOTHING
    assert used == m
    return toy, s


def test_parts_get_their_own_actuator() -> None:
    other = RIG.model_copy(update={"roll_actuator": RIG.roll_actuator.model_copy(update={"resolver_bits": 16})})
    p = judge_limits(other)
    assert p.roll.rad_per_count == p.pitch.rad_per_count / 4.0
    assert p.period_s == 1e-3
    assert judge_limits(other.model_copy(update={"rate_hz": 500})).period_s == 2e-3


@pytest.mark.parametrize(
    ("field", "change", "place", "name"),
    [
        ("resolver_pitch", {"status": 1}, 0, ""),
        ("drive_pitch", {"fault_code": 7}, 0, "drive-fault"),
        ("drive_roll", {"fault_code": 7}, 1, "drive-fault"),
        ("imu", {"valid": False}, 2, ""),
        ("azimuth", {"rate_microsteps_s": nan}, 3, "not-finite"),
        ("temperature", {"screw_roll_c": 50.0}, 4, "temperature-jump"),
    ],
)
def test_what_is_bad_is_named_in_its_place_and_not_handed_on(field: str, change: dict[str, object], place: int, name: str) -> None:
    toy, s = begun()
    m = toy.read()
    sample = getattr(m, field)
    hurt = m._replace(**{field: sample._replace(seq=sample.seq + 1, **change)})
    found, used, after = judge(s, judge_limits(RIG), hurt, True, m.stamp_ns, DT)
    assert [f.id if f else "" for f in found] == ["" if i != place else name for i in range(6)]
    if field != "drive_pitch" and field != "drive_roll":
        assert getattr(used, field) != getattr(hurt, field)
    assert used.base == m.base
    assert (used.stamp_ns, used.cycle) == (m.stamp_ns, m.cycle)
    assert after != s


def test_before_anything_was_good_nothing_is_believed() -> None:
    m = Toy().read()
    empty = m._replace(drive_pitch=m.drive_pitch._replace(current_a=nan), azimuth=m.azimuth._replace(rate_microsteps_s=inf))
    found, used, _ = judge(START, judge_limits(RIG), empty, True, 0, DT)
    assert used.drive_pitch == NO_DRIVE
    assert used.drive_roll == m.drive_roll
    assert used.azimuth.rate_microsteps_s == 0.0
    assert found.pitch is BY_ID["not-finite"]
    assert found.imu is BY_ID["imu-stale"] or m.imu.seq >= 0


def test_a_measurement_is_compared_with_the_command_that_made_it() -> None:
    """Current and azimuth of the command before the last, power of the last, speed asked for in the last."""
    toy, s = begun()
    p = judge_limits(RIG)
    last = OFF._replace(enable=True, pitch_current_a=9.0, roll_current_a=9.0, azimuth_rate_rad_s=9.0)
    before = OFF._replace(enable=True, pitch_current_a=1.0, roll_current_a=-2.0, azimuth_rate_rad_s=0.1)
    s = s._replace(last=last, before=before, speed_pitch_rad_s=10.0, speed_roll_rad_s=-20.0, turned_rad=0.0)
    m = toy.read()
    m = m._replace(
        drive_pitch=m.drive_pitch._replace(enabled=True, current_a=1.0), drive_roll=m.drive_roll._replace(enabled=True, current_a=-2.0)
    )
    found, _, after = judge(s, p, m, True, m.stamp_ns, DT)
    assert found == NOTHING
    assert after.pitch.current_error_a == after.roll.current_error_a == 0.0
    moved = [(m.resolver_pitch.counts - s.pitch.resolver.counts), (m.resolver_roll.counts - s.roll.resolver.counts)]
    assert after.pitch.follow_rad == pytest.approx(10.0 * DT - moved[0] * p.pitch.rad_per_count)
    assert after.roll.follow_rad == pytest.approx(-20.0 * DT - moved[1] * p.roll.rad_per_count)
    assert (after.pitch.state_since, after.roll.state_since) == (0, 0)
    # azimuth travel adds up until the stepper's next frame
    if m.azimuth.seq == s.azimuth.seq:
        assert after.turned_rad == pytest.approx(0.1 * DT)
    for _ in range(11):
        m = toy.read()
        same = after.azimuth.seq
        total = after.turned_rad
        found, _, after = judge(after._replace(last=OFF, before=before), p, m, True, m.stamp_ns, DT)
        assert after.turned_rad == (pytest.approx(total + 0.1 * DT) if after.azimuth.seq == same else 0.0)
    # just switched: not yet judged
    toy, s = begun()
    m = toy.read()
    _, _, after = judge(s._replace(last=last, before=OFF), p, m, True, m.stamp_ns, DT)
    assert after.pitch.state_since == 0
    _, _, after = judge(s._replace(last=last, before=before), p, m, True, m.stamp_ns, DT)
    assert after.pitch.state_since == m.stamp_ns
    # before there was a command nobody was told anything
    for last_, before_ in ((None, before), (last, None)):
        _, _, after = judge(s._replace(last=last_, before=before_, turned_rad=0.5), p, m, True, m.stamp_ns, DT)
        assert after.pitch.state_since == 0
        assert after.turned_rad in (0.5, 0.0)


def test_homed_or_not_reaches_the_zero_switch() -> None:
    for homed, since in ((True, True), (False, False)):
        toy, s = begun()
        toy.azimuth = 0.1
        s = s._replace(azimuth=s.azimuth._replace(lost=True))
        for _ in range(11):
            m = toy.read()
            m = m._replace(azimuth=m.azimuth._replace(home_switch=True))
            _, _, s = judge(s, judge_limits(RIG), m, homed, m.stamp_ns, DT)
        assert (s.azimuth.home_since > 0) == since


def test_cycles_left_out() -> None:
    def skipping(periods: float, every: int, cycles: int) -> int:
        toy, s = begun()
        p, now = judge_limits(RIG), toy.k * MS
        for n in range(cycles):
            dt = periods * DT if n % every == 0 else DT
            now += round(dt * 1e9)
            toy.k = now // MS
            m = toy.read()
            found, _, s = judge(s, p, m, True, now, dt)
            if found.late:
                assert found.late.id == "loop-late"
                return n
        assert s.late_s <= 0.02
        return -1

    assert skipping(1.4, 1, 400) == -1
    assert skipping(2.0, 40, 2000) == -1  # 2.5 % of the time
    assert skipping(3.0, 10, 400) == 110  # 2 ms each, less 0.4 ms in between
    assert skipping(22.5, 1000, 3) == 0
    assert skipping(20.5, 1000, 3) == -1


def test_gravest_and_bits() -> None:
    soft, hard, note = BY_ID["imu-stale"], BY_ID["resolver-fault"], BY_ID["derating"]
    other = BY_ID["drive-fault"]
    assert gravest((None, None)) is None
    assert gravest((None, note, soft, None, hard, other)) is hard
    assert gravest((other, hard)) is other
    assert gravest((note, None)) is note
    assert bits((None, soft, note, soft)) == (1 << 1) | (1 << 39)
    assert bits(()) == 0
    assert {f.id for f in hold_faults()} == {f.id for f in FAULTS if f.reaction == Reaction.HOLD} >= {"derating", "log-backlog"}


def test_finite() -> None:
    e = Estimate(*((0.5,) * (len(Estimate._fields) - 1)), False)
    c = Command(1, 2, True, 1.0, 2.0, 3.0, 4.0, 5.0)
    assert judging.estimate_is_finite(e)
    assert judging.command_is_finite(c)
    for name in Estimate._fields[:-1]:
        for bad in (nan, inf, -inf):
            assert not judging.estimate_is_finite(e._replace(**{name: bad}))
    for name in Command._fields[3:]:
        for bad in (nan, inf, -inf):
            assert not judging.command_is_finite(c._replace(**{name: bad}))
    _ = Measurement
