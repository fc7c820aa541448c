"""Words for what the code names but does not describe: shared message fields, the command row, readings, scratch, exit codes."""

from __future__ import annotations

FIELDS: dict[str, str] = {
    "stamp_ns": "time on the control clock at which the value was valid",
    "seq": "counts the samples of one signal from 0; -1 before the first",
    "cycle": "number of the control cycle; counts on over skipped cycles",
    "ImuSample.stamp_ns": "time on the control clock at which the attitude was valid",
    "Command.stamp_ns": "SYNC at which it was computed; it acts from the next one",
    "Command.seq": "counts commands from 0",
    "/events.level": "how grave it is",
    "/events.id": "`mode`, `skip`, `log-failed`, `law-fallback`, `motion` (the name of the motion that starts, on a single axis), or the id of a fault ([faults](faults.md))",
    "/events.text": "for a person",
}
"""Meaning by ``Class.field`` or, where it is the same everywhere, by ``field``. A docstring in ``messages.py`` comes first."""

TOPIC_WORDS: dict[str, tuple[str, str, str]] = {
    "/measurement": ("every cycle", "yes", "newest sample of each signal, as latched at SYNC: the input of the law"),
    "/control": ("every cycle", "yes", "estimate, reference, every term, the command that was sent: the output of the law"),
    "/timing": ("every cycle", "**no**", "wall-clock quantities of the cycle"),
    "/truth": ("every cycle, virtual rigs only", "yes", "true state; `diagnose` never opens it"),
    "/axis": ("every cycle, logs of a single axis only", "yes", "command, references, readings and known inputs of the axis"),
    "/events": ("when it happens", "yes in lock-step", "mode changes, faults, skipped cycles"),
    "/operator": ("when it happens", "yes in lock-step", "requests as the loop took them: an input of the law"),
}
"""Rate, byte-identical for a seed, content."""

INNER: dict[str, tuple[str, str]] = {
    "enable": ("1", "non-zero: drives and stepper are powered"),
    "pitch_velocity": ("1", "non-zero: the pitch drive follows the speed, else the current"),
    "pitch_current": ("A", "current (torque mode) or feed-forward current (velocity mode)"),
    "pitch_speed": ("rad/s", "motor speed (velocity mode)"),
    "roll_velocity": ("1", "the same for the roll drive"),
    "roll_current": ("A", "the same for the roll drive"),
    "roll_speed": ("rad/s", "the same for the roll drive"),
    "azimuth_rate": ("rad/s", "rate of the azimuth joint, ramped by the stepper driver"),
}

RIG_OUTPUTS: dict[str, tuple[str, str]] = {
    "counts_pitch": ("counts", "resolver of the pitch motor, with its errors"),
    "counts_roll": ("counts", "resolver of the roll motor"),
    "measured_current_pitch": ("A", "reported motor current"),
    "measured_current_roll": ("A", "reported motor current"),
    "bus_voltage_pitch": ("V", "reported supply"),
    "bus_voltage_roll": ("V", "reported supply"),
    "microsteps": ("microsteps", "step counter of the stepper driver"),
    "microstep_rate": ("microsteps/s", "its rate"),
    "left_switch": ("1", "travel switch, positive end"),
    "right_switch": ("1", "travel switch, negative end"),
    "home_switch": ("1", "photoelectric zero"),
    "column_c": ("°C", "column temperature (quantised by the rig)"),
    "frame_c": ("°C", "frame temperature (quantised by the rig)"),
    "imu_roll": ("rad", "IMU Euler roll, IMU sign; new at the IMU rate, held between"),
    "imu_pitch": ("rad", "IMU Euler pitch"),
    "imu_yaw": ("rad", "IMU Euler yaw"),
    "gyro_x": ("rad/s", "gyro, IMU axes"),
    "gyro_y": ("rad/s", "gyro, IMU axes"),
    "gyro_z": ("rad/s", "gyro, IMU axes"),
    "encoder_pitch": ("rad", "swing-table encoder, 20 bit"),
    "encoder_roll": ("rad", "swing-table encoder, 20 bit"),
    "encoder_yaw": ("rad", "swing-table encoder, 20 bit"),
}

WORKING: dict[str, tuple[str, str]] = {
    "height": ("m", "column height with its error and its expansion"),
    "upper": ("m", "hinge radius of the moving platform, likewise"),
    "lower": ("m", "hinge radius of the static platform, likewise"),
    "level": ("m", "nominal rod length at level, from which travel counts"),
    "ixx": ("kg m²", "inertia about the U joint, plate and load"),
    "iyy": ("kg m²", "likewise"),
    "izz": ("kg m²", "likewise"),
    "ixy": ("kg m²", "product of inertia of the load"),
    "ixz": ("kg m²", "likewise"),
    "iyz": ("kg m²", "likewise"),
    "mcx": ("kg m", "mass times centre of gravity"),
    "mcy": ("kg m", "likewise"),
    "mcz": ("kg m", "likewise"),
}

REACTIONS: dict[str, str] = {
    "WARNING": "Say it in the log and to the operator; the run goes on.",
    "SLOW_STOP": "Brake to standstill under control, then disable.",
    "FREE": "Disable at once: what would be needed to brake can no longer be trusted.",
}

EXIT_WORDS: dict[int, str] = {
    0: "done",
    1: "an acceptance row failed (`run --strict`), or a replay differs",
    2: "the user's input is wrong: an option, a file that is missing, a value out of range. One line says what, where and what to do",
    3: "the rig has a fault, or could not be opened",
    4: "data is not understood: not a log, another layout, a run that was never ACTIVE",
    5: "a defect of the program; please report it with the lines printed",
    130: "interrupted by Ctrl-C; the run was ended under control and what was recorded is kept",
}
