"""A simulated record as a log that `diagnose` reads, and the replay of its controller from the logged fields."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml

from spsp_ctrl.messages import AxisSample
from spsp_ctrl.recording.axis_writer import AxisLog
from tools.blind_exam.case import Record
from tools.blind_exam.physics import RATE_HZ, Array, Law, cascade

PERIOD_NS = 1_000_000_000 // RATE_HZ


def controller_yaml(law: Law) -> str:
    """The section ``controller:`` of a model file for the cascade that made the commands."""
    section = {
        "kind": "cascade",
        "feedback": "resolver" if law.resolver else "load",
        "kp_1_s": law.kp_1_s,
        "kv": law.kv_a_s_m,
        "feedforward": law.feedforward,
        "limit": law.limit_a,
        "rate_span": 1,
    }
    return yaml.safe_dump(section, sort_keys=False)


def samples(record: Record) -> Iterator[AxisSample]:
    """One message per cycle."""
    inputs = np.column_stack(record.motion.inputs)
    stamps = np.round((np.arange(1, len(inputs) + 1) + record.when) * PERIOD_NS).astype(np.int64).tolist()
    for k, (row, u) in enumerate(zip(record.rows.tolist(), inputs.tolist(), strict=True)):
        if record.lost[k]:
            continue
        yield AxisSample(
            stamp_ns=stamps[k],
            cycle=k,
            enabled=True,
            velocity_mode=False,
            reference_m=u[0],
            reference_m_s=u[1],
            command_a=row[0],
            command_rad_s=0.0,
            current_a=row[1],
            bus_voltage_v=row[6],
            resolver_counts=int(row[2]),
            load_m=row[3],
            load_force_n=u[2],
            load_mass_kg=u[3],
            screw_c=row[7],
            ambient_c=u[5],
        )


def write(path: Path, record: Record, controller: str) -> None:
    """The log, with the motions as events. Nothing in it tells what is hidden."""
    attachments = {"controller.yaml": controller_yaml(record.law)} if controller == "cascade" else {}
    with AxisLog(path, rate_hz=RATE_HZ, controller=controller, attachments=attachments) as log:
        events = dict(record.motion.events)
        waiting = sorted(events)
        for sample in samples(record):
            while waiting and sample.cycle >= waiting[0]:
                log.motion(sample.stamp_ns, events[waiting.pop(0)])
            log.sample(sample)


def replay(law: Law, counts: Array, ruler: Array, reference: Array, reference_rate: Array) -> Array:
    """The commands again, from what was logged."""
    numbers = np.array(law)
    out, position = np.zeros(len(counts)), 0.0
    for k in range(len(counts)):
        out[k], position = cascade(numbers, reference[k], reference_rate[k], counts[k], ruler[k], position, k == 0)
    return out
