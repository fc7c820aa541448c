"""Faults that a scenario file puts into a session: lost IMU frames, and named faults of any signal at the seam."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from spsp_ctrl.config.strict import Strict

SignalName = Literal[
    "imu",
    "imu.pitch",
    "imu.roll",
    "imu.yaw",
    "imu.gyro_x",
    "imu.gyro_y",
    "imu.gyro_z",
    "resolver_pitch",
    "resolver_roll",
    "resolver_pitch.status",
    "resolver_roll.status",
    "drive_pitch",
    "drive_roll",
    "drive_pitch.current",
    "drive_roll.current",
    "drive_pitch.supply",
    "drive_roll.supply",
    "drive_pitch.enabled",
    "drive_roll.enabled",
    "azimuth",
    "azimuth.count",
    "azimuth.left_switch",
    "azimuth.right_switch",
    "azimuth.home_switch",
    "temperature",
    "temperature.screw_pitch",
    "temperature.screw_roll",
    "base",
    "command.pitch",
    "command.roll",
    "command.azimuth",
]
Kind = Literal["off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent", "noisy"]


class Dropout(Strict):
    """A signal goes silent for a while (the frames do not arrive)."""

    signal: Literal["imu"] = "imu"
    """Which signal."""
    at_s: float = Field(ge=0.0)
    """When it goes silent."""
    duration_s: float = Field(gt=0.0, le=3600.0)
    """For how long."""
    count: int = Field(default=1, ge=1, le=1000)
    """How many times."""
    every_s: float = Field(default=1.0, gt=0.0, le=3600.0)
    """From the start of one to the start of the next."""

    @model_validator(mode="after")
    def _apart(self) -> Dropout:
        if self.count > 1 and self.every_s <= self.duration_s:
            raise ValueError(f"every_s ({self.every_s:g}) must be above duration_s ({self.duration_s:g})")
        return self

    @property
    def spans_s(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each silence."""
        starts = (self.at_s + k * self.every_s for k in range(self.count))
        return tuple((start, start + self.duration_s) for start in starts)


class Injection(Strict):
    """One named fault of one signal, at the seam between controller and rig: it works on every rig."""

    signal: SignalName
    """Which signal: a whole frame (`imu`), one channel of it (`imu.pitch`), or a command on its way to the rig (`command.pitch`)."""
    kind: Kind
    """`off`: no frames (a channel reads 0); `stuck`: repeats its last value; `garbage`: impossible numbers; `wrong`: offset by `size`;
    `slow`: only every `every`-th value; `delayed`: by `delay_ms`; `intermittent`: off for `off_ms`, then good for `on_ms`; `noisy`: noise of
    `size` rms."""
    at_s: float = Field(ge=0.0, le=86_400.0)
    """When it begins."""
    duration_s: float = Field(default=3600.0, gt=0.0, le=86_400.0)
    """For how long."""
    size: float | None = Field(default=None, ge=-1e9, le=1e9)
    """Of `wrong` and `noisy`, in the unit of the signal (deg, deg/s, counts, A, V, degC, microsteps); a size that matters when absent."""
    every: int | None = Field(default=None, ge=2, le=1000)
    """Of `slow`."""
    delay_ms: float | None = Field(default=None, ge=1.0, le=5000.0)
    """Of `delayed`."""
    off_ms: float = Field(default=60.0, ge=1.0, le=60_000.0)
    """Of `intermittent`."""
    on_ms: float = Field(default=40.0, ge=1.0, le=60_000.0)
    """Of `intermittent`."""

    @model_validator(mode="after")
    def _fits(self) -> Injection:
        for key, kinds in (("size", ("wrong", "noisy")), ("every", ("slow",)), ("delay_ms", ("delayed",))):
            if getattr(self, key) is not None and self.kind not in kinds:
                raise ValueError(f"{key} belongs to {' and '.join(kinds)}, not to {self.kind}")
        return self
