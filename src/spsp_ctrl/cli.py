"""The command line. Each command imports what it needs when it runs, so that ``--help`` answers at once."""

from __future__ import annotations

import contextlib
import functools
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from spsp_ctrl import __version__

if TYPE_CHECKING:
    from spsp_ctrl.config.rig import RigConfig
    from spsp_ctrl.config.scenario import Scenario
    from spsp_ctrl.experiments.session import Plan, Watcher

EXIT_ROW_FAILED, EXIT_USER, EXIT_RIG, EXIT_DATA, EXIT_INTERNAL, EXIT_INTERRUPTED = 1, 2, 3, 4, 5, 130
EXIT_CODES = """\b
Exit codes: 0 ok, 1 acceptance row failed or replay differs, 2 wrong input,
3 rig fault, 4 data not understood, 5 internal error, 130 interrupted."""

F = TypeVar("F", bound=Callable[..., Any])


def _guarded(function: F) -> F:
    """A user's mistake ends in clear lines and a documented exit code, never in a traceback."""

    @functools.wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except (click.exceptions.Exit, click.ClickException, click.Abort):
            raise
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            raise SystemExit(EXIT_INTERRUPTED) from None
        except BrokenPipeError:
            # the reader of our output has gone (for instance `| head`): nothing to complain about
            with contextlib.suppress(OSError):
                sys.stdout.close()
            raise SystemExit(0) from None
        except Exception as error:
            code = _user_exit_code(error)
            if code is None:
                raise
            click.echo(str(error), err=True)
            raise SystemExit(code) from None

    return cast("F", wrapper)


def _user_exit_code(error: Exception) -> int | None:
    from spsp_ctrl.config.loader import ConfigError
    from spsp_ctrl.rig.base import RigError

    if isinstance(error, ConfigError):
        return EXIT_USER
    if isinstance(error, RigError):
        return EXIT_RIG
    if type(error).__name__ == "LogError":
        return EXIT_DATA
    if isinstance(error, FileNotFoundError | FileExistsError | IsADirectoryError | NotADirectoryError | PermissionError):
        return EXIT_USER
    return None


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=EXIT_CODES,
)
@click.version_option(__version__, prog_name="spsp-ctrl")
def cli() -> None:
    """Real-time stabilisation controller for a three-axis series-parallel platform.

    \b
    First run, no hardware:   spsp-ctrl run --config config/rig.yaml
    Explain it afterwards:    open runs/<time>/report.html
    Check the law on its log: spsp-ctrl replay runs/<time>/run.mcap
    """


OVERRIDE = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one value of the rig file, e.g. control.law=paper_cascade. May be repeated.",
)
CONFIG = click.option(
    "--config", "-c", required=True, type=click.Path(path_type=Path), help="Rig file, e.g. config/rig.yaml."
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")


@cli.command(epilog="Example: spsp-ctrl run --config config/rig.yaml --fast --duration 20")
@CONFIG
@OVERRIDE
@click.option("--scenario", type=click.Path(path_type=Path), help="Play this scenario instead of the rig file's own.")
@click.option("--duration", type=click.FloatRange(0.1, 86400.0), metavar="S", help="Seconds to run.")
@click.option("--fast", is_flag=True, help="Lock-step, as fast as the computer allows, instead of real time.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Seed of the virtual rig.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Run folder; default runs/<UTC time>.")
@click.option("--strict", is_flag=True, help="Exit with 1 when an acceptance row fails.")
@click.option("--no-screen", is_flag=True, help="No live screen in real time.")
@JSON
@_guarded
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
    as_json: bool,
) -> None:
    """Run the controller on the rig and leave a folder that explains the run.

    The folder holds the log (run.mcap), the resolved rig, scenario and model files, summary.json and report.html. Ctrl-C brakes the platform,
    disables the drives and keeps everything recorded.
    """
    plan = _plan(config, overrides, scenario, duration, seed, real_time=not fast)
    from spsp_ctrl.experiments import session

    say = _progress_line(as_json)
    say("preparing the rig (the first start compiles the plant, about 10 s) ...")
    rig = session.prepare(plan)
    folder = session.new_folder(out)
    with _watch(plan, fast, as_json or no_screen) as watcher:
        result = session.run_session(plan, rig, folder, watcher, say)

    from spsp_ctrl.report.data import RunData
    from spsp_ctrl.report.run_report import write_report

    attachments = {name: data.decode("utf-8", "replace") for name, data in result.log.attachments.items()}
    data = RunData(result.log.topics, result.log.events, result.log.metadata, attachments)
    write_report(folder / "report.html", data.until(plan.scenario.duration_s), result.summary)
    if as_json:
        click.echo(json.dumps(result.summary, indent=2, allow_nan=False))
    else:
        from rich.console import Console

        from spsp_ctrl.report.summary_table import print_summary

        print_summary(result.summary, Console(), folder)
    ended = result.loop.ended
    if ended.startswith("fault"):
        raise SystemExit(EXIT_RIG)
    if ended == "interrupted":
        raise SystemExit(EXIT_INTERRUPTED)
    if strict and not all(row["pass"] for row in result.summary["acceptance"]):
        raise SystemExit(EXIT_ROW_FAILED)


def _plan(
    path: Path, overrides: tuple[str, ...], scenario: Path | None, duration: float | None, seed: int | None, real_time: bool
) -> Plan:
    """Every file read and judged, before anything moves or is written."""
    from spsp_ctrl.config.loader import apply_overrides, load_rig, load_scenario, resolve_reference
    from spsp_ctrl.experiments.session import Plan

    loaded = load_rig(path)
    if overrides:
        loaded = apply_overrides(loaded, overrides)
    rig: RigConfig = loaded.model
    scenario_path = scenario or resolve_reference(loaded, ("scenario",))
    model_path = resolve_reference(loaded, ("rig", "model"))
    plan: Scenario = load_scenario(scenario_path).model
    if duration is not None:
        plan = plan.model_copy(update={"duration_s": duration})
    return Plan(rig, plan, model_path, rig.rig.seed if seed is None else seed, real_time)


def _progress_line(quiet: bool) -> Callable[[str], None]:
    if quiet:
        return lambda text: None
    return lambda text: click.echo(text, err=True)


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


@cli.command(epilog="Example: spsp-ctrl replay runs/20260101T120000Z/run.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--config", "-c", type=click.Path(path_type=Path), help="Rig file to use instead of the recorded one.")
@OVERRIDE
@JSON
@_guarded
def replay(log: Path, config: Path | None, overrides: tuple[str, ...], as_json: bool) -> None:
    """Feed the recorded inputs of a run to the law again and compare its commands bit for bit."""
    from spsp_ctrl.experiments.replaying import replay_log

    with _bar("replaying", as_json) as advance:
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
    if result.active_cycles == 0:
        click.echo("the run was never ACTIVE: a replay of it proves nothing about the law", err=True)
        raise SystemExit(EXIT_DATA)


@contextlib.contextmanager
def _bar(label: str, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error for what takes longer than a moment."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@cli.group()
def log() -> None:
    """Look into a log, export or repair it."""


LOG = click.argument("path", metavar="LOG", type=click.Path(path_type=Path))


@log.command("info", epilog="Example: spsp-ctrl log info runs/20260101T120000Z/run.mcap")
@LOG
@JSON
@_guarded
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
@_guarded
def log_cat(path: Path, topic: str, fields: tuple[str, ...], start: float, end: float, limit: int) -> None:
    """Print messages of one topic as JSON lines."""
    from spsp_ctrl.recording.logtools import cat

    for row in cat(path, topic, fields, start, end, limit):
        click.echo(json.dumps(row))


@log.command("export", epilog="Example: spsp-ctrl log export run.mcap /control --out control.csv")
@LOG
@TOPIC
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="CSV file to write.")
@FIELDS
@FORCE
@_guarded
def log_export(path: Path, topic: str, out: Path, fields: tuple[str, ...], force: bool) -> None:
    """Write one topic as CSV; units are in the column names."""
    from spsp_ctrl.recording.logtools import export_csv

    click.echo(f"{out}: {export_csv(path, topic, out, fields, force=force)} rows")


@log.command("repair", epilog="Example: spsp-ctrl log repair run.mcap --out repaired.mcap")
@LOG
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), help="Finished copy to write.")
@FORCE
@_guarded
def log_repair(path: Path, out: Path, force: bool) -> None:
    """Make a finished copy of an unfinished or damaged log with everything that is readable."""
    from spsp_ctrl.recording.logtools import repair

    kept, problem = repair(path, out, force=force)
    click.echo(f"{out}: {kept} messages kept" + (f"; the input was damaged: {problem}" if problem else "; the input was complete"))


def main() -> None:
    """Entry point."""
    try:
        cli(prog_name="spsp-ctrl")
    except SystemExit:
        raise
    except Exception as error:
        import traceback

        traceback.print_exc()
        click.echo(f"internal error: {error!r}. This is a defect of spsp-ctrl; please report it with the lines above.", err=True)
        raise SystemExit(EXIT_INTERNAL) from None


if __name__ == "__main__":
    main()
