"""The model of the whole rig run along a log, and what is left between the two, channel by channel.

The recorded commands act and a slow loop keeps both motors at the recorded angles (``plant.tracking``); base motion, load and temperatures are
inputs. Channels end in the part of the rig to which they belong: ``current.pitch`` is what the pitch motor draws beyond the model at the measured
motion, ``imu.heading`` what the IMU shows beyond steps, base and gear.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

import numpy as np

from spsp_ctrl.discrepancy.platform_records import PlatformRecord
from spsp_ctrl.discrepancy.replica import TRACKING_HZ, median3, smooth
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.layout import N_AXIS_PARAMETERS, N_BASE, N_COMMAND, N_INPUT, A, C, G, U
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.plant.swing_table import composed, order_of
from spsp_ctrl.plant.tracking import TARGETS, TRACKED, run_along

AXES = ("pitch", "roll")
SETTLE_S = 1.0
"""Left out at the start: the state of gaps and bristles there is a guess."""
SLOW_HZ, FAST_HZ = 50.0, 250.0
"""Rates to which channels are averaged: currents; motor angles."""
SUBSTEP_S = 250e-6
"""Integration step while fitting: coarser than that of the plant; halving it changes no channel by more than its floor."""
STEP_GAIN_1_S = 10.0
UNITS = {
    **{f"{c}.{a}": unit for c, unit in (("current", "A"), ("drive", "A"), ("resolver", "rad")) for a in AXES},
    "imu.pitch": "rad", "imu.roll": "rad", "imu.heading": "rad", "gyro.x": "rad/s", "gyro.y": "rad/s", "gyro.z": "rad/s"
}  # fmt: skip
STAGES = {"current": "drive", "drive": "drive", "resolver": "sensors", "imu": "mechanism", "gyro": "sensors"}
WHERE = {
    **{f"{c}.{a}": a for c in ("current", "drive", "resolver") for a in AXES},
    "imu.pitch": "pitch", "imu.roll": "roll", "imu.heading": "azimuth", "gyro.x": "imu", "gyro.y": "imu", "gyro.z": "imu"
}  # fmt: skip
_AT = {name: k for k, name in enumerate(TRACKED)}
_AZIMUTH = [i for name, i in zip(G._fields, G, strict=True) if name.startswith("az_") or name == "carrier_izz_kg_m2"]
_NOISY = ("imu_noise_rad", "imu_step_rad", "gyro_noise_rad_s", "gyro_step_rad_s", "imu_drift_rad")


@dataclass(frozen=True, slots=True)
class PlatformReplica:
    """A model beside one record."""

    model: PlantModel
    record: PlatformRecord
    inputs: Array
    commands: Array
    targets: Array
    gains: Array
    measured: dict[str, Array]
    frames: Array
    """Place of each IMU frame on the rows, by its stamp."""
    frame_rows: Array
    skip: int
    azimuths: dict[bytes, Array] = field(default_factory=dict, repr=False)
    """What was simulated of the azimuth already."""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of this record."""
        return tuple(UNITS)

    def run(self, p: Array) -> Array:
        """Outputs of the model at every SYNC (``plant.tracking.TRACKED``)."""
        q = p.copy()
        for name in _NOISY:
            q[getattr(G, name)] = 0.0
        rate = self.record.rate_hz
        q[G.imu_rate_hz] = rate  # looked at in every cycle, read off at the stamps of the frames
        substeps = max(1, round(1.0 / rate / SUBSTEP_S))
        y = run_along(q, self.inputs, self.commands, self.targets, self.gains, substeps, 1.0 / rate, True)
        y[:, _AT["imu_yaw"]] = np.unwrap(y[:, _AT["imu_yaw"]]) + self.azimuth_off(q, substeps)
        return y

    def azimuth_off(self, q: Array, substeps: int) -> Array:
        """How far steps, gear and bearing leave the azimuth from where it was: simulated apart, once for each set of their numbers."""
        key = q[_AZIMUTH].tobytes()
        if key not in self.azimuths:
            rate = self.record.rate_hz
            y = run_along(q, self.inputs, self.commands, self.targets, self.gains, substeps, 1.0 / rate, False)
            self.azimuths[key] = y[:, _AT["azimuth"]] - self.targets[:, 9]
        return self.azimuths[key]

    def residuals(self, p: Array) -> dict[str, Array]:
        """Simulated minus measured, by channel, at their rates, without the start."""
        return self.compare(self.run(p))

    def compare(self, y: Array) -> dict[str, Array]:
        """The same from outputs."""
        m, out = self.measured, {}
        for axis in AXES:
            current, command, motor = (y[:, _AT[f"{c}_{axis}"]] for c in ("current", "command", "motor"))
            out[f"current.{axis}"] = self._slow(current - m[f"current_{axis}"], SLOW_HZ)
            out[f"drive.{axis}"] = self._slow((current - command) - (m[f"current_{axis}"] - m[f"command_{axis}"]), FAST_HZ)
            out[f"resolver.{axis}"] = self._slow(motor - m[f"motor_{axis}"], FAST_HZ)
        pitch_off, roll_off = self._carried(y)
        at = self.frames
        grid = np.arange(len(y), dtype=np.float64)
        shown = {}
        for name, column, off in (("pitch", "imu_pitch", pitch_off), ("roll", "imu_roll", roll_off), ("heading", "imu_yaw", None)):
            values = y[:, _AT[column]]
            if name == "heading":
                values = np.unwrap(values)
            shown[name] = np.interp(at, grid, values if off is None else values - off)
        out["imu.pitch"] = shown["pitch"] - m["imu_pitch"]
        out["imu.roll"] = shown["roll"] - m["imu_roll"]
        out["imu.heading"] = _wrapped(shown["heading"] - m["imu_yaw"])
        for c in "xyz":
            out[f"gyro.{c}"] = np.interp(at, grid, y[:, _AT[f"gyro_{c}"]]) - m[f"gyro_{c}"]
        return out

    def _carried(self, y: Array) -> tuple[Array, Array]:
        """Part of the attitude that only comes from the motors not being quite at the recorded angles (pitch, IMU roll), as the lag shows it."""
        p = self.model.parameters()
        sp, cp, sr, cr = (f(y[:, _AT[c]]) for c in ("joint_pitch", "joint_roll") for f in (np.sin, np.cos))
        r, h = p[G.hinge_radius_m], p[G.column_height_m]
        square = 2.0 * r * r + h * h
        l1 = np.sqrt(square - 2.0 * r * (r * cp + h * sp))
        l2 = np.sqrt(square - 2.0 * r * (r * cr + h * sr * cp))
        j11, j21, j22 = r * (r * sp - h * cp) / l1, r * h * sr * sp / l2, r * (r * sr - h * cr * cp) / l2
        off = []
        for k, axis in enumerate(AXES):
            b = k * N_AXIS_PARAMETERS
            off.append((y[:, _AT[f"motor_{axis}"]] - self.measured[f"motor_{axis}"]) * p[b + A.screw_lead_m] / (2.0 * pi * p[b + A.gear_ratio]))
        pitch = off[0] / j11
        roll = (off[1] - j21 * pitch) / j22
        half = max(1, round(0.004 * self.record.rate_hz))
        return smooth(pitch, half), -smooth(roll, half)

    def rates(self) -> dict[str, float]:
        """Samples per second of each channel."""
        frames = 1.0 / float(np.median(np.diff(self.frames))) * self.record.rate_hz
        hz = {"current": SLOW_HZ, "drive": FAST_HZ, "resolver": FAST_HZ}
        return {c: self.record.rate_hz / self._every(hz[k]) if (k := c.split(".")[0]) in hz else frames for c in self.channels}

    def rows(self, channel: str) -> Array:
        """Row of the record in the middle of each residual of a channel."""
        kind = channel.split(".")[0]
        if kind in ("imu", "gyro"):
            return self.frame_rows
        every = self._every(SLOW_HZ if kind == "current" else FAST_HZ)
        n = (len(self.inputs) - self.skip) // every
        return np.asarray(self.skip + np.arange(n) * every + every // 2, np.int64)

    def _every(self, hz: float) -> int:
        return max(1, round(self.record.rate_hz / hz))

    def _slow(self, values: Array, hz: float) -> Array:
        every = self._every(hz)
        kept = values[self.skip :]
        n = len(kept) // every
        return np.asarray(kept[: n * every].reshape(n, every).mean(axis=1))


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + pi) % (2.0 * pi) - pi)


def platform_replica(model: PlantModel, record: PlatformRecord) -> PlatformReplica:
    """Put a model beside a record."""
    p, rate, config = model.parameters(), record.rate_hz, record.config
    n = len(record.measured)
    counts = {a: p[k * N_AXIS_PARAMETERS + A.resolver_counts] or 2.0**32 for k, a in enumerate(AXES)}
    motors = {a: record.column(f"resolver_{a}.counts") * (2.0 * pi / counts[a]) for a in AXES}
    inputs = np.zeros((n, N_INPUT))
    inputs[:, :N_BASE], inputs[:, U.base_pitch : U.base_yaw + 1] = base_rows(record, float(p[G.swing_arm_m]))
    inputs[:, U.load_mass] = record.scenario.load.mass_kg
    targets = np.zeros((n, len(TARGETS)))
    commands = np.zeros((n, N_COMMAND))
    acts = record.control["cycle"].astype(np.int64)
    before = np.maximum(np.arange(n) - 1, 0)  # what was computed at one SYNC acts from the next one on
    commands[:, C.enable] = 1.0
    measured: dict[str, Array] = {}
    gains = np.zeros(6)
    for k, axis in enumerate(AXES):
        b = k * N_AXIS_PARAMETERS
        command = np.asarray(record.control[f"command.{axis}_current_a"], np.float64)[before]
        commands[:, C.pitch_current + k * (C.roll_current - C.pitch_current)] = command
        measured[f"motor_{axis}"], measured[f"command_{axis}"] = motors[axis], command
        measured[f"current_{axis}"] = record.column(f"drive_{axis}.current_a")
        place = smooth(median3(motors[axis]), max(1, round(0.004 * rate)))
        targets[:, 2 * k], targets[:, 2 * k + 1] = place, np.gradient(place) * rate
        w = 2.0 * pi * TRACKING_HZ
        inertia = p[b + A.rotor_inertia_kg_m2]
        gains[2 * k], gains[2 * k + 1] = w / 4.0, w * inertia / p[b + A.torque_constant_nm_a]
    step = 2.0 * pi / (4.0 * p[G.az_teeth] * p[G.az_microsteps])
    rates = np.asarray(record.control["command.azimuth_rate_rad_s"], np.float64)[before]
    every = max(1, round(rate / config.azimuth.rate_hz))
    taken = np.maximum.accumulate(np.where(acts[before] % every == 0, before, 0))
    commands[:, C.azimuth_rate] = rates[np.minimum(taken + 1, n - 1)] if every > 1 else rates
    targets[:, 4] = counted(record) * step
    gains[4], gains[5] = STEP_GAIN_1_S, 1.5 * step
    for k, name in enumerate(("screw_pitch_c", "screw_roll_c", "column_c", "frame_c")):
        targets[:, 5 + k] = smooth(record.column(f"temperature.{name}"), round(0.5 * rate))
    skip = max(2, round(SETTLE_S * rate))
    _frames(record, measured, skip)
    frames, rows = measured.pop("frames"), measured.pop("frame_rows")
    targets[:, 9], targets[:, 10] = azimuth_of(p, inputs, targets, frames, measured, rate)
    return PlatformReplica(model, record, inputs, commands, targets, gains, measured, frames, np.asarray(rows, np.int64), skip)


def azimuth_of(p: Array, inputs: Array, targets: Array, frames: Array, measured: dict[str, Array], rate_hz: float) -> tuple[Array, Array]:
    """Azimuth joint and its rate as the IMU saw them: heading less base and joints by the rods; lag taken off, rattle above 10 Hz smoothed."""
    n = len(inputs)
    pitch = joints_of(p, targets)[0]
    cp, sp = np.cos(pitch), np.sin(pitch)
    forward = np.stack([cp, np.zeros(n), -sp], axis=1)  # image of the platform's x axis before the azimuth turns it: Ry Rx(-roll) leaves y out
    step = targets[:, 4] / p[G.az_gear_ratio]
    c, s = np.cos(step), np.sin(step)
    turned = np.stack([c * forward[:, 0], s * forward[:, 0], forward[:, 2]], axis=1)
    rotation = inputs[:, :9].reshape(n, 3, 3)
    expected = np.einsum("nij,nj->ni", rotation, turned)
    heading = np.unwrap(np.arctan2(expected[:, 1], expected[:, 0]))
    grid = np.arange(n, dtype=np.float64)
    lag = float(p[G.imu_attitude_lag_s]) * rate_hz
    off = _wrapped(measured["imu_yaw"] - np.interp(frames - lag, grid, heading))
    off -= float(p[G.imu_yaw_bias_rad] + p[G.imu_mount_z_rad])
    azimuth = step + np.interp(grid, frames - lag, np.unwrap(off))
    return derivatives(azimuth, rate_hz, 0.05)[:2]


def joints_of(p: Array, targets: Array) -> tuple[Array, Array]:
    """Pitch and roll joint from the motor angles alone, without gap and load (Eqs 9 and 10 solved for the angles)."""
    r, h = float(p[G.hinge_radius_m]), float(p[G.column_height_m])
    rods = []
    for k in range(2):
        b = k * N_AXIS_PARAMETERS
        rods.append(h + targets[:, 2 * k] * p[b + A.screw_lead_m] / (2.0 * pi * p[b + A.gear_ratio]) + p[b + A.zero_offset_m])
    square = 2.0 * r * r + h * h
    pitch = np.arctan2(h, r) - np.arccos((square - rods[0] ** 2) / (2.0 * r * np.hypot(r, h)))
    hp = h * np.cos(pitch)
    roll = np.arctan2(hp, r) - np.arccos((square - rods[1] ** 2) / (2.0 * r * np.hypot(r, hp)))
    return pitch, roll


def counted(record: PlatformRecord) -> Array:
    """Microsteps at every SYNC: between two samples of the driver its own rate goes on."""
    steps, rate = record.column("azimuth.microsteps"), record.column("azimuth.rate_microsteps_s")
    age = (record.column("stamp_ns") - record.column("azimuth.stamp_ns")) * 1e-9
    return np.asarray(steps + rate * age)


def _frames(record: PlatformRecord, measured: dict[str, Array], skip: int) -> None:
    """IMU frames of the record, once each, with their place on its rows by their own stamps."""
    seq = record.measured["imu.seq"]
    fresh = np.flatnonzero(np.diff(seq, prepend=seq[0] - 1) != 0)
    period_ns = 1e9 / record.rate_hz
    place = (record.column("imu.stamp_ns")[fresh] - float(record.measured["stamp_ns"][0])) / period_ns
    kept = fresh[(place >= skip) & (place <= len(seq) - 1) & record.measured["imu.valid"][fresh]]
    place = (record.column("imu.stamp_ns")[kept] - float(record.measured["stamp_ns"][0])) / period_ns
    measured["frames"], measured["frame_rows"] = place, np.rint(place)
    measured["imu_pitch"], measured["imu_roll"] = record.column("imu.pitch_rad")[kept], record.column("imu.roll_rad")[kept]
    measured["imu_yaw"] = record.column("imu.yaw_rad")[kept]
    for c in "xyz":
        measured[f"gyro_{c}"] = record.column(f"imu.gyro_{c}_rad_s")[kept]
    measured["latency"] = (record.column("imu.received_ns")[kept] - record.column("imu.stamp_ns")[kept]) * 1e-9


def base_rows(record: PlatformRecord, arm_m: float) -> tuple[Array, Array]:
    """Rotation, rates and specific acceleration of the base at every SYNC from the encoders of the swing table, and its smoothed angles."""
    motions = []
    for name in ("pitch", "roll", "yaw"):
        angle = np.unwrap(record.column(f"base.{name}_rad"))
        motions.append(np.stack(derivatives(angle, record.rate_hz)))
    tilts = [(axis, sign, motions[which]) for axis, sign, which in order_of(record.scenario.base.axis_order)]
    return composed(motions[2], tilts, arm_m), np.stack([m[0] for m in motions], axis=1)


def derivatives(angle: Array, rate_hz: float, window_s: float = 0.05) -> tuple[Array, Array, Array]:
    """Angle, rate and acceleration by a local cubic (Savitzky and Golay, Anal. Chem. 36, 1964) over ``window_s``."""
    half = max(2, round(0.5 * window_s * rate_hz))
    t = np.arange(-half, half + 1) / rate_hz
    scale = t[-1]
    pinv = np.linalg.pinv(np.stack([(t / scale) ** k for k in range(4)], axis=1))
    n = len(angle)
    padded = np.concatenate([2.0 * angle[0] - angle[half:0:-1], angle, 2.0 * angle[-1] - angle[-2 : -half - 2 : -1]])
    kernels = (pinv[0], pinv[1] / scale, 2.0 * pinv[2] / scale**2)
    a, b, c = (np.convolve(padded, k[::-1], mode="valid")[:n] for k in kernels)
    return a, b, c
