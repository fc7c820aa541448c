"""The platform of the exam behind the driver seam: the real law runs on it in closed loop, and the session writes the log."""

from __future__ import annotations

from math import isfinite, pi, radians

import numpy as np

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.messages import (
    NO_IMU,
    AzimuthSample,
    BaseSample,
    Command,
    DriveSample,
    ImuSample,
    Measurement,
    ResolverSample,
    TemperatureSample,
    Truth,
)
from spsp_ctrl.rig.base import RigIdentity
from tools.blind_exam.platform_physics import (
    AZ,
    FIELD,
    FIELD_RATE,
    GRAVITY,
    N_LEG,
    N_STATE,
    PER_LEG,
    PITCH,
    ROLL,
    ROTOR,
    STEPS,
    Array,
    L,
    R,
    cycle,
    imu,
    legs,
)

ARM_M = 0.45
TEMPERATURE_C = 20.0
DELAY_S = 5e-3


def carrier(scenario: Scenario, cycles: int, rate_hz: int) -> tuple[Array, Array]:
    """Rows of the base (rotation, rate, acceleration, specific acceleration of the joint) by numerical differentiation, and the axis angles."""
    m = scenario.base
    fine = 4
    t = np.arange((cycles + 2) * fine) / (rate_hz * fine) - m.start_s
    x = np.clip(t / m.ramp_s, 0.0, 1.0)
    envelope = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)

    def angle(sines: tuple[object, ...]) -> Array:
        total = np.zeros(len(t))
        for s in sines:
            total += radians(s.amplitude_deg) * np.sin(2.0 * pi * t / s.period_s + radians(s.phase_deg))  # type: ignore[attr-defined]
        return total * envelope

    pitch, roll, yaw = angle(m.pitch), angle(m.roll), angle(m.yaw)

    def about(axis: int, a: Array) -> Array:
        c, s = np.cos(a), np.sin(a)
        out = np.zeros((len(a), 3, 3))
        j, k = (axis + 1) % 3, (axis + 2) % 3
        out[:, axis, axis] = 1.0
        out[:, j, j], out[:, j, k], out[:, k, j], out[:, k, k] = c, -s, s, c
        return out

    tilt = about(0, -roll) @ about(1, pitch) if m.axis_order == "roll_pitch" else about(1, pitch) @ about(0, -roll)
    rotation = about(2, yaw) @ tilt
    dt = 1.0 / (rate_hz * fine)
    spin = np.gradient(rotation, dt, axis=0, edge_order=2)
    skew = np.swapaxes(rotation, 1, 2) @ spin
    omega = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    alpha = np.gradient(omega, dt, axis=0, edge_order=2)
    joint = rotation @ np.array([0.0, 0.0, ARM_M])
    felt = np.gradient(np.gradient(joint, dt, axis=0, edge_order=2), dt, axis=0, edge_order=2) + np.array([0.0, 0.0, GRAVITY])
    specific = np.einsum("nji,nj->ni", rotation, felt)
    rows = np.concatenate([rotation.reshape(-1, 9), omega, alpha, specific], axis=1)
    return np.ascontiguousarray(rows[::fine]), np.stack([pitch, roll, yaw], axis=1)[::fine]


class ExamRig:
    """One session on the platform of the exam. ``late_s`` is delay of the IMU frames beyond the data sheet."""

    def __init__(self, config: RigConfig, p: Array, scenario: Scenario, seed: int, late_s: float = 0.0) -> None:
        self.config, self.p, self.late_s = config, p, late_s
        self.rng = np.random.default_rng(seed)
        cycles = round((scenario.duration_s + 6.0) * config.rate_hz)
        self.rows, self.angles = carrier(scenario, cycles, config.rate_hz)
        self.period = 1.0 / config.rate_hz
        self.period_ns = round(1e9 / config.rate_hz)
        self.s = np.zeros(N_STATE)
        pitch, roll = radians(scenario.park.pitch_deg), radians(scenario.park.roll_deg)
        self.s[AZ], self.s[PITCH], self.s[ROLL] = radians(scenario.park.azimuth_deg), pitch, roll
        self.s[ROTOR] = self.s[FIELD] = self.s[AZ] * p[R.az_gear]
        level = float(np.hypot(p[R.height], p[R.upper] - p[R.lower]))
        lengths = legs(p, pitch, roll)
        for leg in range(2):
            b = leg * N_LEG
            self.s[leg * PER_LEG] = (lengths[leg] - level - p[b + L.zero]) * 2.0 * pi * p[b + L.gear] / p[b + L.lead]
        self.k = 0
        self.frame = np.zeros(6)
        self.queue: list[ImuSample] = []
        self.newest = NO_IMU
        self.pending = self.active = (0.0, 0.0, 0.0, 0.0)
        self.stopped = False
        self.azimuth_every = max(1, round(config.rate_hz / config.azimuth.rate_hz))
        self.imu_every = max(1, round(config.rate_hz / config.imu.rate_hz))
        imu(self.s, p, self.rows[0], np.zeros(9), self.period, True, True, self.frame)
        self.azimuth = self._azimuth()
        self.temperature = self._temperature()
        self._latch()

    def open(self) -> RigIdentity:
        """Nothing to connect to."""
        return RigIdentity("blind exam", "platform", "0", "0", True)

    def read(self, now_ns: int) -> Measurement:
        """Advance to SYNC ``now_ns``."""
        while self.k < round(now_ns / self.period_ns):
            enable, pitch, roll, rate = self.active
            cycle(self.s, self.p, self.rows[self.k : self.k + 2], enable, np.array([pitch, roll]), rate, np.zeros(2), STEPS, self.period)
            self.k += 1
            due = self.k % self.imu_every == 0
            normal = self.rng.standard_normal(9) if due else np.zeros(9)
            imu(self.s, self.p, self.rows[self.k], normal, self.period, due, False, self.frame)
            self.active = self.pending
            self._latch()
        return self._measurement(now_ns)

    def write(self, command: Command, now_ns: int) -> Command:
        """Acts from the next SYNC on."""
        if self.stopped or not all(map(isfinite, command[3:])):
            command = command._replace(
                enable=False, pitch_current_a=0.0, pitch_speed_rad_s=0.0, roll_current_a=0.0, roll_speed_rad_s=0.0, azimuth_rate_rad_s=0.0
            )
        rate = command.azimuth_rate_rad_s if self.k % self.azimuth_every == 0 or not command.enable else self.pending[3]
        self.pending = (float(command.enable), command.pitch_current_a, command.roll_current_a, rate)
        return command

    def stop(self) -> None:
        """Power off."""
        self.stopped, self.pending = True, (0.0, 0.0, 0.0, 0.0)

    def close(self) -> None:
        """Nothing to let go of."""

    def truth(self) -> Truth | None:
        """The log of an exam holds no truth."""
        return None

    def _latch(self) -> None:
        now = self.k * self.period_ns
        if self.k % self.imu_every == 0:
            late = round((DELAY_S + self.late_s) * 1e9)
            self.queue.append(ImuSample(now, now + late, self.k // self.imu_every, True, *(float(v) for v in self.frame)))
        while self.queue and self.queue[0].received_ns <= now:
            self.newest = self.queue.pop(0)
        if self.k % self.azimuth_every == 0:
            self.azimuth = self._azimuth()
        if self.k % 100 == 0:
            self.temperature = self._temperature()

    def _azimuth(self) -> AzimuthSample:
        micro = 2.0 * pi / (4.0 * self.p[R.az_teeth] * self.p[R.az_microsteps])
        az = self.s[AZ]
        return AzimuthSample(
            self.k * self.period_ns, self.k // self.azimuth_every, self.active[0] > 0.0, int(np.floor(self.s[FIELD] / micro + 0.5)),
            float(self.s[FIELD_RATE] / micro), bool(az > 1.597), bool(az < -1.597), bool(abs(az) < 0.00873),
        )  # fmt: skip

    def _temperature(self) -> TemperatureSample:
        return TemperatureSample(self.k * self.period_ns, self.k // 100, *([TEMPERATURE_C] * 4))

    def _measurement(self, now_ns: int) -> Measurement:
        k, on = self.k, self.active[0] > 0.0
        resolvers, drives = [], []
        noise = self.rng.standard_normal(4)
        for leg in range(2):
            b, angle = leg * N_LEG, float(self.s[leg * PER_LEG])
            p = self.p
            reading = angle + p[b + L.ecc1] * np.sin(angle + p[b + L.ecc1_phase]) + p[b + L.ecc2] * np.sin(2.0 * angle + p[b + L.ecc2_phase])
            reading += p[b + L.ecc4] * np.sin(4.0 * angle) + p[b + L.resolver_noise] * noise[leg]
            resolvers.append(ResolverSample(now_ns, k, int(np.floor(reading * p[b + L.counts] / (2.0 * pi) + 0.5)), 0))
            drives.append(DriveSample(now_ns, k, on, 0, float(self.s[leg * PER_LEG + 2] + p[b + L.current_noise] * noise[2 + leg]), 24.0))
        step = 2.0 * pi / 2**20
        base = BaseSample(now_ns, k, *(float(step * round(a / step)) for a in self.angles[k]))
        return Measurement(now_ns, k, self.newest, resolvers[0], resolvers[1], drives[0], drives[1], self.azimuth, self.temperature, base)
