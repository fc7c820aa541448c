"""The virtual rig behind real transports, in real time: what ``spsp-ctrl plant serve`` runs.

The plant is advanced to the instants that matter (a SYNC, by the stamp of its frame; an IMU sample) when they have passed. Its time begins with
the first heartbeat of a controller; until then it stands still in the parked pose. When a controller has left, it begins anew with the next.
"""

from __future__ import annotations

import os
import select
import time
import tty
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np

from spsp_ctrl.config.devices import BusDriver
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.devices import canopen_table as C
from spsp_ctrl.devices.families.base import MASTER
from spsp_ctrl.devices.transport.base import CanTransport, TransportError
from spsp_ctrl.devices.transport.opening import open_can
from spsp_ctrl.devices.transport.slcan_device import SlcanAdapter
from spsp_ctrl.plant.compile import IS_COMPILED, WHY_PLAIN
from spsp_ctrl.plant.continuous import ContinuousPlant, NotContinuous
from spsp_ctrl.plant.layout import N_COMMAND, N_TRUTH, G
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.truth_file import TruthWriter
from spsp_ctrl.rig.virtual_devices import OFF, VirtualDevices
from spsp_ctrl.rig.world import IMU_OUTPUTS, command_row, readings

GRACE_NS = 1_000_000
"""An IMU sample is taken this long after its instant, so that a SYNC before it is not overtaken."""
TICK_NS = 1_000_000
SILENCE_NS = 3_000_000_000
"""Without a heartbeat for as long, a controller has gone."""


class Pty:
    """The device's end of a line: a pseudo-terminal whose other end has a name."""

    def __init__(self, path: Path) -> None:
        """Raises ``RigError`` when the name is taken by something that is no link of ours."""
        self._path = path
        self.fd, self._other = os.openpty()
        tty.setraw(self._other)
        os.set_blocking(self.fd, False)
        if path.is_symlink():
            path.unlink()
        elif path.exists():
            raise RigError(f"{path}: exists and is no link to a pseudo-terminal; choose another port in the rig file")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(os.ttyname(self._other))

    def read(self) -> bytes:
        """What has arrived."""
        try:
            return os.read(self.fd, 65536)
        except OSError:
            return b""

    def write(self, data: bytes) -> None:
        """Send; what does not fit is lost, as on a line that nobody reads."""
        if data:
            try:
                os.write(self.fd, data)
            except OSError:
                return

    def close(self) -> None:
        """Take the name away."""
        for fd in (self.fd, self._other):
            os.close(fd)
        if self._path.is_symlink():
            self._path.unlink()


class _SlcanEnd:
    """The adapter's end of a CAN bus on a pseudo-terminal."""

    def __init__(self, path: Path) -> None:
        self._pty = Pty(path)
        self._adapter = SlcanAdapter()
        self.fd = self._pty.fd

    def poll(self, now_ns: int) -> list[tuple[int, int, bytes]]:
        """Frames from the controller."""
        data = self._pty.read()
        if not data:
            return []
        frames, answer = self._adapter.receive(data)
        self._pty.write(answer)
        return [(now_ns, identifier, payload) for identifier, payload in frames]

    def send(self, frames: list[tuple[int, bytes]]) -> bool:
        """Frames to the controller."""
        self._pty.write(self._adapter.deliver(frames))
        return True

    def close(self) -> None:
        """Take the port away."""
        self._pty.close()


def _open_bus(interface: str, channel: str, bitrate: int, options: dict[str, str | int | float | bool]) -> tuple[CanTransport | _SlcanEnd, int]:
    """The other end of a bus, and what to wait on (-1: nothing)."""
    if interface == "slcan":
        end = _SlcanEnd(Path(channel.partition("@")[0]))
        return end, end.fd
    try:
        bus = open_can(interface, channel, bitrate, options)
    except TransportError as error:
        raise RigError(str(error)) from None
    return bus, getattr(bus, "fileno", lambda: -1)()


class ServedWorld:
    """Plant and devices of one virtual rig in real time."""

    def __init__(
        self, config: RigConfig, driver: BusDriver, model: PlantModel, scenario: Scenario, seed: int, *, at_once: bool = False
    ) -> None:
        """Opens every bus and port. ``at_once``: time begins now, and nobody's leaving starts it anew. Raises ``RigError``."""
        if not IS_COMPILED:
            raise RigError(f"the plant cannot keep real time in plain Python ({WHY_PLAIN})")
        if driver.world != "served":
            raise RigError(f"`world: {driver.world}`: only a rig file with `world: served` can be served")
        self._made = (config, driver, model, scenario, seed)
        self._driver = driver
        self._at_once = at_once
        self._sensor_error_c = scenario.temperature.sensor_error_c
        self._dropouts = tuple(span for d in scenario.dropouts for span in d.spans_s)
        self._buses: dict[str, CanTransport | _SlcanEnd] = {}
        self._ptys: dict[str, Pty] = {}
        self._fds: list[int] = []
        self._truth = TruthWriter(Path(driver.truth)) if driver.truth is not None else None
        self.sessions = 0
        """Controllers that have come and gone."""
        self.syncs = 0
        self.latest_ns = 0
        """Largest time between a SYNC and its handling."""
        try:
            self._fresh()
            self._plant.warm_up()
            for name, bus in driver.can.items():
                self._buses[name], fd = _open_bus(bus.interface, bus.channel, bus.bitrate, bus.options)
                if fd >= 0:
                    self._fds.append(fd)
            for name, line in driver.serial.items():
                self._ptys[name] = Pty(Path(line.port))
                self._fds.append(self._ptys[name].fd)
        except BaseException:
            self.close()
            raise

    def _fresh(self) -> None:
        """A parked rig, nobody there."""
        config, driver, model, scenario, seed = self._made
        try:
            self._plant = ContinuousPlant(model, scenario, seed)
        except NotContinuous as error:
            raise RigError(str(error)) from None
        p = self._plant.parameters
        self._imu_rate_hz = float(p[G.imu_rate_hz])
        self._imu_delay_ns = round(float(p[G.imu_delay_s] + p[G.imu_added_delay_s]) * 1e9)
        self._devices = VirtualDevices(config, driver, self._imu_rate_hz)
        self._boot_ns = time.monotonic_ns()
        self._begun_ns: int | None = self._boot_ns if self._at_once else None
        self._heard_ns = 0
        self._left = False
        self._frame_number = 0
        self._coming: deque[tuple[int, bytes]] = deque()
        self._next_tick_ns = 0
        self._command = np.zeros(N_COMMAND)
        self._orders = (OFF, OFF)
        self._devices.measure(readings(self._plant.out.tolist(), self._sensor_error_c))

    def close(self) -> None:
        """Let go of every bus and port."""
        for end in (*self._buses.values(), *self._ptys.values()):
            end.close()
        if self._truth is not None:
            self._truth.close()
            self._truth = None

    def run(self, ended: Callable[[], bool]) -> None:
        """Serve until ``ended``."""
        while not ended():
            now = time.monotonic_ns()
            due = min(self._next_tick_ns, self._imu_instant(self._frame_number) + GRACE_NS, self._coming[0][0] if self._coming else now + TICK_NS)
            wait_s = max(0.0, min((due - now) * 1e-9, 1e-3))
            if self._fds:
                select.select(self._fds, (), (), wait_s if len(self._fds) == len(self._buses) + len(self._ptys) else min(wait_s, 2e-4))
            else:
                time.sleep(min(wait_s, 2e-4))
            self.turn()

    def turn(self) -> None:
        """Everything that is due."""
        now = time.monotonic_ns()
        events: list[tuple[int, str, int, bytes]] = []
        for name, bus in self._buses.items():
            events += [(t, name, identifier, data) for t, identifier, data in bus.poll(now)]
        events.sort(key=lambda event: event[0])
        answers: dict[str, list[tuple[int, bytes]]] = {}
        for t, name, identifier, data in events:
            self._imu_until(t)
            if identifier == C.SYNC:
                self._sync(t)
                self.latest_ns = max(self.latest_ns, now - t)
            elif identifier == C.HEARTBEAT + MASTER:
                self._heartbeat(t)
            elif identifier == C.NMT and len(data) == 2 and data[0] in (C.NMT_RESET_COMMUNICATION, C.NMT_RESET_NODE):
                self._left = self._begun_ns is not None
            answers.setdefault(name, []).extend(self._devices.receive(name, (identifier, data), t))
            if identifier == C.SYNC:
                self._orders = self._devices.orders()
                self._act()
        for name, frames in answers.items():
            self._buses[name].send(frames)
        self._lines(now)
        self._imu_until(now - GRACE_NS)
        while self._coming and self._coming[0][0] <= now:
            self._ptys[self._driver.devices.imu.serial].write(self._coming.popleft()[1])
        if now >= self._next_tick_ns:
            self._tick(now)

    def _tick(self, now: int) -> None:
        self._next_tick_ns = now + TICK_NS
        self._advance(now - 2 * GRACE_NS)
        for name, bus in self._buses.items():
            frames = self._devices.tick(name, now)
            if frames:
                bus.send(frames)
        self._orders = self._devices.orders()  # a drive may have stopped by itself, a stepper is on its way
        self._act()
        if self._begun_ns is not None and not self._at_once and (self._left or now - self._heard_ns > SILENCE_NS):
            self.sessions += 1
            self._fresh()

    def _lines(self, now: int) -> None:
        for name, pty in self._ptys.items():
            data = pty.read()
            if not data:
                continue
            if name == self._driver.devices.imu.serial:
                pty.write(self._devices.imu.receive(data))
            else:
                self._imu_until(now)
                self._advance(now)
                pty.write(self._devices.stepper_bytes(data))
                self._act()

    def _heartbeat(self, t: int) -> None:
        self._heard_ns = t
        if self._begun_ns is None:
            self._begun_ns = t
            self._frame_number = 0

    def _plant_s(self, t: int) -> float:
        return 0.0 if self._begun_ns is None else max(0.0, (t - self._begun_ns) * 1e-9)

    def _imu_instant(self, number: int) -> int:
        begin = self._boot_ns if self._begun_ns is None else self._begun_ns
        return begin + round(number * 1e9 / self._imu_rate_hz)

    def _imu_until(self, t: int) -> None:
        """Frames whose instant has passed."""
        while (instant := self._imu_instant(self._frame_number)) <= t:
            out = self._plant.advance_to(self._plant_s(instant), self._command, True).tolist()
            self._frame_number += 1
            data = self._devices.imu.sample(instant - self._boot_ns, self._devices.attitude(*out[IMU_OUTPUTS]))
            s = self._plant_s(instant)
            if self._begun_ns is None or not any(a <= s < b for a, b in self._dropouts):
                self._coming.append((instant + self._imu_delay_ns, data))

    def _advance(self, t: int) -> list[float]:
        """Plant and sensors as they are at ``t``."""
        out: list[float] = self._plant.advance_to(self._plant_s(t), self._command).tolist()
        self._devices.measure(readings(out, self._sensor_error_c))
        return out

    def _act(self) -> None:
        self._command[:] = command_row(*self._orders, self._devices.stepper_rate_rad_s())

    def _sync(self, t: int) -> None:
        self.syncs += 1
        out = self._advance(t)
        if self._truth is not None:
            self._truth.put(out[:N_TRUTH])
