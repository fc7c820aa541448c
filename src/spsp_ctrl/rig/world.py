"""The virtual rig behind the buses, in lock-step: the plant moves on at each SYNC, the devices latch and answer. No byte is left out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices.transport.lockstep import LockstepCan, LockstepSerial, Medium
from spsp_ctrl.messages import Truth
from spsp_ctrl.plant.layout import N_COMMAND, N_TRUTH, G, O
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.plant.virtual import VirtualPlant
from spsp_ctrl.rig.virtual_devices import OFF, AxisOrder, AxisReading, Readings, VirtualDevices

IMU_OUTPUTS = slice(O.imu_roll, O.gyro_z + 1)


def readings(out: list[float], sensor_error_c: float) -> Readings:
    """What the sensors read, from an output row of the plant."""
    counts1, counts2, current1, current2, bus1, bus2 = out[N_TRUTH : N_TRUTH + 6]
    steps, rate, left, right, home = out[O.microsteps : O.home_switch + 1]
    speed1, speed2 = out[O.motor_pitch_rate_rad_s], out[O.motor_roll_rate_rad_s]
    screw1, screw2 = (t + sensor_error_c for t in out[O.screw_pitch_c : O.screw_roll_c + 1])
    column, frame = (t + sensor_error_c for t in out[O.column_c : O.frame_c + 1])
    return Readings(
        AxisReading(int(counts1), current1, bus1, speed1, screw1, column),
        AxisReading(int(counts2), current2, bus2, speed2, screw2, frame),
        int(steps),
        rate,
        bool(left),
        bool(right),
        bool(home),
        (out[O.encoder_pitch], out[O.encoder_roll], out[O.encoder_yaw]),
    )


def command_row(pitch: AxisOrder, roll: AxisOrder, azimuth_rad_s: float) -> tuple[float, ...]:
    """Command of the plant, in the order of ``layout.COMMAND``. A drive that is off takes no current."""
    enable = pitch.enabled or roll.enabled or azimuth_rad_s != 0.0
    return (enable, pitch.velocity, pitch.current_a, pitch.speed_rad_s, roll.velocity, roll.current_a, roll.speed_rad_s, azimuth_rad_s)


class LockstepWorld:
    """Plant and devices of one virtual rig on buses inside this process."""

    def __init__(self, config: RigConfig, driver: BusDriver, model: PlantModel, scenario: Scenario, seed: int) -> None:
        self._plant = VirtualPlant(model, scenario, config.rate_hz, seed)
        self._period_ns = round(1e9 / config.rate_hz)
        p = self._plant.parameters
        self._imu_delay_ns = round(float(p[G.imu_delay_s] + p[G.imu_added_delay_s]) * 1e9)
        self._dropouts = tuple(span for d in scenario.dropouts for span in d.spans_s)
        self._sensor_error_c = scenario.temperature.sensor_error_c
        self.devices = VirtualDevices(config, driver, config.rate_hz / self._plant.imu_every)
        self._media = {name: Medium() for name in driver.can}
        self._send = {name: wire.serve(self._receiver(name, wire)) for name, wire in self._media.items()}
        for name, wire in self._media.items():
            wire.on_time = self._before_the_first_sync(name)
        self._lines = {name: LockstepSerial() for name in driver.serial}
        self._imu_line = self._lines[driver.devices.imu.serial]
        self._imu_line.receive = self.devices.imu.receive
        if driver.devices.azimuth.serial is not None:
            self._lines[driver.devices.azimuth.serial].receive = self.devices.stepper_bytes
        self._active = np.zeros(N_COMMAND)
        self._orders = (OFF, OFF)
        self._azimuth_rad_s = 0.0
        self._now_ns = -(1 << 62)
        self._out: list[float] = self._plant.out.tolist()
        self.devices.measure(readings(self._out, self._sensor_error_c))

    def _receiver(self, name: str, wire: Medium) -> Callable[[int, bytes], list[tuple[int, bytes]]]:
        def receive(identifier: int, data: bytes) -> list[tuple[int, bytes]]:
            if identifier == C.SYNC:
                self._advance(wire.now_ns)
            answers = self.devices.receive(name, (identifier, data), wire.now_ns)
            if identifier == C.SYNC:
                self._orders = self.devices.orders()
            return answers

        return receive

    def _before_the_first_sync(self, name: str) -> Callable[[int], None]:
        """During start-up devices send what they send by themselves; afterwards they do so at each SYNC."""

        def pass_time(now_ns: int) -> None:
            if self._now_ns < 0 and now_ns < 0:
                self._send[name](self.devices.tick(name, now_ns))

        return pass_time

    def can(self, name: str) -> LockstepCan:
        """The host's side of a bus."""
        return LockstepCan(self._media[name])

    def medium(self, name: str) -> Medium:
        """The wire of a bus, for others to join."""
        return self._media[name]

    def line(self, name: str) -> LockstepSerial:
        """The host's end of a line."""
        return self._lines[name]

    def warm_up(self) -> None:
        """Compile (or load) the kernel."""
        self._plant.warm_up()

    def truth(self, stamp_ns: int) -> Truth:
        """True state at the last SYNC."""
        return Truth(stamp_ns, self._plant.cycle, *self._out[:N_TRUTH])

    def _advance(self, now_ns: int) -> None:
        """To SYNC ``now_ns``, once for all buses: what the drives and the stepper did at the last SYNC has acted until now."""
        if now_ns == self._now_ns:
            return
        self._now_ns = now_ns
        target = round(now_ns / self._period_ns)
        self._active[:] = command_row(*self._orders, self._azimuth_rad_s)
        while self._plant.cycle < target:
            self._out = self._plant.advance(self._active).tolist()
            self._imu(self._plant.cycle)
        if target == 0:
            self._imu(0)
        self.devices.measure(readings(self._out, self._sensor_error_c))
        self._azimuth_rad_s = self.devices.stepper_rate_rad_s()
        for name, send in self._send.items():
            send(self.devices.tick(name, now_ns))

    def _imu(self, cycle: int) -> None:
        now_ns = cycle * self._period_ns
        if cycle % self._plant.imu_every:
            return
        data = self.devices.imu.sample(now_ns, self.devices.attitude(*self._out[IMU_OUTPUTS]))
        if not any(a <= now_ns * 1e-9 < b for a, b in self._dropouts):
            self._imu_line.deliver(data, now_ns + self._imu_delay_ns)
