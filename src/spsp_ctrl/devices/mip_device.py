"""MicroStrain MIP, the device's side: an IMU that answers commands and streams what its plant tells it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from spsp_ctrl.devices import mip_table as T


class ImuState(NamedTuple):
    """What the unit senses, in its own frame (NED)."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    gyro_x_rad_s: float
    gyro_y_rad_s: float
    gyro_z_rad_s: float
    accel_x_m_s2: float = 0.0
    accel_y_m_s2: float = 0.0
    accel_z_m_s2: float = -T.GRAVITY_M_S2
    valid: bool = True


@dataclass(frozen=True, slots=True)
class Nameplate:
    """What the unit says about itself; texts of at most 16 characters."""

    model_name: str = "3DM-CV7-AHRS"
    model_number: str = "6286-9905"
    serial_number: str = "6286.000001"
    lot_number: str = ""
    options: str = "5g, 500d/s"
    firmware: int = 1105
    """Version 1.1.05 is 1105."""


def fletcher(data: bytes) -> int:
    """Checksum of a packet: running sum in the high byte, sum of the running sums in the low one."""
    high = low = 0
    for value in data:
        high = (high + value) % 256
        low = (low + high) % 256
    return high << 8 | low


def packet(descriptor_set: int, *fields: tuple[int, bytes]) -> bytes:
    """Fields as one packet."""
    payload = b"".join(bytes((len(data) + 2, number)) + data for number, data in fields)
    body = T.SYNC + bytes((descriptor_set, len(payload))) + payload
    return body + fletcher(body).to_bytes(2, "big")


_FIELDS: dict[int, dict[int, Callable[[ImuState, int], bytes]]] = {
    T.SENSOR: {
        T.ACCEL: lambda s, t: struct.pack(T.VECTOR, *(a / T.GRAVITY_M_S2 for a in (s.accel_x_m_s2, s.accel_y_m_s2, s.accel_z_m_s2))),
        T.GYRO: lambda s, t: struct.pack(T.VECTOR, s.gyro_x_rad_s, s.gyro_y_rad_s, s.gyro_z_rad_s),
        T.REFERENCE_TIME: lambda s, t: struct.pack(T.TIME_NS, t),
    },
    T.FILTER: {
        T.EULER: lambda s, t: struct.pack(T.FLAGGED_VECTOR, s.roll_rad, s.pitch_rad, s.yaw_rad, int(s.valid)),
        T.ANGULAR_RATE: lambda s, t: struct.pack(T.FLAGGED_VECTOR, s.gyro_x_rad_s, s.gyro_y_rad_s, s.gyro_z_rad_s, int(s.valid)),
        T.FILTER_GPS_TIME: lambda s, t: struct.pack(T.GPS_TIME, t % T.WEEK_NS * 1e-9, t // T.WEEK_NS, 1),
        T.FILTER_STATUS: lambda s, t: struct.pack(T.STATUS, T.FILTER_RUNNING[1] if s.valid else 1, 1, 0),
        T.REFERENCE_TIME: lambda s, t: struct.pack(T.TIME_NS, t),
    },
}
"""What each data field holds."""

Format = tuple[tuple[int, int], ...]


class MipImu:
    """A unit on a byte stream: ``receive`` what the host sends, ``sample`` at the base rate. Answers are bytes to send back."""

    def __init__(self, base_rate_hz: int = 500, nameplate: Nameplate | None = None) -> None:
        self._rate = base_rate_hz
        self._plate = nameplate or Nameplate()
        self._held = b""
        self._formats: dict[int, Format] = {T.SENSOR: (), T.FILTER: ()}
        self._on = {T.SENSOR: False, T.FILTER: False}
        self._idle = False
        self._ticks = 0
        self._commands: dict[tuple[int, int], Callable[[bytes], tuple[int, tuple[int, bytes] | None]]] = {
            (T.BASE, T.PING): lambda data: (T.ACK_OK, None),
            (T.BASE, T.SET_IDLE): lambda data: self._set_idle(True),
            (T.BASE, T.RESUME): lambda data: self._set_idle(False),
            (T.BASE, T.DEVICE_INFO): lambda data: (T.ACK_OK, (T.INFO_REPLY, self._info())),
            (T.BASE, T.DESCRIPTORS): lambda data: (T.ACK_OK, (T.DESCRIPTORS_REPLY, self._descriptors())),
            (T.BASE, T.SELF_TEST): lambda data: (T.ACK_OK, (T.SELF_TEST_REPLY, bytes(4))),
            (T.CMD_3DM, T.SENSOR_RATE): lambda data: (T.ACK_OK, (T.SENSOR_RATE_REPLY, self._rate.to_bytes(2, "big"))),
            (T.CMD_3DM, T.FILTER_RATE): lambda data: (T.ACK_OK, (T.FILTER_RATE_REPLY, self._rate.to_bytes(2, "big"))),
            (T.CMD_3DM, T.BASE_RATE): self._base_rate,
            (T.CMD_3DM, T.SENSOR_FORMAT): lambda data: self._format(T.SENSOR, data, T.SENSOR_FORMAT_REPLY, b""),
            (T.CMD_3DM, T.FILTER_FORMAT): lambda data: self._format(T.FILTER, data, T.FILTER_FORMAT_REPLY, b""),
            (T.CMD_3DM, T.MESSAGE_FORMAT): self._any_format,
            (T.CMD_3DM, T.STREAM): self._stream,
            (T.CMD_3DM, T.UART_BAUD): self._baud,
        }

    def receive(self, data: bytes) -> bytes:
        """Answers to every whole command in what has arrived; the rest is kept."""
        self._held += data
        answers = b""
        while (start := self._held.find(T.SYNC)) >= 0:
            self._held = self._held[start:]
            if len(self._held) < T.HEADER_BYTES:
                return answers
            size = T.HEADER_BYTES + self._held[3]
            if self._held[2] not in T.COMMAND_SETS or (len(self._held) > 4 and not 2 <= self._held[4] <= self._held[3]):
                self._held = self._held[1:]
                continue
            if len(self._held) < size + T.CHECKSUM_BYTES:
                return answers
            body = self._held[:size]
            if fletcher(body) != int.from_bytes(self._held[size : size + 2], "big"):
                self._held = self._held[1:]
                continue
            self._held = self._held[size + T.CHECKSUM_BYTES :]
            answers += self._answer(body[2], body[T.HEADER_BYTES :])
        self._held = self._held[-1:]
        return answers

    def sample(self, time_ns: int, state: ImuState) -> bytes:
        """One tick of the base rate: the packets that are due. ``time_ns`` counts from power-up."""
        tick = self._ticks
        self._ticks = tick + 1
        if self._idle:
            return b""
        out = b""
        for data_set, fields in self._formats.items():
            due = [(number, _FIELDS[data_set][number](state, time_ns)) for number, decimation in fields if tick % decimation == 0]
            if self._on[data_set] and due:
                out += packet(data_set, *due)
        return out

    def _answer(self, descriptor_set: int, payload: bytes) -> bytes:
        """One packet with the answers to all fields of a command packet."""
        fields: list[tuple[int, bytes]] = []
        while len(payload) >= 2 and 2 <= payload[0] <= len(payload):
            number, data = payload[1], payload[2 : payload[0]]
            payload = payload[payload[0] :]
            handler = self._commands.get((descriptor_set, number))
            code, extra = handler(data) if handler else (T.NACK_UNKNOWN, None)
            fields.append((T.REPLY, bytes((number, code))))
            if extra is not None:
                fields.append(extra)
        return packet(descriptor_set, *fields) if fields else b""

    def _set_idle(self, idle: bool) -> tuple[int, None]:
        self._idle = idle
        return T.ACK_OK, None

    def _info(self) -> bytes:
        plate = self._plate
        texts = (plate.model_name, plate.model_number, plate.serial_number, plate.lot_number, plate.options)
        return plate.firmware.to_bytes(2, "big") + b"".join(text.encode("ascii", "replace")[:16].rjust(16) for text in texts)

    def _descriptors(self) -> bytes:
        pairs = [*self._commands, *((data_set, number) for data_set, fields in _FIELDS.items() for number in fields)]
        return b"".join(bytes(pair) for pair in pairs)

    def _base_rate(self, data: bytes) -> tuple[int, tuple[int, bytes] | None]:
        if len(data) != 1 or data[0] not in T.DATA_SETS:
            return T.NACK_PARAMETER, None
        return T.ACK_OK, (T.BASE_RATE_REPLY, data + self._rate.to_bytes(2, "big"))

    def _any_format(self, data: bytes) -> tuple[int, tuple[int, bytes] | None]:
        if len(data) < 2 or data[1] not in T.DATA_SETS:
            return T.NACK_PARAMETER, None
        return self._format(data[1], data[:1] + data[2:], T.MESSAGE_FORMAT_REPLY, data[1:2])

    def _format(self, data_set: int, data: bytes, reply: int, head: bytes) -> tuple[int, tuple[int, bytes] | None]:
        if not data:
            return T.NACK_PARAMETER, None
        if data[0] == T.READ:
            items = self._formats[data_set]
            body = b"".join(struct.pack(">BH", number, decimation) for number, decimation in items)
            return T.ACK_OK, (reply, head + bytes((len(items),)) + body)
        if data[0] == T.RESET:
            self._formats[data_set] = ()
        if data[0] in (T.SAVE, T.LOAD, T.RESET):
            return T.ACK_OK, None
        if data[0] != T.WRITE or len(data) < 2 or len(data) != 2 + 3 * data[1]:
            return T.NACK_PARAMETER, None
        wanted = tuple(struct.iter_unpack(">BH", data[2:]))
        size = sum(len(_FIELDS[data_set][n](ImuState(0, 0, 0, 0, 0, 0), 0)) + 2 for n, d in wanted if n in _FIELDS[data_set])
        if any(number not in _FIELDS[data_set] or decimation == 0 for number, decimation in wanted) or size > 255:
            return T.NACK_PARAMETER, None
        self._formats[data_set] = wanted
        return T.ACK_OK, None

    def _stream(self, data: bytes) -> tuple[int, tuple[int, bytes] | None]:
        names = {selector: data_set for data_set, selector in T.STREAM_SELECTOR.items()} | {data_set: data_set for data_set in T.DATA_SETS}
        if len(data) < 2 or data[1] not in names or data[0] not in (T.WRITE, T.READ, T.SAVE, T.LOAD, T.RESET):
            return T.NACK_PARAMETER, None
        data_set = names[data[1]]
        if data[0] == T.READ:
            return T.ACK_OK, (T.STREAM_REPLY, bytes((data[1], int(self._on[data_set]))))
        if data[0] == T.WRITE:
            if len(data) != 3 or data[2] > 1:
                return T.NACK_PARAMETER, None
            self._on[data_set] = bool(data[2])
        return T.ACK_OK, None

    def _baud(self, data: bytes) -> tuple[int, tuple[int, bytes] | None]:
        if not data or data[0] not in (T.WRITE, T.READ):
            return T.NACK_PARAMETER, None
        return T.ACK_OK, (T.UART_BAUD_REPLY, (115200).to_bytes(4, "big")) if data[0] == T.READ else None
