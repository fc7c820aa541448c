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

SIGNALS: dict[Break, str] = {"current": "command", "resolver": "motor"}
"""The signal of ``tuning.blocks`` that is cut. The IMU's are two: ``angle`` and ``rate``."""
ISOLATION_HZ = (0.125, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0)


def grid_hz(period_s: float) -> Real:
    """Frequencies on which margins are sought: 0.02 Hz to just below half the control rate."""
    return np.geomspace(0.02, 0.49 / period_s, 600)


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


def _disk(loop: Complex) -> Real:
    # 1 / |S - 1/2| with S = 1 / (1 + L)
    return np.asarray(2.0 * np.abs((1.0 + loop) / (1.0 - loop)), dtype=float)


def disk_margin(loop: Complex) -> float:
    """Balanced disk margin from a frequency response (Seiler, Packard, Gahinet 2020); ``control.disk_margins`` needs a state space, which a
    measurement has not got. A test holds them equal."""
    return float(_disk(loop).min())


def margins(f_hz: Real, loop: Complex) -> Margins:
    """Margins of a loop of which the frequency response is known, designed or measured (``control.stability_margins`` on the response)."""
    omega = 2.0 * np.pi * np.asarray(f_hz, dtype=float)
    gm, pm, _, _, wgc, _ = ct.stability_margins(ct.frd(loop, omega, smooth=True), returnall=True)
    gm, pm, wgc = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (gm, pm, wgc))
    up, down = gm[gm > 1.0], gm[gm < 1.0]
    disk = _disk(loop)
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
    """The loops of one axis of a law. ``kind`` says on what the position loop is closed.

    Closed on the IMU the loop repeats itself only every frame: responses and poles are those of the periodic system. A response is the part of the
    output at the frequency of the input, which is what a correlation measures.
    """

    def __init__(self, law: LawParams, plant: AxisPlant, axis: Axis = "roll", kind: Kind = "inertial", feedforward: bool = True) -> None:
        """``feedforward=False`` leaves rate and acceleration feed-forward out (and keeps the gyro in the PID)."""
        self.axis, self.kind, self.period_s = axis, kind, law.period_s
        self.every = plant.imu_every(law.period_s) if kind == "inertial" else 1
        self._wait, self._imu = plant.imu_delay_cycles(law.period_s), blocks.imu(plant, law.period_s)
        self._law, self._plant, self._feedforward = law, plant, feedforward

    def breaks(self) -> tuple[Break, ...]:
        """Where this loop can be broken."""
        return ("current", "imu", "resolver") if self.kind == "inertial" else ("current", "resolver")

    def _make(self, sampler: float) -> list[Any]:
        return _network(self._law, self._plant, self.axis, self.kind, self._feedforward, sampler)

    def _phases(self, cut: Sequence[str] = ()) -> list[Any]:
        """The system of the cycle that sees a frame, then of those that do not."""
        seeing = blocks.connect(self._make(float(self.every)), cut)
        return [seeing] + ([blocks.connect(self._make(0.0), cut)] * (self.every - 1) if self.every > 1 else [])

    def poles(self) -> Complex:
        """Poles of the closed loop over one IMU frame (one cycle where there is no IMU in the loop)."""
        return np.asarray(np.linalg.eigvals(_over_a_frame(self._phases())), dtype=complex)

    def check_stable(self) -> None:
        """Raises ``UnstableLoopError``."""
        worst = float(np.max(np.abs(self.poles())))
        if worst >= 1.0 - 1e-9:
            raise UnstableLoopError(f"the {self.axis} axis is unstable closed on the {self.kind} reference: largest pole {worst:.4f}")

    def responses(self, f_hz: Real) -> dict[Break, Complex]:
        """Loop transfer functions at all break points, negative feedback: 1 + L = 0 is the edge of stability.

        From the closed loop, as they are measured: ``L = -G / (1 + G)`` with G from an injection to what comes back.
        """
        names = list(SIGNALS.values())
        phases = self._phases()
        g = _steady(phases, f_hz, names, names)
        found: dict[Break, Complex] = {}
        for k, at in enumerate(SIGNALS):
            back = g[:, k, k]
            found[at] = -back / (1.0 + back)
        if self.kind == "inertial":
            # this loop exists at the instants of the frames alone: what was injected over what a frame then holds is 1 + L
            frame = -self._wait % self.every
            omega = 2.0 * np.pi * np.asarray(f_hz, dtype=float)
            seen = _steady(phases, f_hz, ["angle", "rate"], ["attitude_now"], at_phase=frame)[:, 0]
            lag = self._imu(np.exp(1j * omega * self.period_s))[0, 0]
            found["imu"] = np.asarray(lag / (seen[:, 0] + 1j * omega * seen[:, 1]) - 1.0, dtype=complex)
        return found

    def all_margins(self) -> dict[Break, Margins]:
        """Margins of every loop. Raises ``UnstableLoopError`` where the closed loop is not stable."""
        self.check_stable()
        f = grid_hz(self.period_s)
        return {at: margins(f[keep], loop[keep]) for at, loop in self.responses(f).items() for keep in [self._sampled(at, f)]}

    def smallest_disk(self) -> float:
        """The smallest disk margin of all loops, 0 where the closed loop is unstable."""
        try:
            self.check_stable()
        except UnstableLoopError:
            return 0.0
        f = grid_hz(self.period_s)
        return min(disk_margin(loop[self._sampled(at, f)]) for at, loop in self.responses(f).items())

    def _sampled(self, at: Break, f: Real) -> Any:
        """Frequencies below half the rate at which a break point is sampled."""
        return f < 0.49 / (self.period_s * (self.every if at == "imu" else 1))

    def isolation_db(self, f_hz: Sequence[float] = ISOLATION_HZ) -> Real:
        """Platform angle in space over base angle, both sides of the base's motion (angle and rate) included, in dB."""
        f = np.asarray(f_hz, dtype=float)
        g = _steady(self._phases(), f, ["base", "base_rate"], ["angle"])[:, 0, :]
        return np.asarray(20.0 * np.log10(np.abs(g[:, 0] + 2j * np.pi * f * g[:, 1])))

    def transfer(self, source: str, output: str, f_hz: Real, cut: Sequence[str] = ()) -> Complex:
        """Frequency response between two signals of ``tuning.blocks``, with the inputs named in ``cut`` left open."""
        return np.asarray(_steady(self._phases(cut), f_hz, [source], [output])[:, 0, 0], dtype=complex)

    def time_invariant(self, at: Break) -> Any:
        """The open loop without the images of the IMU's sampling, as a ``control.StateSpace`` for the tools of that library (not at the
        IMU, where two signals are one)."""
        name = SIGNALS[at]
        whole = blocks.connect(self._make(1.0), cut=(name,))
        return -whole[whole.output_labels.index(name), whole.input_labels.index(name)]


def _over_a_frame(phases: Sequence[Any]) -> Real:
    """Transition matrix over all phases."""
    a = np.eye(phases[0].nstates)
    for phase in phases:
        a = phase.A @ a
    return np.asarray(a, dtype=float)


def _steady(
    phases: Sequence[Any], f_hz: Real, sources: Sequence[str], outputs: Sequence[str], at_phase: int | None = None
) -> Complex:
    """Response (frequency, output, input) of a periodic system at the frequency of its input; with ``at_phase``, of the output sampled there alone.

    With input ``exp(j w k T)`` the state is ``X_k exp(j w k T)``, ``X`` with the period of the system (exponentially modulated periodic signals:
    Wereley, 1990, ch. 3, in discrete time). Solve for ``X_0`` over one period, then average the outputs over the phases.
    """
    z = np.exp(2j * np.pi * np.asarray(f_hz, dtype=float) * phases[0].dt)[:, None, None]
    columns = [phases[0].input_labels.index(name) for name in sources]
    rows = [phases[0].output_labels.index(name) for name in outputs]
    n = phases[0].nstates
    x = np.zeros((len(z), n, len(columns)), dtype=complex)
    for phase in phases:
        x = (phase.A @ x + phase.B[:, columns]) / z
    x = np.linalg.solve(np.eye(n) - _over_a_frame(phases) / z ** len(phases), x)
    y = np.zeros((len(z), len(rows), len(columns)), dtype=complex)
    for k, phase in enumerate(phases):
        if at_phase is None or k == at_phase:
            y += phase.C[rows] @ x + phase.D[np.ix_(rows, columns)]
        x = (phase.A @ x + phase.B[:, columns]) / z
    return np.asarray(y / (len(phases) if at_phase is None else 1), dtype=complex)


def _network(p: LawParams, plant: AxisPlant, axis: Axis, kind: Kind, feedforward: bool, sampler: float) -> list[Any]:
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
        blocks.speed_pi(p),
    ]
    if kind == "joint":
        # rod_kp * (0 - rod) as a motor speed
        return [*network, blocks.gain(-p.rod_kp, t, ["motor_est"], ["motor_ref"])]
    network.append(blocks.imu(plant, t))
    ahead = feedforward and (p.observe or p.feedforward)
    if p.observe or ahead:
        network += [blocks.gain(np.eye(2) * travel / lever, t, ["motor_est", "speed_est"], ["joint", "joint_rate"])]
        network += blocks.base_observer(p, every, wait, sampler)
    # demands as a platform or joint rate: what they are fed by, and with which gain
    demand: dict[str, float] = {}
    if p.observe:
        # joints wanted at minus the base tilt
        demand |= {"base_est": -p.rod_kp, "joint": -p.rod_kp}
    else:
        network += blocks.attitude_pid(p, every, wait, sampler)
        demand["rate_pid"] = 1.0
    if ahead:
        demand["base_rate_est"] = -1.0
    network.append(blocks.gain([[lever / travel * k for k in demand.values()]], t, list(demand), ["motor_ref"]))
    if ahead and p.accelerate:
        network.append(blocks.gain(-own.accel_ff_a * lever, t, ["base_accel_est"], ["accel_ff"]))
    return network
