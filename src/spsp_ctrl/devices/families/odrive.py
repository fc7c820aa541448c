"""ODrive axes (CANSimple) as the rig uses them. There is no SYNC: estimates come cyclically, commands act when they arrive."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

from spsp_ctrl.devices import odrive_host as host
from spsp_ctrl.devices import odrive_table as T
from spsp_ctrl.devices.families.base import NOBODY, DriveSetup, Frame, Identity
from spsp_ctrl.messages import NO_DRIVE, NO_RESOLVER, DriveSample, ResolverSample

if TYPE_CHECKING:
    from spsp_ctrl.config.devices import DriveNode


class OdriveDrive:
    """One axis in torque or velocity control. Its watchdog (set with the maker's tool) stops it when commands fail."""

    synced = False
    START_TIMEOUT_NS = 2_000_000_000

    def __init__(self, node: DriveNode, setup: DriveSetup) -> None:
        self._node, self._setup = node.node, setup
        self._sign = -1.0 if node.reversed else 1.0
        self._walker = host.Walker(self._node, T.VELOCITY_CONTROL if setup.velocity else T.TORQUE_CONTROL)
        self._heard: host.Heartbeat | None = None
        self._first_ns: int | None = None
        self._bus_v = 0.0
        self._current_a = 0.0
        self._turn = 0
        self.done = False
        self.problem = ""
        self.identity = NOBODY
        self.drive: DriveSample = NO_DRIVE
        self.shaft: ResolverSample = NO_RESOLVER
        self.temperatures_c: tuple[float, float] | None = None

    def start_up(self, now_ns: int, frames: list[Frame]) -> list[Frame]:
        """See ``DriveFamily``: a heartbeat and the version must be heard."""
        begin = self._first_ns is None
        self._first_ns = now_ns if self._first_ns is None else self._first_ns
        for frame in frames:
            self._heard = host.read_heartbeat(frame, self._node) or self._heard
            if frame[0] == host.identifier(self._node, T.VERSION) and len(frame[1]) == 8:
                _, product, hardware, variant, major, minor, revision, _ = frame[1]
                self.identity = Identity("ODrive", f"{product}.{hardware}-{variant}", "", f"{major}.{minor}.{revision}")
        if self._heard is not None and self.identity != NOBODY:
            self.done = True
        elif now_ns - self._first_ns > self.START_TIMEOUT_NS:
            self.problem = f"the ODrive at node {self._node} sends no {'heartbeat' if self._heard is None else 'version'}"
        return [_ask(self._node, T.VERSION)] if begin else []

    def facts(self) -> dict[str, Any]:
        """See ``Dialogue``."""
        return {"identity": list(self.identity)}

    def restore(self, facts: dict[str, Any]) -> None:
        """See ``Dialogue``."""
        self.identity = Identity(*facts["identity"])
        self.done = True

    def operate(self) -> list[Frame]:
        """See ``DriveFamily``."""
        return [_ask(self._node, T.BUS)]

    def prepare(self) -> list[Frame]:
        """See ``DriveFamily``."""
        return [host.set_mode(self._node, T.VELOCITY_CONTROL if self._setup.velocity else T.TORQUE_CONTROL)]

    def receive(self, frame: Frame, stamp_ns: int, seq: int) -> None:
        """See ``DriveFamily``."""
        self._heard = host.read_heartbeat(frame, self._node) or self._heard
        pair = host.read_pair(frame, self._node, T.ESTIMATES)
        if pair is not None and self._heard is not None:
            counts = round(self._sign * pair.first * self._setup.counts_per_turn)
            enabled = self._heard.state == T.CLOSED_LOOP
            self.shaft = ResolverSample(stamp_ns, seq, counts, 0)
            self.drive = DriveSample(stamp_ns, seq, enabled, self._heard.errors, self._current_a, self._bus_v)
            return
        pair = host.read_pair(frame, self._node, T.CURRENTS)
        if pair is not None:
            self._current_a = self._sign * pair.second
            return
        pair = host.read_pair(frame, self._node, T.BUS)
        if pair is not None:
            self._bus_v = pair.first

    def command(self, enable: bool, current_a: float, speed_rad_s: float, now_ns: int) -> list[Frame]:
        """See ``DriveFamily``."""
        out = self._walker.step(self._heard, enable)
        torque = self._sign * current_a * self._setup.torque_constant_nm_a if enable else 0.0
        if self._setup.velocity:
            out.append(host.velocity(self._node, self._sign * speed_rad_s / (2.0 * pi) if enable else 0.0, torque))
        else:
            out.append(host.torque(self._node, torque))
        self._turn = (self._turn + 1) % max(1, self._setup.rate_hz // 100)
        if self._turn == 0:
            out += [_ask(self._node, T.CURRENTS), _ask(self._node, T.BUS)]
        return out

    def reset(self) -> None:
        """Acknowledge errors with the next commands."""
        self._walker.reset()

    def ask_temperatures(self, now_ns: int) -> None:
        """An ODrive's own temperatures are not those of the screw."""

    def ask(self, now_ns: int) -> list[Frame]:
        """Nothing beside ``command``."""
        return []

    def stop(self) -> list[Frame]:
        """See ``DriveFamily``."""
        return [host.set_state(self._node, T.IDLE)]

    def leave(self) -> list[Frame]:
        """See ``DriveFamily``."""
        return [host.set_state(self._node, T.IDLE)]


def _ask(node: int, command: int) -> Frame:
    """A question as a real bus wants it: a remote frame."""
    identifier, data = host.query(node, command)
    return identifier | T.REMOTE, data
