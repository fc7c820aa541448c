"""Open-loop transfer functions of the law on one axis of the plant, broken where the seam is, and their margins.

Three break points, the same that ``tuning.measure`` uses on the running code:

``current``   the motor current command of one actuator (every other loop closed)
``imu``       the platform angle as the IMU senses it, attitude and gyro together
``resolver``  the motor angle as the resolver senses it

In closed loop on the IMU (``inertial``) all three exist; closed on the resolvers through the kinematics (``joint``) there is no ``imu``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import control as ct
import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.control.params import LawParams
from spsp_ctrl.tuning import blocks
from spsp_ctrl.tuning.plant_model import Axis, AxisPlant, discrete

Break = Literal["current", "imu", "resolver"]
Kind = Literal["inertial", "joint"]
Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

SIGNALS: dict[Break, str] = {"current": "command", "imu": "angle", "resolver": "motor"}
"""The signal of ``tuning.blocks`` that is cut."""
ISOLATION_HZ = (0.125, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0)


def grid_hz(period_s: float) -> Real:
    """Frequencies on which margins are sought: 0.02 Hz to just below half the control rate."""
    return np.geomspace(0.02, 0.49 / period_s, 2500)


@dataclass(frozen=True, slots=True)
class Margins:
    """Margins of one loop. Gains in dB, angles in degrees; infinite where there is none."""

    crossover_hz: float
    """Highest frequency at which the loop gain is 1."""
    phase_deg: float
    """Smallest phase margin over all crossovers."""
    gain_db: float
    """Smallest factor by which the gain may grow."""
    gain_down_db: float
    """Smallest factor by which it may fall (negative; minus infinity where falling never hurts)."""
    delay_ms: float
    """Smallest delay that the loop does not survive."""
    disk: float
    """Disk margin (balanced): 0.5 allows gain by +-4.4 dB and phase by +-28 deg at once."""
    disk_hz: float
    """Where it is smallest."""

    def as_dict(self) -> dict[str, float | None]:
        """For JSON: infinities as None."""
        return {name: value if np.isfinite(value) else None for name, value in asdict(self).items()}


def response(system: Any, f_hz: Real) -> Complex:
    """Frequency response of a SISO system of ``control`` at ``f_hz``."""
    z = np.exp(2j * np.pi * np.asarray(f_hz) * system.dt)
    return np.asarray(system(z), dtype=complex).reshape(np.shape(f_hz))


def margins(f_hz: Real, loop: Complex) -> Margins:
    """Margins of a loop of which the frequency response is known, designed or measured (``control.stability_margins`` on the response)."""
    omega = 2.0 * np.pi * np.asarray(f_hz, dtype=float)
    gm, pm, _, _, wgc, _ = ct.stability_margins(ct.frd(loop, omega, smooth=True), returnall=True)
    gm, pm, wgc = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (gm, pm, wgc))
    up, down = gm[gm > 1.0], gm[gm < 1.0]
    # the distance to the disk's centre: S - 1/2 = (1 - L) / (2 (1 + L)) (Seiler, Packard, Gahinet 2020, Eq 9); the library's own needs a state space
    disk = 2.0 * np.abs((1.0 + loop) / (1.0 - loop))
    worst = int(np.argmin(disk))
    delays = np.radians(np.where(pm > 0.0, pm, pm + 360.0)) / wgc
    return Margins(
        crossover_hz=float(wgc.max() / (2.0 * np.pi)) if wgc.size else 0.0,
        phase_deg=float(np.abs(pm).min()) if pm.size else float("inf"),
        gain_db=float(20.0 * np.log10(up.min())) if up.size else float("inf"),
        gain_down_db=float(20.0 * np.log10(down.max())) if down.size else float("-inf"),
        delay_ms=float(1e3 * delays.min()) if delays.size else float("inf"),
        disk=float(disk[worst]),
        disk_hz=float(f_hz[worst]),
    )


class UnstableLoopError(Exception):
    """The closed loop has poles outside the unit circle: margins would mean nothing."""


class AxisLoops:
    """The loops of one axis of a law. ``kind`` says on what the position loop is closed."""

    def __init__(self, law: LawParams, plant: AxisPlant, axis: Axis = "roll", kind: Kind = "inertial") -> None:
        self.law, self.plant, self.axis, self.kind = law, plant, axis, kind
        self.period_s = law.period_s
        self._blocks = _network(law, plant, axis, kind)

    def poles(self) -> Complex:
        """Poles of the closed loop."""
        return np.asarray(np.linalg.eigvals(blocks.connect(self._blocks, cut=()).A), dtype=complex)

    def check_stable(self) -> None:
        """Raises ``UnstableLoopError``."""
        worst = float(np.max(np.abs(self.poles())))
        if worst >= 1.0 - 1e-9:
            raise UnstableLoopError(f"the {self.axis} axis is unstable closed on the {self.kind} reference: largest pole {worst:.4f}")

    def open_loop(self, at: Break) -> Any:
        """Loop transfer function, negative feedback, as a discrete ``control.StateSpace``: 1 + L = 0 is the edge of stability."""
        if at not in self.breaks():
            raise ValueError(f"a {self.kind} loop has no break point {at!r}")
        name = SIGNALS[at]
        whole = blocks.connect(self._blocks, cut=(name,))
        return -whole[whole.output_labels.index(name), whole.input_labels.index(name)]

    def breaks(self) -> tuple[Break, ...]:
        """Where this loop can be broken."""
        return ("current", "imu", "resolver") if self.kind == "inertial" else ("current", "resolver")

    def margins(self, at: Break) -> Margins:
        """Margins of the loop broken at ``at``. Raises ``UnstableLoopError`` where the closed loop is not stable."""
        self.check_stable()
        f = grid_hz(self.period_s)
        return margins(f, response(self.open_loop(at), f))

    def isolation_db(self, f_hz: Sequence[float] = ISOLATION_HZ) -> Real:
        """Platform angle in space over base angle, both sides of the base's motion (angle and rate) included, in dB."""
        f = np.asarray(f_hz, dtype=float)
        whole = blocks.connect(self._blocks)
        o = whole.output_labels.index("angle")
        angle, rate = (response(whole[o, whole.input_labels.index(name)], f) for name in ("base", "base_rate"))
        return np.asarray(20.0 * np.log10(np.abs(angle + 2j * np.pi * f * rate)))

    def transfer(self, source: str, output: str, f_hz: Real, cut: Sequence[str] = ()) -> Complex:
        """Frequency response between two signals of ``tuning.blocks``, with the inputs named in ``cut`` left open."""
        whole = blocks.connect(self._blocks, cut=cut)
        return response(whole[whole.output_labels.index(output), whole.input_labels.index(source)], f_hz)


def _network(p: LawParams, plant: AxisPlant, axis: Axis, kind: Kind) -> list[Any]:
    """All blocks of one axis. Names of inputs are those of the outputs that feed them."""
    t = p.period_s
    own = p.roll if axis == "roll" else p.pitch
    if own.velocity_mode:
        raise ValueError(f"the {axis} actuator is in velocity mode: its speed loop is in the drive, only torque mode is designed here")
    every, wait = plant.imu_every(t), plant.imu_delay_cycles(t)
    lever, travel = -p.radius_m, own.travel_per_rad_m
    network = [
        discrete(plant, t),
        blocks.delay(1, t, "command", "acting"),
        blocks.gain(1.0, t, ["motor"], ["resolver"]),
        blocks.observer(p, own),
        blocks.gain(travel / lever, t, ["speed_est"], ["joint_rate"]),
        blocks.speed_pi(p),
    ]
    if kind == "inertial":
        network += [blocks.imu(plant, t), *blocks.attitude_pid(p, every, wait)]
        demand, sources = [1.0], ["rate_pid"]
        if p.feedforward:
            network += blocks.base_rate(p, every, wait)
            demand, sources = [1.0, -1.0], ["rate_pid", "base_est"]
            accel = p.accel_ff_a[1 if axis == "roll" else 0]
            network.append(blocks.gain(-accel * lever, t, ["accel_est"], ["accel_ff"]))
        network.append(blocks.gain([[lever / travel * k for k in demand]], t, sources, ["motor_ref"]))
    else:
        # rod_kp * (0 - rod) as a motor speed
        network.append(blocks.gain(-p.rod_kp, t, ["motor_est"], ["motor_ref"]))
    return network
