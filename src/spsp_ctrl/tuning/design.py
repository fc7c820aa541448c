"""Gains from the plant model by a stated method, in the order in which the loops are closed from the inside out.

1. Motor observer: steady-state Kalman gains (``tuning.kalman``).
2. Speed PI: the two gains that give the motor loop, broken at the current command, its crossover and phase margin: a complex equation,
   ``kp X + ki Y = -exp(j PM)`` at the crossover.
3. Rod position gain (closed on the resolvers): unit gain of the position path at its crossover.
4. Attitude PID: the derivative time cancels the attitude's own lag and half a frame; kp and ki again by crossover and phase margin of the loop broken
   at the IMU, without base-rate feed-forward.
5. Base-rate filter (``stabiliser``): steady-state Kalman gains. Its feed-forward closes a loop through the joint rate, so the process noise is raised
   until a loop with the nominal plant, or in a corner of the motor's parameters, reaches its smallest allowed disk margin. The prediction ``lead``
   minimises what is left of a slow base motion.

Every gain is rounded as it stands in the rig file before margins are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from math import floor, log10, pi
from typing import Any, Literal

import numpy as np
from scipy.optimize import minimize_scalar

from spsp_ctrl.config.rig import ControlConfig, RigConfig
from spsp_ctrl.control.params import LawParams, law_params
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning import kalman
from spsp_ctrl.tuning.loops import ISOLATION_HZ, AxisLoops, Break, Kind, Margins, UnstableLoopError
from spsp_ctrl.tuning.plant_model import Axis, AxisPlant, axis_plant

Progress = Callable[[int, int], None]
Law = Literal["cascade", "stabiliser"]
LAWS: tuple[Law, ...] = ("cascade", "stabiliser")
AXES: tuple[Axis, ...] = ("pitch", "roll")
DISK_NOMINAL, DISK_CORNER = 0.5, 0.35
"""Smallest disk margin that a gain set may have: with the nominal plant, and in the corners."""
DIGITS = 3
"""Significant digits of a gain in a rig file."""


@dataclass(frozen=True, slots=True)
class DesignSpec:
    """What is asked of each loop. Every number has its reason."""

    reversals_s: float = 0.5
    """Reversals of the friction: twice in 4 s, the faster axis of the paper's motion."""
    joint_rate_rad_s: float = 0.1
    """Joint rate at which the resolver's periodic error is counted as noise: rms of the paper's motion."""
    speed_crossover_hz: float = 20.0
    """Motor loop: a fifth of the structural mode (105 Hz), which must stay below unity with a motor gain 1.9 times too large."""
    speed_phase_deg: float = 65.0
    """With the attitude loop closed around it about 10 deg less is left."""
    rod_crossover_hz: float = 5.0
    """Position on the resolvers: about a quarter of the motor loop."""
    cascade_crossover_hz: float = 6.2
    """Attitude: about a quarter of the motor loop; delay, lag and frame of the IMU take 25 deg there."""
    cascade_phase_deg: float = 48.0
    stabiliser_crossover_hz: float = 4.0
    """Lower than the plain cascade: the feed-forward, which does the work, needs part of the margin."""
    stabiliser_phase_deg: float = 60.0
    base_corner_hz: float = 5.0
    """Base motion below it is a swing or a sea (its acceleration persists), above it roughness (it does not)."""
    lead_hz: float = 0.5
    """Base motion for which the prediction is best."""
    disk_nominal: float = 0.55
    """Smallest disk margin of any loop that the feed-forward may leave with the nominal plant (0.5 is asked for) ..."""
    disk_corner: float = 0.36
    """... and in a corner (0.35 is asked for)."""
    corner: float = 0.3
    """Corners: torque constant and motor inertia by this much up and down."""


@dataclass(frozen=True, slots=True)
class LoopRow:
    """Margins of one loop in one case."""

    law: Law
    kind: Kind
    axis: Axis
    at: Break
    torque_constant: float
    motor_inertia: float
    margins: Margins | None
    """None: unstable."""

    @property
    def nominal(self) -> bool:
        """Not a corner."""
        return self.torque_constant == 1.0 and self.motor_inertia == 1.0


@dataclass(frozen=True, slots=True)
class Design:
    """What the tool hands over."""

    control: dict[str, Any]
    """Gains as a fragment of the rig file's ``control:``."""
    noise: dict[str, float]
    rows: list[LoopRow] = field(default_factory=list)
    isolation_db: dict[Law, list[float]] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "control": self.control,
            "noise": self.noise,
            "isolation": {"f_hz": list(ISOLATION_HZ), **{law: [round(v, 2) for v in db] for law, db in self.isolation_db.items()}},
            "loops": [
                {**{k: v for k, v in asdict(row).items() if k != "margins"}, "margins": row.margins.as_dict() if row.margins else None}
                for row in self.rows
            ],
        }


def shortfalls(rows: Sequence[LoopRow]) -> list[str]:
    """One line per loop whose margins fall short."""
    lines = []
    for row in rows:
        least = DISK_NOMINAL if row.nominal else DISK_CORNER
        if row.margins is None or row.margins.disk < least:
            found = "unstable" if row.margins is None else f"disk margin {row.margins.disk:.2f} at {row.margins.disk_hz:.0f} Hz, needs {least:g}"
            where = "nominal plant" if row.nominal else f"torque constant x {row.torque_constant:g}, motor inertia x {row.motor_inertia:g}"
            lines.append(f"{row.law}, {row.axis}, {row.kind} loop at {row.at}, {where}: {found}")
    return lines


def differences(control: ControlConfig, designed: dict[str, Any]) -> list[str]:
    """Gains of a rig file that are not the designed ones, one line each."""
    lines = []

    def walk(have: Any, want: dict[str, Any], place: str) -> None:
        for key, value in want.items():
            mine = have.get(key) if isinstance(have, dict) else None
            if isinstance(value, dict):
                walk(mine, value, f"{place}.{key}")
            elif mine is None or abs(mine - value) > 1e-9 * max(1.0, abs(value)):
                lines.append(f"{place}.{key}: {mine} in the file, {value:g} by design")

    walk(control.model_dump(by_alias=True), designed, "control")
    return lines


def rounded(value: float, digits: int = DIGITS) -> float:
    """To significant digits, as written in a rig file."""
    return round(float(value), digits - 1 - floor(log10(abs(value)))) if value else 0.0


def corners(plant: AxisPlant, by: float) -> list[tuple[float, float, AxisPlant]]:
    """The four corners of torque constant and motor inertia."""
    return [(k, j, plant.scaled(k, j)) for k, j in product((1.0 - by, 1.0 + by), repeat=2)]


def _silent(done: int, total: int) -> None:
    """No progress bar."""


def design(config: RigConfig, model: PlantModel, spec: DesignSpec | None = None, progress: Progress = _silent) -> Design:
    """Design every gain of ``control:`` but the heading's for the rig in ``config`` on the plant in ``model``.

    Raises ``ValueError`` where the specification cannot be met (a gain would be negative, no margin is left for the feed-forward).
    """
    spec = spec or DesignSpec()
    plant = axis_plant(model, "roll")
    params = {law: law_params(with_law(config, law)) for law in LAWS}
    base = params["cascade"]
    noise = kalman.motor_noise(model, spec.reversals_s)
    l_angle, l_speed, l_disturbance = (rounded(k) for k in kalman.steady_gain(kalman.motor_filter(noise, base.period_s)))
    inner: dict[str, Any] = {"l_angle": l_angle, "l_speed": l_speed, "l_disturbance": l_disturbance}
    inner |= speed_gains(base._replace(**inner), plant, spec)
    inner["rod_kp"] = rod_gain(base._replace(**inner), plant, spec)

    cascade = params["cascade"]._replace(**inner)
    cascade = cascade._replace(**attitude_gains(cascade, plant, spec.cascade_crossover_hz, spec.cascade_phase_deg))
    stabiliser = params["stabiliser"]._replace(**inner)
    stabiliser = stabiliser._replace(**attitude_gains(stabiliser, plant, spec.stabiliser_crossover_hz, spec.stabiliser_phase_deg))
    seen = kalman.base_measurement_rad_s(model, spec.joint_rate_rad_s)
    if stabiliser.feedforward:
        stabiliser, walk = base_gains(stabiliser, [axis_plant(model, axis) for axis in AXES], spec, seen, progress)
    else:
        walk = 0.0

    result = Design(
        control=fragment(cascade, stabiliser),
        noise={
            "resolver_rad": noise.angle_rad,
            "drive_rad_s2": noise.input_rad_s2,
            "friction_walk_rad2_s5": noise.walk_rad2_s5,
            "base_rate_seen_rad_s": seen,
            "base_white_rad2_s3": walk,
            "base_walk_rad2_s5": walk * (2.0 * pi * spec.base_corner_hz) ** 2,
        },
    )
    designed: dict[Law, LawParams] = {"cascade": cascade, "stabiliser": stabiliser}
    for law, p in designed.items():
        result.rows.extend(loop_rows(law, p, model, spec))
        result.isolation_db[law] = AxisLoops(p, plant).isolation_db().tolist()
    return result


def with_law(config: RigConfig, law: Law) -> RigConfig:
    """The rig file with another law chosen."""
    return config.model_copy(update={"control": config.control.model_copy(update={"law": law})})


def _two_gains(x: complex, y: complex, phase_deg: float, what: str) -> tuple[float, float]:
    """Real ``a``, ``b`` with ``a x + b y = -exp(j PM)``: unit gain and the phase margin at one frequency."""
    target = -np.exp(1j * np.radians(phase_deg))
    a, b = np.linalg.solve(np.array([[x.real, y.real], [x.imag, y.imag]]), np.array([target.real, target.imag]))
    if a <= 0.0 or b <= 0.0:
        raise ValueError(f"{what}: crossover and phase margin do not go together (gains {a:.4g} and {b:.4g}); lower one of them")
    return float(a), float(b)


def speed_gains(p: LawParams, plant: AxisPlant, spec: DesignSpec) -> dict[str, Any]:
    """Step 2."""
    f = np.array([spec.speed_crossover_hz])
    per_gain = []
    for kp, ki in ((1.0, 0.0), (0.0, 1.0)):
        loops = AxisLoops(p._replace(speed_kp=kp, speed_ki=ki), plant, kind="joint")
        # the motor loop alone: the position loop is open
        per_gain.append(-loops.transfer("command", "command", f, cut=("command", "motor_est"))[0])
    kp, ki = _two_gains(per_gain[0], per_gain[1], spec.speed_phase_deg, "speed loop")
    return {"speed_kp": rounded(kp), "speed_ki": rounded(ki)}


def rod_gain(p: LawParams, plant: AxisPlant, spec: DesignSpec) -> float:
    """Step 3."""
    loops = AxisLoops(p._replace(rod_kp=1.0), plant, kind="joint")
    return rounded(1.0 / abs(loops.transfer("motor_est", "motor_est", np.array([spec.rod_crossover_hz]), cut=("motor_est",))[0]))


def attitude_gains(p: LawParams, plant: AxisPlant, crossover_hz: float, phase_deg: float) -> dict[str, Any]:
    """Step 4: the loop is a sum of a part by kp and a part by ki."""
    td = rounded(plant.attitude_lag_s + 0.5 * plant.imu_period_s)
    f = np.array([crossover_hz])
    per_gain = []
    for kp, ki in ((1.0, 0.0), (0.0, 1.0)):
        loops = AxisLoops(p._replace(kp=kp, ki=ki, td=td), plant, feedforward=False)
        per_gain.append(loops.responses(f)["imu"][0])
    kp, ki = _two_gains(per_gain[0], per_gain[1], phase_deg, "attitude loop")
    return {"kp": rounded(kp), "ki": rounded(ki), "td": td}


def base_gains(
    p: LawParams, plants: Sequence[AxisPlant], spec: DesignSpec, seen_rad_s: float, progress: Progress = _silent
) -> tuple[LawParams, float]:
    """Step 5; also returns the density of the white acceleration that was found."""
    steps = 8
    plant = plants[-1]
    # the two corners with the largest and the smallest motor gain: the others have about that of the nominal plant
    more, less = 1.0 + spec.corner, 1.0 - spec.corner
    cases = [(axis.scaled(*k), spec.disk_corner) for axis in plants for k in ((more, less), (less, more))]
    cases += [(axis, spec.disk_nominal) for axis in plants]
    low, high = -8.0, -4.0
    best: tuple[LawParams, float] | None = None
    for k in range(steps):
        progress(k, steps)
        level = 0.5 * (low + high)
        white = 10.0**level
        noise = kalman.BaseNoise(seen_rad_s, white * (2.0 * pi * spec.base_corner_hz) ** 2, white)
        l_rate, l_accel = kalman.steady_gain(kalman.base_filter(noise, plant.imu_period_s))
        tried = p._replace(l_rate=rounded(float(l_rate)), l_accel=rounded(float(l_accel)))
        tried = tried._replace(lead_s=best_lead(tried, plant, spec.lead_hz))
        if all(AxisLoops(tried, c).smallest_disk() >= least for c, least in cases):
            best, low = (tried, white), level
        else:
            high = level
    progress(steps, steps)
    if best is None:
        raise ValueError("base-rate filter: the attitude loop leaves no margin for the feed-forward; lower its crossover")
    return best


def best_lead(p: LawParams, plant: AxisPlant, f_hz: float) -> float:
    """The prediction that leaves least of a base motion at ``f_hz``, in whole tenths of a millisecond."""

    def left(lead_s: float) -> float:
        return float(AxisLoops(p._replace(lead_s=lead_s), plant).isolation_db([f_hz])[0])

    return round(float(minimize_scalar(left, bounds=(0.0, 0.03), method="bounded", options={"xatol": 5e-5}).x), 4)


def loop_rows(law: Law, p: LawParams, model: PlantModel, spec: DesignSpec) -> list[LoopRow]:
    """Margins of every loop of both axes, with the nominal plant and in the corners."""
    rows: list[LoopRow] = []
    # closed on the resolvers both laws are one
    kinds: tuple[Kind, ...] = ("inertial", "joint") if law == "cascade" else ("inertial",)
    for axis in AXES:
        nominal = axis_plant(model, axis)
        cases = [(1.0, 1.0, nominal), *corners(nominal, spec.corner)]
        for kt, inertia, plant in cases:
            for kind in kinds:
                loops = AxisLoops(p, plant, axis, kind)
                try:
                    found = loops.all_margins()
                except UnstableLoopError:
                    found = {}
                rows.extend(LoopRow(law, kind, axis, at, kt, inertia, found.get(at)) for at in loops.breaks())
    return rows


def fragment(cascade: LawParams, stabiliser: LawParams) -> dict[str, Any]:
    """The gains as they stand in a rig file."""

    def loop(p: LawParams) -> dict[str, Any]:
        return {"attitude": {"kp_1_s": p.kp, "ki_1_s2": p.ki, "td_s": p.td}, "rod_kp_1_s": p.rod_kp}

    gains = {
        "observer": {"l_angle": cascade.l_angle, "l_speed_1_s": cascade.l_speed, "l_disturbance_1_s2": cascade.l_disturbance},
        "speed": {"kp_a_s_rad": cascade.speed_kp, "ki_a_rad": cascade.speed_ki},
        "stabiliser": loop(stabiliser),
        "cascade": loop(cascade),
    }
    if stabiliser.feedforward:
        gains["stabiliser"]["base_rate"] = {
            "l_rate": stabiliser.l_rate,
            "l_accel_1_s": stabiliser.l_accel,
            "lead_ms": round(stabiliser.lead_s * 1e3, 1),
        }
    return gains
