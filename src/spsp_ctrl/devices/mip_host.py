"""MicroStrain MIP, the host's side: packets out of a byte stream, readings out of packets, commands, and the start-up dialogue."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from itertools import accumulate
from math import isfinite
from typing import NamedTuple

from spsp_ctrl.devices import mip_table as T


class Packet(NamedTuple):
    """One packet whose checksum holds."""

    descriptor_set: int
    fields: tuple[tuple[int, bytes], ...]
    """Descriptor and data of each field."""

    def field(self, descriptor: int) -> bytes | None:
        """Data of the first field of that kind."""
        for number, data in self.fields:
            if number == descriptor:
                return data
        return None


class ImuReading(NamedTuple):
    """One attitude with the rate that belongs to it, in the frame of the unit (NED: x forward, y right, z down)."""

    device_ns: int
    """Time of the device since power-up; -1 when the packet has none."""
    valid: bool
    """The unit says that attitude and rate are valid, and all numbers are finite."""
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    gyro_x_rad_s: float
    gyro_y_rad_s: float
    gyro_z_rad_s: float


class DeviceInfo(NamedTuple):
    """Who answers."""

    firmware: str
    model_name: str
    model_number: str
    serial_number: str


def checksum(data: bytes) -> bytes:
    """Fletcher-16 as MIP defines it: both sums modulo 256, the sum of sums last."""
    sums = list(accumulate(data))
    return bytes(((sums[-1] if sums else 0) & 0xFF, sum(sums) & 0xFF))


class PacketParser:
    """Packets out of a byte stream. A damaged packet costs itself only: the search goes on one byte after its first."""

    def __init__(self) -> None:
        self._held = b""
        self.skipped_bytes = 0
        """Bytes that belong to no packet."""
        self.bad_packets = 0
        """Packets whose checksum or field lengths are wrong."""

    def feed(self, data: bytes) -> list[Packet]:
        """Every packet that is complete now."""
        held = self._held + data
        found: list[Packet] = []
        at = 0
        while True:
            start = held.find(T.SYNC, at)
            if start < 0:
                keep = 1 if held[at:].endswith(T.SYNC[:1]) else 0
                self.skipped_bytes += len(held) - at - keep
                self._held = held[len(held) - keep :] if keep else b""
                return found
            self.skipped_bytes += start - at
            at = start
            if len(held) < at + T.HEADER_BYTES:
                break
            end = at + T.HEADER_BYTES + held[at + 3]
            fields = _fields(held, at + T.HEADER_BYTES, end)
            if fields is None or (len(held) >= end + T.CHECKSUM_BYTES and checksum(held[at:end]) != held[end : end + T.CHECKSUM_BYTES]):
                self.bad_packets += 1
                self.skipped_bytes += 1
                at += 1
                continue
            if len(held) < end + T.CHECKSUM_BYTES:
                break
            found.append(Packet(held[at + 2], fields))
            at = end + T.CHECKSUM_BYTES
        self._held = held[at:]
        return found


def _fields(held: bytes, at: int, end: int) -> tuple[tuple[int, bytes], ...] | None:
    """Fields from ``at`` to ``end`` as far as they have arrived; None when their lengths do not fill the payload: then it is no packet."""
    if at == end:
        return None
    found, here = [], len(held)
    while at < end and at < here:
        following = at + held[at]
        if following < at + 2 or following > end:
            return None
        if at + 1 < here:
            found.append((held[at + 1], held[at + 2 : following]))
        at = following
    return tuple(found)


_VECTOR, _FLAGGED, _TIME, _GPS = (struct.Struct(layout) for layout in (T.VECTOR, T.FLAGGED_VECTOR, T.TIME_NS, T.GPS_TIME))


def _device_ns(packet: Packet) -> int | None:
    """Time of a filter packet: since power-up, else of GPS week and second (units without the other), -1 for none; None when it is damaged."""
    data = packet.field(T.REFERENCE_TIME)
    if data is not None:
        return int(_TIME.unpack(data)[0]) if len(data) == _TIME.size else None
    data = packet.field(T.FILTER_GPS_TIME)
    if data is None:
        return -1
    if len(data) != _GPS.size:
        return None
    second, week, _ = _GPS.unpack(data)
    return week * T.WEEK_NS + round(second * 1e9) if 0.0 <= second < 604_801.0 else None


class ImuDecoder:
    """Readings out of packets: each attitude of the filter set with the filter's own rate, else with the newest gyro of the sensor set."""

    def __init__(self) -> None:
        self._gyro: tuple[float, float, float] | None = None
        self.unusable = 0
        """Data packets that gave no reading though they should: a field of the wrong length, an attitude without any rate."""

    def decode(self, packets: Iterable[Packet]) -> list[ImuReading]:
        """A reading for every attitude among the packets."""
        found = []
        for packet in packets:
            if packet.descriptor_set == T.SENSOR:
                self._sensor(packet)
            elif packet.descriptor_set == T.FILTER:
                reading = self._filter(packet)
                if reading is not None:
                    found.append(reading)
        return found

    def _sensor(self, packet: Packet) -> None:
        data = packet.field(T.GYRO)
        if data is None:
            return
        if len(data) != _VECTOR.size:
            self.unusable += 1
            return
        self._gyro = _VECTOR.unpack(data)

    def _filter(self, packet: Packet) -> ImuReading | None:
        angles, rate = packet.field(T.EULER), packet.field(T.ANGULAR_RATE)
        if angles is None:
            return None
        device_ns = _device_ns(packet)
        wrong = len(angles) != _FLAGGED.size or (rate is not None and len(rate) != _FLAGGED.size)
        if wrong or device_ns is None or (rate is None and self._gyro is None):
            self.unusable += 1
            return None
        roll, pitch, yaw, flag = _FLAGGED.unpack(angles)
        if rate is not None:
            x, y, z, rate_flag = _FLAGGED.unpack(rate)
        else:
            assert self._gyro is not None
            (x, y, z), rate_flag = self._gyro, 1
        numbers = (roll, pitch, yaw, x, y, z)
        valid = bool(flag & 1) and bool(rate_flag & 1) and all(map(isfinite, numbers))
        return ImuReading(device_ns, valid, *numbers)


def command(descriptor_set: int, descriptor: int, data: bytes = b"") -> bytes:
    """A packet with one command field."""
    body = T.SYNC + bytes((descriptor_set, len(data) + 2, len(data) + 2, descriptor)) + data
    return body + checksum(body)


def ping() -> bytes:
    """Is anybody there?"""
    return command(T.BASE, T.PING)


def set_idle() -> bytes:
    """Stop all streams, so that answers are not lost among data."""
    return command(T.BASE, T.SET_IDLE)


def resume() -> bytes:
    """Stream again."""
    return command(T.BASE, T.RESUME)


def device_info() -> bytes:
    """Ask for model, serial number and firmware."""
    return command(T.BASE, T.DEVICE_INFO)


def base_rate(data_set: int) -> bytes:
    """Ask for the rate that decimations of a data set count from, in Hz."""
    return command(T.CMD_3DM, T.BASE_RATE, bytes((data_set,)))


def message_format(data_set: int, fields: Iterable[tuple[int, int]]) -> bytes:
    """Ask for these fields, each with its decimation of the base rate."""
    items = tuple(fields)
    body = b"".join(struct.pack(">BH", number, decimation) for number, decimation in items)
    return command(T.CMD_3DM, T.MESSAGE_FORMAT, bytes((T.WRITE, data_set, len(items))) + body)


def stream(data_set: int, on: bool) -> bytes:
    """Switch the stream of a data set."""
    return command(T.CMD_3DM, T.STREAM, bytes((T.WRITE, data_set, int(on))))


def acknowledged(packet: Packet) -> tuple[int, int] | None:
    """Command and code of an answer; None when the packet is no answer."""
    data = packet.field(T.REPLY)
    return (data[0], data[1]) if data is not None and len(data) == 2 else None


def read_info(packet: Packet) -> DeviceInfo | None:
    """Who answers, from the answer to ``device_info``."""
    data = packet.field(T.INFO_REPLY)
    if packet.descriptor_set != T.BASE or data is None or len(data) < 50:
        return None
    number = int.from_bytes(data[:2], "big")
    texts = [data[at : at + 16].decode("ascii", "replace").strip(" \0") for at in (2, 18, 34)]
    return DeviceInfo(f"{number // 1000}.{number // 100 % 10}.{number % 100:02d}", *texts)


def read_base_rate(packet: Packet) -> tuple[int, int] | None:
    """Data set and its base rate in Hz, from the answer to ``base_rate``."""
    data = packet.field(T.BASE_RATE_REPLY)
    if packet.descriptor_set != T.CMD_3DM or data is None or len(data) != 3:
        return None
    return data[0], int.from_bytes(data[1:], "big")


class SetUp:
    """Start-up dialogue: idle, who are you, base rate, format, stream on. Time is an argument; nothing waits.

    ``step`` takes what has arrived and returns what to send. It ends with ``done`` or with a text in ``problem``.
    """

    TIMEOUT_NS = 500_000_000
    TRIES = 4

    def __init__(self, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        self._dialogue = self._script()
        self._waiting: tuple[bytes, int, int] | None = None
        self._sent_ns = 0
        self._tries = 0
        self.info: DeviceInfo | None = None
        self.rate_hz = 0.0
        """Rate that the device will stream at: the nearest that its base rate allows."""
        self.done = False
        self.problem = ""

    def _script(self) -> Iterator[tuple[bytes, int, int]]:
        """Commands, each with set and descriptor of its acknowledgement."""
        yield set_idle(), T.BASE, T.SET_IDLE
        yield device_info(), T.BASE, T.DEVICE_INFO
        yield base_rate(T.FILTER), T.CMD_3DM, T.BASE_RATE
        if not self.rate_hz:
            return
        decimation = max(1, round(self.rate_hz / self._rate_hz))
        self.rate_hz /= decimation
        fields = ((T.REFERENCE_TIME, decimation), (T.EULER, decimation), (T.ANGULAR_RATE, decimation))
        yield message_format(T.FILTER, fields), T.CMD_3DM, T.MESSAGE_FORMAT
        yield stream(T.FILTER, True), T.CMD_3DM, T.STREAM
        yield resume(), T.BASE, T.RESUME

    def step(self, now_ns: int, packets: Iterable[Packet]) -> bytes:
        """Go on with what has arrived; the bytes to send now."""
        if self.done or len(self.problem) > 0:
            return b""
        for packet in packets:
            if self._waiting is not None and self._answered(packet, self._waiting):
                self._waiting = None
        if self.problem:
            return b""
        if self._waiting is None:
            self._waiting = next(self._dialogue, None)
            self._tries = 0
            if self._waiting is None:
                self.done = bool(self.rate_hz)
                self.problem = "" if self.done else "the IMU does not say its base rate"
                return b""
        elif now_ns - self._sent_ns < self.TIMEOUT_NS:
            return b""
        self._tries += 1
        if self._tries > self.TRIES:
            self.problem = f"the IMU does not answer command 0x{self._waiting[2]:02X} of set 0x{self._waiting[1]:02X}"
            return b""
        self._sent_ns = now_ns
        return self._waiting[0]

    def _answered(self, packet: Packet, waiting: tuple[bytes, int, int]) -> bool:
        answer = acknowledged(packet)
        if answer is None or packet.descriptor_set != waiting[1] or answer[0] != waiting[2]:
            return False
        if answer[1] != T.ACK_OK:
            self.problem = f"the IMU refuses command 0x{waiting[2]:02X} of set 0x{waiting[1]:02X}: {T.NACK_TEXT.get(answer[1], 'code')} ({answer[1]})"
            return False
        self.info = read_info(packet) or self.info
        rate = read_base_rate(packet)
        if rate is not None and rate[0] == T.FILTER:
            self.rate_hz = float(rate[1])
        return True
