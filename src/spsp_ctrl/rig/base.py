"""The driver seam. Everything above it is the same for the virtual rig, a rig on a bus, and hardware.

Timing contract, one for all rigs: inputs are latched at SYNC k (``read``), the command computed from them (``write``) acts from SYNC k+1
to SYNC k+2. ``now_ns`` is always the time of the cycle's SYNC on the control clock, never "now" on some other clock.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from spsp_ctrl.messages import Command, Measurement, Truth


class RigIdentity(NamedTuple):
    """Who answered."""

    vendor: str
    product: str
    serial: str
    firmware: str
    virtual: bool


class RigError(Exception):
    """A rig cannot be opened or has stopped answering; the text says what to check."""


class Rig(Protocol):
    """A rig. A simulated session constructs only simulated rigs."""

    def open(self) -> RigIdentity:
        """Connect and identify. Raises ``RigError``."""
        ...

    def read(self, now_ns: int) -> Measurement:
        """Newest sample of each signal at SYNC ``now_ns``, with stamp and sequence. Never waits."""
        ...

    def write(self, command: Command, now_ns: int) -> Command:
        """Hand over the command of this cycle; returns what is really sent."""
        ...

    def stop(self) -> None:
        """Take power from the actuators, from any state. Cannot raise, and may be called twice."""
        ...

    def close(self) -> None:
        """Let go of everything."""
        ...

    def truth(self) -> Truth | None:
        """True state at the last ``read``, where the rig is virtual; never seen by the law."""
        ...
