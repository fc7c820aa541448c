"""The faults of buses and lines, worst last, and which of several a transport reports. A fault is a value, never an exception."""

from __future__ import annotations

import errno

from spsp_ctrl.devices.transport.base import ALL_WELL, Fault

FAULTS: dict[str, str] = {
    "error-frames": "the controller of the bus reports errors; check termination (120 ohm at both ends), bit rate and shield",
    "framing": "bytes arrive with framing or parity errors; check the baud rate at both ends and the ground of the line",
    "flooded": "more arrives than one cycle can take; look for a node that babbles or a second master",
    "overrun": "frames or bytes were lost before they were read; the computer was too late, or the bus is overloaded",
    "queue-full": "the send queue is full: nothing leaves the adapter; check that another node is powered (who acknowledges?) and the bit rate",
    "error-passive": "the controller of the bus is error-passive: many frames fail; check termination, bit rate and cable",
    "down": "the network interface is down; bring it up: ip link set <channel> up type can bitrate <bitrate> restart-ms 100",
    "bus-off": "the controller has left the bus after too many errors; check for a short, a wrong bit rate, missing termination",
    "unplugged": "the adapter or port is gone; check the plug and the supply, then start again",
}
"""Identifier and what to check, from the mildest to the worst."""
_RANK = {name: rank for rank, name in enumerate(FAULTS)}

_FULL = {errno.ENOBUFS, errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOMEM}
_GONE = {errno.ENODEV, errno.ENXIO, errno.EIO, errno.EBADF, errno.ENOENT, errno.EPIPE, errno.ENOTCONN}


def named(error: BaseException) -> str:
    """Identifier of the fault behind what a driver raises. What cannot be told apart counts as ``unplugged``, the worst."""
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    seen: BaseException | None = error
    while code is None and seen is not None:
        code = getattr(seen, "errno", None)
        seen = seen.__cause__
    text = str(error).lower()
    if code in _FULL or isinstance(error, TimeoutError) or "buffer full" in text or "queue" in text:
        return "queue-full"
    if code == errno.ENETDOWN:
        return "down"
    if "bus off" in text or "bus-off" in text or "busoff" in text:
        return "bus-off"
    return "unplugged"


def fault(name: str, detail: str = "") -> Fault:
    """The fault with its advice; ``detail`` says what was seen."""
    return Fault(name, f"{detail}: {FAULTS[name]}" if detail else FAULTS[name])


class Ledger:
    """Faults that hold now. ``unplugged`` is never taken back."""

    def __init__(self) -> None:
        self._holding: dict[str, Fault] = {}
        self.worst = ALL_WELL
        self.counts: dict[str, int] = {}
        """How often each fault began."""

    def set(self, name: str, detail: str = "") -> None:
        """It holds from now on."""
        if name not in self._holding:
            self.counts[name] = self.counts.get(name, 0) + 1
        elif not detail:
            return
        self._holding[name] = fault(name, detail)
        self._choose()

    def clear(self, *names: str) -> None:
        """It is over."""
        for name in names:
            if name != "unplugged":
                self._holding.pop(name, None)
        self._choose()

    def has(self, name: str) -> bool:
        """Whether it holds."""
        return name in self._holding

    def _choose(self) -> None:
        self.worst = max(self._holding.values(), key=lambda f: _RANK[f.id], default=ALL_WELL)
