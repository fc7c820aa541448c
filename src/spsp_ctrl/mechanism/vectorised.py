"""The scalar kinematics and frames for arrays: the same code objects, bound to numpy's functions instead of ``math``'s.

So there is one formula for the loop (plain Python), the plant (numba) and analysis (arrays), and none can drift from the
others. Arguments are floats or arrays that broadcast; a result has the broadcast shape, a matrix is still a tuple of nine.
Complex arguments carry a derivative by complex step: ``f(x + 1e-30j).imag / 1e-30`` is ``f'(x)`` without cancellation.

Outside its domain a function gives NaN (with numpy's warning, unless the caller silences it) where the scalar raises.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.mechanism import chain as _chain
from spsp_ctrl.mechanism import frames as _frames
from spsp_ctrl.mechanism import kinematics as _kinematics

Array = NDArray[np.float64]
ArrayFunction = Callable[..., tuple[Any, ...]]


def _arctan2(y: Any, x: Any) -> Any:
    """``numpy.arctan2``, to first order in an imaginary part: exact for a complex step."""
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return np.arctan2(y, x)
    y, x = np.asarray(y, dtype=np.complex128), np.asarray(x, dtype=np.complex128)
    slope = (x.real * y.imag - y.real * x.imag) / (x.real * x.real + y.real * y.real)
    return np.arctan2(y.real, x.real) + 1j * slope


NUMPY: dict[str, Any] = {"sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "acos": np.arccos, "atan2": _arctan2}


_SPACES: dict[str, dict[str, Any]] = {}


def rebound(module: ModuleType) -> dict[str, Any]:
    """Every function of ``module`` with numpy's functions in place of ``math``'s, those it calls included.

    What it imports from another mechanism module must have been rebound before.
    """
    space: dict[str, Any] = {**vars(module), **NUMPY}
    for name, value in vars(module).items():
        if not isinstance(value, FunctionType):
            continue
        if value.__module__ in _SPACES:
            space[name] = _SPACES[value.__module__][value.__name__]
        elif value.__module__ == module.__name__:
            space[name] = copy = FunctionType(value.__code__, space, name, value.__defaults__, value.__closure__)
            copy.__doc__ = value.__doc__
    _SPACES[module.__name__] = space
    return space


_of_frames = rebound(_frames)
multiply: ArrayFunction = _of_frames["multiply"]
transpose: ArrayFunction = _of_frames["transpose"]
apply: ArrayFunction = _of_frames["apply"]
rotation_from_euler: ArrayFunction = _of_frames["rotation_from_euler"]
joint_rotation: ArrayFunction = _of_frames["joint_rotation"]
attitude: ArrayFunction = _of_frames["attitude"]
joint_angles: ArrayFunction = _of_frames["joint_angles"]
joint_axes: ArrayFunction = _of_frames["joint_axes"]
joint_rates_to_body: ArrayFunction = _of_frames["joint_rates_to_body"]
body_to_joint_rates: ArrayFunction = _of_frames["body_to_joint_rates"]
joint_accels_to_body: ArrayFunction = _of_frames["joint_accels_to_body"]
body_to_joint_accels: ArrayFunction = _of_frames["body_to_joint_accels"]
body_to_tilt_rates: ArrayFunction = _of_frames["body_to_tilt_rates"]
body_to_tilt_accels: ArrayFunction = _of_frames["body_to_tilt_accels"]
euler_rates_to_body: ArrayFunction = _of_frames["euler_rates_to_body"]

_of_kinematics = rebound(_kinematics)
rod_lengths: ArrayFunction = _of_kinematics["rod_lengths"]
attitude_from_rods: ArrayFunction = _of_kinematics["attitude_from_rods"]
jacobian: ArrayFunction = _of_kinematics["jacobian"]
jacobian_rate: ArrayFunction = _of_kinematics["jacobian_rate"]
rod_motion: ArrayFunction = _of_kinematics["rod_motion"]
jacobian_gains: ArrayFunction = _of_kinematics["jacobian_gains"]

_of_chain = rebound(_chain)
joint_references: Callable[..., Any] = _of_chain["joint_references"]
joint_motion: Callable[..., Any] = _of_chain["joint_motion"]
level_motion: Callable[..., Any] = _of_chain["level_motion"]


def matrix(nine: tuple[Any, ...]) -> Array:
    """Array of shape (..., 3, 3) from a tuple of nine that broadcast."""
    parts = np.broadcast_arrays(*nine)
    return np.stack(parts, axis=-1).reshape(*parts[0].shape, 3, 3)
