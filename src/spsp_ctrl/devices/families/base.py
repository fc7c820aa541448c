"""What a family of devices is to a rig. No I/O, no clock: frames and bytes in and out, time as an argument, SI outside.

A family is made from its part of the rig file and from what the rest of that file says about the same thing (``DriveSetup`` …). First
``start_up`` is called until ``done`` or ``problem``; it identifies and configures and never switches power on. ``facts`` is what it found
out, and ``restore`` takes it instead of a dialogue when recorded frames are replayed.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from spsp_ctrl.messages import DriveSample, ImuSample, ResolverSample

Frame = tuple[int, bytes]
MASTER = 127
"""Our node number on a CANopen bus."""


class Identity(NamedTuple):
    """Who answers."""

    vendor: str
    product: str
    serial: str
    firmware: str


NOBODY = Identity("", "", "", "")


class DriveSetup(NamedTuple):
    """What the rest of the rig file says about a drive."""

    velocity: bool
    """Velocity mode, else torque mode."""
    counts_per_turn: int
    torque_constant_nm_a: float
    rate_hz: int


class ImuSetup(NamedTuple):
    """The same about the IMU."""

    rate_hz: float
    delay_ns: int
    """Shortest time from sample to arrival."""


class StepperSetup(NamedTuple):
    """The same about the stepper."""

    microsteps_per_rad: float
    microsteps: int
    """Per full step."""


class Dialogue(Protocol):
    """Start-up, common to all."""

    done: bool
    problem: str
    identity: Identity

    def facts(self) -> dict[str, Any]:
        """What the dialogue found out, as JSON."""
        ...

    def restore(self, facts: dict[str, Any]) -> None:
        """Take it from a log."""
        ...


class DriveFamily(Dialogue, Protocol):
    """A drive on CAN."""

    synced: bool
    """It works by SYNC: what it is sent acts at the next one, and it reports the instant of each."""
    drive: DriveSample
    """Newest status."""
    shaft: ResolverSample
    """Newest position of its motor, in the counts of the resolver."""
    temperatures_c: tuple[float, float] | None
    """Newest pair, None when it has none."""

    def start_up(self, now_ns: int, frames: list[Frame]) -> list[Frame]:
        """Go on with what has arrived; the frames to send now."""
        ...

    def operate(self) -> list[Frame]:
        """Cyclic traffic on, after every device is configured. No power yet."""
        ...

    def prepare(self) -> list[Frame]:
        """Everything up to a drive that takes current with the next ``command``, as far as it goes without SYNC."""
        ...

    def receive(self, frame: Frame, stamp_ns: int, seq: int) -> None:
        """One frame of the bus; ``stamp_ns`` and ``seq`` of the newest SYNC."""
        ...

    def command(self, enable: bool, current_a: float, speed_rad_s: float, now_ns: int) -> list[Frame]:
        """What to send in this cycle."""
        ...

    def ask_temperatures(self, now_ns: int) -> None:
        """Begin to ask."""
        ...

    def ask(self, now_ns: int) -> list[Frame]:
        """Questions to send now, one at a time."""
        ...

    def stop(self) -> list[Frame]:
        """Power off, from any state."""
        ...

    def leave(self) -> list[Frame]:
        """End of the session: no watching of our heartbeat any more."""
        ...


class AngleFamily(Dialogue, Protocol):
    """A resolver or encoder node on CAN."""

    shaft: ResolverSample
    """Newest position, unrolled."""
    counts_per_turn: int

    def start_up(self, now_ns: int, frames: list[Frame]) -> list[Frame]:
        """Go on with what has arrived; the frames to send now."""
        ...

    def operate(self) -> list[Frame]:
        """Cyclic traffic on."""
        ...

    def receive(self, frame: Frame, stamp_ns: int, seq: int) -> None:
        """One frame of the bus."""
        ...

    def leave(self) -> list[Frame]:
        """End of the session."""
        ...


class ImuFamily(Dialogue, Protocol):
    """An inertial unit on a serial line."""

    imu: ImuSample
    """Newest frame."""
    device_ns: int
    """Its time on the unit's own clock; -1 when the unit has none."""

    def start_up(self, now_ns: int, data: bytes) -> bytes:
        """Go on with what has arrived; the bytes to send now."""
        ...

    def receive(self, data: bytes, received_ns: int) -> None:
        """Bytes that arrived at ``received_ns``."""
        ...


class StepperFamily(Dialogue, Protocol):
    """A stepper module. ``frames`` on CAN, ``data`` on a serial line: both directions take one of them."""

    position_microsteps: int
    rate_microsteps_s: float
    positive_switch: bool
    negative_switch: bool
    home_switch: bool
    stamp_ns: int
    seq: int

    def start_up(self, now_ns: int, frames: list[Frame], data: bytes) -> tuple[list[Frame], bytes]:
        """Go on with what has arrived; what to send now."""
        ...

    def rate(self, rad_s: float) -> None:
        """Rate to hold from now on."""
        ...

    def halt(self) -> None:
        """Stop."""
        ...

    def round(self) -> None:
        """Ask for everything once, from now on."""
        ...

    def exchange(self, now_ns: int, frames: list[Frame], data: bytes) -> tuple[list[Frame], bytes]:
        """Take what has arrived; what to send now."""
        ...
