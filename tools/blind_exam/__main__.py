"""``python -m tools.blind_exam``: draw, seal, diagnose, score; print the table."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import click

import spsp_ctrl
from spsp_ctrl.cli.common import EXIT_ROW_FAILED, EXIT_USER, JSON, bar, guarded
from tools.blind_exam import machine, table
from tools.blind_exam.case import SETS
from tools.blind_exam.exam import Settings, run_case
from tools.blind_exam.ledger import Ledger, commit_of, settings_of


@click.command(epilog="Example: python -m tools.blind_exam --n 20 --seed 1 --jobs 2 --set single --out runs/exam")
@click.option("--n", "count", default=10, show_default=True, type=click.IntRange(1), help="Cases of each set.")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="Seed of the draw.")
@click.option("--jobs", default=1, show_default=True, type=click.IntRange(1), help="Cases at a time.")
@click.option("--set", "groups", multiple=True, type=click.Choice(SETS), help="Only this set (repeatable); default: all.")
@click.option("--index", "indices", multiple=True, type=click.IntRange(0), help="Only this case of the set (repeatable), to run one again.")
@click.option("--kind", default="axis", show_default=True, type=click.Choice(["axis"]), help="Truth: a single lead-screw axis.")
@click.option("--model", default=machine.MODEL, show_default="config/axis.yaml", type=click.Path(path_type=Path), help="Model that is diagnosed.")
@click.option("--out", default=Path("runs/exam"), show_default=True, type=click.Path(path_type=Path), help="Folder of cases and answers.")
@click.option("--ledger", "book", type=click.Path(path_type=Path), help="Ledger (JSON lines); default: ledger.jsonl in --out.")
@click.option("--keep", is_flag=True, help="Keep the logs of every case.")
@click.option("--table-only", is_flag=True, help="Run nothing, print what the ledger has of this commit.")
@JSON
@guarded
def main(
    count: int,
    seed: int,
    jobs: int,
    groups: tuple[str, ...],
    indices: tuple[int, ...],
    kind: str,
    model: Path,
    out: Path,
    book: Path | None,
    keep: bool,
    table_only: bool,
    as_json: bool,
) -> None:
    """Examine `spsp-ctrl diagnose` on a machine that it has never seen.

    Cases that the ledger has for this commit and these settings are not run again. Exit code 1 when a case ended without a diagnosis.
    """
    if not model.exists():
        click.echo(f"{model}: there is no such model file", err=True)
        raise SystemExit(EXIT_USER)
    commit = commit_of(Path(spsp_ctrl.__file__).parent)
    exam = commit_of(Path(__file__).parent)
    keyed = settings_of({"kind": kind, "model": model.read_text(encoding="utf-8"), "exam": exam})
    ledger = Ledger(book or out / "ledger.jsonl")
    wanted = [(group, index) for index in (indices or range(count)) for group in (groups or SETS)]
    names = {f"{group}-{seed}-{index:04d}" for group, index in wanted}
    todo = [] if table_only else [(g, i) for g, i in wanted if not ledger.has(commit, f"{g}-{seed}-{i:04d}", keyed)]
    settings = Settings(model.resolve(), out, keep)

    def note(row: dict[str, Any]) -> None:
        ledger.append({"commit": commit, "settings": keyed, **row})

    with bar("examining", as_json) as progress:
        if jobs == 1:
            for done, (group, index) in enumerate(todo):
                note(run_case(group, seed, index, settings))
                progress(done + 1, len(todo))
        else:
            with ProcessPoolExecutor(jobs) as pool:
                running = [pool.submit(run_case, group, seed, index, settings) for group, index in todo]
                for done, future in enumerate(as_completed(running)):
                    note(future.result())
                    progress(done + 1, len(todo))
    rows = ledger.of(commit, keyed, None if table_only else names)
    if as_json:
        shown = dict(table.figures(rows)) if rows else {}
        click.echo(json.dumps({"commit": commit, "settings": keyed, "cases": len(rows), "figures": shown, "table": table.by_effect(rows)}, indent=2))
    else:
        click.echo(f"commit {commit}, settings {keyed}, {len(rows)} cases, {len(todo)} run now, ledger rows torn: {ledger.torn}\n")
        click.echo(table.text(rows) if rows else "no rows of this commit and these settings")
    if any("failed" in row for row in rows):
        raise SystemExit(EXIT_ROW_FAILED)


if __name__ == "__main__":
    sys.exit(main())
