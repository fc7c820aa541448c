"""The fault table: one row for each fault. The supervisor sees only class and reaction; the operator sees the text.

A row says all there is to know of a fault: how long its condition must hold (``debounce_ms``), what is done, what happened and what to check, which
module sees it, within which time of becoming observable it has been named (``limit_ms``, held by ``tools.fault_matrix``) and when it is observable.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class FaultClass(IntEnum):
    """What the supervisor may still do, mildest first."""

    NO_ENTRY = 0
    """A rig that moves goes on; one that stands is not armed."""
    SOFT = 1
    """A moving rig is brought to rest under control."""
    IMMEDIATE = 2
    """A moving rig is braked as hard as its limits allow, or loses power, in the same cycle."""


class Reaction(IntEnum):
    """What a fault does, weakest first."""

    HOLD = 0
    """The last good value is held and the run goes on; it is said in the log and to the operator."""
    SLOW_STOP = 1
    """Brake gently to standstill (a quarter of the acceleration limit), then disable."""
    QUICK_STOP = 2
    """Brake to standstill with the full acceleration limit, then disable."""
    FREE = 3
    """Disable at once: what would be needed to brake can no longer be trusted."""


class Fault(NamedTuple):
    """One row."""

    number: int
    id: str
    reaction: Reaction
    text: str
    """What happened."""
    causes: str
    """Likely reasons, most likely first."""
    check: str
    """What to look at."""
    where: str
    """Module that sees it."""
    debounce_ms: float
    """Its condition must hold for so long; what comes from the rig file is on top."""
    limit_ms: float
    """Cause to safe command, counted from when it is observable."""
    observable: str
    """When it can be seen at all."""

    @property
    def fault_class(self) -> FaultClass:
        """By its reaction."""
        return _CLASS[self.reaction]


_CLASS = {
    Reaction.HOLD: FaultClass.NO_ENTRY,
    Reaction.SLOW_STOP: FaultClass.SOFT,
    Reaction.QUICK_STOP: FaultClass.IMMEDIATE,
    Reaction.FREE: FaultClass.IMMEDIATE,
}
HOLD, SLOW, QUICK, FREE = Reaction.HOLD, Reaction.SLOW_STOP, Reaction.QUICK_STOP, Reaction.FREE
ALWAYS = "always"

# fmt: off
FAULTS: tuple[Fault, ...] = (
    Fault(1, "imu-stale", SLOW, "no IMU frame for longer than the loop may coast",
          "cable, supply, the unit has restarted", "IMU cable and supply, its output rate, serial errors; supervisor.imu_timeout_ms",
          "safety/imu.py", 0, 150, ALWAYS),
    Fault(2, "resolver-stale", FREE, "no fresh resolver angle",
          "bus overloaded, drive restarted, cable", "resolver cable, drive status, bus load; supervisor.signal_timeout_ms",
          "safety/axis.py", 0, 10, ALWAYS),
    Fault(3, "drive-stale", FREE, "no status from an actuator drive",
          "drive without supply, bus broken", "drive supply, bus termination, node number",
          "safety/axis.py", 0, 10, ALWAYS),
    Fault(4, "resolver-fault", FREE, "the resolver converter reports loss of signal, degradation or loss of tracking",
          "broken wire, excitation lost, connector, overspeed", "resolver cable and excitation (7 V, 10 kHz), connector, speed",
          "safety/axis.py", 2, 10, ALWAYS),
    Fault(5, "drive-fault", FREE, "an actuator drive reports a fault",
          "overcurrent, overvoltage, emergency input, internal error", "fault code of the drive in /measurement",
          "safety/axis.py", 0, 5, ALWAYS),
    Fault(6, "not-finite", FREE, "a measurement that the law needs is not a finite number",
          "scaling by zero, a defect of a driver", "the first non-finite value in /measurement; configuration of scalings",
          "safety/axis.py", 0, 20, ALWAYS),
    Fault(7, "attitude-lost", SLOW, "attitude error far beyond what the loop holds",
          "end stop, motion beyond the limits of the rig, slipped coupling, loose IMU",
          "end stops, motion beyond the limits of the rig, gains, a loose IMU; supervisor.tilt_fault_deg",
          "safety/supervisor.py", 0, 10, "the error exceeds supervisor.tilt_fault_deg"),
    Fault(8, "align-timeout", SLOW, "the platform did not reach its reference after arming",
          "reference outside the travel, base motion too large, overload",
          "reference outside the travel, base motion too large, load; supervisor.align_timeout_s",
          "safety/supervisor.py", 0, 10, "supervisor.align_timeout_s has passed"),
    Fault(9, "travel-switch", SLOW, "an azimuth travel switch is pressed",
          "lost steps, wrong zero, heading demand beyond the range, broken wire of the switch",
          "azimuth zero, lost steps, heading demand beyond the range, the switch and its wire",
          "safety/azimuth.py", 10, 150, "always; a steady contact within 30 ms, a flickering one when it is seen twice in a row"),
    Fault(10, "exception", FREE, "the control program failed",
          "a defect of the program", "the event log has the traceback; please report it",
          "runtime/loop.py", 0, 5, ALWAYS),
    Fault(11, "stop-timeout", FREE, "the rig did not come to rest in time",
          "drive does not follow, time too short for the speed", "supervisor.stop_timeout_s, friction, load",
          "safety/supervisor.py", 0, 10, "supervisor.stop_timeout_s has passed"),
    Fault(12, "steps-lost", HOLD, "the azimuth stepper has lost steps: its count is no longer the joint angle",
          "overload, too little current, acceleration too high",
          "load and friction of azimuth, stepper current and supply, acceleration limit; home azimuth again before trusting its travel",
          "safety/steps.py", 0, 250, "a slip of 0.2 deg within 0.1 s, or the vane is passed"),
    Fault(13, "imu-invalid", SLOW, "the IMU calls its own frames invalid, or their numbers, stamps or sequence are impossible",
          "the unit is still starting, disturbed serial line, wrong format set", "IMU status, serial cable and baud rate, message format of the unit",
          "safety/imu.py", 0, 150, ALWAYS),
    Fault(14, "imu-range", SLOW, "an attitude or a rate of the IMU is beyond what this rig can do",
          "garbage on the line, wrong units, the unit is saturated", "IMU message format and units; what was hit",
          "safety/imu.py", 0, 150, "attitude beyond 60 deg or rate beyond 200 deg/s"),
    Fault(15, "imu-gyro", SLOW, "attitude and integrated gyro of the IMU contradict each other",
          "a frozen or offset channel, a restart of its filter, magnetic or acceleration disturbance",
          "IMU filter settings and bias; compare attitude with gyro in /measurement",
          "safety/imu.py", 0, 400, "attitude and integrated gyro part by 20 arcmin within 0.5 s"),
    Fault(16, "imu-noise", SLOW, "the IMU is far noisier than it was",
          "loose mounting, vibration, supply ripple, a defect", "mounting screws, supply, vibration of the carrier",
          "safety/imu.py", 900, 1300, "frame-to-frame contradiction of attitude and gyro above 2 arcmin rms, or gyro steps above 1.5 deg/s rms"),
    Fault(17, "imu-stuck", SLOW, "a channel of the IMU repeats the same number",
          "the unit hangs, its driver repeats an old frame", "power-cycle the IMU; its driver; supervisor.imu_stuck_frames",
          "safety/imu.py", 0, 400, "40 equal gyro frames, or 200 equal attitude frames"),
    Fault(18, "imu-density", SLOW, "too many IMU frames are missing or late",
          "serial line overloaded, wrong output rate, host too slow", "IMU output rate and baud rate, latency timer of the USB adapter",
          "safety/imu.py", 150, 900, "frames are overdue for more than 15 % of the time"),
    Fault(19, "resolver-jump", FREE, "a resolver angle has jumped further than the motor can turn",
          "lost turn, wrong count, slipped coupling, garbage on the bus",
          "resolver cable and coupling; the zero of the actuator before it is armed again (calibration)",
          "safety/axis.py", 0, 12, "the jump is beyond what full current could do (about 120 counts in 1 ms)"),
    Fault(20, "resolver-stuck", FREE, "a resolver repeats the same angle while its motor is told to turn",
          "converter hangs, bus repeats an old frame, motor blocked", "resolver and drive; whether the actuator is free to move",
          "safety/axis.py", 0, 60, "the motor is told to travel more than 0.15 rad (10 LSB and stiction)"),
    Fault(21, "resolver-noise", FREE, "a resolver angle is far noisier than it was",
          "shield, excitation, connector", "shield and connector of the resolver, excitation voltage",
          "safety/axis.py", 0, 150, "steps of more than 25 counts rms that no acceleration explains"),
    Fault(22, "resolver-density", FREE, "too many resolver frames are missing or bad",
          "bus overloaded or disturbed", "bus load and error counters, termination",
          "safety/axis.py", 20, 150, "more than 15 % of the frames are missing"),
    Fault(23, "following-error", FREE, "a motor does not do what its drive was told (limit grows with speed)",
          "blocked, overloaded, torque constant wrong, command does not arrive, slipped coupling",
          "free movement of the actuator, drive mode, current limit, coupling of the resolver",
          "safety/axis.py", 0, 150, "commanded and measured motor travel part by 1.5 rad + 20 ms of speed within 0.1 s"),
    Fault(24, "drive-state", FREE, "a drive is not powered although it was told to be, or the other way round",
          "emergency stop, drive tripped without a code, lost command", "emergency-stop chain, drive status word, bus",
          "safety/axis.py", 20, 50, "the enable command and the status differ"),
    Fault(25, "overcurrent", FREE, "a motor current is beyond its limit",
          "short circuit, wrong current scaling, drive setting", "motor wiring, drive current limit and scaling",
          "safety/axis.py", 3, 20, "the reported current exceeds 1.25 times limits.current_a"),
    Fault(26, "current-error", FREE, "a measured current is not the commanded one",
          "open winding, supply too low for the speed, drive limit, current sensor, command does not arrive",
          "motor wiring, supply, drive limits, current scaling",
          "safety/axis.py", 0, 150, "the difference exceeds 0.75 A in the mean over 20 ms, or 1.5 A rms"),
    Fault(27, "supply", SLOW, "the supply of a drive is outside its range",
          "power supply, braking energy with nowhere to go, wire", "power supply and wiring; supervisor.supply_min_v, supply_max_v",
          "safety/axis.py", 20, 60, "the reported voltage is outside the range"),
    Fault(28, "drive-density", FREE, "too many status frames of a drive are missing",
          "bus overloaded or disturbed", "bus load and error counters, termination",
          "safety/axis.py", 20, 150, "more than 15 % of the frames are missing"),
    Fault(29, "imu-resolver", SLOW, "IMU and resolvers contradict each other through the kinematics",
          "slipped coupling, wrong zero, wrong IMU mounting", "couplings, IMU mounting, zero offsets of the actuators",
          "safety/consistency.py", 0, 400, "innovations of the carrier observer above 1 deg rms over 0.1 s"),
    Fault(30, "rod-travel", QUICK, "a rod runs into the end of its stroke faster than it can brake, or is beyond it",
          "motion beyond the limits of the rig, wrong zero, drive runs away", "zero offset of the actuator, stroke in the rig file, demand",
          "safety/consistency.py", 5, 20, "room to the end is less than the braking distance"),
    Fault(31, "azimuth-stale", SLOW, "no fresh status of the azimuth stepper, or too many missing",
          "cable, supply, bus", "stepper module, cable and supply",
          "safety/azimuth.py", 0, 400, ALWAYS),
    Fault(32, "azimuth-following", SLOW, "the azimuth stepper does not count what it was told",
          "stepper disabled, stop input active, module restarted, command does not arrive",
          "stepper module status, stop inputs, ramp settings; home azimuth again",
          "safety/azimuth.py", 0, 1000, "commanded and counted travel part by 0.5 deg + 60 ms of rate within 1 s, or the count jumps"),
    Fault(33, "switch-implausible", SLOW, "switches of azimuth contradict each other or the count",
          "broken wire, short circuit, wrong zero", "wires of the switches; home azimuth again",
          "safety/azimuth.py", 10, 150, "both travel switches at once"),
    Fault(34, "home-switch", HOLD, "the zero switch is seen where it is not, or not where it is",
          "switch or vane bent or dirty, wire, lost steps", "zero switch, its vane and wire; home azimuth again",
          "safety/azimuth.py", 30, 400, "azimuth is more than 3 deg from zero, or has passed zero"),
    Fault(35, "homing-failed", SLOW, "the zero of azimuth was not found between the travel switches",
          "zero switch without signal, azimuth blocked", "zero switch and travel switches, free movement of azimuth; supervisor.homing_timeout_s",
          "safety/supervisor.py", 0, 10, "both travel switches were reached, or supervisor.homing_timeout_s has passed"),
    Fault(36, "temperature-stale", HOLD, "no fresh temperature; the last one is held",
          "cable, slow bus object lost", "temperature sensors and their bus object",
          "safety/temperature.py", 0, 1600, "it was there before: a rig may have no such sensor"),
    Fault(37, "temperature-jump", HOLD, "a temperature has changed faster than a screw can, or is impossible; the last good one is held",
          "broken or loose sensor", "temperature sensors, connectors",
          "safety/temperature.py", 0, 300, "a step of more than 3 K between two samples, or outside -40 to 120 degC"),
    Fault(38, "overtemperature", SLOW, "a screw is too hot",
          "overload, friction, hot surroundings", "lubrication, load; let it cool down; supervisor.temperature_max_c",
          "safety/temperature.py", 200, 500, "the reading exceeds supervisor.temperature_max_c"),
    Fault(39, "derating", HOLD, "a screw is hot: the current limit is lowered",
          "overload, friction, hot surroundings", "lubrication, load; supervisor.derating_from_c",
          "safety/temperature.py", 0, 300, "the reading exceeds supervisor.derating_from_c"),
    Fault(40, "loop-late", SLOW, "the control loop has left out too many cycles",
          "no real-time priority, another program, power management", "spsp-ctrl latency; what was granted in summary.json; CPU load",
          "safety/judge.py", 0, 100, "more than 20 ms of cycles left out within 0.5 s"),
    Fault(41, "log-backlog", HOLD, "the log writer does not keep up: records are lost",
          "disk full or slow", "free space and speed of the disk; the run is complete up to here",
          "runtime/loop.py", 0, 1000, "the recorder reports lost records"),
    Fault(42, "bus-off", FREE, "the bus controller has switched itself off",
          "short circuit, wrong bit rate, missing termination", "bus wiring, termination, bit rate, error counters",
          "runtime/loop.py", 0, 5, ALWAYS),
    Fault(43, "queue-full", FREE, "commands do not leave the transmit queue",
          "bus overloaded, no other node answers", "bus load, whether the drives are powered, termination",
          "runtime/loop.py", 0, 5, ALWAYS),
    Fault(44, "operator-absent", SLOW, "the operator that this rig needs has not been heard of",
          "ctl or its connection has ended", "the operator's program; supervisor.operator_timeout_s",
          "safety/supervisor.py", 0, 10, "supervisor.operator_timeout_s is set and has passed"),
    Fault(45, "command-not-finite", FREE, "a command would not have been a finite number",
          "a defect of the program, wrong parameters", "rig file; please report it with the log",
          "runtime/cycle.py", 0, 1, ALWAYS),
    Fault(46, "not-referenced", HOLD, "an actuator stands outside its stroke: its zero cannot be right",
          "wrong zero offset, resolver turned while off", "zero offset of the actuator (calibration), stroke in the rig file",
          "safety/consistency.py", 0, 200, "a rod is more than 2 mm beyond its stroke"),
)
# fmt: on
BY_ID: dict[str, Fault] = {fault.id: fault for fault in FAULTS}
BY_NUMBER: dict[int, Fault] = {fault.number: fault for fault in FAULTS}


def graver(a: Fault | None, b: Fault | None) -> Fault | None:
    """The one with the stronger reaction; the first of two alike."""
    if a is None or (b is not None and b.reaction > a.reaction):
        return b
    return a
