"""The figures of an exam: shares with Wilson intervals, quantiles, and a table by effect and severity in which no row is left out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tools.blind_exam.catalogue import LIBRARY, SEVERITIES
from tools.blind_exam.scoring import APART, Share, quantile

Rows = list[dict[str, Any]]


def _share(values: Iterable[bool]) -> Share:
    listed = list(values)
    return Share(sum(listed), len(listed))


def _seen(rows: Rows) -> Rows:
    return [r for r in rows if any(h["detectable"] for h in r["hidden"])]


def _q(values: list[float]) -> str:
    median, ninety = quantile(values, 0.5), quantile(values, 0.9)
    return "none" if median is None or ninety is None else f"median {100 * median:.1f} %, 90 % {100 * ninety:.1f} % ({len(values)})"


def _closed(rows: Rows) -> str:
    values = [r["worst_closed"] for r in rows if r.get("worst_closed") is not None]
    median, worst = quantile(values, 0.5), quantile(values, 0.1)
    return "none" if median is None or worst is None else f"median {median:.3f}, worst 10 % {worst:.3f} ({len(values)})"


def figures(rows: Rows) -> list[tuple[str, str]]:
    """Lines of the summary."""
    by: dict[str, Rows] = {}
    for row in rows:
        by.setdefault(row["group"], []).append(row)
    lines: list[tuple[str, str]] = []
    if single := by.get("single"):
        seen = _seen(single)
        beyond = [r for r in seen if not r["hidden"][0]["recalibration"]]
        named = [r for r in seen if r["first_right"]]
        lines += [
            ("single: detectable", str(Share(len(seen), len(single)))),
            ("single: first name right, of detectable", str(_share(r["first_right"] for r in seen))),
            ("single: the same, beyond calibration tolerance", str(_share(r["first_right"] for r in beyond))),
            ("single: exactly that name", str(_share(r["first_right"] and r["exact"] for r in seen))),
            ("single: where right, of those named right", str(_share(r["where_right"] for r in named))),
            ("single: parameter error", _q([e for r in named for e in r["errors"]])),
            ("single: truth inside 95 % interval", str(_share(ok for r in named for ok in r["inside"]))),
            ("single: gap closed, worst channel", _closed(named)),
            ("single: smallest that was named, in floors", _smallest(seen)),
        ]
    if multiple := by.get("multiple"):
        recall = [sum(r["recall"][i] for r in multiple) for i in (0, 1)]
        precision = [sum(r["precision"][i] for r in multiple) for i in (0, 1)]
        lines += [
            ("multiple: recall on detectable", str(Share(recall[0], recall[1]))),
            ("multiple: precision", str(Share(precision[0], precision[1]))),
            ("multiple: exact set", str(_share(r["exact"] for r in multiple))),
            ("multiple: gap closed, worst channel", _closed(multiple)),
        ]
    if nothing := by.get("nothing"):
        lines.append(("nothing: any name", str(_share(r["any_name"] for r in nothing))))
        lines.append(("nothing: flagged as unexplained", str(_share(r["flagged"] for r in nothing))))
    if outside := by.get("outside"):
        seen = _seen(outside)
        lines += [
            ("outside: detectable", str(Share(len(seen), len(outside)))),
            ("outside: flagged, of detectable", str(_share(r["flagged"] for r in seen))),
            ("outside: confidently misnamed (a name and no flag)", str(_share(r["misnamed"] for r in seen))),
            ("outside: a nearest name beside the flag", str(_share(r["attracted"] and r["flagged"] for r in seen))),
        ]
    if twins := by.get("twins"):
        seen = _seen(twins)
        alike = [r for r in seen if r["apart"] is not None and r["apart"] < APART]
        asked = [r for r in seen if r.get("asked")]
        lines.append(("twins: as one class, or the right one alone where the truth parts them", str(_share(r["twin_ok"] for r in seen))))
        lines.append(("twins: as one class, of those that the truth does not part", str(_share(r["as_class"] for r in alike))))
        lines.append(("twins: next experiment given, of those in a class", str(_share(bool(r.get("asked")) for r in seen if r["as_class"]))))
        lines.append(
            ("twins: resolved by the next experiment, of those in a class with one", str(_share(bool(r["resolved"]) for r in asked if r["as_class"])))
        )
        lines.append(("twins: right name or its twin first", str(_share(r["first_right"] for r in seen))))
    if poor := by.get("poor"):
        lines.append(("poor excitation: abstains or names right", str(_share(r["poor_ok"] for r in poor))))
    failed = [r for r in rows if "failed" in r]
    lines.append(("no diagnosis at all", str(Share(len(failed), len(rows)))))
    lines.append(("a sentinel named", str(_share(r["sentinel"] for r in rows))))
    seconds = [r["seconds"] for r in rows]
    if seconds:
        lines.append(("wall time per diagnosis", f"median {quantile(seconds, 0.5)} s, 90 % {quantile(seconds, 0.9)} s, longest {max(seconds)} s"))
    return lines


def _smallest(seen: Rows) -> str:
    """Per effect the smallest size that was named right, in floors of its best channel; the median over effects."""
    least: dict[str, float] = {}
    for row in seen:
        if row["first_right"]:
            hidden = row["hidden"][0]
            size = max(hidden["floors"].values())
            least[hidden["effect"]] = min(least.get(hidden["effect"], size), size)
    median = quantile(list(least.values()), 0.5)
    return "none" if median is None else f"median over {len(least)} effects {median:.3g}"


def by_effect(rows: Rows) -> list[list[str]]:
    """Effect × severity: detectable of drawn, named right of detectable; with Wilson intervals over severities, and over effects."""
    single = [r for r in rows if r["group"] == "single"]
    table = [["effect", *(f"{s:g}" for s in SEVERITIES), "detectable", "named right"]]

    def line(name: str, mine: Rows) -> list[str]:
        cells = [name]
        for severity in SEVERITIES:
            here = [r for r in mine if r["hidden"][0]["severity"] == severity]
            seen = _seen(here)
            cells.append(f"{len(seen)}/{len(here)} seen, {sum(r['first_right'] for r in seen)} named" if here else "not drawn")
        seen = _seen(mine)
        return [*cells, _short(Share(len(seen), len(mine))), _short(_share(r["first_right"] for r in seen))]

    table += [line(effect, [r for r in single if r["hidden"][0]["effect"] == effect]) for effect in LIBRARY]
    table.append(line("all", single))
    at = {severity: [r for r in single if r["hidden"][0]["severity"] == severity] for severity in SEVERITIES}
    seen = {severity: Share(len(_seen(mine)), len(mine)) for severity, mine in at.items()}
    named = {severity: _share(r["first_right"] for r in _seen(mine)) for severity, mine in at.items()}
    for title, found in (("detectable", seen), ("named right", named)):
        shares = [_short(found[severity]) for severity in SEVERITIES]
        table.append([title, *shares, "", ""])
    return table


def _short(share: Share) -> str:
    """A share with its interval, in two digits."""
    low, high = share.interval
    return f"{share.hits}/{share.of} [{low:.2f}, {high:.2f}]" if share.of else "none"


def text(rows: Rows) -> str:
    """Everything for a person, as markdown."""
    width = max(len(name) for name, _ in figures(rows)) if rows else 0
    parts = [f"{name:<{width}}  {value}" for name, value in figures(rows)]
    if any(r["group"] == "single" for r in rows):
        table = by_effect(rows)
        widths = [max(len(line[c]) for line in table) for c in range(len(table[0]))]
        ruled = ["| " + " | ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)) + " |" for line in table]
        parts += ["", ruled[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *ruled[1:]]
    wrong = [r for r in rows if not good(r)]
    if wrong:
        parts += ["", "Cases that went wrong (set, seed, index: hidden -> named):"]
        for r in wrong:
            hidden = ", ".join(f"{h['effect']} x{h['severity']:g}{'' if h['detectable'] else ' (not detectable)'}" for h in r["hidden"])
            named = ", ".join(r["named"]) or "no name"
            parts.append(f"  {r['group']} {r['exam_seed']} {r['index']}: {hidden or 'nothing'} -> {named} [{r['verdict']}] {r.get('failed', '')}")
    return "\n".join(parts)


def good(row: dict[str, Any]) -> bool:
    """Whether a case needs no second look."""
    group, seen = row["group"], any(h["detectable"] for h in row["hidden"])
    if "failed" in row:
        return False
    if group == "nothing":
        return not row["any_name"]
    if group == "outside":
        return not row["misnamed"] and (row["flagged"] or not seen)
    if group == "poor":
        return bool(row["poor_ok"])
    if group == "twins":
        return bool(row["twin_ok"]) or not seen
    return bool(row["exact"])
