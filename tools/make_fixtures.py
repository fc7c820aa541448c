"""Make the small logs that the tests replay: ``python -m tools.make_fixtures`` after a change of the law, and read what it prints.

Three short sessions on the virtual rig, each thinned to what a replay reads: measurements, commands with mode and fault, requests, events,
the resolved files. Estimate, reference and terms of the law are left out (NaN), which keeps a log below 300 kB.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments import session
from spsp_ctrl.experiments.session import Plan, Watcher
from spsp_ctrl.messages import Command, OperatorRequest
from spsp_ctrl.recording.reader import LogError, digest_topics, read_log, records
from spsp_ctrl.recording.schema import JSON_TOPICS, TOPICS

ROOT = Path(__file__).resolve().parents[1]
FIXTURES = ROOT / "tests" / "fixtures"
KEPT = ("/measurement", "/control", *JSON_TOPICS)
LEFT_OUT = ("estimate.", "reference.", "pitch.", "roll.", "azimuth.")
HEADING_AT_NS, HEADING_RAD = 600_000_000, 0.2


class _Heading(Watcher):
    """An operator who asks for a heading once."""

    def __init__(self) -> None:
        self.operator = self
        self._asked = False

    def poll(self, now_ns: int) -> tuple[OperatorRequest, ...]:
        """The request, once it is time."""
        if self._asked or now_ns < HEADING_AT_NS:
            return ()
        self._asked = True
        return (OperatorRequest(now_ns, "heading", HEADING_RAD, "fixture"),)


@dataclass(frozen=True)
class Fixture:
    """How one log is made: changes of the swing scenario, and who operates."""

    name: str
    changes: dict[str, Any] = field(default_factory=dict)
    watcher: Callable[[], Watcher | None] = lambda: None


_SOON = {"base": {"axis_order": "roll_pitch", "start_s": 0.2, "ramp_s": 0.5, "pitch": [{"amplitude_deg": 6.0, "period_s": 4.0}],
                  "roll": [{"amplitude_deg": 15.0, "period_s": 8.0}]}}  # fmt: skip
MADE = (
    Fixture("swing", _SOON),
    Fixture("heading", {}, _Heading),
    Fixture("imu-dropout", {**_SOON, "dropouts": [{"at_s": 1.0, "duration_s": 2.0}]}),
)


def make(fixture: Fixture, out: Path, duration_s: float = 1.2) -> None:
    """Run and thin one fixture into the file ``out``."""
    config = ROOT / "config"
    swing = load_scenario(config / "experiments" / "swing-2dof.yaml").model
    scenario = Scenario.model_validate(swing.model_dump(by_alias=True) | fixture.changes | {"duration_s": duration_s, "acceptance": []})
    plan = Plan(load_rig(config / "rig.yaml").model, scenario, config / "model.yaml", 1, False)
    with tempfile.TemporaryDirectory() as folder:
        session.run_session(plan, session.prepare(plan), Path(folder), fixture.watcher())
        thin(Path(folder) / session.LOG_NAME, out)


def thin(log: Path, out: Path) -> None:
    """Copy what a replay reads, the rest of ``/control`` as NaN."""
    dtype = TOPICS["/control"].dtype
    blank = [name for name in dtype.names or () if name.startswith(LEFT_OUT) and dtype[name].kind == "f"]
    schemas: dict[int, int] = {}
    channels: dict[int, tuple[int, str]] = {}
    with out.open("wb") as stream:
        writer = Writer(stream, chunk_size=1 << 24, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start(profile="ros2", library="spsp-ctrl make_fixtures")
        for record in records(log):
            if isinstance(record, Schema):
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.topic in KEPT:
                number = writer.register_channel(record.topic, record.message_encoding, schemas[record.schema_id])
                channels[record.id] = (number, record.topic)
            elif isinstance(record, Message) and record.channel_id in channels:
                number, topic = channels[record.channel_id]
                data = record.data
                if topic == "/control":
                    # in place: a copy of a padded dtype does not keep the header and the padding
                    buffer = bytearray(data)
                    row = np.frombuffer(buffer, dtype)
                    for name in blank:
                        row[name] = np.nan
                    data = bytes(buffer)
                writer.add_message(number, record.log_time, data, record.publish_time, record.sequence)
            elif isinstance(record, Attachment):
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, dict(record.metadata))
        writer.finish()


def compare(before: Path | None, after: Path) -> list[str]:
    """What changed, in words."""
    law = read_log(after).metadata["run"]["law_digest"]
    size = f"{after.stat().st_size / 1e3:.0f} kB, law {law}"
    if before is None:
        return [f"new, {size}", *(f"  {topic:<13} {digest[:16]}" for topic, digest in digest_topics(after).items())]
    try:
        old_law = read_log(before).metadata["run"]["law_digest"]
    except LogError as error:
        return [f"{size}; the layout of the log has changed, nothing to compare with", f"  {error}"]
    old, new = digest_topics(before), digest_topics(after)
    lines = [size + ("" if law == old_law else f" (was {old_law})")]
    for topic in sorted({*old, *new}):
        a, b = old.get(topic, "absent")[:16], new.get(topic, "absent")[:16]
        lines.append(f"  {topic:<13} " + (f"{a} unchanged" if a == b else f"{a} -> {b}"))
    a_rows, b_rows = (read_log(path).topics["/control"] for path in (before, after))
    if len(a_rows) != len(b_rows):
        lines.append(f"  cycles: {len(a_rows)} -> {len(b_rows)}")
    n = min(len(a_rows), len(b_rows))
    for name in Command._fields[2:]:
        lines += _largest(f"command.{name}", a_rows[:n], b_rows[:n])
    return lines


def _largest(name: str, a: NDArray[Any], b: NDArray[Any]) -> list[str]:
    change = np.abs(b[name].astype(float) - a[name].astype(float))
    if not change.any():
        return []
    k = int(change.argmax())
    return [f"  {name}: largest change {change[k]:.3g} at {a['stamp_ns'][k] * 1e-9:.3f} s ({a[name][k]} -> {b[name][k]})"]


def update(fixture: Fixture, folder: Path) -> list[str]:
    """Make ``fixture`` again in ``folder`` and say what changed."""
    path = folder / f"{fixture.name}.mcap"
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        new = Path(scratch) / path.name
        make(fixture, new)
        lines = compare(path if path.exists() else None, new)
        new.replace(path)
    return lines


@click.command(epilog="Example: python -m tools.make_fixtures")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=FIXTURES, help="Folder of the logs; default tests/fixtures.")
def main(out: Path) -> None:
    """Make the logs that the tests replay and print what changed in them."""
    out.mkdir(parents=True, exist_ok=True)
    for fixture in MADE:
        click.echo(f"{fixture.name}.mcap: " + "\n".join(update(fixture, out)))


if __name__ == "__main__":
    main()
