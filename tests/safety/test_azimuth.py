"""The azimuth stepper: its age, its count against what it was told, and its three switches."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan, pi, radians
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.messages import NO_AZIMUTH, AzimuthSample
from spsp_ctrl.safety import azimuth
from spsp_ctrl.safety.azimuth import AzimuthState, azimuth_limits

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
P = azimuth_limits(RIG)
MS, DT = 1_000_000, 1e-3
STEP_DEG = 360.0 / 76800.0
Change = Callable[[AzimuthSample], AzimuthSample]


class Stepper:
    """Turns at the rate it is told, served at 100 Hz."""

    def __init__(self, start_deg: float = 0.0, *, homed: bool = True) -> None:
        self.state: AzimuthState = azimuth.START
        self.k = 0
        self.angle_deg = start_deg
        self.told = 0.0
        self.homed = homed
        self.sample = NO_AZIMUTH

    def step(self, rate_deg_s: float = 0.0, change: Change | None = None, *, follows: float = 1.0, silent: bool = False, enabled: bool = True) -> str:
        now = self.k * MS
        self.angle_deg += follows * rate_deg_s * DT
        self.told += radians(rate_deg_s) * DT
        if self.k % 10 == 0 and not silent:
            sample = AzimuthSample(
                now, self.k // 10, enabled, round(self.angle_deg / STEP_DEG), rate_deg_s / STEP_DEG, False, False, abs(self.angle_deg) < 0.5
            )
            self.sample = change(sample) if change else sample
        seq = self.state.seq
        fault, self.state = azimuth.step(self.state, P, self.sample, self.told, enabled, self.homed, now, DT)
        if self.state.seq != seq:
            self.told = 0.0
        self.k += 1
        return fault.id if fault else ""

    def run(self, cycles: int, rate_deg_s: float = 0.0, change: Change | None = None, **how: object) -> tuple[str, int]:
        """The first fault and when, in ms."""
        for n in range(cycles):
            found = self.step(rate_deg_s, change, **how)  # type: ignore[arg-type]
            if found:
                return found, n
        return "", -1


def test_constants_from_the_rig_file() -> None:
    assert P.stale_ns == 55 * MS
    assert P.overdue_ns == 20 * MS
    assert P.rad_per_microstep == pytest.approx(2.0 * pi / 76800.0)
    assert P.rate_rad_s == pytest.approx(radians(25.0))
    assert (P.switch_ns, P.home_ns) == (10 * MS, 30 * MS)


def test_health_at_rest_turning_and_through_zero() -> None:
    assert Stepper().run(500) == ("", -1)
    for start, rate in ((-10.0, 20.0), (10.0, -20.0)):
        stepper = Stepper(start)
        assert stepper.run(1500, rate) == ("", -1)
        assert stepper.state.good == stepper.sample
        assert abs(stepper.state.follow_rad) < radians(0.02)


def test_nothing_yet_is_stale_and_so_is_silence() -> None:
    assert Stepper().step(silent=True) == "azimuth-stale"
    stepper = Stepper()
    stepper.run(100)
    assert stepper.run(200, silent=True) == ("azimuth-stale", 46)  # 55 ms after the stamp of the newest, 10 ms ago
    stepper.run(2)
    late = Stepper()
    late.run(100)
    assert late.run(300, change=lambda a: a._replace(stamp_ns=a.stamp_ns + 100 * MS)) == ("azimuth-stale", 46)


def test_density_of_missing_frames() -> None:
    sparse = Stepper()
    for _ in range(4000):
        assert sparse.step(silent=(sparse.k // 10) % 5 == 1) == ""
    thin = Stepper()
    n = 0
    while not thin.step(silent=(thin.k // 10) % 5 != 0) and n < 4000:
        n += 1
    assert 150 < n < 400
    rest = Stepper()
    rest.run(100)
    for _ in range(40):
        rest.step(silent=True)
    full = rest.state.overdue_s
    assert full == pytest.approx(0.029, abs=2e-3)
    for _ in range(30):
        rest.step()
    assert rest.state.overdue_s == pytest.approx(full - 0.03 * 0.3 / 0.7, abs=2e-3)
    for _ in range(100):
        rest.step()
    assert rest.state.overdue_s == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_count_that_does_not_follow(sign: float) -> None:
    still = Stepper(5.0)
    still.run(100)
    found, ms = still.run(1000, sign * 10.0, follows=0.0)
    assert found == "azimuth-following"
    assert 100 < ms < 160  # 0.5 deg and 60 ms of speed, at 10 deg/s
    # a tenth less is wind-up and service
    close = Stepper(5.0)
    assert close.run(3000, sign * 4.0, follows=0.9) == ("", -1)
    # one that runs by itself
    runaway = Stepper(5.0)
    runaway.run(100)
    found, ms = runaway.run(1000, 0.0, lambda a: a._replace(microsteps=a.microsteps + round(sign * (runaway.k - 100) * 5e-3 / STEP_DEG)))
    assert found == "azimuth-following"
    assert 90 < ms < 130
    # power off: nobody follows
    off = Stepper(5.0)
    assert off.run(1000, sign * 10.0, follows=0.0, enabled=False) == ("", -1)
    assert off.state.follow_rad == 0.0


def test_jumps_and_impossible_rates_are_not_believed() -> None:
    reach = radians(1.0) + radians(25.0) * 0.01
    for size, jumps in ((reach * 0.99, False), (reach * 1.01, True), (-reach * 1.01, True)):
        stepper = Stepper(5.0)
        stepper.run(100, enabled=False)
        before = stepper.state.good
        found = stepper.step(enabled=False, change=lambda a, s=size: a._replace(microsteps=a.microsteps + round(s / P.rad_per_microstep)))
        assert (found == "azimuth-following") == jumps, size
        assert (stepper.state.good == before) == jumps
        assert stepper.state.lost == jumps
        if jumps:  # from there on it is judged anew
            for _ in range(9):
                assert stepper.step(enabled=False) == "azimuth-following"
            assert stepper.step(enabled=False) == ""
            assert not stepper.state.lost
    for rate, jumps in ((49.0, False), (51.0, True), (-51.0, True)):
        stepper = Stepper(5.0)
        stepper.run(100)
        assert (stepper.step(change=lambda a, r=rate: a._replace(rate_microsteps_s=r / STEP_DEG)) == "azimuth-following") == jumps
    for bad in (nan, inf):
        stepper = Stepper(5.0)
        stepper.run(100)
        before = stepper.state.good
        assert stepper.step(change=lambda a, r=bad: a._replace(rate_microsteps_s=r)) == "not-finite"
        assert stepper.state.good == before
    back = Stepper(5.0)
    back.run(100)
    assert back.step(change=lambda a: a._replace(stamp_ns=a.stamp_ns - 10 * MS)) == "azimuth-following"


def test_switches() -> None:
    def press(left: bool, right: bool) -> Change:
        return lambda a: a._replace(left_switch=left, right_switch=right)

    for left, right, name in ((True, False, "travel-switch"), (False, True, "travel-switch"), (True, True, "switch-implausible")):
        stepper = Stepper(5.0)
        stepper.run(100)
        assert stepper.run(50, change=press(left, right)) == (name, 10)
        bounce = Stepper(5.0)
        bounce.run(100)
        for n in range(10):
            for _ in range(10):
                assert bounce.step(change=press(left, right) if n % 2 else None) == ""
    first = Stepper(5.0)
    assert first.step(change=press(True, False)) == ""
    assert first.state.pressed_since == 1


def test_the_zero_switch_where_it_is_not() -> None:
    def on(a: AzimuthSample) -> AzimuthSample:
        return a._replace(home_switch=True)

    for angle, found in ((2.9, ("", -1)), (3.1, ("home-switch", 30)), (-3.1, ("home-switch", 30))):
        stepper = Stepper(angle)
        stepper.run(100)
        assert stepper.run(200, change=on) == found, angle
    lost = Stepper(3.1, homed=False)
    lost.run(100)
    assert lost.run(200, change=on) == ("", -1)
    flicker = Stepper(5.0)
    flicker.run(100)
    for n in range(12):
        for _ in range(10):
            assert flicker.step(change=on if n % 4 else None) == ""
    begin = Stepper(5.0)
    begin.step(change=on)
    assert begin.state.home_since == 1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_zero_switch_not_where_it_is(sign: float) -> None:
    def off(a: AzimuthSample) -> AzimuthSample:
        return a._replace(home_switch=False)

    stepper = Stepper(-4.0 * sign)
    found, ms = stepper.run(1000, 10.0 * sign, off)
    assert found == "home-switch"
    assert 540 <= ms <= 570  # at 1.5 deg on the other side
    # said once; then the next pass is judged
    for _ in range(9):
        assert stepper.step(10.0 * sign, off) == "home-switch"
    assert stepper.run(200, 10.0 * sign, off) == ("", -1)
    unknown = Stepper(-4.0 * sign, homed=False)
    assert unknown.run(1000, 10.0 * sign, off) == ("", -1)
    near = Stepper(-1.4 * sign)
    assert near.run(500, 10.0 * sign, off) == ("", -1)
    turned = Stepper(-4.0 * sign)
    turned.run(380, 10.0 * sign, off)
    assert turned.run(500, -10.0 * sign, off) == ("", -1)
    # seen once on the way to and fro, it must be seen again on the next pass
    twice = Stepper(-4.0 * sign)
    assert twice.run(800, 10.0 * sign) == ("", -1)
    assert twice.run(800, -10.0 * sign, off)[0] == "home-switch"
