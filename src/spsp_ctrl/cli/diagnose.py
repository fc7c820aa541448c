"""``spsp-ctrl diagnose``: find, name, add and show what a model is missing."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from spsp_ctrl.cli.common import EXIT_DATA, EXIT_USER, JSON, bar, guarded

if TYPE_CHECKING:
    from spsp_ctrl.discrepancy.result import Diagnosis

FILE = click.Path(path_type=Path)


@click.command(epilog="Example: spsp-ctrl diagnose train.mcap --model config/axis.yaml --held-out other.mcap --out diagnosis")
@click.argument("logs", nargs=-1, required=True, metavar="LOG...", type=click.Path(path_type=Path))
@click.option("--model", "-m", required=True, type=click.Path(path_type=Path), help="Model file, e.g. config/model.yaml. Never changed.")
@click.option("--out", "-o", required=True, type=click.Path(path_type=Path), metavar="DIR", help="New folder for the results.")
@click.option(
    "--commissioning",
    help="Log of the machine as calibrated: sets the floor. Repeatable.",
    multiple=True,
    type=FILE,
    metavar="LOG",
)
@click.option(
    "--held-out",
    help="Log with other motion, only to judge; else the last motions are kept back.",
    multiple=True,
    type=FILE,
    metavar="LOG",
)
@click.option("--stage", type=click.Choice(["find", "name", "add", "show"]), default="show", help="Last stage to run (default show, all of them).")
@click.option("--seed", type=click.IntRange(0), default=1, help="Seed of the bootstrap (default 1). Same seed, same answer.")
@click.option("--jobs", type=click.IntRange(1), default=2, help="Cores to use (default 2); the answer does not depend on it.")
@JSON
@guarded
def diagnose(
    logs: tuple[Path, ...],
    model: Path,
    out: Path,
    commissioning: tuple[Path, ...],
    held_out: tuple[Path, ...],
    stage: str,
    seed: int,
    jobs: int,
    as_json: bool,
) -> None:
    """Say where simulation and measurement part, name what the model is missing, write a new model and show how much of the gap is gone.

    Exit code 0: explained, partly explained or nothing missing; 4: the logs are not understood, or the library does not explain them; 2: wrong input.
    """
    import time

    from spsp_ctrl.discrepancy.folder import check_out, publish, scratch
    from spsp_ctrl.discrepancy.next_experiment import text as next_text
    from spsp_ctrl.discrepancy.pipeline import Task
    from spsp_ctrl.discrepancy.pipeline import diagnose as run
    from spsp_ctrl.discrepancy.records import load_record
    from spsp_ctrl.plant.axis_model import load_axis_model
    from spsp_ctrl.report.diagnosis import page_of
    from spsp_ctrl.report.diagnosis_text import screen_of

    start = time.monotonic()
    if problem := check_out(out):
        click.echo(problem, err=True)
        raise SystemExit(EXIT_USER)
    given = [*logs, *commissioning, *held_out]
    if len({p.resolve() for p in given}) < len(given):
        click.echo("a log is given twice: training, commissioning and held-out data must be different logs", err=True)
        raise SystemExit(EXIT_USER)
    groups = (logs, commissioning, held_out)
    diagnosed: Callable[[Path, Callable[[str], None]], Diagnosis]
    if _kind(model) == "platform":
        from spsp_ctrl.discrepancy.platform_pipeline import PlatformTask, diagnose_platform
        from spsp_ctrl.discrepancy.platform_records import load_platform
        from spsp_ctrl.plant.model import load_model

        rig = load_model(model)
        runs = [tuple(load_platform(path) for path in group) for group in groups]
        diagnosed = partial(diagnose_platform, PlatformTask(rig, runs[0], runs[1], runs[2], seed, stage, jobs))
    else:
        axis = load_axis_model(model)
        sets = [tuple(load_record(path)[0] for path in group) for group in groups]
        diagnosed = partial(run, Task(axis, sets[0], sets[1], sets[2], seed, stage, jobs))
    with scratch(out) as folder, bar("diagnose", as_json) as advance:
        done = 0

        def tick(text: str) -> None:
            nonlocal done
            done += 1
            advance(done, max(40, done + 5))

        answer = diagnosed(folder / "model.yaml", tick)
        answer.seconds = time.monotonic() - start
        (folder / "diagnosis.json").write_text(json.dumps(answer.to_dict(), indent=2) + "\n", encoding="utf-8")
        if answer.plan is not None and answer.next_experiment:
            (folder / answer.next_experiment).write_text(next_text(answer.plan), encoding="utf-8")
        (folder / "report.html").write_text(page_of(answer, model.name, [p.name for p in logs]), encoding="utf-8")
        publish(folder, out)
    click.echo(json.dumps(answer.to_dict(), indent=2) if as_json else "\n".join(screen_of(answer, out)))
    if not answer.good:
        raise SystemExit(EXIT_DATA)


def _kind(path: Path) -> str:
    """Kind of a model file, as far as it says one; errors are left to the loader."""
    import yaml

    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return "axis"
    return str(raw.get("kind", "platform")) if isinstance(raw, dict) and "schema" in raw else "axis"
