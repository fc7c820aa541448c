"""The device side of the virtual rig: simulated drives, encoder nodes, IMU and stepper, fed with readings of the plant. No plant is known here."""

from __future__ import annotations

from collections.abc import Callable
from math import pi, radians
from typing import NamedTuple, Protocol

from spsp_ctrl.config.devices import AngleNode, BusDriver, DriveNode
from spsp_ctrl.config.rig import Actuator, RigConfig
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices import cia402_device, odrive_device, tmcl_device
from spsp_ctrl.devices import odrive_table as O_T
from spsp_ctrl.devices import tmcl_table as T
from spsp_ctrl.devices.cia406_device import Encoder
from spsp_ctrl.devices.mip_device import ImuState, MipImu
from spsp_ctrl.devices.scaling import amperes, counts_s, millivolts, permille, rad_s
from spsp_ctrl.rig.base import RigError

Frame = tuple[int, bytes]
ENCODER_BITS = 20
"""Of the swing table."""
RATED_CURRENT_A = 2.5
"""Of a simulated drive, where the rig file does not say."""


class AxisReading(NamedTuple):
    """What a drive measures of its motor."""

    counts: int
    current_a: float
    bus_voltage_v: float
    speed_rad_s: float
    screw_c: float
    other_c: float
    """Column (pitch drive) or frame (roll drive)."""


class Readings(NamedTuple):
    """What the sensors of the rig read at one instant."""

    pitch: AxisReading
    roll: AxisReading
    microsteps: int
    microsteps_s: float
    positive_switch: bool
    negative_switch: bool
    home_switch: bool
    base_rad: tuple[float, float, float]


class AxisOrder(NamedTuple):
    """What a drive does with its motor."""

    enabled: bool
    velocity: bool
    current_a: float
    speed_rad_s: float


OFF = AxisOrder(False, False, 0.0, 0.0)


class SimulatedDrive(Protocol):
    """A drive of any family around a motor."""

    def receive(self, frame: Frame, now_ns: int) -> list[Frame]:
        """One frame of its bus."""
        ...

    def tick(self, now_ns: int) -> list[Frame]:
        """What is due."""
        ...

    def measure(self, r: AxisReading) -> None:
        """What its sensors read from now on."""
        ...

    @property
    def order(self) -> AxisOrder:
        """What it does now."""
        ...


class Cia402(SimulatedDrive):
    """A CiA 402 drive."""

    def __init__(self, node: DriveNode, actuator: Actuator, serial: int) -> None:
        self._rated_a = node.rated_current_a or RATED_CURRENT_A
        self._sign = -1 if node.reversed else 1
        self._per_turn = node.counts_per_turn or 1 << actuator.resolver_bits
        torque = round(self._rated_a * actuator.torque_constant_nm_a * 1e3)
        identity = (0x53505350, 0x402, 0x00010000, serial)
        self.drive = cia402_device.Drive(node.node, rated_current_ma=round(self._rated_a * 1e3), rated_torque_mnm=torque, identity=identity)

    def receive(self, frame: Frame, now_ns: int) -> list[Frame]:
        """See ``SimulatedDrive``."""
        return self.drive.receive(frame, now_ns)

    def tick(self, now_ns: int) -> list[Frame]:
        """See ``SimulatedDrive``."""
        return self.drive.tick(now_ns)

    def measure(self, r: AxisReading) -> None:
        """See ``SimulatedDrive``."""
        counts = (self._sign * r.counts + (1 << 31)) % (1 << 32) - (1 << 31)
        torque = self._sign * permille(r.current_a, self._rated_a)
        speed = self._sign * counts_s(r.speed_rad_s, self._per_turn)
        self.drive.motor = cia402_device.MotorReading(counts, torque, speed, millivolts(r.bus_voltage_v) * 1e-3)
        self.drive.warm(r.screw_c, r.other_c)

    @property
    def order(self) -> AxisOrder:
        """See ``SimulatedDrive``."""
        enabled, mode, torque, speed = self.drive.command
        if not enabled:
            return OFF
        current = amperes(self._sign * torque, self._rated_a)
        return AxisOrder(True, mode == C.CSV, current, rad_s(self._sign * speed, self._per_turn) if mode == C.CSV else 0.0)


class Odrive(SimulatedDrive):
    """An ODrive axis."""

    def __init__(self, node: DriveNode, actuator: Actuator, serial: int) -> None:
        self._sign = -1.0 if node.reversed else 1.0
        self._per_turn = node.counts_per_turn or 1 << actuator.resolver_bits
        self._kt = actuator.torque_constant_nm_a
        watchdog = 3_000_000 * node.heartbeat_ms
        self.axis = odrive_device.Axis(node.node, estimates_ns=int(node.settings.get("estimates_us", 1000)) * 1000, watchdog_ns=watchdog)

    def receive(self, frame: Frame, now_ns: int) -> list[Frame]:
        """See ``SimulatedDrive``."""
        return self.axis.receive(frame, now_ns)

    def tick(self, now_ns: int) -> list[Frame]:
        """See ``SimulatedDrive``."""
        return self.axis.tick(now_ns)

    def measure(self, r: AxisReading) -> None:
        """See ``SimulatedDrive``."""
        self.axis.turns = self._sign * r.counts / self._per_turn
        self.axis.speed_turns_s = self._sign * r.speed_rad_s / (2.0 * pi)
        self.axis.current_a, self.axis.bus_voltage_v = self._sign * r.current_a, r.bus_voltage_v

    @property
    def order(self) -> AxisOrder:
        """See ``SimulatedDrive``."""
        enabled, control, torque_nm, turns_s = self.axis.command
        if not enabled:
            return OFF
        velocity = control == O_T.VELOCITY_CONTROL
        return AxisOrder(True, velocity, self._sign * torque_nm / self._kt, self._sign * turns_s * 2.0 * pi if velocity else 0.0)


DRIVES: dict[str, Callable[[DriveNode, Actuator, int], SimulatedDrive]] = {"cia402": Cia402, "odrive": Odrive}


class _Angle:
    """A CiA 406 node and what it counts."""

    def __init__(self, node: AngleNode, units_per_turn: int) -> None:
        self._sign = -1 if node.reversed else 1
        self._offset = node.offset_counts
        self.units = node.counts_per_turn or units_per_turn
        turns = max(1, (1 << 31) // self.units)
        self.encoder = Encoder(node.node, units_per_turn=self.units, turns=turns, identity=(0x53505350, 0x406, 1, node.node))

    def measure(self, counts: int) -> None:
        self.encoder.counts = self._sign * counts + self._offset


class VirtualDevices:
    """Every simulated device of a rig file. Buses and lines are named as there."""

    def __init__(self, config: RigConfig, driver: BusDriver, imu_rate_hz: float) -> None:
        d = driver.devices
        self.drives: list[SimulatedDrive] = []
        self._on_bus: dict[str, list[Callable[[Frame, int], list[Frame]]]] = {name: [] for name in driver.can}
        self._ticks: dict[str, list[Callable[[int], list[Frame]]]] = {name: [] for name in driver.can}
        for serial, (node, actuator) in enumerate(((d.drive_pitch, config.pitch_actuator), (d.drive_roll, config.roll_actuator)), 1):
            if node.family not in DRIVES:
                raise RigError(f"no simulated drive of the family {node.family!r}; there are: {', '.join(DRIVES)}")
            drive = DRIVES[node.family](node, actuator, serial)
            self.drives.append(drive)
            self._on_bus[node.bus].append(drive.receive)
            self._ticks[node.bus].append(drive.tick)
        for kind, known, family in (("imu", "mip", d.imu.family), ("stepper", "tmcl", d.azimuth.family)):
            if family != known:
                raise RigError(f"no simulated {kind} of the family {family!r}; there is: {known}")
        pairs = ((d.resolver_pitch, config.pitch_actuator), (d.resolver_roll, config.roll_actuator))
        self._resolvers = [self._angle(node, 1 << actuator.resolver_bits) for node, actuator in pairs]
        self._encoders = [self._angle(node, 1 << ENCODER_BITS) for node in (d.base_pitch, d.base_roll, d.base_yaw)]
        self.imu = MipImu(round(imu_rate_hz))
        self.module = tmcl_device.Module(axes=d.azimuth.motor + 1, address=d.azimuth.address, host=d.azimuth.host)
        self._stepper = self.module.axes[d.azimuth.motor]
        self._stepper.parameters[T.MICROSTEPS] = config.azimuth.microsteps.bit_length() - 1
        self._stepper_sign = -1 if d.azimuth.reversed else 1
        self._counter_offset = 0
        self._plant_microsteps = 0
        a = config.azimuth
        self._microsteps_per_rad = a.gear_ratio * a.full_steps_per_turn * a.microsteps / (2.0 * pi)
        if d.azimuth.bus is not None:
            self._on_bus[d.azimuth.bus].append(lambda frame, now_ns: self._module_can(*frame))
        limits = config.limits
        for number, degrees in ((T.MAX_SPEED, limits.azimuth_rate_deg_s), (T.MAX_ACCELERATION, limits.azimuth_accel_deg_s2)):
            self._stepper.parameters[number] = round(radians(degrees) * self._microsteps_per_rad)
        self._dt_s = 1.0 / config.rate_hz

    def _angle(self, node: AngleNode | None, units: int) -> _Angle | None:
        if node is None:
            return None
        angle = _Angle(node, units)
        self._on_bus[node.bus].append(angle.encoder.receive)
        self._ticks[node.bus].append(angle.encoder.tick)
        return angle

    def receive(self, bus: str, frame: Frame, now_ns: int) -> list[Frame]:
        """One frame on a bus; all answers."""
        out: list[Frame] = []
        for device in self._on_bus[bus]:
            out += device(frame, now_ns)
        return out

    def tick(self, bus: str, now_ns: int) -> list[Frame]:
        """Heartbeats and watchdogs that are due on a bus."""
        out: list[Frame] = []
        for device in self._ticks[bus]:
            out += device(now_ns)
        return out

    def stepper_bytes(self, data: bytes) -> bytes:
        """Bytes on the line of the stepper; its answers."""
        out = self.module.serial(data)
        self._moved_counter()
        return out

    def _module_can(self, identifier: int, data: bytes) -> list[Frame]:
        out = self.module.can(identifier, data)
        self._moved_counter()
        return out

    def _moved_counter(self) -> None:
        """The host may have set the counter: from now on it is that far from the plant's."""
        self._counter_offset = round(self._stepper.position) - self._stepper_sign * self._plant_microsteps

    def measure(self, r: Readings) -> None:
        """What every sensor reads from now on."""
        for drive, axis in zip(self.drives, (r.pitch, r.roll), strict=True):
            drive.measure(axis)
        for resolver, axis in zip(self._resolvers, (r.pitch, r.roll), strict=True):
            if resolver is not None:
                resolver.measure(axis.counts)
        for encoder, angle in zip(self._encoders, r.base_rad, strict=True):
            if encoder is not None:
                encoder.measure(round(angle * encoder.units / (2.0 * pi)))
        s, sign = self._stepper, self._stepper_sign
        self._plant_microsteps = r.microsteps
        s.position = float(sign * r.microsteps + self._counter_offset)
        s.speed = sign * r.microsteps_s
        s.home_switch = r.home_switch
        s.right_switch, s.left_switch = (r.positive_switch, r.negative_switch) if sign > 0 else (r.negative_switch, r.positive_switch)

    def orders(self) -> tuple[AxisOrder, AxisOrder]:
        """What the two drives do now."""
        pitch, roll = (drive.order for drive in self.drives)
        return pitch, roll

    def stepper_rate_rad_s(self) -> float:
        """Rate that the stepper ramps towards now."""
        demand = self._stepper.demand(self._dt_s)
        self._moved_counter()  # a finished search has set it to zero
        return self._stepper_sign * demand / self._microsteps_per_rad

    @staticmethod
    def attitude(roll: float, pitch: float, yaw: float, gx: float, gy: float, gz: float) -> ImuState:
        """The frame of the design as the unit has it: y to the right, z down."""
        return ImuState(roll, -pitch, -yaw, gx, -gy, -gz)

