"""The fault table: one row for each fault. The supervisor sees only the reaction; the operator sees the text."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Reaction(IntEnum):
    """What a fault does, weakest first."""

    WARNING = 0
    """Said in the log and to the operator; the run goes on."""
    SLOW_STOP = 1
    """Brake to standstill under control, then disable."""
    FREE = 2
    """Disable at once: what would be needed to brake can no longer be trusted."""


class Fault(NamedTuple):
    """One row."""

    number: int
    id: str
    reaction: Reaction
    text: str
    """What happened."""
    check: str
    """Likely causes and what to look at."""


FAULTS: tuple[Fault, ...] = (
    Fault(
        1,
        "imu-stale",
        Reaction.SLOW_STOP,
        "no IMU frame for longer than the loop may coast",
        "IMU cable and supply, its output rate, serial errors; supervisor.imu_timeout_ms",
    ),
    Fault(
        2,
        "resolver-stale",
        Reaction.FREE,
        "no fresh resolver angle",
        "resolver cable, drive status, bus load",
    ),
    Fault(
        3,
        "drive-stale",
        Reaction.FREE,
        "no status from an actuator drive",
        "drive supply, bus termination, node number",
    ),
    Fault(
        4,
        "resolver-fault",
        Reaction.FREE,
        "the resolver converter reports loss of signal, degradation or loss of tracking",
        "resolver cable and excitation (7 V, 10 kHz), connector, speed",
    ),
    Fault(5, "drive-fault", Reaction.FREE, "an actuator drive reports a fault", "fault code of the drive in /measurement"),
    Fault(
        6,
        "not-finite",
        Reaction.FREE,
        "a measurement or a command is not a finite number",
        "the first non-finite value in /measurement; configuration of scalings",
    ),
    Fault(
        7,
        "attitude-lost",
        Reaction.SLOW_STOP,
        "attitude error far beyond what the loop holds",
        "end stops, motion beyond the limits of the rig, gains, a loose IMU; supervisor.tilt_fault_deg",
    ),
    Fault(
        8,
        "align-timeout",
        Reaction.SLOW_STOP,
        "the platform did not reach its reference after arming",
        "reference outside the travel, base motion too large, load; supervisor.align_timeout_s",
    ),
    Fault(
        9,
        "travel-switch",
        Reaction.SLOW_STOP,
        "an azimuth travel switch is pressed",
        "azimuth zero, lost steps, heading demand beyond the range",
    ),
    Fault(
        10,
        "exception",
        Reaction.FREE,
        "the control program failed",
        "the event log has the traceback; please report it",
    ),
    Fault(11, "stop-timeout", Reaction.FREE, "the rig did not come to rest in time", "supervisor.stop_timeout_s, friction, load"),
    Fault(
        12,
        "steps-lost",
        Reaction.WARNING,
        "the azimuth stepper has lost steps: its count is no longer the joint angle",
        "load and friction of azimuth, stepper current and supply, acceleration limit; home azimuth again before trusting its travel",
    ),
)
BY_ID: dict[str, Fault] = {fault.id: fault for fault in FAULTS}
BY_NUMBER: dict[int, Fault] = {fault.number: fault for fault in FAULTS}
