"""``spsp-ctrl log``: look into a log, export or repair it, bring a foreign recording in."""

from __future__ import annotations

import json
from pathlib import Path

import click

from spsp_ctrl.cli.common import EXIT_DATA, JSON, bar, guarded


@click.group()
def log() -> None:
    """Look into a log, export or repair it, bring a foreign recording in."""


LOG = click.argument("path", metavar="LOG", type=click.Path(path_type=Path))


@log.command("info", epilog="Example: spsp-ctrl log info runs/20260101T120000Z/run.mcap")
@LOG
@JSON
@guarded
def log_info(path: Path, as_json: bool) -> None:
    """What is in a log: duration, topics, gaps, whether it is complete. Reads unfinished files too."""
    from spsp_ctrl.recording.logtools import info

    found = info(path)
    click.echo(json.dumps(found.to_dict(), indent=2) if as_json else "\n".join(found.lines()))


FIELDS = click.option("--field", "-f", "fields", multiple=True, help="Only this field, e.g. estimate.platform_pitch_rad.")
TOPIC = click.argument("topic", default="/control")
FORCE = click.option("--force", is_flag=True, help="Replace an existing file.")


@log.command("cat", epilog="Example: spsp-ctrl log cat run.mcap /control -f stamp_ns -f pitch.u_a --limit 5")
@LOG
@TOPIC
@FIELDS
@click.option("--start", default=0.0, metavar="S", help="From this time on.")
@click.option("--end", default=1e12, metavar="S", help="Up to this time.")
@click.option("--limit", default=1000, type=click.IntRange(1), help="At most so many messages (default 1000).")
@guarded
def log_cat(path: Path, topic: str, fields: tuple[str, ...], start: float, end: float, limit: int) -> None:
    """Print messages of one topic as JSON lines."""
    from spsp_ctrl.recording.logtools import cat

    for row in cat(path, topic, fields, start, end, limit):
        click.echo(json.dumps(row))


@log.command("export", epilog="Example: spsp-ctrl log export run.mcap /control --out control.csv")
@LOG
@TOPIC
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="File to write.")
@click.option("--to", "kind", type=click.Choice(["csv", "candump", "asc", "blf"]), default="csv", show_default=True, help="Form of the file.")
@click.option("--bus", help="Which bus, for a bus trace of a log with several.")
@FIELDS
@FORCE
@guarded
def log_export(path: Path, topic: str, out: Path, kind: str, bus: str | None, fields: tuple[str, ...], force: bool) -> None:
    """Write one topic as CSV (units are in the column names), or the raw frames of a bus as a trace: candump, asc, blf."""
    if kind != "csv":
        from spsp_ctrl.recording.traces import export_trace

        if fields or topic != "/control":
            raise click.UsageError("a bus trace has no topic and no fields; leave them away")
        count, name, problem = export_trace(path, bus, kind, out, force=force)
        click.echo(f"{out}: {count} frames of {name}")
        if problem:
            click.echo(f"{path} is not complete ({problem}): only what could be read was written", err=True)
            raise SystemExit(EXIT_DATA)
        return
    from spsp_ctrl.recording.logtools import export_csv

    click.echo(f"{out}: {export_csv(path, topic, out, fields, force=force)} rows")


@log.command("repair", epilog="Example: spsp-ctrl log repair run.mcap --out repaired.mcap")
@LOG
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Finished copy to write.")
@FORCE
@guarded
def log_repair(path: Path, out: Path, force: bool) -> None:
    """Make a finished copy of an unfinished or damaged log with everything that is readable."""
    from spsp_ctrl.recording.logtools import repair

    kept, problem = repair(path, out, force=force)
    click.echo(f"{out}: {kept} messages kept" + (f"; the input was damaged: {problem}" if problem else "; the input was complete"))


@log.command("import", epilog="Example: spsp-ctrl log import bench.csv --map config/import/bench-csv.yaml --out bench.mcap")
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option("--map", "-m", "map_path", metavar="MAP", type=click.Path(path_type=Path), help="Import map: which column is what.")
@click.option("--bus", help="Name of the bus, for a bus trace; its own channel names when absent.")
@click.option("--out", "-o", type=click.Path(path_type=Path), help="Log to write; without it the recording is only judged.")
@FORCE
@JSON
@guarded
def log_import(path: Path, map_path: Path | None, bus: str | None, out: Path | None, force: bool, as_json: bool) -> None:
    """Turn a CSV, MATLAB (.mat) or MDF (.mf4) recording into a log, after checking its time base, units, signs and scaling.

    A bus trace (candump .log, .asc, .blf) needs no map: its frames become the raw topics of a log.
    """
    if map_path is None:
        if path.suffix.lower() not in (".log", ".asc", ".blf"):
            raise click.UsageError("Missing option '--map' / '-m': only a bus trace (.log, .asc, .blf) needs none.")
        if out is None:
            raise click.UsageError("Missing option '--out' / '-o'.")
        from spsp_ctrl.recording.traces import import_trace

        counts = import_trace(path, bus, out, force=force)
        lines = [f"{out}: {count} frames of {name}" for name, count in sorted(counts.items())]
        click.echo(json.dumps({"frames": counts}, indent=2) if as_json else "\n".join(lines))
        return
    from spsp_ctrl.config.loader import load_import_map
    from spsp_ctrl.recording.importing import import_log

    loaded = load_import_map(map_path)
    with bar("writing", as_json) as progress:
        found = import_log(path, loaded, out, force=force, progress=progress)
    click.echo(json.dumps(found.to_dict() | {"written": bool(out) and not found.refused}, indent=2) if as_json else "\n".join(found.lines()))
    for check in found.refused:
        click.echo(f"{path}: {check.channel}: {check.name} = {check.value:.4g}, allowed {check.limit}: {check.text}", err=True)
    if found.refused:
        click.echo("nothing was written" if out else "it would not be taken", err=True)
        raise SystemExit(EXIT_DATA)
    if out and not as_json:
        click.echo(f"{out}: {found.samples} cycles")
