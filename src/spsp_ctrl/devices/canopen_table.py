"""CANopen (CiA 301) and the drive profile CiA 402: the numbers of the protocols. All values are little-endian."""

from __future__ import annotations

from typing import NamedTuple

# identifiers; those with a node number are the base to which it is added
NMT, SYNC, EMCY, TPDO1, RPDO1, TPDO2, RPDO2, SDO_REPLY, SDO_REQUEST, HEARTBEAT = 0x000, 0x080, 0x080, 0x180, 0x200, 0x280, 0x300, 0x580, 0x600, 0x700
MAX_NODE = 127

# NMT commands and the states that a heartbeat reports
NMT_START, NMT_STOP, NMT_PRE_OPERATIONAL, NMT_RESET_NODE, NMT_RESET_COMMUNICATION = 1, 2, 128, 129, 130
BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0, 4, 5, 127

# SDO command bytes
SDO_READ, SDO_WRITTEN, SDO_ABORT, SDO_READ_SEGMENT = 0x40, 0x60, 0x80, 0x60
SDO_WRITE_SIZED, SDO_READ_SIZED = 0x23, 0x43
"""Expedited with size: bits 2 and 3 count the unused bytes of four."""
SDO_READ_LONG = 0x41
"""Answer to a read that does not fit into four bytes: the size, then segments."""

# abort codes
TOGGLE_WRONG, COMMAND_UNKNOWN, WRITE_ONLY, READ_ONLY, NO_OBJECT = 0x05030000, 0x05040001, 0x06010001, 0x06010002, 0x06020000
NOT_MAPPABLE, PDO_TOO_LONG, WRONG_LENGTH, NO_SUBINDEX, OUT_OF_RANGE = 0x06040041, 0x06040042, 0x06070010, 0x06090011, 0x06090030
WRONG_STATE = 0x08000022
ABORT_TEXT = {
    TOGGLE_WRONG: "toggle bit not alternated",
    COMMAND_UNKNOWN: "command unknown",
    WRITE_ONLY: "write-only object read",
    READ_ONLY: "read-only object written",
    NO_OBJECT: "no such object",
    NOT_MAPPABLE: "object cannot be mapped",
    PDO_TOO_LONG: "PDO too long",
    WRONG_LENGTH: "wrong length",
    NO_SUBINDEX: "no such sub-index",
    OUT_OF_RANGE: "value out of range",
    WRONG_STATE: "not in this state",
}

# emergency codes (the high byte is the class) and bits of the error register
EMCY_NONE, EMCY_OVER_CURRENT, EMCY_UNDER_VOLTAGE, EMCY_OVER_TEMPERATURE = 0x0000, 0x2310, 0x3220, 0x4310
EMCY_RESOLVER, EMCY_HEARTBEAT = 0x7300, 0x8130
EMCY_CLASS = {
    0x00: "no error", 0x10: "generic", 0x20: "current", 0x21: "current, input side", 0x22: "current inside the device",
    0x23: "current, output side", 0x30: "voltage", 0x31: "mains voltage", 0x32: "voltage inside the device", 0x33: "output voltage",
    0x40: "temperature", 0x41: "ambient temperature", 0x42: "device temperature", 0x43: "drive temperature", 0x50: "device hardware",
    0x60: "device software", 0x70: "additional modules", 0x73: "sensor", 0x80: "monitoring", 0x81: "communication", 0x82: "protocol",
    0x84: "speed controller", 0x86: "position controller", 0x90: "external", 0xFF: "of the manufacturer",
}  # fmt: skip
ERROR_BITS = {1: "generic", 2: "current", 4: "voltage", 8: "temperature", 16: "communication", 32: "of the profile", 128: "of the manufacturer"}

# objects of CiA 301
DEVICE_TYPE, ERROR_REGISTER, DEVICE_NAME, CONSUMER_HEARTBEAT, PRODUCER_HEARTBEAT, IDENTITY = 0x1000, 0x1001, 0x1008, 0x1016, 0x1017, 0x1018
RPDO_SETTINGS, RPDO_MAPPING, TPDO_SETTINGS, TPDO_MAPPING = 0x1400, 0x1600, 0x1800, 0x1A00
PDO_OFF = 1 << 31
"""Bit of a PDO's identifier that switches it off."""

# objects of CiA 402
COMM_LOSS_REACTION, ERROR_CODE, CONTROLWORD, STATUSWORD, MODE, MODE_DISPLAY = 0x6007, 0x603F, 0x6040, 0x6041, 0x6060, 0x6061
POSITION, VELOCITY, TARGET_TORQUE, RATED_CURRENT, RATED_TORQUE, TORQUE, CURRENT, BUS_VOLTAGE = (
    0x6064, 0x606C, 0x6071, 0x6075, 0x6076, 0x6077, 0x6078, 0x6079,
)  # fmt: skip
TORQUE_OFFSET, INTERPOLATION_PERIOD, TARGET_VELOCITY, SUPPORTED_MODES = 0x60B2, 0x60C2, 0x60FF, 0x6502
CSV, CST = 9, 10
"""Modes of operation: cyclic synchronous velocity and torque."""
MODE_BITS = 1 << (CSV - 1) | 1 << (CST - 1)
DEVICE_TYPE_SERVO = 0x00020192
TEMPERATURES = 0x2002
"""Of the manufacturer: two temperature inputs, signed 16 bit in steps of 1/16 degree."""

# controlword: commands and bits
SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP, FAULT_RESET = 0x0006, 0x0007, 0x000F, 0x0000, 0x0002, 0x0080


class State(NamedTuple):
    """One state of the CiA 402 state machine and how the statusword shows it."""

    name: str
    mask: int
    bits: int


NOT_READY = State("not ready to switch on", 0x4F, 0x00)
SWITCH_ON_DISABLED = State("switch on disabled", 0x4F, 0x40)
READY_TO_SWITCH_ON = State("ready to switch on", 0x6F, 0x21)
SWITCHED_ON = State("switched on", 0x6F, 0x23)
OPERATION_ENABLED = State("operation enabled", 0x6F, 0x27)
QUICK_STOP_ACTIVE = State("quick stop active", 0x6F, 0x07)
FAULT_REACTION = State("fault reaction active", 0x4F, 0x0F)
FAULT = State("fault", 0x4F, 0x08)
STATES = (NOT_READY, SWITCH_ON_DISABLED, READY_TO_SWITCH_ON, SWITCHED_ON, OPERATION_ENABLED, QUICK_STOP_ACTIVE, FAULT_REACTION, FAULT)
VOLTAGE_ENABLED, REMOTE, LIMIT_ACTIVE = 0x10, 0x200, 0x800
"""Further bits of the statusword: the power stage has voltage, the bus commands, a limit acts."""

# what travels in every cycle: status and one command for each mode, 64 bits at the most
STATUS_PDO = ((STATUSWORD, 0, 16), (POSITION, 0, 32), (TORQUE, 0, 16))
SLOW_PDO = ((BUS_VOLTAGE, 0, 32), (ERROR_CODE, 0, 16), (MODE_DISPLAY, 0, 8))
TORQUE_PDO = ((CONTROLWORD, 0, 16), (TARGET_TORQUE, 0, 16))
VELOCITY_PDO = ((CONTROLWORD, 0, 16), (TARGET_VELOCITY, 0, 32), (TORQUE_OFFSET, 0, 16))
STATUS_LAYOUT, SLOW_LAYOUT, TORQUE_LAYOUT, VELOCITY_LAYOUT = "<Hih", "<IHb", "<Hh", "<Hih"
SLOW_EVERY = 10
"""Cycles between two slow PDOs."""
