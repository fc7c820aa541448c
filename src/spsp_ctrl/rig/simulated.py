"""The virtual rig: the plant in this process behind the driver seam."""

from __future__ import annotations

import struct
from collections import deque
from math import isfinite, pi

import numpy as np

from spsp_ctrl.config.devices import Wire
from spsp_ctrl.config.rig import RigConfig, SimulatedDriver
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.devices.scaling import TEMPERATURE_STEP_C, amperes, counts_s, permille, pulses_s, rad_s, singles, sixteenths
from spsp_ctrl.messages import (
    NO_IMU,
    NO_TEMPERATURE,
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
from spsp_ctrl.plant.compile import IS_COMPILED, WHY_PLAIN
from spsp_ctrl.plant.layout import N_COMMAND, N_TRUTH, C, G, O
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.plant.virtual import VirtualPlant
from spsp_ctrl.rig.base import RigError, RigIdentity

TEMPERATURE_HZ = 10
_ENCODERS = slice(O.encoder_pitch, O.encoder_yaw + 1)
_COMMAND_ROW = struct.Struct(f"{N_COMMAND}d")
_IDLE = (0.0,) * N_COMMAND
_new = tuple.__new__


class OnWire:
    """What a bus would round, see ``devices.scaling``."""

    def __init__(self, config: RigConfig, wire: Wire) -> None:
        self._rated_a = wire.rated_current_a
        self._per_turn = [1 << actuator.resolver_bits for actuator in (config.pitch_actuator, config.roll_actuator)]
        a = config.azimuth
        self._microsteps_per_rad = a.gear_ratio * a.full_steps_per_turn * a.microsteps / (2.0 * pi)

    def reported(self, current_a: float) -> float:
        """Measured current."""
        return amperes(permille(current_a, self._rated_a), self._rated_a)

    def sent(self, pitch_a: float, pitch_rad_s: float, roll_a: float, roll_rad_s: float, azimuth_rad_s: float) -> tuple[float, ...]:
        """Commands."""
        return (
            self.reported(pitch_a),
            rad_s(counts_s(pitch_rad_s, self._per_turn[0]), self._per_turn[0]),
            self.reported(roll_a),
            rad_s(counts_s(roll_rad_s, self._per_turn[1]), self._per_turn[1]),
            pulses_s(azimuth_rad_s, self._microsteps_per_rad) / self._microsteps_per_rad,
        )


class SimulatedRig:
    """Lock-step and real time alike: ``read`` advances the plant to the SYNC it is told."""

    def __init__(
        self, config: RigConfig, model: PlantModel, scenario: Scenario, seed: int, *, real_time: bool = False
    ) -> None:
        if real_time and not IS_COMPILED:
            raise RigError(f"the virtual rig cannot keep real time in plain Python ({WHY_PLAIN}); use --fast")
        self._config = config
        self._plant = VirtualPlant(model, scenario, config.rate_hz, seed)
        self._period_ns = round(1e9 / config.rate_hz)
        parameters = self._plant.parameters
        self._imu_delay_ns = round(float(parameters[G.imu_delay_s] + parameters[G.imu_added_delay_s]) * 1e9)
        self._azimuth_every = max(1, round(config.rate_hz / config.azimuth.rate_hz))
        self._temperature_every = max(1, config.rate_hz // TEMPERATURE_HZ)
        self._temperature_error_c = scenario.temperature.sensor_error_c
        self._dropouts = tuple(span for d in scenario.dropouts for span in d.spans_s)
        self._velocity_modes = (config.pitch_actuator.mode == "velocity", config.roll_actuator.mode == "velocity")
        wire = config.rig.wire if isinstance(config.rig, SimulatedDriver) else None
        self._on_wire = None if wire is None else OnWire(config, wire)
        self._active = np.zeros(N_COMMAND)
        self._active_memory = self._active.data
        self._enabled = False
        self._pending: tuple[float, ...] = _IDLE
        self._out: list[float] = self._plant.out.tolist()
        self._in_flight: deque[ImuSample] = deque()
        self._imu = NO_IMU
        self._azimuth = self._azimuth_sample(0)
        self._temperature = NO_TEMPERATURE
        self._stopped = False
        self._latch(0)
        self._measurement = self._measure(0)

    def open(self) -> RigIdentity:
        """Compile the kernel (or load it) before any clock starts."""
        self._plant.warm_up()
        return RigIdentity("spsp-ctrl", "virtual rig", self._config.name, "plant", True)

    def read(self, now_ns: int) -> Measurement:
        """Advance to SYNC ``now_ns`` and latch. Several periods at once after a skipped cycle: the last command keeps acting."""
        target = round(now_ns / self._period_ns)
        if self._plant.cycle < target:
            while self._plant.cycle < target:
                self._out = self._plant.advance(self._active).tolist()
                _COMMAND_ROW.pack_into(self._active_memory, 0, *self._pending)
                self._enabled = bool(self._pending[C.enable])
                self._latch(self._plant.cycle)
            self._measurement = self._measure(now_ns)
        return self._measurement

    def write(self, command: Command, now_ns: int) -> Command:
        """Take the command for the next SYNC. A value that is not finite disables the drives instead of reaching them."""
        if self._stopped or not all(map(isfinite, command[3:])):
            command = command._replace(
                enable=False,
                pitch_current_a=0.0,
                pitch_speed_rad_s=0.0,
                roll_current_a=0.0,
                roll_speed_rad_s=0.0,
                azimuth_rate_rad_s=0.0,
            )
        _, _, enable, pitch_current, pitch_speed, roll_current, roll_speed, azimuth_rate = command
        if enable and self._plant.cycle % self._azimuth_every:
            azimuth_rate = self._pending[C.azimuth_rate]
        pitch_velocity, roll_velocity = self._velocity_modes
        if self._on_wire is not None:
            pitch_current, pitch_speed, roll_current, roll_speed, azimuth_rate = self._on_wire.sent(
                pitch_current, pitch_speed, roll_current, roll_speed, azimuth_rate
            )
        # in the order of layout.COMMAND
        self._pending = (
            enable,
            pitch_velocity,
            pitch_current,
            pitch_speed,
            roll_velocity,
            roll_current,
            roll_speed,
            azimuth_rate,
        )
        return command

    def stop(self) -> None:
        """Disable everything from the next SYNC on; later commands are ignored."""
        self._stopped = True
        self._pending = _IDLE

    def close(self) -> None:
        """Nothing to let go of."""

    def truth(self) -> Truth:
        """True state at the last SYNC."""
        m = self._measurement
        return _new(Truth, (m.stamp_ns, m.cycle, *self._out[:N_TRUTH]))

    def _latch(self, cycle: int) -> None:
        out = self._out
        now = cycle * self._period_ns
        if cycle % self._plant.imu_every == 0 and not any(a <= now * 1e-9 < b for a, b in self._dropouts):
            roll, pitch, yaw, gx, gy, gz = out[O.imu_roll : O.gyro_z + 1]
            if self._on_wire is not None:
                roll, pitch, yaw, gx, gy, gz = singles((roll, pitch, yaw, gx, gy, gz))
            self._in_flight.append(
                ImuSample(
                    now, now + self._imu_delay_ns, cycle // self._plant.imu_every, True, roll, pitch, yaw, gx, gy, gz
                )
            )
        while self._in_flight and self._in_flight[0].received_ns <= now:
            self._imu = self._in_flight.popleft()
        if cycle % self._azimuth_every == 0:
            self._azimuth = self._azimuth_sample(cycle)
        if cycle % self._temperature_every == 0:
            screw_p, screw_r = out[O.screw_pitch_c : O.screw_roll_c + 1]
            column, frame = out[O.column_c : O.frame_c + 1]
            self._temperature = TemperatureSample(
                now,
                cycle // self._temperature_every,
                *(TEMPERATURE_STEP_C * sixteenths(t + self._temperature_error_c) for t in (screw_p, screw_r, column, frame)),
            )

    def _azimuth_sample(self, cycle: int) -> AzimuthSample:
        steps, rate, left, right, home = self._out[O.microsteps : O.home_switch + 1]
        if self._on_wire is not None:
            rate = float(round(rate))
        return AzimuthSample(
            cycle * self._period_ns,
            cycle // self._azimuth_every,
            self._enabled,
            int(steps),
            rate,
            bool(left),
            bool(right),
            bool(home),
        )

    def _measure(self, now_ns: int) -> Measurement:
        counts1, counts2, current1, current2, bus1, bus2 = self._out[N_TRUTH : N_TRUTH + 6]
        cycle, enabled = self._plant.cycle, self._enabled
        if self._on_wire is not None:
            current1, current2 = self._on_wire.reported(current1), self._on_wire.reported(current2)
        return _new(
            Measurement,
            (
                now_ns,
                cycle,
                self._imu,
                _new(ResolverSample, (now_ns, cycle, int(counts1), 0)),
                _new(ResolverSample, (now_ns, cycle, int(counts2), 0)),
                _new(DriveSample, (now_ns, cycle, enabled, 0, current1, bus1)),
                _new(DriveSample, (now_ns, cycle, enabled, 0, current2, bus2)),
                self._azimuth,
                self._temperature,
                _new(BaseSample, (now_ns, cycle, *self._out[_ENCODERS])),
            ),
        )
