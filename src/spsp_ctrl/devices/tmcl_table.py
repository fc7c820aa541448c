"""Trinamic TMCL, direct mode: the numbers of the protocol (TMCM firmware manuals). Values are signed 32 bit, big-endian.

A request on a serial line is ``address, instruction, type, motor, value, sum of the eight bytes``; the answer is ``host, address, status,
instruction, value, sum``. On CAN the first byte is the identifier and the sum is left out.
"""

from __future__ import annotations

REQUEST_LAYOUT, REPLY_LAYOUT = ">BBBBi", ">BBBBi"
BODY_BYTES = 8
SERIAL_BYTES = 9
CAN_BYTES = 7
MODULE, HOST = 1, 2
"""Addresses as delivered."""

ROTATE_RIGHT, ROTATE_LEFT, STOP, MOVE, SET_PARAMETER, GET_PARAMETER = 1, 2, 3, 4, 5, 6
STORE_PARAMETER, RESTORE_PARAMETER, SET_GLOBAL, GET_GLOBAL, REFERENCE_SEARCH, SET_OUTPUT, GET_INPUT = 7, 8, 9, 10, 13, 14, 15
VERSION = 136
MOVE_ABSOLUTE, MOVE_RELATIVE = 0, 1
SEARCH_START, SEARCH_STOP, SEARCH_STATUS = 0, 1, 2
VERSION_TEXT, VERSION_BINARY = 0, 1
ANALOGUE_INPUTS = 1
"""Bank of GIO for analogue inputs."""

OK, WRONG_CHECKSUM, INVALID_COMMAND, WRONG_TYPE, INVALID_VALUE, NOT_AVAILABLE = 100, 1, 2, 3, 4, 6
STATUS_TEXT = {
    OK: "ok",
    101: "command loaded",
    WRONG_CHECKSUM: "wrong checksum",
    INVALID_COMMAND: "invalid command",
    WRONG_TYPE: "wrong type",
    INVALID_VALUE: "invalid value",
    5: "configuration memory locked",
    NOT_AVAILABLE: "command not available",
    9: "maximum exceeded",
}

# axis parameters
TARGET_POSITION, POSITION, TARGET_SPEED, SPEED, MAX_SPEED, MAX_ACCELERATION, MAX_CURRENT, STANDBY_CURRENT = 0, 1, 2, 3, 4, 5, 6, 7
POSITION_REACHED, HOME_SWITCH, RIGHT_SWITCH, LEFT_SWITCH, RIGHT_DISABLE, LEFT_DISABLE = 8, 9, 10, 11, 12, 13
MICROSTEPS, SOFT_STOP, SEARCH_MODE, SEARCH_SPEED, SWITCH_SPEED, SWITCH_DISTANCE, LAST_SWITCH = 140, 149, 193, 194, 195, 196, 197
ERROR_FLAGS, DRIVER_FLAGS = 207, 208
SWITCH_POLARITY = 79
"""Global parameter."""

SEARCH_LEFT, SEARCH_HOME_NEGATIVE, SEARCH_HOME_POSITIVE, SEARCH_OPPOSITE = 1, 7, 8, 64
"""Search modes: left stop switch; home switch in negative or positive direction, stop switches ignored; added to turn the first round."""

CLOCK_HZ = 16_000_000
"""Of the TMC429: there a speed is an internal number, pulses per second = clock * number / (2^divisor * 2048 * 32)."""
