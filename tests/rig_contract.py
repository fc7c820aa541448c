"""What every rig must do. Each rig's own test module calls ``check_contract`` with a factory; see ``tests/rig/test_simulated.py``."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from spsp_ctrl.messages import Command, Measurement
from spsp_ctrl.rig.base import Rig

PERIOD_NS = 1_000_000
Factory = Callable[[], Rig]


def command(k: int, current_a: float, *, enable: bool = True, azimuth: float = 0.0) -> Command:
    return Command(k * PERIOD_NS, k, enable, current_a, 0.0, -current_a, 0.0, azimuth)


def drive(rig: Rig, cycles: int, current_a: Callable[[int], float]) -> list[Measurement]:
    seen = []
    for k in range(cycles):
        seen.append(rig.read(k * PERIOD_NS))
        rig.write(command(k, current_a(k)), k * PERIOD_NS)
    return seen


def check_command_acts_one_cycle_later(make: Factory) -> None:
    """Inputs latched at SYNC k; the command of that cycle acts from SYNC k+1, so its effect is first seen at SYNC k+2."""
    quiet, moved = make(), make()
    for rig in (quiet, moved):
        rig.open()
    a = drive(quiet, 8, lambda k: 0.0)
    b = drive(moved, 8, lambda k: 3.0 if k == 3 else 0.0)
    for k in range(5):
        assert a[k] == b[k], f"SYNC {k} already shows the command of cycle 3"
    assert abs(b[5].drive_pitch.current_a - a[5].drive_pitch.current_a) > 0.5


def check_stamps_and_sequences(make: Factory) -> None:
    """Stamps never lie in the future and never go back, sequences only grow, signals of the cycle carry its own stamp."""
    rig = make()
    rig.open()
    before: Measurement | None = None
    for m in drive(rig, 400, lambda k: 0.0):
        assert m.stamp_ns == m.cycle * PERIOD_NS
        for sample in (m.imu, m.resolver_pitch, m.resolver_roll, m.drive_pitch, m.drive_roll, m.azimuth, m.temperature, m.base):
            assert sample.stamp_ns <= m.stamp_ns
        assert m.resolver_pitch.stamp_ns == m.drive_roll.stamp_ns == m.stamp_ns
        if before is not None:
            for name in ("imu", "resolver_pitch", "drive_pitch", "azimuth", "temperature", "base"):
                old, new = getattr(before, name), getattr(m, name)
                assert new.seq >= old.seq
                assert new.stamp_ns >= old.stamp_ns
        before = m
    assert before is not None
    assert before.imu.seq > 50
    assert before.imu.received_ns > before.imu.stamp_ns


def check_read_twice_is_the_same(make: Factory) -> None:
    """Reading the same SYNC again neither waits nor advances anything."""
    rig = make()
    rig.open()
    drive(rig, 10, lambda k: 1.0)
    assert rig.read(9 * PERIOD_NS) == rig.read(9 * PERIOD_NS)


def check_skipped_cycles_hold_the_command(make: Factory) -> None:
    """After a skipped cycle the rig has moved on under the last command."""
    rig = make()
    rig.open()
    drive(rig, 5, lambda k: 2.0)
    m = rig.read(9 * PERIOD_NS)
    assert m.cycle == 9
    assert m.drive_pitch.current_a > 1.0


def check_write_returns_what_is_sent(make: Factory) -> None:
    """A command that is not finite never reaches a drive, and the caller is told."""
    rig = make()
    rig.open()
    rig.read(0)
    good = command(0, 0.5)
    assert rig.write(good, 0) == good
    for bad in (math.nan, math.inf, -math.inf):
        rig.read(PERIOD_NS)
        sent = rig.write(command(1, bad), PERIOD_NS)
        assert not sent.enable
        assert all(math.isfinite(value) for value in sent)


def check_stop_cannot_fail(make: Factory) -> None:
    """Stop works before open, while moving, twice, after close; afterwards nothing is powered whatever is written."""
    make().stop()
    rig = make()
    rig.open()
    drive(rig, 50, lambda k: 3.0)
    rig.stop()
    rig.stop()
    for k in range(50, 100):
        rig.read(k * PERIOD_NS)
        assert not rig.write(command(k, 3.0), k * PERIOD_NS).enable
    m = rig.read(100 * PERIOD_NS)
    assert not m.drive_pitch.enabled
    assert abs(m.drive_pitch.current_a) < 0.1
    rig.close()
    rig.stop()


def check_same_seed_same_bits(make: Factory) -> None:
    """Two rigs of one seed give the same measurements to the last bit."""
    runs = []
    for _ in range(2):
        rig = make()
        rig.open()
        runs.append(drive(rig, 300, lambda k: math.sin(k / 20.0)))
    assert runs[0] == runs[1]


CONTRACT = (
    check_command_acts_one_cycle_later,
    check_stamps_and_sequences,
    check_read_twice_is_the_same,
    check_skipped_cycles_hold_the_command,
    check_write_returns_what_is_sent,
    check_stop_cannot_fail,
    check_same_seed_same_bits,
)
contract = pytest.mark.parametrize("check", CONTRACT, ids=lambda check: check.__name__.removeprefix("check_"))
