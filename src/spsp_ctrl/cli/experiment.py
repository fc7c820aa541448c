"""``spsp-ctrl experiment``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from spsp_ctrl.cli.common import EXIT_INTERRUPTED, EXIT_RIG, EXIT_ROW_FAILED, JSON, OVERRIDE, bar, guarded

if TYPE_CHECKING:
    from spsp_ctrl.experiments.runner import Outcome

DEFAULT_RIG = Path("config/rig.yaml")
DEFAULT_AXIS = Path("config/axis.yaml")


@click.command(epilog="Example: spsp-ctrl experiment swing-2dof --jobs 2 --out runs/swing")
@click.argument("name", metavar="NAME|FILE|list|all")
@click.option("--config", "-c", default=DEFAULT_RIG, show_default=True, type=click.Path(path_type=Path), help="Rig file.")
@click.option(
    "--model",
    "-m",
    default=DEFAULT_AXIS,
    show_default=True,
    type=click.Path(path_type=Path),
    help="Model of the axis, for a motion file of a single axis (as `diagnose` writes one).",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder for the results; default runs/<UTC time>.")
@click.option("--fast", is_flag=True, help="Lock-step, as fast as the computer allows. This is the default and the only way.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Seed of the first repeat; the others count on from it.")
@click.option(
    "--repeats", "--n", "repeats", type=click.IntRange(1, 1000), metavar="N", help="Repeats, or draws, instead of the scenario's own number."
)
@click.option("--variant", "only", multiple=True, metavar="NAME", help="Only this variant (and those it needs); may be given several times.")
@click.option("--jobs", "-j", default=2, show_default=True, type=click.IntRange(1, 64), help="Processes.")
@click.option("--no-logs", is_flag=True, help="Delete each run's log once it is evaluated (a log takes about 0.8 MB per simulated second).")
@click.option("--strict", is_flag=True, help="Exit with 1 when an acceptance row fails.")
@OVERRIDE
@JSON
@guarded
def experiment(
    name: str,
    config: Path,
    model: Path,
    out: Path | None,
    fast: bool,
    seed: int | None,
    repeats: int | None,
    only: tuple[str, ...],
    jobs: int,
    no_logs: bool,
    strict: bool,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Run an experiment: a scenario with its repeats, laws and variants, judged against the paper.

    NAME is one of the shipped experiments (`list` shows them), FILE any scenario file, `all` runs the whole set and writes one page. The folder holds
    report.html, summary.json and one folder per run with its log. A motion file of a single axis runs on the virtual bench of --model and leaves
    axis.mcap there, which `diagnose` reads.
    """
    if name == "list":
        _list(config, as_json)
        return
    if name.endswith((".yaml", ".yml")) and _axis_motion(Path(name), model, out, seed, as_json, strict):
        return
    from spsp_ctrl.experiments import catalogue, runner
    from spsp_ctrl.report.experiment import write_all, write_report

    rig = runner.load_rig_with(config, overrides)
    paths = list(catalogue.shipped(config).values()) if name == "all" else [catalogue.find(name, config)]
    experiments = sorted((runner.load(path, rig, seed, repeats, only) for path in paths), key=lambda e: e.scenario.position)
    if name == "all":
        experiments = [e for e in experiments if e.scenario.position < catalogue.STUDIES]
    if name == "all" and only:
        raise click.UsageError("--variant picks variants of one experiment; name it instead of `all`")
    folder = runner.open_folder(out)
    folders = [folder / e.name for e in experiments] if name == "all" else [folder]
    for path in folders:
        path.mkdir(parents=True, exist_ok=True)
    if not as_json:
        count = sum(len(e.cases) for e in experiments)
        for e in experiments:
            if e.scenario.repeats.first_seed == "commit":
                click.echo(f"{e.name}: seed {e.seed} ({e.seed_from}); --seed {e.seed} repeats it", err=True)
        click.echo(f"{count} runs in {jobs} processes; the first start compiles the plant, about 10 s ...", err=True)
    with bar("simulating", as_json) as advance:
        outcomes = runner.run(experiments, folders, jobs, not no_logs, lambda done, total: advance(round(done), round(total)))
    for outcome, path in zip(outcomes, folders, strict=True):
        write_report(path / "report.html", outcome)
    if name == "all":
        write_all(folder / "report.html", outcomes, [f"{p.name}/report.html" for p in folders])
        text = json.dumps({"experiments": [o.to_dict() for o in outcomes]}, indent=2, allow_nan=False)
        (folder / runner.SUMMARY_NAME).write_text(text + "\n", encoding="utf-8")
    _show(outcomes, folder, as_json, name == "all")
    if any(o.faults for o in outcomes):
        ended = [fault for o in outcomes for fault in o.faults]
        raise SystemExit(EXIT_INTERRUPTED if all(f.endswith("interrupted") for f in ended) else EXIT_RIG)
    if strict and not all(o.passed for o in outcomes):
        raise SystemExit(EXIT_ROW_FAILED)


def _axis_motion(path: Path, model: Path, out: Path | None, seed: int | None, as_json: bool, strict: bool) -> bool:
    """Run a motion file of a single axis; False when the file is something else."""
    from spsp_ctrl.experiments import axis_session, runner
    from spsp_ctrl.plant.axis_model import load_axis_model
    from spsp_ctrl.plant.axis_scenario import load_axis_scenario

    if not axis_session.is_axis_motion(path):
        return False
    load_axis_scenario(path)  # refused before a folder is made
    load_axis_model(model)
    folder = runner.open_folder(out)
    folder.mkdir(parents=True, exist_ok=True)
    summary = axis_session.run(path, model, folder, 1 if seed is None else seed)
    if as_json:
        click.echo(json.dumps(summary, indent=2))
    else:
        kept = "within its limits" if summary["within_limits"] else "BEYOND the current limit of the file"
        click.echo(f"{summary['scenario']} on {summary['model']}: {summary['seconds']:g} s, command up to {summary['command_max_a']:.3g} A, {kept}")
        click.echo(str(folder / summary["log"]))
    if strict and not summary["within_limits"]:
        raise SystemExit(EXIT_ROW_FAILED)
    return True


def _list(config: Path, as_json: bool) -> None:
    from spsp_ctrl.config.loader import load_rig, load_scenario
    from spsp_ctrl.experiments import catalogue

    load_rig(config)
    rows: list[dict[str, Any]] = []
    for name, path in catalogue.shipped(config).items():
        plan = load_scenario(path).model
        laws = max(1, len(plan.laws))
        count = plan.repeats.count
        runs = sum((len(v.laws) or laws) * (v.repeats or count) for v in plan.variants) if plan.variants else laws * count
        runs *= max(1, len(plan.motions))
        rows.append({"name": name, "position": plan.position, "title": plan.title, "runs": runs, "file": str(path)})
    rows.sort(key=lambda row: (row["position"], row["name"]))
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    width = max((len(str(row["name"])) for row in rows), default=0)
    for row in rows:
        click.echo(f"{row['name']:<{width}}  {row['runs']:>3} runs  {row['title']}")
    if not rows:
        click.echo(f"no experiments beside {config}", err=True)


def _show(outcomes: list[Outcome], folder: Path, as_json: bool, many: bool) -> None:
    if as_json:
        found = [o.to_dict() for o in outcomes]
        click.echo(json.dumps({"experiments": found} if many else found[0], indent=2, allow_nan=False))
        return
    from rich.console import Console
    from rich.text import Text

    from spsp_ctrl.report.experiment_table import print_outcome

    console = Console()
    for outcome in outcomes:
        print_outcome(outcome, console)
    console.print(Text(str(folder / "report.html")), soft_wrap=True)
