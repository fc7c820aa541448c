"""CiA 406, encoders on CANopen: what they add to the numbers of CANopen. The status word is that of a resolver-to-digital converter."""

from __future__ import annotations

DEVICE_TYPE = 0x00010196
"""Profile 406, absolute multi-turn encoder."""

OPERATING, UNITS_PER_TURN, TOTAL_RANGE, PRESET, POSITION, SPEED, CYCLE_TIMER = 0x6000, 0x6001, 0x6002, 0x6003, 0x6004, 0x6030, 0x6200
OPERATING_STATUS, SINGLE_TURN, TURNS, OFFSET = 0x6500, 0x6501, 0x6502, 0x6509
CONVERTER_STATUS = 0x2001
"""Of the manufacturer: fault bits of the converter."""

ANGLE_PDO = ((POSITION, 0, 32), (SPEED, 1, 16), (CONVERTER_STATUS, 0, 16))
"""Mapping of the AXRES resolver module (manual, example of a PDO): exactly 64 bits."""
ANGLE_LAYOUT = "<IhH"

LOSS_OF_SIGNAL, DEGRADATION, LOSS_OF_TRACKING = 1, 2, 4
"""AD2S1210: LOS, DOS, LOT."""
CONVERTER_FAULTS = LOSS_OF_SIGNAL | DEGRADATION | LOSS_OF_TRACKING
