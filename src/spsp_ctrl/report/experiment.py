"""The page of an experiment: verdict with the paper's values, what was done, the pictures, every run. And the page of all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.runner import Outcome
from spsp_ctrl.experiments.summary import look_up
from spsp_ctrl.experiments.verdict import CaseResult, Found, Verdict
from spsp_ctrl.report import experiment_figures, study_tables
from spsp_ctrl.report.page import details, page, section, table
from spsp_ctrl.report.text import DASH, number

FOOTER = "Errors by the IMU are what the closed loop itself sees, as in the paper; true errors are known on a virtual rig only. "
RUNS_NOTE = (
    "Largest / rms in arcmin after the start-up. IMU: by the IMU that closes the loop. "
    "No bias: true, without the IMU's constant bias. True: in full."
)
ERROR_KINDS = (("imu", "IMU"), ("unbiased", "no bias"), ("true", "true"))


def laws_of(outcomes: Sequence[Outcome]) -> list[str]:
    """Laws in the order of their first run."""
    return list(dict.fromkeys(r.law for o in outcomes for r in o.results))


def shown(value: float | None) -> str:
    """A figure with three significant places."""
    if value is None:
        return DASH
    size = abs(value)
    return number(value, 0 if size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 0.1 else 3)


def _cell(found: Found | None) -> str:
    if found is None:
        return ""
    cls = "pass" if found.passed else "fail"
    mark = "✓" if found.passed else "✗"
    return f'<span class="tag {cls}" title="{escape(found.at)}">{shown(found.value)} {mark}</span>'


def acceptance_table(verdicts: Sequence[Verdict], laws: Sequence[str]) -> str:
    """Row, the paper's value, requirement, bound here, and the value under each law."""
    cells = []
    for v in verdicts:
        note = f'<br><small class="note">{escape(v.note)}</small>' if v.note else ""
        row = [escape(v.name) + note, escape(v.paper) or DASH, escape(v.requirement) or DASH, escape(v.bound), escape(v.unit)]
        cells.append([*row, *(_cell(v.by_law.get(law)) for law in laws)])
    head = ["Row", "Paper", "Required", "Bound", "Unit", *(f"here, {law}" for law in laws)]
    return table(head, cells, numeric=tuple(range(5, 5 + len(laws))))


def _headline(outcome: Outcome) -> tuple[str, str]:
    rows = outcome.verdicts
    failed = [v for v in rows if not v.passed]
    if outcome.faults:
        return f"{len(outcome.faults)} of {len(outcome.results)} runs did not complete", "fail"
    if failed:
        return f"{len(failed)} of {len(rows)} rows not met", "fail"
    return (f"All {len(rows)} rows met", "pass") if rows else ("Completed; no rows to judge", "warn")


def _runs(results: Sequence[CaseResult]) -> str:
    """Every run, with the three kinds of error never mixed."""
    if any(r.figures.get("error_arcmin") for r in results):
        head = ["Run", "Seed", "Ended"]
        cells: list[list[str]] = []
        for axis in ("pitch", "roll"):
            head += [f"{axis}: {text}" for _, text in ERROR_KINDS]
        for r in results:
            row = [f'<span class="tag">{escape(r.key)}</span>', str(r.seed), escape(r.ended)]
            for axis in ("pitch", "roll"):
                for kind, _ in ERROR_KINDS:
                    top = look_up(r.figures, f"error_arcmin.{axis}.{kind}_max")
                    rms = look_up(r.figures, f"error_arcmin.{axis}.{kind}_rms")
                    row.append(DASH if top is None else f"{shown(top)} / {shown(rms)}")
            cells.append(row)
        return table(head, cells, numeric=tuple(range(3, 9))) + f'<p class="note">{RUNS_NOTE}</p>'
    return table(["Run", "Seed", "Ended"], [[escape(r.key), str(r.seed), escape(r.ended)] for r in results])


def _flat(node: Mapping[str, Any], head: str = "") -> list[str]:
    """Dotted names of the leaves."""
    out: list[str] = []
    for name, value in node.items():
        out += _flat(value, f"{head}{name}.") if isinstance(value, Mapping) else [head + name]
    return out


def _special(results: Sequence[CaseResult]) -> str:
    """Figures beyond the errors, one table per kind."""
    out = ""
    for kind in ("push_rod", "open_loop", "pointing", "thermal"):
        rows = [r for r in results if isinstance(r.figures.get(kind), dict)]
        names = list(dict.fromkeys(name for r in rows for name in _flat(r.figures[kind])))
        if not rows:
            continue
        cells = [[escape(n), *(shown(look_up(r.figures, f"{kind}.{n}")) for r in rows)] for n in names]
        out += f"<h3>{kind}</h3>" + table([kind, *(r.key for r in rows)], cells, numeric=tuple(range(1, 1 + len(rows))))
    return out


def _pictures(scenario: Scenario, results: Sequence[CaseResult]) -> list[str]:
    text = experiment_figures.render(scenario, results)
    return [section("Pictures", "Of several repeats the one with the largest error is drawn.", text)] if text else []


def _studies(outcome: Outcome) -> list[str]:
    """Sections that a scenario asks for among its figures and that are tables first."""
    asked, sections = outcome.experiment.scenario.figures, []
    if "ladder" in asked:
        lead = "Each rung on every motion."
        sections.append(section("Ladder", lead, study_tables.ladder(outcome.results, outcome.margins)))
    if "draws" in asked:
        lead = f"First seed {outcome.experiment.seed}, from {outcome.experiment.seed_from}."
        sections.append(section("What was drawn", lead, study_tables.draws(outcome.results)))
    return sections


def write_report(out: Path, outcome: Outcome) -> None:
    """One self-contained HTML file for one experiment."""
    scenario = outcome.experiment.scenario
    title, cls = _headline(outcome)
    story = "".join(
        f"<h3>{head}</h3><p>{escape(text)}</p>" for head, text in (("The paper", scenario.paper), ("Here", scenario.note)) if text
    )
    faults = "".join(f'<p class="note">{escape(f)}</p>' for f in outcome.faults)
    laws = laws_of([outcome])
    sections = [
        section(title, scenario.title or scenario.name, acceptance_table(outcome.verdicts, laws) + faults, f"verdict {cls}"),
        *_studies(outcome),
        section("What was done", "", story or '<p class="note">The scenario says nothing about it.</p>'),
        *_pictures(scenario, outcome.results),
        section("Runs", "Each has its own folder with the log, the resolved files and its summary.", _runs(outcome.results)),
    ]
    special = _special(outcome.results)
    if special:
        sections.append(section("Further figures", "By run, names as in summary.json.", special))
    text = outcome.experiment.path.read_text(encoding="utf-8", errors="replace")
    sections.append(section("Record", "", details(outcome.experiment.path.name, text), cls="record"))
    header = f'<header><div><div class="brand">spsp-ctrl · experiment</div><h1>{escape(scenario.name)}</h1></div></header>'
    out.write_text(page(f"{scenario.name} · spsp-ctrl", header, sections, FOOTER), encoding="utf-8")


def write_all(out: Path, outcomes: Sequence[Outcome], links: Sequence[str]) -> None:
    """One page for all: every row, the paper's value beside what each law does, and the pictures of the paper's figures."""
    laws = laws_of(outcomes)
    rows = [v for o in outcomes for v in o.verdicts]
    failed = sum(not v.passed for v in rows)
    runs = sum(len(o.results) for o in outcomes)
    head = f"{len(rows) - failed} of {len(rows)} rows met in {runs} runs"
    body = ""
    for outcome, link in zip(outcomes, links, strict=True):
        s = outcome.experiment.scenario
        body += f'<h3><a href="{escape(link)}">{escape(s.title or s.name)}</a></h3>' + acceptance_table(outcome.verdicts, laws)
    lead = "One parameter set in the model file for all of them, none tuned per experiment. Values are the worst of all repeats."
    sections = [section(head, lead, body, "verdict " + ("fail" if failed else "pass"))]
    for outcome in outcomes:
        s = outcome.experiment.scenario
        if s.paper:
            sections.append(section(s.title or s.name, s.paper, experiment_figures.render(s, outcome.results)))
    header = '<header><div><div class="brand">spsp-ctrl · experiments</div><h1>Section 4 of the paper, and beyond</h1></div></header>'
    out.write_text(page("experiments · spsp-ctrl", header, sections, FOOTER), encoding="utf-8")
