"""The page of a diagnosis: the answer in words, waterfall of the gap, before and after on held-out data, names with rivals, regimes, what is left."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from spsp_ctrl.discrepancy.result import Diagnosis
from spsp_ctrl.report import diagnosis_figures as figures
from spsp_ctrl.report.diagnosis_figures import shown
from spsp_ctrl.report.diagnosis_text import class_of, plain, quantity, story
from spsp_ctrl.report.page import details, facts, page, section, table, tile
from spsp_ctrl.report.text import number

CLASS = {"explained": "pass", "nothing-missing": "pass", "partly-explained": "warn"}
WORDS = {
    "force": "command in closed loop, as force at the load",
    "current": "current at the measured motion",
    "drive": "current against its command",
    "resolver": "motor angle against the tracking model",
    "ruler": "load against motor",
}


def page_of(answer: Diagnosis, model: str, logs: list[str]) -> str:
    """The whole page."""
    header = (
        f"<style>{figures.STYLE}</style>"
        f'<header><div><div class="brand">spsp-ctrl · diagnosis</div><h1>{escape(", ".join(logs))}</h1></div>'
        f'<div><span class="badge">{escape(model)}</span><span class="badge">floor {answer.floor_quality}</span></div></header>'
    )
    sections = [_verdict(answer), *_gap(answer), *_names(answer), *_left(answer), *_next(answer), *_regimes(answer), *_rest(answer)]
    footer = "Gap closed is judged on held-out data only, with the model file read back from disk. A floor is what even a right model leaves."
    return page(f"Diagnosis: {answer.verdict}", header, sections, footer)


def _verdict(answer: Diagnosis) -> str:
    tiles = []
    for e in answer.effects[:4]:
        value = next(iter(e.parameters.values()))
        text, _, unit = quantity(value).partition(" ± ")[0].partition(" ")
        tiles.append(tile(text, unit, plain(e.name) + (", or a twin" if len(e.members) > 1 else "")))
    for channel, gap in answer.gap.items():
        if gap.closed is not None:
            whole = gap.after <= gap.floor
            tiles.append(tile("all" if whole else number(100 * gap.closed, 1), "" if whole else "%", f"of the gap closed, {channel}"))
    told = "".join(f"<p>{escape(text)}</p>" for text in story(answer))
    body = f'<div class="story">{told}</div><div class="tiles">{"".join(tiles)}</div>'
    problems = [(name, text) for name, gate in answer.gates.items() for text in (*gate.problems, *gate.remarks)]
    if problems:
        body += table(("log", "gate"), [(escape(a), escape(b)) for a, b in problems], cls="log")
    return section(plain(answer.verdict).capitalize(), answer.reason, body, f"verdict {CLASS.get(answer.verdict, 'fail')}")


def _gap(answer: Diagnosis) -> Iterator[str]:
    if not answer.gap:
        return
    if fall := figures.waterfall(answer.waterfall, answer.gap):
        lead = "Held-out data. Each name is put in, in the order in which it was found; what was recalibrated with it moves along with the first."
        yield section("Where the gap went", lead, fall)
    body = figures.bars(answer.gap, WORDS) + "".join(figures.series(answer))
    lead = "Residual, simulated less measured, on motion that was not fitted. A channel at its floor has nothing to close."
    yield section("Before and after, against the floor", lead, body)


def _names(answer: Diagnosis) -> Iterator[str]:
    if not answer.effects:
        return
    rows = []
    for k, e in enumerate(answer.effects, 1):
        numbers = "<br>".join(f"{escape(plain(n))} {escape(quantity(v))}" for n, v in e.parameters.items())
        share = "" if e.gap_closed is None else f"{number(100 * e.gap_closed, 0)} %"
        remarks = "; ".join(filter(None, [class_of(e) and f"cannot be told apart: {class_of(e)}", *e.remarks]))
        rows.append(
            (str(k), f"<b>{escape(plain(e.name))}</b>", escape(e.stage), numbers, escape(e.channel), number(e.evidence, 0), share, escape(remarks))
        )
    head = ("", "name", "stage", "value ± σ", "channel", "evidence", "of its excess", "rivals and remarks")
    body = table(head, rows, (5, 6))
    for step, ranked in answer.screening:
        if ranked:
            text = "\n".join(f"{gain:12.1f}  {name}" for name, gain in ranked[:12])
            body += details(f"What else was looked at: screening {step} names", text)
    if answer.correlation is not None:
        body += "<h3>Correlation of the fitted numbers</h3>" + figures.correlation_table(answer.correlation)
        body += '<p class="note">Numbers of the names, and recalibrated ones that hang together with one by a half or more.</p>'
    lead = "In the order in which they were found; evidence is the gain of the score (BIC), shares are of training."
    yield section("Named: how large, how sure, what else it could be", lead, body)


def _left(answer: Diagnosis) -> Iterator[str]:
    if answer.refused:
        rows = [(escape(plain(r.name)), escape(r.channel), number(r.evidence, 0)) for r in answer.refused]
        lead = "The nearest name, which closes less than half of its channel's excess: it is not given, and not in the model."
        yield section("Not explained by the library", lead, table(("name refused", "channel", "evidence"), rows, (2,)))
    if not answer.unexplained:
        return
    rows = [(escape(u.channel), escape(u.regime), shown(u.size, u.unit)) for u in answer.unexplained]
    body = table(("channel", "regime", "rms"), rows, (2,)) + "".join(figures.sketch_chart(s) for s in answer.sketches)
    yield section("What is left, and its shape", "Above its floor with every name in place; drawn over the variable that orders it best.", body)


def _next(answer: Diagnosis) -> Iterator[str]:
    plan = answer.plan
    if plan is None:
        return
    body = ""
    if plan.scenario is not None:
        rows = [
            (escape(plain(p.name)), escape(plain(p.rival)), ", ".join(f"{c} {figures.floors(f)}" for c, f in p.floors.items())) for p in plan.partings
        ]
        body += f"<p><b>{escape(plan.scenario.title)}</b>, {plan.scenario.seconds:g} s: <code>next.yaml</code></p>"
        body += table(("name", "or its twin", "predicted to part by, in floors"), rows, cls="log")
        body += details("Motions that were compared", "\n".join(f"{value:10.3g} floors  {name}" for name, value in plan.tried))
    for a, b in plan.together:
        text = f"{plain(a)} and {plain(b)}: no motion that was looked at parts them; that takes a second reference or a wider reach."
        body += f"<p>{escape(text)}</p>"
    yield section(
        "Next experiment", "What would tell the twins apart, within what the bench has already shown to bear; the rival refitted first.", body
    )


def _regimes(answer: Diagnosis) -> Iterator[str]:
    if answer.regimes:
        lead = "rms over floor on held-out data, before → after. Green is at the floor."
        yield section("Map of regimes", lead, figures.regime_table(answer.regimes))
    if not answer.found:
        return
    rows = [
        (escape(f.channel), escape(f.regime), shown(f.size, f.unit), number(100 * f.share, 0) + " %", number(f.enrichment, 2), f"{f.p_value:.1e}")
        for f in answer.found[:20]
    ]
    head = ("channel", "regime", "rms", "energy", "enrichment", "p (family-wise)")
    lead = "Where the recalibrated model and the training data part: enrichment is the share of energy over the share of time."
    yield section("Found", lead, table(head, rows, (2, 3, 4, 5)))


def _rest(answer: Diagnosis) -> Iterator[str]:
    if answer.not_excited:
        yield section("Not excited", "These logs say nothing about:", "<ul>" + "".join(f"<li>{escape(t)}</li>" for t in answer.not_excited) + "</ul>")
    if answer.fingerprints:
        yield section("Data", "", facts(answer.fingerprints.items()))
