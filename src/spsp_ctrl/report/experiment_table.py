"""The table that an experiment prints at its end."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from spsp_ctrl.experiments.runner import Outcome
from spsp_ctrl.report.experiment import laws_of, shown
from spsp_ctrl.report.text import DASH


def print_outcome(outcome: Outcome, console: Console) -> None:
    """Rows with the paper's value and what each law reaches."""
    terminal = console.is_terminal
    good = outcome.passed and not outcome.faults
    scenario = outcome.experiment.scenario
    laws = laws_of([outcome])
    table = Table(
        box=box.ROUNDED if terminal else None,
        title=Text(scenario.title or scenario.name, "bold green" if good else "bold red"),
        title_justify="left",
        border_style="bright_black",
        header_style="bold",
        padding=(0, 1),
    )
    for name in ("row", "paper", "bound", "unit"):
        table.add_column(name)
    for law in laws:
        table.add_column(law, justify="right")
    for v in outcome.verdicts:
        cells: list[Text | str] = [v.name, v.paper or DASH, v.bound, v.unit]
        for law in laws:
            found = v.by_law.get(law)
            text = Text("") if found is None else Text(shown(found.value) + (" pass" if found.passed else " FAIL"))
            if found is not None:
                text.stylize("green" if found.passed else "bold red")
            cells.append(text)
        table.add_row(*cells)
    console.print(table)
    for fault in outcome.faults:
        console.print(Text(fault, "bold red"))
