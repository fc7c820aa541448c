"""The page of a diagnosis: verdict, names, gap before and after on held-out data, regimes, what is left, what was never excited."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

import numpy as np

from spsp_ctrl.discrepancy.result import Diagnosis
from spsp_ctrl.report.diagnosis_text import class_of, quantity
from spsp_ctrl.report.page import facts, page, section, table, tile
from spsp_ctrl.report.svg import Panel, TimeAxis, Trace, render_panel
from spsp_ctrl.report.text import number

CLASS = {"explained": "pass", "nothing-missing": "pass", "partly-explained": "warn"}
SCALES = {"m": (1e6, "µm"), "rad": (1e3, "mrad"), "A": (1e3, "mA"), "N": (1.0, "N")}
WORDS = {
    "force": "command in closed loop, as force at the load",
    "current": "current at the measured motion",
    "drive": "current against its command",
    "resolver": "motor angle against the tracking model",
    "ruler": "load against motor",
}


def shown(value: float, unit: str) -> str:
    """A size in the unit of reports."""
    factor, name = SCALES.get(unit, (1.0, unit))
    return f"{number(float(f'{value * factor:.3g}'))} {name}"


def page_of(answer: Diagnosis, model: str, logs: list[str]) -> str:
    """The whole page."""
    header = (
        f'<header><div><div class="brand">spsp-ctrl · diagnosis</div><h1>{escape(", ".join(logs))}</h1></div>'
        f'<div><span class="badge">{escape(model)}</span><span class="badge">floor {answer.floor_quality}</span></div></header>'
    )
    sections = [_verdict(answer), *_names(answer), *_gap(answer), *_regimes(answer), *_rest(answer)]
    footer = "Gap closed is judged on held-out data only, with the model file read back from disk."
    return page(f"Diagnosis: {answer.verdict}", header, sections, footer)


def _verdict(answer: Diagnosis) -> str:
    tiles = []
    for e in answer.effects[:4]:
        value = next(iter(e.parameters.values()))
        tiles.append(tile(f"{value.value:.4g}", value.unit if value.unit != "1" else "", e.name.replace("_", " ")))
    for channel, gap in answer.gap.items():
        if gap.closed is not None:
            tiles.append(tile(number(100 * gap.closed, 1), "%", f"gap closed, {channel}"))
    body = f'<p>{escape(answer.reason)}</p><div class="tiles">{"".join(tiles)}</div>'
    problems = [(name, text) for name, gate in answer.gates.items() for text in (*gate.problems, *gate.remarks)]
    if problems:
        body += table(("log", "gate"), [(escape(a), escape(b)) for a, b in problems], cls="log")
    return section(answer.verdict, "", body, f"verdict {CLASS.get(answer.verdict, 'fail')}")


def _names(answer: Diagnosis) -> Iterator[str]:
    if not answer.effects:
        return
    rows = []
    for k, e in enumerate(answer.effects, 1):
        numbers = "<br>".join(f"{escape(n)} {escape(quantity(v))}" for n, v in e.parameters.items())
        share = "" if e.gap_closed is None else f"{number(100 * e.gap_closed, 0)} %"
        remarks = "; ".join(filter(None, [class_of(e) and f"cannot be told apart: {class_of(e)}", *e.remarks]))
        rows.append((str(k), escape(e.name), escape(e.stage), numbers, escape(e.channel), number(e.evidence, 0), share, escape(remarks)))
    head = ("", "name", "stage", "value ± σ", "channel", "evidence", "of its excess", "remarks")
    yield section(
        "Named", "In the order in which they were found; evidence is the gain of the score (BIC), shares are of training.", table(head, rows, (5, 6))
    )


def _gap(answer: Diagnosis) -> Iterator[str]:
    if not answer.gap:
        return
    rows = []
    for channel, g in answer.gap.items():
        low, high = g.interval or (0.0, 0.0)
        closed = "at floor" if g.closed is None else f"{number(100 * g.closed, 1)} % [{number(100 * low, 1)}, {number(100 * high, 1)}]"
        rows.append((escape(channel), escape(WORDS[channel]), shown(g.floor, g.unit), shown(g.before, g.unit), shown(g.after, g.unit), closed))
    body = table(("channel", "what", "floor", "before", "after", "closed [95 %]"), rows, (2, 3, 4, 5))
    panels = [c for c in answer.curves if len(c.t_s) > 2]
    for k, curve in enumerate(panels):
        factor, unit = SCALES.get(curve.unit, (1.0, curve.unit))
        t = curve.t_s - curve.t_s[0]
        traces = (
            Trace("before", t, np.asarray(curve.before * factor), "base", soft=True),
            Trace("after", t, np.asarray(curve.after * factor), "roll"),
        )
        panel = Panel(title=curve.channel, unit=unit, traces=traces)
        body += render_panel(panel, TimeAxis(end_s=float(t[-1])), last=k == len(panels) - 1)
    yield section("Gap on held-out data", "Residual, simulated minus measured, before and after. A channel at its floor has nothing to close.", body)


def _regimes(answer: Diagnosis) -> Iterator[str]:
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
    if answer.unexplained:
        rows = [(escape(u.channel), escape(u.regime), shown(u.size, u.unit)) for u in answer.unexplained]
        yield section("Not explained", "Above its floor with every name in place.", table(("channel", "regime", "rms"), rows, (2,)))
    if answer.not_excited:
        yield section("Not excited", "These logs say nothing about:", "<ul>" + "".join(f"<li>{escape(t)}</li>" for t in answer.not_excited) + "</ul>")
    if answer.fingerprints:
        yield section("Data", "", facts(answer.fingerprints.items()))
