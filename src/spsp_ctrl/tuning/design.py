"""Gains from the plant model by a stated method, in the order in which the loops are closed from the inside out.

1. Observers of the motor, of the base and of its yaw: steady-state Kalman gains (``tuning.kalman``).
2. Speed PI of each law: the two gains that give the motor loop, broken at the current command, its crossover and phase margin: a complex equation,
   ``kp X + ki Y = -exp(j PM)`` at the crossover.
3. Rod position gain of each law (closed on the resolvers): unit gain of the position path at its crossover.
4. Attitude PID: the derivative time cancels the attitude's own lag and half a frame (whole milliseconds of it); kp and ki again by crossover
   and phase margin of the loop broken at the IMU, without base-rate feed-forward.

Every gain is rounded as it stands in the rig file before margins are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from math import floor, log10
from typing import Any, Literal

import numpy as np

from spsp_ctrl.config.rig import ControlConfig, RigConfig
from spsp_ctrl.control.params import LawParams, law_ladder
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.tuning import kalman
from spsp_ctrl.tuning.loops import ISOLATION_HZ, AxisLoops, Break, Kind, Margins, UnstableLoopError
from spsp_ctrl.tuning.plant_model import Axis, AxisPlant, axis_plant

Progress = Callable[[int, int], None]
Law = Literal["cascade", "stabiliser", "performance"]
"""``performance``: the stabiliser with its performance gains."""
LAWS: tuple[Law, ...] = ("cascade", "stabiliser", "performance")
AXES: tuple[Axis, ...] = ("pitch", "roll")
DISK_NOMINAL, DISK_CORNER = 0.5, 0.35
"""Smallest disk margin asked for: with the nominal plant, and in the corners (not of the performance gains, which need an identified motor)."""
DIGITS, BASE_DIGITS = 2, 3
"""Significant digits of a gain in a rig file. The six of the base observer belong together and have one more."""


@dataclass(frozen=True, slots=True)
class DesignSpec:
    """What is asked of each loop, and the noise that the observers are for. Every number has its reason."""

    motor_angle_walk_rad2_s: float = 3.5e-6
    """Random walk of the motor angle: the resolver's periodic error, 2 mrad over a second."""
    motor_white_rad2_s3: float = 3.5
    """White acceleration of the motor: 59 rad/s2 per cycle, or 24 mA: reported current's noise, cogging, ripple and +-30 % of motor gain."""
    motor_walk_rad2_s5: float = 1.65e5
    """Random walk of the disturbance: friction (500 rad/s2) that turns round once in 6 s; an observer slower than that costs the loop phase."""
    base_attitude_arcmin: float = 0.1
    """Standard deviation of one base tilt seen: attitude noise and what the joints add."""
    base_gyro_arcmin_s: float = 4.0
    """Standard deviation of one base rate seen: the joint rates' share is the larger."""
    base_jerk_arcmin2_s5: float = 3e3
    """White jerk of the carrier."""
    base_walk_arcmin2_s: float = 0.1
    """Random walk of the apparent base tilt: what the kinematics does not know (lead error, wind-up)."""
    yaw_jerk_arcmin2_s5: float = 890.0
    """White jerk of base yaw: below the tilts', since what is fast in this signal is the azimuth axis in its play."""
    yaw_walk_arcmin2_s3: float = 18.0
    """Random walk of the yaw rate."""
    cascade_speed_hz: float = 23.6
    """Motor loop of the cascade: a quarter of the structural mode (105 Hz)."""
    cascade_speed_deg: float = 67.0
    """With the attitude loop closed around it about 20 deg less is left."""
    cascade_rod_hz: float = 8.9
    """Position on the resolvers: about a third of the motor loop."""
    cascade_attitude_hz: float = 6.9
    """Attitude: under a third of the motor loop; delay, lag and frame of the IMU take 30 deg there."""
    cascade_attitude_deg: float = 47.3
    stabiliser_speed_hz: float = 23.9
    """As the cascade's ..."""
    stabiliser_speed_deg: float = 63.7
    """... with a third more integral: friction's share in the error falls with it."""
    stabiliser_rod_hz: float = 8.3
    """Position loop, a third of the motor loop: it does not wait for the IMU, and every corner keeps its disk margin."""
    stabiliser_attitude_hz: float = 5.3
    """Used with the base observer off. Lower than the cascade's: the feed-forward, which does the work, needs part of the margin."""
    stabiliser_attitude_deg: float = 60.4
    performance_speed_hz: float = 36.0
    """Motor loop of an identified motor: a third of the structural mode."""
    performance_speed_deg: float = 59.0
    performance_rod_hz: float = 10.9
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
        if row.law == "performance" and not row.nominal:
            continue
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
            elif mine is None or rounded(mine, BASE_DIGITS) != rounded(value, BASE_DIGITS):
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

    Raises ``ValueError`` where the specification cannot be met (a gain would be negative).
    """
    spec = spec or DesignSpec()
    plant = axis_plant(model, "roll")
    params = {law: law_ladder(with_law(config, law))[0] for law in LAWS}
    noise = motor_noise(model, spec)
    shared = observer_gains(params["cascade"], noise, spec)
    designed: dict[Law, LawParams] = {}
    for k, (law, given) in enumerate(params.items()):
        progress(k, 2 * len(LAWS))
        designed[law] = loop_gains(law, replace(given, **shared), plant, spec)
    result = Design(control=fragment(designed), noise=asdict(noise))
    for k, (law, p) in enumerate(designed.items()):
        progress(len(LAWS) + k, 2 * len(LAWS))
        result.rows.extend(loop_rows(law, p, model, spec))
        result.isolation_db[law] = AxisLoops(p, plant).isolation_db().tolist()
    progress(2 * len(LAWS), 2 * len(LAWS))
    return result


def with_law(config: RigConfig, law: Law) -> RigConfig:
    """The rig file with another law chosen; the first of its ladder is meant."""
    ours = config.control.stabiliser
    performance = ours.performance.model_copy(update={"enabled": law == "performance"})
    update = {
        "law": "cascade" if law == "cascade" else "stabiliser",
        "stabiliser": ours.model_copy(update={"performance": performance}),
    }
    return config.model_copy(update={"control": config.control.model_copy(update=update)})


def motor_noise(model: PlantModel, spec: DesignSpec) -> kalman.MotorNoise:
    """Of the motor observer."""
    return kalman.MotorNoise(
        kalman.resolver_noise_rad(model), spec.motor_angle_walk_rad2_s, spec.motor_white_rad2_s3, spec.motor_walk_rad2_s5
    )


def base_noise(spec: DesignSpec) -> kalman.BaseNoise:
    """Of the base observer, in SI."""
    square = kalman.ARCMIN**2
    return kalman.BaseNoise(
        spec.base_attitude_arcmin * kalman.ARCMIN,
        spec.base_gyro_arcmin_s * kalman.ARCMIN,
        spec.base_jerk_arcmin2_s5 * square,
        spec.base_walk_arcmin2_s * square,
    )


def yaw_noise(spec: DesignSpec) -> kalman.YawNoise:
    """Of the yaw pair, in SI."""
    square = kalman.ARCMIN**2
    return kalman.YawNoise(
        spec.base_gyro_arcmin_s * kalman.ARCMIN, spec.yaw_jerk_arcmin2_s5 * square, spec.yaw_walk_arcmin2_s3 * square
    )


def observer_gains(p: LawParams, noise: kalman.MotorNoise, spec: DesignSpec) -> dict[str, Any]:
    """Step 1."""
    motor = [rounded(k) for k in kalman.steady_gain(kalman.motor_filter(noise, p.period_s))[:, 0]]
    base = kalman.steady_gain(kalman.base_filter(base_noise(spec), p.attitude_lag_s, p.gyro_lag_s, p.imu_period_s))
    yaw = [rounded(k) for k in kalman.steady_gain(kalman.yaw_filter(yaw_noise(spec), p.gyro_lag_s, p.imu_period_s))[:, 0]]
    by_attitude, by_gyro = ([rounded(k, BASE_DIGITS) for k in column] for column in base.T)
    gains = replace(p.base, 
        angle_by_attitude=by_attitude[0],
        rate_by_attitude=by_attitude[1],
        accel_by_attitude=by_attitude[2],
        angle_by_gyro=by_gyro[0],
        rate_by_gyro=by_gyro[1],
        accel_by_gyro=by_gyro[2],
        yaw_rate=yaw[0],
        yaw_accel=yaw[1],
    )
    return {"l_angle": motor[0], "l_speed": motor[1], "l_disturbance": motor[2], "base": gains}


def loop_gains(law: Law, p: LawParams, plant: AxisPlant, spec: DesignSpec) -> LawParams:
    """Steps 2 to 4."""
    crossover: dict[Law, tuple[float, float, float]] = {
        "cascade": (spec.cascade_speed_hz, spec.cascade_speed_deg, spec.cascade_rod_hz),
        "stabiliser": (spec.stabiliser_speed_hz, spec.stabiliser_speed_deg, spec.stabiliser_rod_hz),
        "performance": (spec.performance_speed_hz, spec.performance_speed_deg, spec.performance_rod_hz),
    }
    speed_hz, speed_deg, rod_hz = crossover[law]
    p = replace(p, **speed_gains(p, plant, speed_hz, speed_deg))
    p = replace(p, rod_kp=rod_gain(p, plant, rod_hz))
    if law == "cascade":
        return replace(p, **attitude_gains(p, plant, spec.cascade_attitude_hz, spec.cascade_attitude_deg))
    if law == "stabiliser":
        alone = replace(p, observe=False, feedforward=True)
        return replace(p, **attitude_gains(alone, plant, spec.stabiliser_attitude_hz, spec.stabiliser_attitude_deg))
    return p


def _two_gains(x: complex, y: complex, phase_deg: float, what: str) -> tuple[float, float]:
    """Real ``a``, ``b`` with ``a x + b y = -exp(j PM)``: unit gain and the phase margin at one frequency."""
    target = -np.exp(1j * np.radians(phase_deg))
    a, b = np.linalg.solve(np.array([[x.real, y.real], [x.imag, y.imag]]), np.array([target.real, target.imag]))
    if a <= 0.0 or b <= 0.0:
        raise ValueError(f"{what}: crossover and phase margin do not go together (gains {a:.4g} and {b:.4g}); lower one of them")
    return float(a), float(b)


def speed_gains(p: LawParams, plant: AxisPlant, crossover_hz: float, phase_deg: float) -> dict[str, Any]:
    """Step 2."""
    f = np.array([crossover_hz])
    per_gain = []
    for kp, ki in ((1.0, 0.0), (0.0, 1.0)):
        loops = AxisLoops(replace(p, speed_kp=kp, speed_ki=ki), plant, kind="joint")
        # the motor loop alone: the position loop is open
        per_gain.append(-loops.transfer("command", "command", f, cut=("command", "motor_est"))[0])
    kp, ki = _two_gains(per_gain[0], per_gain[1], phase_deg, "speed loop")
    return {"speed_kp": rounded(kp), "speed_ki": rounded(ki)}


def rod_gain(p: LawParams, plant: AxisPlant, crossover_hz: float) -> float:
    """Step 3."""
    loops = AxisLoops(replace(p, rod_kp=1.0), plant, kind="joint")
    return rounded(1.0 / abs(loops.transfer("motor_est", "motor_est", np.array([crossover_hz]), cut=("motor_est",))[0]))


def attitude_gains(p: LawParams, plant: AxisPlant, crossover_hz: float, phase_deg: float) -> dict[str, Any]:
    """Step 4: the loop is a sum of a part by kp and a part by ki."""
    td = 1e-3 * floor(1e3 * (plant.attitude_lag_s + 0.5 * plant.imu_period_s))
    f = np.array([crossover_hz])
    per_gain = []
    for kp, ki in ((1.0, 0.0), (0.0, 1.0)):
        loops = AxisLoops(replace(p, kp=kp, ki=ki, td=td), plant, feedforward=False)
        per_gain.append(loops.responses(f)["imu"][0])
    kp, ki = _two_gains(per_gain[0], per_gain[1], phase_deg, "attitude loop")
    return {"kp": rounded(kp), "ki": rounded(ki), "td": td}


def loop_rows(law: Law, p: LawParams, model: PlantModel, spec: DesignSpec) -> list[LoopRow]:
    """Margins of every loop of both axes, with the nominal plant and in the corners."""
    rows: list[LoopRow] = []
    kinds: tuple[Kind, ...] = ("inertial", "joint")
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


def fragment(designed: dict[Law, LawParams]) -> dict[str, Any]:
    """The gains as they stand in a rig file."""
    cascade, stabiliser, performance = (designed[law] for law in LAWS)
    base = cascade.base

    def inner(p: LawParams) -> dict[str, Any]:
        return {"speed": {"kp_a_s_rad": p.speed_kp, "ki_a_rad": p.speed_ki}, "rod_kp_1_s": p.rod_kp}

    def loops(p: LawParams) -> dict[str, Any]:
        return inner(p) | {"attitude": {"kp_1_s": p.kp, "ki_1_s2": p.ki, "td_s": p.td}}

    return {
        "observer": {"l_angle": cascade.l_angle, "l_speed_1_s": cascade.l_speed, "l_disturbance_1_s2": cascade.l_disturbance},
        "base": {
            "attitude": {
                "l_angle": base.angle_by_attitude, "l_rate_1_s": base.rate_by_attitude, "l_accel_1_s2": base.accel_by_attitude,
            },
            "gyro": {"l_angle_s": base.angle_by_gyro, "l_rate": base.rate_by_gyro, "l_accel_1_s": base.accel_by_gyro},
            "yaw": {"l_rate": base.yaw_rate, "l_accel_1_s": base.yaw_accel},
        },
        "stabiliser": loops(stabiliser) | {"performance": inner(performance)},
        "cascade": loops(cascade),
    }  # fmt: skip
