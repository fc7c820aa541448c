"""The names that a diagnosis of the whole rig may give: every effect of the registry at every place where it can act, as (name, where)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from spsp_ctrl.discrepancy.library import NOMINAL_SIGMA, Candidate, Group, candidate
from spsp_ctrl.discrepancy.variables import Variable, pair
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects import EFFECTS, Effect, Hypothesis
from spsp_ctrl.plant.layout import AXES, N_AXIS_PARAMETERS, A, G

WHERE = {"azimuth_backlash": "azimuth", "azimuth_friction": "azimuth", "geometric_error": "base"}
"""Where effects of the whole rig act; the others are of the IMU. ``base`` is what both legs share: column and plates."""
SIGN = "@"
"""Between name and place in the name of a candidate: ``backlash@pitch``."""


@dataclass(frozen=True, slots=True)
class View:
    """Parameters as one place of the rig has them: 0 pitch leg, 1 roll leg; -1 knows only those of the whole rig."""

    axis: int

    def index(self, name: str) -> int:
        """Place of a parameter in the flat array."""
        if hasattr(G, name):
            return int(getattr(G, name))
        return int(getattr(A, name)) + max(0, self.axis) * N_AXIS_PARAMETERS


DIRECT = ("imu_delay",)
"""Read off the log itself: arrival after stamp. No simulation is needed, and none would show it."""


def places() -> Iterator[tuple[Effect, Hypothesis, str, int]]:
    """Every name with where it may act, and the leg (-1: none)."""
    for effect in EFFECTS:
        if effect.kind == "axis" and not any(h.sentinel and effect.per_axis for h in effect.hypotheses):
            continue
        for h in effect.hypotheses:
            if h.random or h.name in DIRECT:
                continue
            if effect.per_axis:
                for k, axis in enumerate(AXES):
                    yield effect, h, axis, k
            else:
                yield effect, h, WHERE.get(effect.name, "imu"), -1


def split(name: str) -> tuple[str, str]:
    """Name and place of a candidate."""
    head, _, where = name.partition(SIGN)
    return head, where


def candidates(p: Array, reach: Sequence[dict[str, float]], orders: Sequence[Sequence[float]], calibrated: bool) -> list[Candidate]:
    """All of them at parameters ``p``; ``reach`` and ``orders`` for each leg."""
    made = []
    for effect, h, where, axis in places():
        view = View(axis)
        one = candidate(cast("Any", view), effect, h, p, reach[max(0, axis)], orders[max(0, axis)], (), calibrated)
        one = replace(one, groups=tuple(_fewer(one)))
        variables = tuple(replace(v, name=f"{where}:{v.name}") for v in one.variables)
        made.append(replace(one, name=f"{h.name}{SIGN}{where}", variables=variables))
    return made


MOST_STARTS = 3


def _fewer(one: Candidate) -> list[Group]:
    """A simulation of the rig costs more than that of an axis: the starts in the middle of the range, evenly chosen."""
    groups = list(one.groups)
    if len(groups) <= MOST_STARTS:
        return groups
    return [groups[round(k * (len(groups) - 1) / (MOST_STARTS - 1))] for k in range(MOST_STARTS)]


_LEG = (
    "rotor_inertia_kg_m2", "torque_constant_nm_a", "mf_coulomb_nm", "mf_viscous_nm_s", "mf_load_factor", "mf_static_nm", "mf_bristle_nm_rad",
    "gap_m", "cogging_nm", "current_lag_s", "axial_stiffness_n_m", "hf_coulomb_nm", "hf_viscous_nm_s",
)  # fmt: skip
_RIG = (
    "plate_ixx_kg_m2", "plate_iyy_kg_m2", "plate_cog_z_m", "load_cog_x_m", "load_cog_y_m", "az_gap_rad", "az_coulomb_nm", "az_viscous_nm_s",
    "imu_attitude_lag_s", "imu_gyro_lag_s",
)  # fmt: skip
_PAIRS = (
    ("lead_first_m", "lead_first_phase_rad"), ("lead_second_m", "lead_second_phase_rad"), ("res_first_rad", "res_first_phase_rad"),
    ("res_second_rad", "res_second_phase_rad"),
)  # fmt: skip
_LEG_ZEROS = (("lead_slope", 2e-5, 1e-5), ("zero_offset_m", 2e-6, 1e-6))
_RIG_ZEROS = (
    ("imu_pitch_bias_rad", 3e-5, 1e-5), ("imu_roll_bias_rad", 3e-5, 1e-5), ("imu_yaw_bias_rad", 3e-3, 1e-4), ("imu_mount_z_rad", 1e-4, 3e-5),
    ("gyro_bias_x_rad_s", 2e-5, 1e-5), ("gyro_bias_y_rad_s", 2e-5, 1e-5), ("gyro_bias_z_rad_s", 2e-5, 1e-5), ("dh_m", 5e-6, 5e-6),
)  # fmt: skip
"""Numbers that an honest recalibration may move from where they are: name, standard deviation, step."""


def nominal_variables(p: Array, reference: Array, sigma: float) -> tuple[Variable, ...]:
    """What a recalibration may change, each with its tolerance around ``reference``; 4 % of a number on a drawing before the first one."""
    made: list[Variable] = []
    share = sigma / NOMINAL_SIGMA
    for axis, where in enumerate(AXES):
        view = View(axis)
        for name in _LEG:
            made += _number(f"{where}:{name}", view.index(name), reference, sigma, free_sign=name == "cogging_nm")
        for name, phase in _PAIRS:
            size = float(reference[view.index(name)])
            if size > 0.0:
                both = pair(f"{where}:{name}", view.index(name), view.index(phase), 10.0 * size, 0.2 * size, reference)
                made += [replace(v, mean=v.get(reference), sigma=sigma * size) for v in both]
        made += [_zero(f"{where}:{name}", view.index(name), reference, width * share, step) for name, width, step in _LEG_ZEROS]
    view = View(-1)
    for name in _RIG:
        made += _number(f"rig:{name}", view.index(name), reference, sigma)
    made += [_zero(f"rig:{name}", view.index(name), reference, width * share, step) for name, width, step in _RIG_ZEROS]
    return tuple(made)


def _number(name: str, i: int, reference: Array, sigma: float, free_sign: bool = False) -> list[Variable]:
    value = float(reference[i])
    if value == 0.0:
        return []
    size = abs(value)
    low, high = (-2.0 * size, 2.0 * size) if free_sign else sorted((0.5 * value, 2.0 * value))
    # where the rotor stands at the zero of the resolver is not on a drawing: cogging may have either sign
    width = 1.0 if free_sign and sigma >= NOMINAL_SIGMA else sigma
    return [Variable(name, i, low, high, 0.02 * size, mean=value, sigma=width * size)]


def _zero(name: str, i: int, reference: Array, sigma: float, step: float) -> Variable:
    value = float(reference[i])
    return Variable(name, i, value - 200.0 * sigma, value + 200.0 * sigma, step, mean=value, sigma=sigma)


def reaches(p: Array, axis: int, current: Array, speed: Array) -> dict[str, float]:
    """The largest current, speed and winding voltage of a leg: where a limit would have to lie to be felt."""
    b = axis * N_AXIS_PARAMETERS
    voltage = np.abs(p[b + A.resistance_ohm] * current + p[b + A.torque_constant_nm_a] * speed)
    return {
        "current_ceiling_a": float(np.quantile(np.abs(current), 0.9995)),
        "speed_ceiling_rad_s": float(np.quantile(np.abs(speed), 0.9995)),
        "voltage_limit_v": float(np.quantile(voltage, 0.9995)),
    }
