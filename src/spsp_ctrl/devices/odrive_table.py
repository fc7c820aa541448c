"""ODrive CANSimple: the numbers of the protocol (firmware 0.6). Identifier = node * 32 + command; values are little-endian."""

from __future__ import annotations

COMMAND_BITS = 5
MAX_NODE = 62

VERSION, HEARTBEAT, ESTOP, ERRORS, SET_STATE, ESTIMATES, SET_MODE = 0x00, 0x01, 0x02, 0x03, 0x07, 0x09, 0x0B
INPUT_VELOCITY, INPUT_TORQUE, CURRENTS, TEMPERATURES, BUS, CLEAR_ERRORS, TORQUES = 0x0D, 0x0E, 0x14, 0x15, 0x17, 0x18, 0x1C
QUERIES = (VERSION, ERRORS, ESTIMATES, CURRENTS, TEMPERATURES, BUS, TORQUES)
"""What is answered on a remote frame; a frame without data stands for one here."""
REMOTE = 1 << 30
"""Flag of an identifier that makes it a remote frame on a real bus (as SocketCAN has it)."""

HEARTBEAT_LAYOUT, TWO_FLOATS, ONE_FLOAT, TWO_WORDS, ONE_WORD, VERSION_LAYOUT = "<IBBBx", "<ff", "<f", "<II", "<I", "<8B"

IDLE, CLOSED_LOOP = 1, 8
"""Axis states."""
TORQUE_CONTROL, VELOCITY_CONTROL = 1, 2
"""Control modes."""
PASSTHROUGH = 1
"""Input mode: the input is the set-point."""

INITIALIZING, SYSTEM_LEVEL, TIMING, MISSING_ESTIMATE, BAD_CONFIG, DRIVE_FAULT, MISSING_INPUT = 1, 2, 4, 8, 16, 32, 64
WATCHDOG, ESTOP_REQUESTED = 1 << 24, 1 << 25
ERROR_TEXT = {
    INITIALIZING: "initialising", SYSTEM_LEVEL: "system level", TIMING: "timing", MISSING_ESTIMATE: "missing estimate",
    BAD_CONFIG: "bad configuration", DRIVE_FAULT: "gate driver fault", MISSING_INPUT: "missing input",
    1 << 8: "bus over-voltage", 1 << 9: "bus under-voltage",
    1 << 10: "bus over-current", 1 << 11: "regeneration over-current", 1 << 12: "current limit", 1 << 13: "motor over-temperature",
    1 << 14: "inverter over-temperature", 1 << 15: "velocity limit", 1 << 16: "position limit", WATCHDOG: "watchdog expired",
    ESTOP_REQUESTED: "emergency stop requested", 1 << 26: "spin-out", 1 << 27: "brake resistor disarmed", 1 << 28: "thermistor disconnected",
    1 << 30: "calibration",
}  # fmt: skip
