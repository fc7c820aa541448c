"""IMU against resolvers, and room to brake before the end of the stroke."""

from __future__ import annotations

from math import exp, pi, radians, sqrt
from pathlib import Path

import pytest

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.messages import Estimate
from spsp_ctrl.safety import consistency
from spsp_ctrl.safety.consistency import ConsistencyState, consistency_limits

RIG = load_rig(Path(__file__).parents[2] / "config" / "rig.yaml").model
P = consistency_limits(RIG)
MS = 1_000_000
ZERO = Estimate(*((0.0,) * (len(Estimate._fields) - 1)), False)


def run(e: Estimate, innovation_sq: float = 0.0, cycles: int = 1, s: ConsistencyState = consistency.START, start_ms: int = 10) -> list[str]:
    found = []
    for k in range(cycles):
        fault, s = consistency.step(s, P, e, innovation_sq, (start_ms + k) * MS)
        found.append(fault.id if fault else "")
    return found


def test_constants() -> None:
    assert P.frame_share == pytest.approx(1.0 - exp(-1.0 / 20.0))
    assert (P.low_m, P.high_m) == pytest.approx((-0.0341, 0.0343))
    assert P.twice_accel_m_s2 == pytest.approx(2.0 * 0.4 / 0.5)
    assert P.pitch_m_rad == P.roll_m_rad == pytest.approx(4e-3 / (2.0 * pi * 3.0))
    assert P.travel_ns == 5 * MS


def test_innovations_above_a_degree() -> None:
    fresh = ZERO._replace(attitude_dt_s=5e-3)
    assert "imu-resolver" not in run(fresh, radians(0.99) ** 2, 400)
    found = run(fresh, radians(2.0) ** 2, 400)
    assert found.index("imu-resolver") == 5  # 20 frames * ln(4 / 3) = 5.8
    assert set(found[5:]) == {"imu-resolver"}
    # no frame, no news; nor from a dead-reckoned attitude
    assert "imu-resolver" not in run(ZERO, radians(20.0) ** 2, 400)
    assert "imu-resolver" not in run(fresh._replace(coasting=True), radians(20.0) ** 2, 400)


def moving(rod_m: float, speed_m_s: float, axis: str) -> Estimate:
    fields = {f"rod_{axis}_m": rod_m, f"motor_{axis}_rate_rad_s": speed_m_s / (4e-3 / (2.0 * pi * 3.0))}
    return ZERO._replace(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize("axis", ["pitch", "roll"])
@pytest.mark.parametrize(("end_m", "sign"), [(0.0343, 1.0), (-0.0341, -1.0)])
def test_room_to_brake(axis: str, end_m: float, sign: float) -> None:
    room = 0.004
    speed = sqrt(1.6 * (room + 0.5e-3))
    rod = end_m - sign * room
    assert set(run(moving(rod, sign * speed * 0.999, axis), cycles=20)) == {""}
    found = run(moving(rod, sign * speed * 1.001, axis), cycles=20)
    assert found == [""] * 5 + ["rod-travel"] * 15
    # going away from the end there is all the room of the stroke
    assert set(run(moving(rod, -sign * speed * 1.001, axis), cycles=20)) == {""}
    # past the end only standing and going back
    outside = end_m + sign * 0.6e-3
    assert run(moving(outside, sign * 1e-6, axis), cycles=20)[-1] == "rod-travel"
    assert set(run(moving(outside, 0.0, axis), cycles=20)) == {""} if sign > 0 else True
    assert set(run(moving(outside, -sign * 0.01, axis), cycles=20)) == {""}
    assert set(run(moving(end_m + sign * 0.4e-3, 0.0, axis), cycles=20)) == {""}
    # it must last
    fast = moving(rod, sign * speed * 1.2, axis)
    s = consistency.START
    for k in range(40):
        fault, s = consistency.step(s, P, fast if k % 5 else ZERO, 0.0, (10 + k) * MS)
        assert fault is None
    _, first = consistency.step(consistency.START, P, fast, 0.0, 0)
    assert first.travel_since == 1


@pytest.mark.parametrize("axis", ["pitch", "roll"])
def test_far_outside_the_stroke_the_zero_is_wrong(axis: str) -> None:
    for rod, name in ((0.0343 + 1.9e-3, ""), (0.0343 + 2.1e-3, "not-referenced"), (-0.0341 - 1.9e-3, ""), (-0.0341 - 2.1e-3, "not-referenced")):
        assert run(ZERO._replace(**{f"rod_{axis}_m": rod})) == [name]  # type: ignore[arg-type]
