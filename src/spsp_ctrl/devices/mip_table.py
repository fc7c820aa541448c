"""MicroStrain MIP: the numbers of the protocol (3DM-GX5 and 3DM-CV7 data communications manuals). All fields are big-endian."""

from __future__ import annotations

SYNC = b"ue"
HEADER_BYTES = 4
"""Two sync bytes, descriptor set, payload length."""
CHECKSUM_BYTES = 2
MAX_PACKET_BYTES = HEADER_BYTES + 255 + CHECKSUM_BYTES

BASE, CMD_3DM, SENSOR, FILTER = 0x01, 0x0C, 0x80, 0x82
"""Descriptor sets: base commands, 3DM commands, data of the sensors, data of the estimation filter."""
DATA_SETS = (SENSOR, FILTER)
COMMAND_SETS = (BASE, CMD_3DM, 0x0D, 0x7F)
"""Base, 3DM, estimation filter, system."""

REPLY = 0xF1
"""Field of the answer to every command: the command's descriptor and a code."""
ACK_OK, NACK_UNKNOWN, NACK_CHECKSUM, NACK_PARAMETER, NACK_FAILED = 0, 1, 2, 3, 4
NACK_TEXT = {
    NACK_UNKNOWN: "unknown command",
    NACK_CHECKSUM: "checksum invalid",
    NACK_PARAMETER: "parameter invalid",
    NACK_FAILED: "command failed",
    5: "timeout in the device",
}

# base commands, and the field that carries the answer
PING, SET_IDLE, DEVICE_INFO, DESCRIPTORS, SELF_TEST, RESUME, MORE_DESCRIPTORS = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07
INFO_REPLY, DESCRIPTORS_REPLY, SELF_TEST_REPLY, MORE_DESCRIPTORS_REPLY = 0x81, 0x82, 0x83, 0x86

# 3DM commands
SENSOR_RATE, FILTER_RATE, BASE_RATE = 0x06, 0x0B, 0x0E
SENSOR_FORMAT, FILTER_FORMAT, MESSAGE_FORMAT = 0x08, 0x0A, 0x0F
STREAM, UART_BAUD = 0x11, 0x40
SENSOR_RATE_REPLY, FILTER_RATE_REPLY, BASE_RATE_REPLY = 0x83, 0x8A, 0x8E
SENSOR_FORMAT_REPLY, FILTER_FORMAT_REPLY, MESSAGE_FORMAT_REPLY = 0x80, 0x82, 0x8F
STREAM_REPLY, UART_BAUD_REPLY = 0x85, 0x87
STREAM_SELECTOR = {SENSOR: 0x01, FILTER: 0x03}
"""Older devices name the two streams by these numbers, newer ones by the descriptor set."""

WRITE, READ, SAVE, LOAD, RESET = 1, 2, 3, 4, 5
"""Function selectors."""

# data fields of the sensor set
ACCEL, GYRO = 0x04, 0x05
# data fields of the filter set
EULER, ANGULAR_RATE, FILTER_STATUS, FILTER_GPS_TIME = 0x05, 0x0E, 0x10, 0x11
# data fields of every set
REFERENCE_TIME = 0xD5
"""Nanoseconds since power-up, unsigned 64 bit."""

VECTOR, FLAGGED_VECTOR, GPS_TIME, TIME_NS, STATUS = ">3f", ">3fH", ">dHH", ">Q", ">3H"
"""Layouts: gyro (rad/s) or accelerometer (g); Euler angles (roll, pitch, yaw in rad) or rate, with a validity flag; times; status."""
WEEK_NS = 604_800_000_000_000
"""GPS time counts weeks and seconds in the week."""
FILTER_RUNNING = (2, 3, 4)
"""Filter states with a valid attitude: vertical gyro, AHRS, full navigation."""

GRAVITY_M_S2 = 9.80665
"""What the accelerometer field calls 1 g."""
