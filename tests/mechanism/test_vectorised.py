"""One formula: what the arrays give is what the loop gives."""

from __future__ import annotations

from math import radians
from types import FunctionType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from spsp_ctrl.mechanism import chain, frames, kinematics, vectorised

H, R = 0.2655, 0.1
GEOMETRY = (H, R, R)
RNG = np.random.default_rng(3)
N = 400


def random(low: float, high: float) -> NDArray[np.float64]:
    return RNG.uniform(low, high, N)


TILT = radians(25.0)
PITCH, ROLL, HEADING = random(-TILT, TILT), random(-TILT, TILT), random(-3.0, 3.0)
RATES = tuple(random(-2.0, 2.0) for _ in range(9))
L1, L2 = vectorised.rod_lengths(PITCH, ROLL, H, R, 0.09)
BASE = vectorised.rotation_from_euler(HEADING, PITCH * 0.5, ROLL * 0.5)
CASES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "rod_lengths": (kinematics, (PITCH, ROLL, H, R, 0.09)),
    "attitude_from_rods": (kinematics, (L1, L2, H, R, 0.09)),
    "jacobian": (kinematics, (PITCH, ROLL, L1, L2, H, R, 0.09)),
    "jacobian_rate": (kinematics, (PITCH, ROLL, RATES[0], RATES[1], L1, L2, H, R, 0.09)),
    "rod_motion": (kinematics, (PITCH, ROLL, *RATES[:4], H, R, 0.09)),
    "jacobian_gains": (kinematics, (PITCH, RATES[0], ROLL)),
    "joint_rotation": (frames, (PITCH, ROLL)),
    "attitude": (frames, (HEADING, PITCH, ROLL)),
    "rotation_from_euler": (frames, (HEADING, PITCH, ROLL)),
    "joint_angles": (frames, (BASE, HEADING + 0.1, PITCH, ROLL)),
    "joint_rates_to_body": (frames, (PITCH, ROLL, *RATES[:3])),
    "body_to_joint_rates": (frames, (PITCH, ROLL, *RATES[:3])),
    "body_to_tilt_rates": (frames, (PITCH, ROLL, *RATES[:3])),
    "euler_rates_to_body": (frames, (ROLL, PITCH, *RATES[:3])),
    "joint_references": (chain, (BASE, RATES[:3], HEADING, PITCH, ROLL, *RATES[3:6])),
    "joint_accels_to_body": (frames, (PITCH, ROLL, *RATES[:6])),
    "body_to_joint_accels": (frames, (PITCH, ROLL, *RATES[:6])),
    "body_to_tilt_accels": (frames, (PITCH, ROLL, *RATES[:6])),
    "level_motion": (chain, (BASE, RATES[:3], RATES[6:9], HEADING, RATES[3], RATES[4])),
    "joint_axes": (frames, (PITCH, ROLL)),
    "joint_motion": (
        chain,
        (BASE, RATES[:3], RATES[6:9], HEADING, PITCH, ROLL, *RATES[3:6], *(0.7 * r for r in RATES[:3])),
    ),
}


def pick(argument: Any, k: int) -> Any:
    if isinstance(argument, tuple):
        return tuple(pick(a, k) for a in argument)
    return float(argument[k]) if isinstance(argument, np.ndarray) else argument


@pytest.mark.parametrize("name", CASES)
def test_arrays_give_what_the_scalar_gives(name: str) -> None:
    module, arguments = CASES[name]
    scalar, array = getattr(module, name), getattr(vectorised, name)
    assert array.__code__ is scalar.__code__
    result = array(*arguments)
    for k in range(N):
        np.testing.assert_allclose(
            pick(tuple(result), k), scalar(*(pick(a, k) for a in arguments)), rtol=1e-12, atol=1e-12
        )


def test_broadcasting() -> None:
    l1, l2 = vectorised.rod_lengths(PITCH[:, None], ROLL[None, :], *GEOMETRY)
    assert l2.shape == (N, N)
    assert l1.shape == (N, 1)
    back = vectorised.attitude_from_rods(l1, l2, *GEOMETRY)
    np.testing.assert_allclose(back[1], np.broadcast_to(ROLL, (N, N)), atol=1e-12)
    stacked = vectorised.matrix(vectorised.joint_rotation(PITCH[:, None], ROLL[None, :]))
    np.testing.assert_allclose(stacked @ np.swapaxes(stacked, -1, -2), np.broadcast_to(np.eye(3), stacked.shape), atol=1e-14)


def test_no_function_is_left_out_that_could_serve_arrays() -> None:
    """What is not offered here branches on a value, or is for plain Python by its docstring."""
    missing = {
        name
        for module in (frames, kinematics, chain)
        for name, value in vars(module).items()
        if isinstance(value, FunctionType) and value.__module__ == module.__name__ and not hasattr(vectorised, name)
    }
    loop_only = {"body_to_tilt_motion", "rods_and_jacobian"}
    assert missing == {*loop_only, "wrap_angle", "euler_from_rotation", "imu_attitude", "roll_from_imu", "imu_roll_from_roll"}


def test_outside_the_reach_is_nan_for_arrays_and_an_error_for_scalars() -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - the message is Python's own
        kinematics.attitude_from_rods(0.5, 0.2655, *GEOMETRY)
    with np.errstate(invalid="ignore"):
        pitch, roll = vectorised.attitude_from_rods(np.array([0.5, 0.2655]), np.array([0.2655, 0.2655]), *GEOMETRY)
    assert list(np.isnan(pitch)) == [True, False]
    assert list(np.isnan(roll)) == [True, False]
