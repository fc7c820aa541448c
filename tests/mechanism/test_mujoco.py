"""Independent check by MuJoCo: the linkage as bodies, joints and two loop closures; nothing of it comes from our equations.

Attitude for given rod lengths: rods and closures are stiff constraints, gravity is off, the model settles; what then remains open in
the closures is the residual. Mobility: joint freedoms less the rank of the closures' Jacobian.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from spsp_ctrl.mechanism import frames, kinematics, mobility, vectorised

PAPER = (0.2655, 0.1, 0.1)
LARGE = (0.62, 0.24, 0.30)
AXES = {"x": "1 0 0", "y": "0 1 0"}


def vec(v: NDArray[np.float64]) -> str:
    return " ".join(repr(float(x)) for x in v)


def linkage(lengths: tuple[float, float, float], pitch: float = 0.0, roll: float = 0.0, r_axis: str = "y") -> mujoco.MjModel:
    """The mechanism drawn at a pose, where all joint coordinates are zero.

    U joint between column and platform; pitch leg R (``r_axis``), P and a ball closure at A1; roll leg U, P and a ball closure at A2.
    """
    h, upper, lower = lengths
    rotation = np.array(frames.joint_rotation(pitch, roll)).reshape(3, 3)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    a1, a2 = upper * rotation[:, 0], upper * rotation[:, 1]
    b1, b2 = np.array([lower, 0.0, -h]), np.array([0.0, lower, -h])
    rod1, rod2 = a1 - b1, a2 - b2
    across = np.cross([0.0, 1.0, 0.0], rod2)
    body = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option gravity="0 0 0" timestep="0.002" integrator="implicitfast" iterations="200" tolerance="1e-14" solver="Newton">
    <flag contact="disable"/>
  </option>
  <default><joint damping="1"/><equality solref="0.01 1" solimp="0.9999 0.9999 0.001"/></default>
  <worldbody>
    <body name="platform" quat="{vec(quat)}">{body}
      <joint name="u_column" axis="{vec(rotation.T @ [0.0, 1.0, 0.0])}"/>
      <joint name="u_platform" axis="1 0 0"/>
      <site name="a1" pos="{upper} 0 0"/><site name="a2" pos="0 {upper} 0"/>
    </body>
    <body name="leg1" pos="{vec(b1)}">{body}
      <joint name="r" axis="{AXES[r_axis]}"/>
      <body name="rod1">{body}
        <joint name="p1" type="slide" axis="{vec(rod1)}"/>
        <site name="end1" pos="{vec(rod1)}"/>
      </body>
    </body>
    <body name="leg2" pos="{vec(b2)}">{body}
      <joint name="u_first" axis="0 1 0"/>
      <joint name="u_second" axis="{vec(across)}"/>
      <body name="rod2">{body}
        <joint name="p2" type="slide" axis="{vec(rod2)}"/>
        <site name="end2" pos="{vec(rod2)}"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect name="ball1" site1="a1" site2="end1"/>
    <connect name="ball2" site1="a2" site2="end2"/>
    <joint name="length1" joint1="p1" polycoef="0 0 0 0 0"/>
    <joint name="length2" joint1="p2" polycoef="0 0 0 0 0"/>
  </equality>
</mujoco>""")


def settle(model: mujoco.MjModel, data: mujoco.MjData, travel: tuple[float, float]) -> float:
    """Set both rods and step until nothing moves; the largest gap of a closure or a rod that remains, in m."""
    for k, moved in enumerate(travel):
        model.eq_data[2 + k, 0] = moved
    for _ in range(3000):
        mujoco.mj_step(model, data)
        if np.abs(data.qvel).max() < 1e-11:
            break
    mujoco.mj_forward(model, data)
    return float(np.abs(data.efc_pos[: data.ne]).max())


def attitude(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, float]:
    """Pitch and roll of the platform from its rotation matrix: the normal is (sin p cos r, sin r, cos p cos r)."""
    nx, ny, nz = data.body("platform").xmat.reshape(3, 3)[:, 2]
    return float(np.arctan2(nx, nz)), float(np.arctan2(ny, np.hypot(nx, nz)))


@pytest.mark.parametrize("lengths", [PAPER, LARGE])
def test_attitude_for_given_rod_lengths(lengths: tuple[float, float, float], capsys: pytest.CaptureFixture[str]) -> None:
    model = linkage(lengths)
    data = mujoco.MjData(model)
    level = np.array(kinematics.rod_lengths(0.0, 0.0, *lengths))
    # random rod lengths within what +-20 degrees need, not images of attitudes
    span = [kinematics.rod_lengths(a, 0.0, *lengths)[0] - level[0] for a in np.radians((19.0, -19.0))]
    count = 120
    travels = np.random.default_rng(11).uniform(*span, (count, 2))
    gaps, residual = [], 0.0
    for travel in travels:
        residual = max(residual, settle(model, data, (float(travel[0]), float(travel[1]))))
        expected = kinematics.attitude_from_rods(*(level + travel), *lengths)
        array = vectorised.attitude_from_rods(*(level + travel), *lengths)
        assert np.abs(np.subtract(expected, array)).max() < 1e-12
        gaps.append(np.subtract(attitude(model, data), expected))
    worst = float(np.abs(gaps).max())  # NaN, from a model that flew apart, stays NaN
    with capsys.disabled():
        print(f"\nMuJoCo, {count} poses, h {lengths[0]} m: attitude within {worst:.1e} rad, residual of the closures {residual:.1e} m")
    assert residual < 1e-8
    assert worst < 1e-6
    assert not any(warning.number for warning in data.warning)


def loop_rank(model: mujoco.MjModel) -> tuple[int, int]:
    """Joint freedoms, and rank of the Jacobian of the two ball closures where they are drawn."""
    data = mujoco.MjData(model)
    data.eq_active[2:] = 0  # rods free
    mujoco.mj_forward(model, data)
    assert data.ne == 6
    assert np.abs(data.efc_pos[:6]).max() < 1e-12
    jacobian = np.array(data.efc_J).reshape(-1, model.nv)[:6]
    scale = np.abs(jacobian).max()
    return model.nv, int(np.linalg.matrix_rank(jacobian, tol=1e-9 * scale))


@pytest.mark.parametrize("lengths", [PAPER, LARGE])
def test_closed_loop_mobility(lengths: tuple[float, float, float]) -> None:
    """Seven joint freedoms, six closure equations: five independent when R is parallel to y, six off home when it is parallel to x."""
    poses = np.radians(np.random.default_rng(5).uniform(-20.0, 20.0, (40, 2)))
    for pitch, roll in poses:
        for r_axis in ("y", "x"):
            freedoms, rank = loop_rank(linkage(lengths, pitch, roll, r_axis))
            assert freedoms == 7
            ours = mobility.mobility(pitch, roll, *lengths, r_axis=r_axis)  # type: ignore[arg-type]
            assert freedoms - rank == int(ours.mobility) == (2 if r_axis == "y" else 1)


def test_closed_loop_mobility_at_home() -> None:
    for r_axis in ("y", "x"):
        freedoms, rank = loop_rank(linkage(PAPER, r_axis=r_axis))
        assert freedoms - rank == 2


def test_with_r_parallel_x_pitch_is_impossible() -> None:
    """The rod that pitches by 10 degrees leaves the closures open by millimetres: A1 cannot move along x."""
    model = linkage(PAPER, r_axis="x")
    data = mujoco.MjData(model)
    level = kinematics.rod_lengths(0.0, 0.0, *PAPER)
    wanted = kinematics.rod_lengths(np.radians(10.0), 0.0, *PAPER)
    assert settle(model, data, (wanted[0] - level[0], 0.0)) > 1e-4
    # roll alone still works
    data = mujoco.MjData(model)
    wanted = kinematics.rod_lengths(0.0, np.radians(10.0), *PAPER)
    assert settle(model, data, (0.0, wanted[1] - level[1])) < 1e-8
    assert attitude(model, data) == pytest.approx((0.0, np.radians(10.0)), abs=1e-6)
