"""Replay from the bytes: recorded frames and bytes through the decoders, measurements compared bit for bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Schema

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.experiments.replaying import attached
from spsp_ctrl.messages import Control, Measurement
from spsp_ctrl.recording.raw import FRAME_NAME, decode, place
from spsp_ctrl.recording.reader import LogData, LogError, messages, read_log, records
from spsp_ctrl.recording.schema import TOPICS
from spsp_ctrl.rig.base import RigError
from spsp_ctrl.rig.raw import RawEntry
from spsp_ctrl.rig.replaying import ReplayRig


@dataclass(frozen=True, slots=True)
class RawReplay:
    """Outcome."""

    cycles: int
    frames: int
    """Frames and pieces of bytes that had arrived."""
    differing_cycles: int
    first: str
    """The first difference in words; empty when there is none."""
    log_problem: str

    def to_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return asdict(self)


def replay_raw(log: Path, progress: Callable[[int, int], None]) -> RawReplay:
    """Decode ``log`` again. Raises ``LogError`` for one that holds no raw frames or not what its devices said at start-up."""
    data = read_log(log)
    if "devices.json" not in data.attachments:
        raise LogError(f"{log}: cannot be decoded again: it has no attachment devices.json (not a rig on buses, or an older log)")
    for topic in ("/measurement", "/control"):
        if topic not in data.topics or len(data.topics[topic]) == 0:
            raise LogError(f"{log}: cannot be decoded again: no messages on {topic}")
    entries = list(_entries(log))
    if not entries:
        raise LogError(f"{log}: cannot be decoded again: no messages on /raw/...")
    config = attached(data, "rig.yaml", load_rig).model
    facts = _facts(data)
    try:
        rig = ReplayRig(config, facts, entries)
    except (RigError, KeyError, TypeError, ValueError) as error:
        raise LogError(f"{log}: cannot be decoded again: {error}") from None
    arrived = sum(not entry.sent for entry in entries)
    return _compare(rig, data, arrived, progress)


def _facts(data: LogData) -> dict[str, Any]:
    try:
        facts = json.loads(data.attachments["devices.json"])["facts"]
    except (ValueError, KeyError, TypeError):
        raise LogError(f"{data.path}: cannot be decoded again: its attachment devices.json is damaged") from None
    return dict(facts)


def _entries(log: Path) -> list[RawEntry]:
    names: dict[int, str] = {}
    channels: dict[int, tuple[str, bool, bool]] = {}
    found: list[RawEntry] = []
    for record in records(log):
        if isinstance(record, Schema):
            names[record.id] = record.name
        elif isinstance(record, Channel):
            where = place(record.topic)
            if where is not None:
                channels[record.id] = (*where, names.get(record.schema_id) == FRAME_NAME)
        elif isinstance(record, Message) and record.channel_id in channels:
            try:
                entry = decode(*channels[record.channel_id], record.data)
            except ValueError as error:
                raise LogError(f"{log}: a raw message cannot be read ({error})") from None
            found.append(RawEntry(entry.stamp_ns, entry.name, entry.sent, entry.identifier, entry.data, record.sequence))
    return found


def _compare(rig: ReplayRig, data: LogData, arrived: int, progress: Callable[[int, int], None]) -> RawReplay:
    codec = TOPICS["/measurement"]
    measured, controls = data.topics["/measurement"], data.topics["/control"]
    total = min(len(measured), len(controls))
    differing, first = 0, ""
    for k, (was, control) in enumerate(zip(messages(measured, Measurement), messages(controls, Control), strict=False)):
        now = rig.read(was.stamp_ns)
        if codec.encode(now) != codec.encode(was):
            differing += 1
            first = first or _difference(was, now)
        rig.write(control.command, was.stamp_ns)
        if k % 200 == 0:
            progress(k, total)
    return RawReplay(total, arrived, differing, first, data.problem)


def _difference(was: Measurement, now: Measurement) -> str:
    where = f"{was.stamp_ns * 1e-9:.3f} s (cycle {was.cycle})"
    for name in Measurement._fields:
        a, b = getattr(was, name), getattr(now, name)
        for field in getattr(a, "_fields", ("",)):
            x, y = (getattr(a, field), getattr(b, field)) if field else (a, b)
            if x != y:
                return f"first difference at {where} in {name}{field and '.' + field}: recorded {x!r}, decoded {y!r}"
    return f"first difference at {where} in the sign of a zero"
