"""The gate of a platform log: numbers, time, units, and the law replayed from its recorded inputs before the plant is blamed."""

from __future__ import annotations

from collections import defaultdict
from math import degrees

import numpy as np

from spsp_ctrl.discrepancy.gate import MOST_LOST, MOST_SKEW, REPLAYED, Gate, slope
from spsp_ctrl.discrepancy.platform_records import PlatformRecord
from spsp_ctrl.discrepancy.platform_replica import AXES, PlatformReplica
from spsp_ctrl.discrepancy.statistics import rms
from spsp_ctrl.messages import Measurement, Mode, OperatorRequest
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.recording.reader import messages
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.identity import law_digest

COMMANDS = ("pitch_current_a", "roll_current_a", "azimuth_rate_rad_s")
FAR_RAD = 0.05
"""An attitude that model and base encoders miss by more is not a matter of calibration."""


def judge_values(record: PlatformRecord) -> Gate:
    """Numbers, time base, modes of the drives: what must hold before anything is computed from a log."""
    gate = Gate()
    for name in record.measured.dtype.names or ():
        values = record.data.topics["/measurement"][name]
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            bad = np.flatnonzero(~np.isfinite(values))
            where = int(record.data.topics["/measurement"]["cycle"][bad[0]])
            gate.problems.append(f"{name} is not a number in {len(bad)} cycles, first in cycle {where}")
    if gate.problems:
        return gate
    _time(gate, record)
    for axis in AXES:
        if getattr(record.config, f"{axis}_actuator").mode == "velocity":
            gate.problems.append(f"the {axis} drive was in velocity mode: a diagnosis of its own speed loop is not built yet")
    if (record.column("base.seq") < 0).any():
        gate.problems.append("/base is lacking: without encoders of the carrier the attitude cannot be told from its motion")
    if (record.column("temperature.seq") < 0).any():
        gate.remarks.append("no temperatures yet at the start: the first one is taken there")
    for axis in AXES:
        current, command = record.column(f"drive_{axis}.current_a"), np.asarray(record.control[f"command.{axis}_current_a"], np.float64)
        if np.ptp(current) == 0.0:
            gate.problems.append(f"drive_{axis}.current_a never changes: the channel is lacking")
        elif np.ptp(command) > 0.0 and not 0.2 < (ratio := slope(command[:-1], current[1:])) < 5.0:
            gate.problems.append(f"drive_{axis}.current_a against its command: a ratio of {ratio:.4g} where 1 was expected; unit or sign is wrong")
        if np.ptp(record.column(f"resolver_{axis}.counts")) == 0.0:
            gate.problems.append(f"resolver_{axis}.counts never changes: the channel is lacking")
    return gate


def _time(gate: Gate, record: PlatformRecord) -> None:
    cycles, stamps = record.measured["cycle"], record.measured["stamp_ns"]
    steps, times = np.diff(cycles), np.diff(stamps)
    if (steps <= 0).any() or (times <= 0).any():
        gate.problems.append(f"time runs backwards after cycle {int(cycles[int(np.flatnonzero((steps <= 0) | (times <= 0))[0])])}")
        return
    gate.lost = int(np.sum(steps - 1))
    if gate.lost > MOST_LOST * len(cycles):
        gate.problems.append(f"{gate.lost} of {len(cycles)} cycles are missing")
    elif gate.lost:
        gate.remarks.append(f"{gate.lost} cycles are missing: they were filled with the sample before")
    skew = float(np.median(times / steps)) * 1e-9 * record.rate_hz - 1.0
    if abs(skew) > MOST_SKEW:
        gate.problems.append(f"the stamps say {record.rate_hz / (1.0 + skew):.6g} Hz, the rig file {record.rate_hz:g} Hz")
    elif abs(skew) > 2e-5:
        gate.remarks.append(f"clock skew: the stamps run {skew * 1e6:.0f} ppm off the stated rate")


def replayed(record: PlatformRecord) -> tuple[float, int, bool]:
    """Run the law of this program on the recorded inputs: share of the commands that it misses, ACTIVE cycles, and whether the log has this law."""
    data, config = record.data, record.config
    by_stamp: defaultdict[int, list[OperatorRequest]] = defaultdict(list)
    for r in data.operator:
        by_stamp[int(r["stamp_ns"])].append(OperatorRequest(int(r["stamp_ns"]), str(r["verb"]), float(r["value"]), str(r["source"])))
    controller, state = cycle.controller(config), cycle.start(config, record.scenario.reference)
    last_ns = -round(1e9 / config.rate_hz)
    rows = min(len(data.topics["/measurement"]), len(data.topics["/control"]))
    again, active = np.zeros((rows, len(COMMANDS))), 0
    for k, m in enumerate(messages(data.topics["/measurement"][:rows], Measurement)):
        control, state = cycle.step(state, controller, m, tuple(by_stamp.pop(m.stamp_ns, ())), m.stamp_ns, (m.stamp_ns - last_ns) * 1e-9)
        last_ns = m.stamp_ns
        c = control.command
        again[k] = c.pitch_current_a, c.roll_current_a, c.azimuth_rate_rad_s
    told = data.topics["/control"][:rows]
    active = int(np.sum(told["mode"] == int(Mode.ACTIVE)))
    worst = 0.0
    for j, name in enumerate(COMMANDS):
        recorded = np.asarray(told[f"command.{name}"], np.float64)
        level = rms(recorded)
        if level > 0.0 or rms(again[:, j]) > 0.0:
            worst = max(worst, rms(again[:, j] - recorded) / max(level, 1e-12))
    same = data.metadata.get("run", {}).get("law_digest", "") == law_digest()
    return worst, active, same


def judge_law(gate: Gate, result: tuple[float, int, bool]) -> None:
    """What the replay says."""
    share, active, same = result
    gate.controller_replay = share
    if active == 0:
        gate.problems.append("the law was never ACTIVE")
    if share > REPLAYED:
        how = "" if same else "; the log comes from another build of the law"
        gate.problems.append(
            f"the law does not give the recorded commands from the recorded inputs: {share:.1%} of one is left{how}; "
            "unit, gain or input is wrong, so the plant is not judged"
        )
    elif not same:
        gate.remarks.append("the log comes from another build of the law; it replays all the same")


def judge_attitude(gate: Gate, one: PlatformReplica, residuals: dict[str, Array]) -> None:
    """Base, rods and IMU must belong together."""
    for channel, base in (("imu.pitch", "pitch"), ("imu.roll", "roll"), ("imu.heading", "yaw")):
        left = residuals[channel]
        angle = np.interp(one.frames, np.arange(len(one.inputs)), np.unwrap(one.record.column(f"base.{base}_rad")))
        if rms(left) > FAR_RAD and np.ptp(angle) > FAR_RAD:
            gate.problems.append(
                f"{channel} and base.{base}_rad do not belong together: {degrees(rms(left)):.3g} deg are left "
                f"(ratio of what is left to the base {slope(angle, left):.3g}); unit, sign or order of the axes is wrong"
            )


