"""``spsp-ctrl run`` and ``spsp-ctrl replay``."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from spsp_ctrl.cli import bringup
from spsp_ctrl.cli.common import CONFIG, EXIT_DATA, EXIT_INTERRUPTED, EXIT_RIG, EXIT_ROW_FAILED, JSON, OVERRIDE, bar, finite, guarded

if TYPE_CHECKING:
    from spsp_ctrl.config.rig import RigConfig
    from spsp_ctrl.config.scenario import Scenario
    from spsp_ctrl.experiments.session import Plan, Watcher


@click.command(epilog="Example: spsp-ctrl run --config config/rig.yaml --fast --duration 20")
@CONFIG
@OVERRIDE
@click.option("--scenario", type=click.Path(path_type=Path), help="Play this scenario instead of the rig file's own.")
@click.option("--duration", type=click.FloatRange(0.1, 86400.0), callback=finite, metavar="S", help="Seconds to run.")
@click.option("--fast", is_flag=True, help="Lock-step, as fast as the computer allows, instead of real time.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Seed of the virtual rig.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Run folder; default runs/<UTC time>.")
@click.option("--strict", is_flag=True, help="Exit with 1 when an acceptance row fails.")
@click.option("--no-screen", is_flag=True, help="No live screen in real time.")
@click.option("--dry-run", is_flag=True, help="Identify and check, print the frames that would be sent, end. Power is never enabled.")
@click.option("--no-enable", is_flag=True, help="Everything runs, but every command is \"off\".")
@click.option("--limit", metavar="SHARE", callback=bringup.share, help="Speeds, accelerations and currents at this share, e.g. 10%.")
@click.option("--yes", is_flag=True, help="On real hardware: do not ask before each stage.")
@JSON
@guarded
def run(
    config: Path,
    overrides: tuple[str, ...],
    scenario: Path | None,
    duration: float | None,
    fast: bool,
    seed: int | None,
    out: Path | None,
    strict: bool,
    no_screen: bool,
    dry_run: bool,
    no_enable: bool,
    limit: float | None,
    yes: bool,
    as_json: bool,
) -> None:
    """Run the controller on the rig and leave a folder that explains the run.

    The folder holds the log (run.mcap), the resolved rig, scenario and model files, summary.json and report.html. Ctrl-C brakes the platform,
    disables the drives and keeps everything recorded.
    """
    plan = bringup.stages(_plan(config, overrides, scenario, duration, seed, real_time=not fast), no_enable, limit, yes or dry_run)
    if dry_run:
        bringup.dry_run(plan, as_json)
        return
    from spsp_ctrl.experiments import session

    say = _progress_line(as_json)
    rig = bringup.never_enabled(session.prepare(plan, say), no_enable)
    bringup.before_power(plan.config, rig, no_enable, limit, yes)
    folder = session.new_folder(out)
    with _watch(plan, fast, as_json or no_screen) as watcher:
        result = session.run_session(plan, rig, folder, watcher, say)

    from spsp_ctrl.report.data import RunData
    from spsp_ctrl.report.run_report import write_report

    attachments = {name: data.decode("utf-8", "replace") for name, data in result.log.attachments.items()}
    data = RunData(result.log.topics, result.log.events, result.log.metadata, attachments)
    lost = result.summary["log"]["lost"]
    if len(result.log.topics["/control"]):
        try:
            write_report(folder / "report.html", data.until(plan.scenario.duration_s), result.summary)
        except OSError as error:  # the run is over and recorded; its table still tells
            with contextlib.suppress(OSError):
                (folder / "report.html").unlink()
            click.echo(f"{folder / 'report.html'}: cannot be written: {error.strerror}", err=True)
    if as_json:
        click.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        from rich.console import Console

        from spsp_ctrl.report.summary_table import print_summary

        print_summary(result.summary, Console(), folder)
    if lost or not result.log.complete:
        problem = result.summary["log"]["problem"] or "the loop was faster than the log writer"
        click.echo(f"{folder / 'run.mcap'} is not complete: {lost} records lost ({problem})", err=True)
    ended = result.loop.ended
    if ended.startswith(("fault", "stopped: deadline")):
        raise SystemExit(EXIT_RIG)
    if ended == "interrupted":
        raise SystemExit(EXIT_INTERRUPTED)
    if lost or not result.log.complete:
        raise SystemExit(EXIT_DATA)
    if strict and not all(row["pass"] for row in result.summary["acceptance"]):
        raise SystemExit(EXIT_ROW_FAILED)


def _plan(
    path: Path, overrides: tuple[str, ...], scenario: Path | None, duration: float | None, seed: int | None, real_time: bool
) -> Plan:
    """Every file read and judged, before anything moves or is written."""
    from spsp_ctrl.config.loader import ConfigError, ConfigProblem, apply_overrides, load_rig, load_scenario, resolve_reference
    from spsp_ctrl.experiments.checking import check_rig, check_scenario
    from spsp_ctrl.experiments.session import Plan

    loaded = load_rig(path)
    if overrides:
        loaded = apply_overrides(loaded, overrides)
    rig: RigConfig = loaded.model
    scenario_path = scenario or resolve_reference(loaded, ("scenario",))
    model_path = resolve_reference(loaded, ("rig", "model"))
    check_rig(loaded)
    played = load_scenario(scenario_path)
    plan: Scenario = played.model
    if plan.bench or plan.rig or plan.model:
        text = f"this scenario changes the rig or plays on a bench; play it with `spsp-ctrl experiment {scenario_path}`"
        raise ConfigError([ConfigProblem(scenario_path, 0, 0, text)])
    check_scenario(played)
    if duration is not None:
        plan = plan.model_copy(update={"duration_s": duration})
    return Plan(rig, plan, model_path, rig.rig.seed if seed is None else seed, real_time)


def _progress_line(quiet: bool) -> Callable[[str], None]:
    if quiet:
        return lambda text: None
    return lambda text: click.secho(text, err=True, fg="red" if text.startswith("degraded") else None)


@contextlib.contextmanager
def _watch(plan: Plan, fast: bool, quiet: bool) -> Iterator[Watcher | None]:
    """The live screen in real time, a progress bar in lock-step, nothing when nobody looks."""
    from spsp_ctrl.report import watching

    if quiet:
        yield None
    elif fast:
        with watching.progress_bar(plan.scenario.duration_s) as watcher:
            yield watcher
    else:
        with watching.live_screen(plan.config, plan.scenario) as watcher:
            yield watcher


@click.command(epilog="Example: spsp-ctrl replay runs/20260101T120000Z/run.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--config", "-c", type=click.Path(path_type=Path), help="Rig file to use instead of the recorded one.")
@OVERRIDE
@click.option(
    "--from",
    "source",
    type=click.Choice(["measurements", "raw"]),
    default="measurements",
    show_default=True,
    help="Recorded measurements through the law, or recorded frames and bytes through the decoders.",
)
@JSON
@guarded
def replay(log: Path, config: Path | None, overrides: tuple[str, ...], source: str, as_json: bool) -> None:
    """Feed the recorded inputs of a run to the law again and compare its commands bit for bit.

    With `--from raw` the recorded frames and bytes of a rig on buses go through the decoders again, and the measurements are compared.
    """
    if source == "raw":
        _replay_raw(log, config is not None or bool(overrides), as_json)
        return
    from spsp_ctrl.experiments.replaying import replay_log

    with bar("replaying", as_json) as advance:
        result = replay_log(log, config, overrides, advance)
    if as_json:
        click.echo(json.dumps(result.to_dict(), indent=2))
    else:
        how = "bit for bit" if result.exact else "to 1e-9 (the log comes from another build of the law)"
        click.echo(f"{result.cycles} cycles, {result.active_cycles} of them ACTIVE, compared {how}")
        click.echo(f"{result.differing_cycles} cycles differ" if result.first else "0 differences")
        if result.first:
            click.echo(str(result.first))
    if result.first:
        raise SystemExit(EXIT_ROW_FAILED)
    if result.log_problem:
        click.echo(f"{log} is not complete ({result.log_problem}): only what could be read was compared", err=True)
        raise SystemExit(EXIT_DATA)
    if result.active_cycles == 0:
        click.echo("the run was never ACTIVE: a replay of it proves nothing about the law", err=True)
        raise SystemExit(EXIT_DATA)


def _replay_raw(log: Path, changed: bool, as_json: bool) -> None:
    if changed:
        raise click.UsageError("--from raw decodes with the rig file of the log; leave --config and --set away")
    from spsp_ctrl.experiments.replaying_raw import replay_raw

    with bar("decoding", as_json) as advance:
        result = replay_raw(log, advance)
    if as_json:
        click.echo(json.dumps(result.to_dict(), indent=2))
    else:
        click.echo(f"{result.cycles} cycles, {result.frames} frames and pieces of bytes decoded again, compared bit for bit")
        click.echo(f"{result.differing_cycles} cycles differ" if result.first else "0 differences")
        if result.first:
            click.echo(result.first)
    if result.first:
        raise SystemExit(EXIT_ROW_FAILED)
    if result.log_problem:
        click.echo(f"{log} is not complete ({result.log_problem}): only what could be read was compared", err=True)
        raise SystemExit(EXIT_DATA)
