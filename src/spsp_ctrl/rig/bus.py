"""A rig on CAN buses and serial lines: hardware, the plant server in another process, or simulated devices in this one.

Where answers come at once (inside this process, in lock-step) ``read`` sends SYNC k and has its answers. On wires an answer takes half a
millisecond and nothing here may wait: there SYNC k closes cycle k-1, after its commands, and ``read`` of cycle k finds the answers. Either way
inputs of SYNC k give the command that acts at SYNC k+1. Control time is that of the SYNCs: arrival stamps are put on it by the SYNCs' own times.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from math import isfinite, pi
from pathlib import Path
from typing import Any

from spsp_ctrl.config.devices import BusDriver, DriveNode, Expected
from spsp_ctrl.config.rig import Actuator, RigConfig
from spsp_ctrl.devices import canopen_host as canopen
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices.families.base import (
    MASTER,
    AngleFamily,
    DriveFamily,
    DriveSetup,
    Frame,
    Identity,
    ImuFamily,
    ImuSetup,
    StepperFamily,
    StepperSetup,
)
from spsp_ctrl.devices.families.registry import UnknownFamily, family
from spsp_ctrl.devices.transport.base import CanTransport, SerialTransport
from spsp_ctrl.devices.transport.stamped import StampedLine
from spsp_ctrl.devices.watch_host import AnswerWatch
from spsp_ctrl.messages import NO_BASE, NO_MEASUREMENT, NO_TEMPERATURE, AzimuthSample, BaseSample, Command, Measurement, TemperatureSample, Truth
from spsp_ctrl.rig.base import RigError, RigIdentity
from spsp_ctrl.rig.control_time import Answers, ControlTime
from spsp_ctrl.rig.line_watch import LineWatch, Note
from spsp_ctrl.rig.raw import Raw
from spsp_ctrl.rig.truth_file import TruthReader

TEMPERATURE_HZ = 10
START_UP_S = 15.0
SPIN_NS = 80_000
"""The end of a sleep is this uncertain."""
START_UP_NS = 20_000_000_000
_new = tuple.__new__
_OFF = (False, 0.0, 0.0, 0.0, 0.0, 0.0)


class BusRig:
    """See ``rig.base.Rig``. ``truth`` is where true states are known (simulated devices in this process)."""

    def __init__(
        self,
        config: RigConfig,
        can: Mapping[str, CanTransport],
        serial: Mapping[str, SerialTransport],
        truth: Callable[[int], Truth] | None = None,
        warm_up: Callable[[], None] = lambda: None,
    ) -> None:
        assert isinstance(config.rig, BusDriver)
        self._config = config
        self._driver = config.rig
        self._can, self._serial = dict(can), dict(serial)
        self._truth = truth
        self._warm_up = warm_up
        self._immediate = all(line.immediate for line in self._lines().values())
        self._period_ns = round(1e9 / config.rate_hz)
        self._build()
        self._watch = LineWatch(self._driver, self._can, self._serial)
        self._time = ControlTime(self._period_ns)
        self.raw = Raw()
        self._azimuth_every = max(1, round(config.rate_hz / config.azimuth.rate_hz))
        self._temperature_every = max(1, config.rate_hz // TEMPERATURE_HZ)
        self._heartbeat_ns = min((node.heartbeat_ms for _, node in self._driver.devices.nodes()), default=20) * 1_000_000
        self._next_heartbeat_ns = 0
        self._opened: RigIdentity | None = None
        self._reads = self._missed = self._waited_ns = 0
        self._stepper_frames: list[Frame] = []
        self._stepper_bytes = b""
        self._stopped = False
        self._enabled = False
        self._cycle = -1
        self._read_ns = -1
        self._temperature = NO_TEMPERATURE
        self._azimuth = AzimuthSample(0, -1, False, 0, 0.0, False, False, False)
        self._measurement: Measurement = NO_MEASUREMENT

    def _lines(self) -> dict[str, CanTransport | SerialTransport]:
        """Buses and lines by name."""
        return {**self._can, **self._serial}

    def _build(self) -> None:
        """The families of the rig file."""
        config, d = self._config, self._driver.devices
        a = config.azimuth
        try:
            self._drives: tuple[DriveFamily, DriveFamily] = (
                _drive(d.drive_pitch, config.pitch_actuator, config.rate_hz),
                _drive(d.drive_roll, config.roll_actuator, config.rate_hz),
            )
            self._imu: ImuFamily = family("imu", d.imu.family)(d.imu, ImuSetup(config.imu.rate_hz, round(config.imu.delay_ms * 1e6)))
            steps = StepperSetup(a.gear_ratio * a.full_steps_per_turn * a.microsteps / (2.0 * pi), a.microsteps)
            self._stepper: StepperFamily = family("stepper", d.azimuth.family)(d.azimuth, steps)
            self._angles: dict[str, AngleFamily] = {
                name: family("angle", node.family)(node)
                for name in ("resolver_pitch", "resolver_roll", "base_pitch", "base_roll", "base_yaw")
                if (node := getattr(d, name)) is not None
            }
        except UnknownFamily as error:
            raise RigError(str(error)) from None
        names: dict[str, DriveFamily | AngleFamily] = {"drive_pitch": self._drives[0], "drive_roll": self._drives[1], **self._angles}
        self._on_bus: dict[str, list[DriveFamily | AngleFamily]] = {name: [] for name in self._can}
        for name, device in names.items():
            self._on_bus[getattr(d, name).bus].append(device)
        self._answers = {C.TPDO1 + node.node: Answers(self._period_ns) for name, node in d.nodes() if getattr(names[name], "synced", True)}
        self._drives_on = {bus: [x for x in self._drives if x in members] for bus, members in self._on_bus.items()}
        self._stepper_bus, self._stepper_line = d.azimuth.bus, d.azimuth.serial
        self._bases = [self._angles.get(name) for name in ("base_pitch", "base_roll", "base_yaw")]
        self._resolvers = [self._angles.get(name) for name in ("resolver_pitch", "resolver_roll")]
        self.devices: dict[str, Any] = {**names, "imu": self._imu, "azimuth": self._stepper}
        """Families by their name in the rig file."""

    # ---- start and end ---------------------------------------------------------------------------------------------------

    def open(self) -> RigIdentity:
        """Identify, compare with the rig file, configure. Power stages come up to the step before current. May be called twice."""
        if self._opened is None:
            self._warm_up()
            self.identify()
            self._opened = self._identity()
            for name, members in self._on_bus.items():
                self._send_can(name, [frame for device in members for frame in device.operate()])
                self._send_can(name, [frame for drive in self._drives_on[name] for frame in drive.prepare()])
            if not self._immediate:
                name = self._driver.devices.imu.serial
                self._serial[name] = StampedLine(self._serial[name])
        if not self._immediate:
            self._sync()
            time.sleep(2e-9 * self._period_ns)
        return self._opened

    def identify(self) -> dict[str, Identity]:
        """Start-up dialogues of all devices, side by side. No power. Raises ``RigError`` with every problem."""
        begin = time.monotonic()
        turn = 0
        twice = {name: AnswerWatch() for name in self._can}
        heard = dict.fromkeys(self._serial, 0)
        while any(not device.done and not device.problem for device in self.devices.values()):
            now_ns = turn * 1_000_000 - START_UP_NS if self._immediate else time.monotonic_ns()
            for name, bus in self._can.items():
                frames = [(identifier, data) for _, identifier, data in bus.poll(now_ns)]
                for frame in frames:
                    twice[name].frame(*frame)
                out = [frame for device in self._on_bus[name] if not device.done for frame in device.start_up(now_ns, frames)]
                if name == self._stepper_bus and not self._stepper.done:
                    out += self._stepper.start_up(now_ns, frames, b"")[0]
                bus.send(out)
            for name, line in self._serial.items():
                data = b"".join(piece for _, piece in line.poll(now_ns))
                heard[name] += len(data)
                if name == self._driver.devices.imu.serial and not self._imu.done:
                    line.send(self._imu.start_up(now_ns, data))
                elif name == self._stepper_line and not self._stepper.done:
                    line.send(self._stepper.start_up(now_ns, [], data)[1])
            if not self._immediate:
                if time.monotonic() - begin > START_UP_S:
                    break
                time.sleep(0.0005)
            turn += 1
        problems = [f"{name}: {device.problem or 'does not answer'}" for name, device in self.devices.items() if device.problem or not device.done]
        problems += [f"{name}: {text}" for name, device in self.devices.items() if device.done for text in self._strangers(name, device.identity)]
        for device, line_name in (("imu", self._driver.devices.imu.serial), ("azimuth", self._stepper_line)):
            if line_name is not None and not self.devices[device].done:
                problems.append(_line_hint(device, heard[line_name], self._driver.serial[line_name].baud))
        for name, watch in twice.items():
            problems += [f"{name}: two devices answer with the number {node}: unplug one and give it another number" for node in watch.twins]
        faults = [f"{name}: {line.fault.text}" for name, line in self._lines().items() if line.fault.id]
        if problems or faults:
            raise RigError("\n".join([*faults, *problems]))
        return {name: device.identity for name, device in self.devices.items()}

    def _strangers(self, name: str, found: Identity) -> list[str]:
        expect: Expected = getattr(self._driver.devices, name).expect
        pairs = (("vendor", expect.vendor, found.vendor), ("product", expect.product, found.product), ("serial", expect.serial, found.serial))
        return [f"another {word} answers: {got!r}, the rig file expects {want!r}" for word, want, got in pairs if want is not None and want != got]

    def _identity(self) -> RigIdentity:
        drive, imu = self._drives[0].identity, self._imu.identity
        words = "; ".join(f"{name} {device.identity.product} {device.identity.serial}".strip() for name, device in self.devices.items())
        virtual = self._driver.world != "hardware"
        return RigIdentity(f"{drive.vendor}, {imu.vendor}", words, drive.serial, imu.firmware, virtual)

    def facts(self) -> dict[str, Any]:
        """What the devices said at start-up, as JSON: with it recorded frames can be decoded again."""
        return {name: device.facts() for name, device in self.devices.items()}

    def restore(self, facts: Mapping[str, Any]) -> None:
        """Take the facts from a log instead of opening."""
        for name, device in self.devices.items():
            device.restore(facts[name])
        self._opened = self._identity()

    def stop(self) -> None:
        """Power off, from any state. Cannot raise, and may be called twice."""
        self._stopped = True
        self._enabled = False
        for name in self._can:
            try:
                self._send_can(name, [frame for drive in self._drives_on[name] for frame in drive.stop()])
            except Exception:  # nothing may keep the others from being stopped
                continue
        try:
            self._stepper.halt()
            self._pump_stepper(self._read_ns)
            if not self._immediate:
                self._sync()
        except Exception:
            return

    def close(self) -> None:
        """Let go of everything; the nodes no longer wait for our heartbeat."""
        for name, members in self._on_bus.items():
            try:
                if self._opened is not None:
                    self._send_can(name, [frame for device in members for frame in device.leave()])
            except Exception:
                continue
        for line in self._lines().values():
            line.close()

    def see_truth(self, path: Path) -> None:
        """True states of a served plant come through a file in memory. Raises ``RigError`` when nobody serves it."""
        try:
            reader = TruthReader(path)
        except (OSError, ValueError):
            self.close()
            raise RigError(f"{path}: no plant is served there; start one: spsp-ctrl plant serve --config ...") from None
        self._truth = lambda stamp_ns: reader.get(stamp_ns, self._cycle)

    def truth(self) -> Truth | None:
        """See ``Rig``."""
        return self._truth(self._read_ns) if self._truth is not None else None

    def notes(self) -> list[Note]:
        """Troubles of buses, lines and nodes that began or ended since the last call."""
        return self._watch.notes()

    def trouble(self) -> str:
        """Fault of a bus of the drives by its name (``transport.trouble``), which no measurement shows; empty for none."""
        return self._watch.trouble()

    # ---- the cycle -------------------------------------------------------------------------------------------------------

    def read(self, now_ns: int) -> Measurement:
        """See ``Rig``."""
        if now_ns == self._read_ns:
            return self._measurement
        if not self._immediate:
            if self._read_ns < 0:
                self._time.exact(now_ns, round(now_ns / self._period_ns))  # the SYNC that closed ``open``
                for key in self._answers:
                    self._answers[key] = Answers(self._period_ns)
                    self._answers[key].sync(self._time.sync_ns, self._time.sync_seq)
            self._time.begin(time.monotonic_ns(), now_ns)
        self._read_ns = now_ns
        cycle = self._cycle = round(now_ns / self._period_ns)
        if self._immediate:
            for name, bus in self._can.items():
                self._dispatch(name, bus, now_ns)
            self._sync()
        slot = cycle % self._azimuth_every == 0
        if slot:
            self._stepper.round()
        if cycle % self._temperature_every == 0:
            for drive in self._drives:
                drive.ask_temperatures(now_ns)
        for name, bus in self._can.items():
            self._dispatch(name, bus, now_ns)
            while out := [frame for drive in self._drives_on[name] for frame in drive.ask(now_ns)]:
                self._send_can(name, out)
                if not self._dispatch(name, bus, now_ns):
                    break
        for name, line in self._serial.items():
            before, heard = self._imu.imu, 0
            for stamp, data in self._arrived(name, line, now_ns):
                if name == self._driver.devices.imu.serial:
                    heard += len(data)
                    self._imu.receive(data, stamp)
                elif name == self._stepper_line:
                    self._stepper_bytes += data
            if name == self._driver.devices.imu.serial:
                self._watch.imu(now_ns, heard, self._imu.device_ns if self._imu.imu is not before else None)
        self._pump_stepper(now_ns)
        if self._stepper.seq != self._azimuth.seq:
            s = self._stepper
            self._azimuth = AzimuthSample(
                s.stamp_ns, s.seq, self._enabled, s.position_microsteps, s.rate_microsteps_s, s.positive_switch, s.negative_switch, s.home_switch
            )
        self._warmth(now_ns, cycle)
        self._watch.step()
        self._measurement = self._measure(now_ns, cycle)
        return self._measurement

    def _dispatch(self, name: str, bus: CanTransport, now_ns: int) -> int:
        """Frames that have arrived to whom they belong; how many."""
        self.raw.asked(name)
        arrived = bus.poll(now_ns)
        stamp, seq = self._time.sync_ns, self._time.sync_seq
        for t, identifier, data in arrived:
            self._watch.frame(name, identifier, data)
            frame = (identifier, data)
            of_ns, of_seq = stamp, seq
            if not self._immediate:
                t = self._time.control_ns(t, now_ns)
                if identifier in self._answers:
                    of_ns, of_seq = self._answers[identifier].match(t) or (stamp, seq)
            self.raw.arrived(name, t, identifier, data)
            for device in self._on_bus[name]:
                device.receive(frame, of_ns, of_seq)
            if name == self._stepper_bus:
                self._stepper_frames.append(frame)
        return len(arrived)

    def _arrived(self, name: str, line: SerialTransport, now_ns: int) -> list[tuple[int, bytes]]:
        """Bytes that have arrived, on the control clock."""
        self.raw.asked(name)
        found = [(t if self._immediate else self._time.control_ns(t, now_ns), data) for t, data in line.poll(now_ns)]
        for stamp, data in found:
            self.raw.arrived(name, stamp, -1, data)
        return found

    def _pump_stepper(self, now_ns: int) -> None:
        """What the stepper has sent and is sent, as often as answers come at once."""
        while True:
            frames, self._stepper_frames = self._stepper_frames, []
            data, self._stepper_bytes = self._stepper_bytes, b""
            out_frames, out_data = self._stepper.exchange(now_ns, frames, data)
            if self._stepper_bus is not None and out_frames:
                self._send_can(self._stepper_bus, out_frames)
            elif self._stepper_line is not None and out_data:
                self._serial[self._stepper_line].send(out_data)
                self.raw.sent(self._stepper_line, now_ns, -1, out_data)
            else:
                return
            if not self._immediate:
                return
            if self._stepper_bus is not None:
                self._dispatch(self._stepper_bus, self._can[self._stepper_bus], now_ns)
            elif self._stepper_line is not None:
                for _, piece in self._arrived(self._stepper_line, self._serial[self._stepper_line], now_ns):
                    self._stepper_bytes += piece

    def _sync(self) -> None:
        """SYNC on every bus with synchronous nodes; what follows is of that instant."""
        if self._immediate:
            self._time.exact(self._read_ns, self._cycle)
        self._watch.sync(self._read_ns)
        buses = [name for name, members in self._on_bus.items() if members]
        for name in buses:
            self._can[name].send((canopen.SYNC_FRAME,))
        if not self._immediate:
            self._time.sent(time.monotonic_ns(), self._cycle + 1)
            for answers in self._answers.values():
                answers.sync(self._time.sync_ns, self._time.sync_seq)
        for name in buses:
            self.raw.sent(name, self._time.sync_ns, *canopen.SYNC_FRAME)

    def _warmth(self, now_ns: int, cycle: int) -> None:
        """A new temperature sample when the drives have answered."""
        pitch, roll = self._drives
        if pitch.temperatures_c is None or roll.temperatures_c is None:
            return
        seq = self._temperature.seq + 1 if self._temperature.seq >= 0 else cycle // self._temperature_every
        self._temperature = TemperatureSample(
            now_ns, seq, pitch.temperatures_c[0], roll.temperatures_c[0], pitch.temperatures_c[1], roll.temperatures_c[1]
        )
        pitch.temperatures_c = roll.temperatures_c = None

    def _measure(self, now_ns: int, cycle: int) -> Measurement:
        pitch, roll = self._drives
        self._reads += 1
        for drive in self._drives:
            self._missed += drive.synced and drive.drive.seq != self._time.sync_seq
        shafts = [drive.shaft if node is None else node.shaft for drive, node in zip(self._drives, self._resolvers, strict=True)]
        base = NO_BASE
        found = [node for node in self._bases if node is not None]
        if found:
            angles = [2.0 * pi / node.counts_per_turn * node.shaft.counts if node is not None else 0.0 for node in self._bases]
            base = _new(BaseSample, (found[0].shaft.stamp_ns, found[0].shaft.seq, *angles))
        return _new(Measurement, (now_ns, cycle, self._imu.imu, *shafts, pitch.drive, roll.drive, self._azimuth, self._temperature, base))

    def write(self, command: Command, now_ns: int) -> Command:
        """See ``Rig``. Commands first, then our heartbeat; on wires the SYNC closes the cycle."""
        if self._stopped or not all(map(isfinite, command[3:])):
            command = _new(Command, (*command[:2], *_OFF))
        _, _, enable, pitch_a, pitch_rad_s, roll_a, roll_rad_s, azimuth_rad_s = command
        beat = now_ns >= self._next_heartbeat_ns
        if beat:
            self._next_heartbeat_ns = now_ns + self._heartbeat_ns
        orders = ((pitch_a, pitch_rad_s), (roll_a, roll_rad_s))
        for name, drives in self._drives_on.items():
            out = [frame for drive in drives for frame in drive.command(enable, *orders[drive is self._drives[1]], now_ns)]
            if beat and self._on_bus[name]:
                out.append(canopen.heartbeat(MASTER))
            self._send_can(name, out)
        if not enable and self._enabled:
            self._stepper.halt()
        elif enable and self._cycle % self._azimuth_every == 0:
            self._stepper.rate(azimuth_rad_s)
        self._enabled = enable
        if not self._immediate and self._stepper_line is not None:  # an answer to what ``read`` asked may be here already
            for _, piece in self._arrived(self._stepper_line, self._serial[self._stepper_line], now_ns):
                self._stepper_bytes += piece
        self._pump_stepper(now_ns)
        if not self._immediate:
            self._wait(self._time.sync_due_ns(now_ns))
            self._sync()
        return command

    def _wait(self, until_ns: int) -> None:
        """To the fixed phase of SYNC: sleep, then look at the clock."""
        begin = time.monotonic_ns()
        if until_ns - begin > SPIN_NS:
            time.sleep((until_ns - begin - SPIN_NS) * 1e-9)
        while (now := time.monotonic_ns()) < until_ns:
            pass
        self._waited_ns += now - begin

    def figures(self) -> dict[str, float]:
        """For the summary of a run: answers of the drives that were not there in time, and the waiting for the phase of SYNC."""
        expected = self._reads * sum(drive.synced for drive in self._drives)
        return {
            "statuses_expected": expected,
            "statuses_late": self._missed,
            "statuses_lost": sum(answers.lost for answers in self._answers.values()),
            "waiting_us_mean": round(1e-3 * self._waited_ns / max(self._reads, 1), 3),
        }

    def _send_can(self, name: str, frames: list[Frame]) -> None:
        if frames:
            self._can[name].send(frames)
            if self.raw.recording:
                for identifier, data in frames:
                    self.raw.sent(name, self._read_ns, identifier, data)


def _line_hint(device: str, heard: int, baud: int) -> str:
    """Why a device on a line of its own may not have answered."""
    if not heard:
        return f"{device}: not one byte has arrived; check port, cable and supply"
    return f"{device}: {heard} bytes have arrived that are no answer; is it at {baud} baud, and is this its port?"


def _drive(node: DriveNode, actuator: Actuator, rate_hz: int) -> DriveFamily:
    per_turn = node.counts_per_turn or 1 << actuator.resolver_bits
    setup = DriveSetup(actuator.mode == "velocity", per_turn, actuator.torque_constant_nm_a, rate_hz)
    found: DriveFamily = family("drive", node.family)(node, setup)
    return found
