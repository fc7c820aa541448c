"""A CAN bus by any interface of python-can, in its own words (``socketcan``, ``udp_multicast``, ``pcan``, ``virtual`` and others).

Own frames are left out, error frames become faults, a call of ``poll`` takes a bounded number of frames, and no driver's exception gets through.
"""

from __future__ import annotations

import itertools
import os
import socket
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

import can

from spsp_ctrl.devices.transport.base import ALL_WELL, EXTENDED, REMOTE, Arrived, TransportError
from spsp_ctrl.devices.transport.trouble import Ledger, named

MOST_FRAMES = 256
"""Frames of one call: more than a 1 Mbit/s bus carries in 12 ms."""
_STATE_NS = 50_000_000
_QUIET_NS = 2_000_000_000
"""Without an error frame for as long, the bus is well again."""
_LATEST_S = 1.0
_token = itertools.count()

_IP_MULTICAST_ALL, _IPV6_MULTICAST_ALL = 49, 29
"""Of linux/in.h and linux/in6.h; Python has no names for them."""

# error frames of SocketCAN (linux/can/error.h): class in the identifier, detail in data[1]
_CONTROLLER, _BUS_OFF, _RESTARTED = 0x04, 0x40, 0x100
_RX_OVERFLOW, _TX_OVERFLOW, _RX_PASSIVE, _TX_PASSIVE, _ACTIVE = 0x01, 0x02, 0x10, 0x20, 0x40


class PythonCanBus:
    """See ``transport.base.CanTransport``."""

    immediate = False

    def __init__(self, interface: str, channel: str, bitrate: int = 1_000_000, options: Mapping[str, Any] | None = None) -> None:
        """Opens the bus. Raises ``TransportError``."""
        self.fault = ALL_WELL
        self._name = f"{interface} {channel}"
        # a sender's own frames come back on multicast, without any mark (its socket cannot tell): the channel field travels along
        self._mark = f"spsp-{os.getpid()}-{next(_token)}" if interface == "udp_multicast" else None
        self._ledger = Ledger()
        self._state_ns = self._erred_ns = 0
        self.sent = self.received = self.own = self.malformed = self.error_frames = 0
        words: dict[str, Any] = {"interface": interface, "channel": channel, "bitrate": bitrate, **(options or {})}
        if interface == "udp_multicast":
            words.setdefault("hop_limit", 0)  # stay in this computer
            words.setdefault("fd", False)
        try:
            self._bus: can.BusABC | None = can.Bus(**words)
        except Exception as error:  # each driver has its own kinds
            raise TransportError(_why(interface, channel, error)) from None
        if interface == "udp_multicast":
            _only_this_group(self._bus)
        self._has_state = type(self._bus).state is not can.BusABC.state

    def poll(self, now_ns: int) -> list[Arrived]:
        """Every frame that has arrived since the last call, without our own."""
        bus = self._bus
        if bus is None or self._ledger.has("unplugged"):
            return []
        found: list[Arrived] = []
        wall_s, now = time.time(), time.monotonic_ns()
        flooded = False
        for _ in range(MOST_FRAMES):
            try:
                message = bus.recv(0)
            except Exception as error:
                if "unpack" in str(error):  # a datagram of somebody else on that group
                    self.malformed += 1
                    continue
                self._set(named(error), f"{self._name}: {error}")
                break
            if message is None:
                break
            if message.is_error_frame:
                self._take_error(message, now)
            elif (self._mark is not None and message.channel == self._mark) or not message.is_rx:
                self.own += 1
            elif message.is_fd or len(message.data) > 8:
                self.malformed += 1
            else:
                late = wall_s - message.timestamp
                stamp = now - int(late * 1e9) if -_LATEST_S < late < _LATEST_S else now
                flag = (EXTENDED if message.is_extended_id else 0) | (REMOTE if message.is_remote_frame else 0)
                found.append((stamp, message.arbitration_id | flag, bytes(message.data)))
        else:
            self._set("flooded", f"{self._name}: {MOST_FRAMES} frames at once")
            flooded = True
        if not flooded and self._ledger.has("flooded"):
            self._clear("flooded")
        self.received += len(found)
        if now - self._state_ns > _STATE_NS:
            self._state_ns = now
            self._look(now)
        return found

    def send(self, frames: Iterable[tuple[int, bytes]]) -> bool:
        """Hand over frames in order. After one that is not taken the rest is left: a SYNC never goes out without the commands before it."""
        bus = self._bus
        if bus is None or self._ledger.has("unplugged"):
            return False
        for identifier, data in frames:
            try:
                bus.send(
                    can.Message(
                        arbitration_id=identifier & 0x1FFFFFFF, data=data, is_extended_id=bool(identifier & EXTENDED),
                        is_remote_frame=bool(identifier & REMOTE), is_rx=False, channel=self._mark, check=True,
                    )
                )  # fmt: skip
            except ValueError:  # too long, or a wrong identifier: ours, and nothing of the bus
                return False
            except Exception as error:
                self._set(named(error), f"{self._name}: {error}")
                return False
            self.sent += 1
        if self._ledger.has("queue-full") or self._ledger.has("down"):
            self._clear("queue-full", "down")
        return True

    def fileno(self) -> int:
        """What to wait on for frames; -1 where the driver has nothing."""
        try:
            return self._bus.fileno() if self._bus is not None else -1
        except NotImplementedError:
            return -1

    def close(self) -> None:
        """Let go of the bus."""
        bus, self._bus = self._bus, None
        if bus is not None:
            with suppress(Exception):
                bus.shutdown()

    def _set(self, name: str, detail: str) -> None:
        self._ledger.set(name, detail)
        self.fault = self._ledger.worst

    def _clear(self, *names: str) -> None:
        self._ledger.clear(*names)
        self.fault = self._ledger.worst

    def _take_error(self, message: can.Message, now: int) -> None:
        """An error frame. Drivers without detail send an empty one."""
        self.error_frames += 1
        self._erred_ns = now
        kind, detail = message.arbitration_id, message.data[1] if len(message.data) > 1 else 0
        counters = f", counters {message.data[6]} sent, {message.data[7]} received" if len(message.data) == 8 else ""
        if kind & _RESTARTED:
            self._clear("bus-off", "error-passive")
        if kind & _BUS_OFF:
            self._set("bus-off", f"{self._name}{counters}")
        elif kind & _CONTROLLER and detail & (_RX_PASSIVE | _TX_PASSIVE):
            self._set("error-passive", f"{self._name}{counters}")
        elif kind & _CONTROLLER and detail & (_RX_OVERFLOW | _TX_OVERFLOW):
            self._set("overrun", f"{self._name}{counters}")
        elif kind & _CONTROLLER and detail & _ACTIVE:
            self._clear("error-passive", "error-frames")
        elif not kind & _RESTARTED:
            self._set("error-frames", f"{self._name}: {self.error_frames} error frames{counters}")

    def _look(self, now: int) -> None:
        """State of the controller, where the driver knows it; and the end of a spell of errors."""
        if self._has_state and self._bus is not None:
            try:
                state = self._bus.state
            except Exception as error:
                self._set(named(error), f"{self._name}: {error}")
                return
            if state is can.BusState.ERROR:
                self._set("bus-off", self._name)
            elif self._ledger.has("bus-off") and not self.error_frames:
                self._clear("bus-off")
        if now - self._erred_ns > _QUIET_NS:
            self._clear("error-frames", "error-passive", "overrun")


def _only_this_group(bus: Any) -> None:
    """A socket bound to a port hears every group that anybody on this computer has joined, unless it is told not to (ip(7), IP_MULTICAST_ALL)."""
    with suppress(AttributeError, OSError):
        multicast = bus._multicast
        if multicast.ip_version == 4:
            multicast._socket.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        else:
            multicast._socket.setsockopt(socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL, 0)


def _why(interface: str, channel: str, error: Exception) -> str:
    name = f"{interface} {channel}"
    text = str(error) or type(error).__name__
    if "msgpack" in text:
        return f"{name}: python-can's udp_multicast needs the package msgpack: pip install msgpack"
    if "Unknown interface" in text or isinstance(error, NotImplementedError):
        return f"{name}: python-can cannot use this interface here: {text}"
    if interface == "socketcan" and ("No such device" in text or getattr(error, "errno", 0) == 19):
        return f"{name}: no such interface; `ip link` lists them, and `ip link set {channel} up type can bitrate 1000000` brings one up"
    if "Address family not supported" in text:
        return f"{name}: this kernel has no CAN sockets; load the module: sudo modprobe can_raw"
    return f"{name}: cannot be opened: {text}"
