"""The IMU judged frame by frame: what is dropped, how long the loop coasts, and when which fault is named."""

from __future__ import annotations

from math import cos, exp, inf, nan, pi, radians, sin
from pathlib import Path
from random import Random

import pytest

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.messages import NO_IMU, ImuSample
from spsp_ctrl.safety import imu
from spsp_ctrl.safety.imu import ImuLimits, ImuState, imu_limits

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
MS, DT = 1_000_000, 1e-3
ARCMIN = radians(1.0 / 60.0)


class Unit:
    """An IMU at 200 Hz with 5 ms delay on a moving platform: the test hurts its frames."""

    def __init__(self, p: ImuLimits | None = None, rate_rad_s: float = 0.0) -> None:
        self.p = p or imu_limits(RIG)
        self.state: ImuState = imu.START
        self.k = 0
        self.rate = rate_rad_s
        self.random = Random(1)
        self.frame: ImuSample = NO_IMU
        self.found = ""

    def made(self, n: int) -> ImuSample:
        """Frame ``n``, as a healthy unit sends it."""
        t, noise = 5e-3 * n, self.random.gauss
        w = self.rate * sin(t)
        angle = self.rate * (1.0 - cos(t))
        quiet = (noise(0.0, 1e-5), noise(0.0, 1e-5), noise(0.0, 1e-5))
        return ImuSample(
            5 * n * MS, (5 * n + 5) * MS, n, True, quiet[0], angle + quiet[1], quiet[2], noise(0.0, 4e-4), w + noise(0.0, 4e-4), noise(0.0, 4e-4)
        )

    def step(self, hurt: object = None, *, silent: bool = False) -> str:
        """One cycle of 1 ms; ``hurt`` changes a new frame."""
        now = self.k * MS
        if self.k >= 5 and self.k % 5 == 0 and not silent:
            frame = self.made(self.k // 5 - 1)
            self.frame = hurt(frame) if callable(hurt) else frame  # type: ignore[assignment]
        fault, self.state = imu.step(self.state, self.p, self.frame, now, DT)
        self.found = fault.id if fault else ""
        self.k += 1
        return self.found

    def run(self, cycles: int, hurt: object = None, *, silent: bool = False) -> tuple[str, int]:
        """The first fault and when, in ms."""
        for n in range(cycles):
            if self.step(hurt, silent=silent):
                return self.found, n
        return "", -1


def good(rate_rad_s: float = 0.0, p: ImuLimits | None = None) -> Unit:
    """After a second of health."""
    unit = Unit(p, rate_rad_s)
    for _ in range(10):
        unit.step()
    assert unit.run(990) == ("", -1)
    assert unit.state.good == unit.frame
    return unit


def test_constants_from_the_rig_file() -> None:
    p = imu_limits(RIG)
    assert p.stale_ns == 90 * MS
    assert p.overdue_ns == 12_500_000
    assert p.late_ns == 14 * MS
    assert p.stuck_frames == 40
    assert p.density_s == 0.15
    assert p.noisy_frames == 180


def test_before_the_first_frame_there_is_none() -> None:
    unit = Unit()
    assert unit.step() == "imu-stale"
    assert unit.state.good == NO_IMU


def test_health_at_rest_and_in_a_swing() -> None:
    good()
    good(0.5)


def test_silence_is_coasted_over_and_then_stale() -> None:
    unit = good()
    frame = unit.state.good
    assert unit.run(200, silent=True) == ("imu-stale", 81)  # 90 ms after the stamp of the newest, which is 9 ms old here already
    assert unit.state.good == frame
    for _ in range(10):
        unit.step()
    assert unit.found == ""
    assert unit.state.good.seq > frame.seq


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"valid": False}, "imu-invalid"),
        ({"pitch_rad": nan}, "imu-invalid"),
        ({"gyro_z_rad_s": inf}, "imu-invalid"),
        ({"roll_rad": 1.05}, "imu-range"),
        ({"roll_rad": -1.05}, "imu-range"),
        ({"pitch_rad": 1.05}, "imu-range"),
        ({"pitch_rad": -1.05}, "imu-range"),
        ({"yaw_rad": 6.3}, "imu-range"),
        ({"gyro_x_rad_s": 3.5}, "imu-range"),
        ({"gyro_y_rad_s": -3.5}, "imu-range"),
        ({"gyro_z_rad_s": 3.5}, "imu-range"),
        ({"pitch_rad": 21.0 * ARCMIN}, "imu-gyro"),
        ({"roll_rad": -21.0 * ARCMIN}, "imu-gyro"),
        ({"yaw_rad": 21.0 * ARCMIN}, "imu-gyro"),
    ],
)
def test_a_bad_frame_never_replaces_a_good_one(change: dict[str, object], name: str) -> None:
    unit = good()
    before = unit.state.good

    def hurt(frame: ImuSample) -> ImuSample:
        return frame._replace(**change)  # type: ignore[arg-type]

    for _ in range(20):
        assert unit.step(hurt) == ""
        assert unit.state.good == before
    named, ms = unit.run(200, hurt)
    assert (named, ms) == (name, 61)
    # a single one is only a gap
    other = good()
    for _ in range(5):
        other.step(hurt)
    assert other.run(300) == ("", -1)
    assert other.state.why is None


@pytest.mark.parametrize("change", [{"roll_rad": 1.04}, {"pitch_rad": -1.04}, {"yaw_rad": 6.28}, {"gyro_x_rad_s": 3.48}, {"gyro_z_rad_s": -3.48}])
def test_what_a_rig_can_do_is_within_range(change: dict[str, float]) -> None:
    assert imu._form(Unit().made(3)._replace(**change), 2, NO_IMU, 20 * MS) is None  # type: ignore[arg-type]


def test_sequence_and_stamps_must_go_on() -> None:
    frame, before = Unit().made(10), Unit().made(9)
    now = 55 * MS

    def form(f: ImuSample, last: int = 9, was: ImuSample = before, at: int = now) -> str:
        fault = imu._form(f, last, was, at)
        return fault.id if fault else ""

    assert form(frame) == ""
    assert form(frame, last=10) == form(frame, last=11) == "imu-invalid"
    assert form(frame, at=50 * MS) == ""
    assert form(frame, at=50 * MS - 1) == "imu-invalid"
    assert form(frame, was=before._replace(stamp_ns=50 * MS)) == "imu-invalid"
    assert form(frame, was=before._replace(stamp_ns=50 * MS - 1)) == ""
    assert form(frame, was=NO_IMU._replace(stamp_ns=99 * MS)) == ""


def test_a_frame_that_comes_too_late_is_of_no_use() -> None:
    for late, used in ((9, True), (10, False)):
        unit = good()
        for _ in range(5):
            unit.step(lambda f, late=late: f._replace(stamp_ns=f.stamp_ns - late * MS + MS))
        before = unit.state.good.seq
        unit.step(lambda f, late=late: f._replace(stamp_ns=f.stamp_ns - late * MS))
        assert (unit.state.good.seq > before) == used, late


def test_a_unit_that_has_restarted_is_believed_again_after_the_coasting() -> None:
    unit = good()

    def restarted(f: ImuSample) -> ImuSample:
        return f._replace(seq=f.seq - 150)

    assert unit.run(100, restarted) == ("imu-invalid", 81)
    for _ in range(15):
        unit.step(restarted)
    assert unit.found == ""
    assert unit.state.good.seq == unit.frame.seq < 100


@pytest.mark.parametrize("name", ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"])
def test_a_biased_gyro_parts_from_the_attitude(name: str) -> None:
    unit = good()
    # 2 deg/s reach 20 arcmin after 0.2 s; then frames are dropped and the loop coasts 85 ms on
    named, ms = unit.run(600, lambda f: f._replace(**{name: getattr(f, name) + radians(2.0)}))
    assert named == "imu-gyro"
    assert 250 < ms < 310
    small = good()
    assert small.run(3000, lambda f: f._replace(**{name: getattr(f, name) + radians(0.6)})) == ("", -1)


def test_attitude_and_gyro_are_compared_through_the_kinematics_of_euler_angles() -> None:
    """A true turn about an axis in space, on a tilted unit, is no contradiction; and headings may turn over at 180 deg."""
    roll, pitch, rate = 0.4, -0.3, 0.5

    def frame(n: int) -> ImuSample:
        yaw = 3.1 + rate * 5e-3 * n
        yaw = yaw - 2.0 * pi if yaw > pi else yaw
        p, q, r = -sin(pitch) * rate, sin(roll) * cos(pitch) * rate, cos(roll) * cos(pitch) * rate
        return ImuSample(5 * n * MS, 5 * n * MS, n, True, roll, pitch, yaw, p, q, r)

    for n in range(60):
        d = imu._against_gyro(frame(n), frame(n + 1), 5e-3)
        assert d == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    back = imu._against_gyro(frame(1), frame(0)._replace(stamp_ns=0), -5e-3)
    assert back == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    faster = frame(1)._replace(gyro_x_rad_s=1.0)
    assert imu._against_gyro(frame(0), faster, 5e-3)[0] == pytest.approx(-0.5 * (1.0 + sin(pitch) * rate) * 5e-3)


def test_noise() -> None:
    random = Random(3)
    for rms_arcmin, named in ((3.0, "imu-noise"), (0.6, "")):
        unit = good()
        found, ms = unit.run(1300, lambda f, s=rms_arcmin: f._replace(pitch_rad=f.pitch_rad + random.gauss(0.0, s * ARCMIN)))
        assert found == named, (rms_arcmin, ms)
    for rms_deg_s, named in ((1.5, "imu-noise"), (0.3, "")):
        unit = good()
        found, ms = unit.run(1300, lambda f, s=rms_deg_s: f._replace(gyro_x_rad_s=f.gyro_x_rad_s + random.gauss(0.0, radians(s))))
        assert found == named, (rms_deg_s, ms)
    # the verdict of a frame holds until the next
    unit = good()
    unit.run(1300, lambda f: f._replace(gyro_x_rad_s=f.gyro_x_rad_s + random.gauss(0.0, radians(3.0))))
    for _ in range(4):
        assert unit.step() == "imu-noise"


def test_the_noise_statistics_by_number() -> None:
    """One frame with a known contradiction: shares and squares as stated."""
    a = ImuSample(0, 0, 0, True, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    b = ImuSample(5 * MS, 10 * MS, 1, True, 3 * ARCMIN, 4 * ARCMIN, 12 * ARCMIN, 0.0, 0.0, 0.0)
    p = imu_limits(RIG)
    s = imu._take(imu._take(imu.START, p, a, 5 * MS), p, b, 10 * MS)
    share = 1.0 - exp(-5e-3 / 0.1)
    assert s.noise_rad2 == pytest.approx(share * 169.0 * ARCMIN**2, rel=1e-3)
    assert (s.part_roll, s.part_pitch, s.part_yaw) == pytest.approx((3 * ARCMIN, 4 * ARCMIN, 12 * ARCMIN))
    c = b._replace(stamp_ns=10 * MS, seq=2, gyro_x_rad_s=0.003, gyro_y_rad_s=0.004, gyro_z_rad_s=0.012)
    t = imu._take(s, p, c, 15 * MS)
    assert t.gyro_power == pytest.approx(share * 0.013**2)
    assert t.part_yaw == pytest.approx(12 * ARCMIN * exp(-5e-3 / 0.5) - 0.006 * 5e-3, rel=1e-3)
    assert (t.step_x, t.step_y, t.step_z) == (0.003, 0.004, 0.012)
    d = c._replace(stamp_ns=15 * MS, seq=3, gyro_x_rad_s=0.006, gyro_y_rad_s=0.008, gyro_z_rad_s=0.024)
    u = imu._take(t, p, d, 20 * MS)
    assert u.gyro_power == pytest.approx((1.0 - share) * t.gyro_power)  # a ramp has no second difference
    assert u.noise_rad2 < t.noise_rad2 < s.noise_rad2
    assert u.still == (2, 2, 2, 0, 0, 0)
    assert (u.same_attitude, u.same_gyro) == (2, 0)


@pytest.mark.parametrize("name", ["gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"])
def test_equal_gyro_frames_are_a_frozen_unit(name: str) -> None:
    unit = good()
    named, ms = unit.run(400, lambda f: f._replace(**{name: 0.001}))
    assert named == "imu-stuck"
    assert ms == 200  # 40 frames equal to the one before
    assert good(p=imu_limits(RIG.model_copy(update={"supervisor": RIG.supervisor.model_copy(update={"imu_stuck_frames": 0})}))).run(
        3000, lambda f: f._replace(gyro_x_rad_s=0.001, roll_rad=0.0)
    ) == ("", -1)


@pytest.mark.parametrize("name", ["roll_rad", "pitch_rad", "yaw_rad"])
def test_equal_attitudes_take_five_times_as_long(name: str) -> None:
    unit = good()
    assert unit.run(1400, lambda f: f._replace(**{name: 0.0})) == ("imu-stuck", 1000)


def test_density_of_missing_frames() -> None:
    def one_in(unit: Unit, n: int, lost: int) -> str:
        return unit.step(silent=(unit.k // 5) % n < lost)

    unit = good()
    for _ in range(6000):
        assert one_in(unit, 8, 1) == ""
    slow = good()
    k = 0
    named = ""
    while not named and k < 3000:
        named = one_in(slow, 4, 3)
        k += 1
    assert named == "imu-density"
    assert 150 < k < 500
    late = good()
    named, ms = late.run(400, lambda f: f._replace(stamp_ns=f.stamp_ns - 30 * MS))
    assert named == "imu-density"
    assert ms == 81
    # the bucket empties, but slowly
    rest = good()
    for _ in range(60):
        rest.step(silent=True)
    full = rest.state.overdue_s
    assert full == pytest.approx(0.057, abs=2e-3)
    for _ in range(100):
        rest.step()
    assert rest.state.overdue_s == pytest.approx(full - 0.15 / 0.85 * 0.1, abs=2e-3)
    for _ in range(400):
        rest.step()
    assert rest.state.overdue_s == 0.0
