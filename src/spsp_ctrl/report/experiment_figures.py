"""The pictures of an experiment, by the names that a scenario lists under ``figures``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.summary import look_up
from spsp_ctrl.experiments.verdict import CaseResult
from spsp_ctrl.report.svg import Level, Style
from spsp_ctrl.report.xy import Chart, Line, render_chart

LAW_STYLE: dict[str, Style] = {"cascade": "roll", "stabiliser": "pitch"}
STYLES: tuple[Style, ...] = ("pitch", "roll", "third", "base")
TIME = "time, s"
Results = Sequence[CaseResult]


def _both(value: float, label: str) -> list[Level]:
    return [Level(value, label), Level(-value, label)]


def _variants(results: Results) -> list[str]:
    return list(dict.fromkeys(r.variant for r in results))


def _worst(results: Results, variant: str, law: str, path: str) -> CaseResult | None:
    """The repeat with the largest figure."""
    mine = [r for r in results if r.variant == variant and r.law == law]
    return max(mine, key=lambda r: abs(look_up(r.figures, path) or 0.0), default=None)


def _line(r: CaseResult, curve: str, name: str, style: Style, soft: bool = False, dots: bool = False) -> list[Line]:
    found = r.curves.get(curve)
    return [] if found is None else [Line(name, found[0], found[1], style, soft, dots)]


def _label(r: CaseResult) -> str:
    return f"{r.variant}, {r.law}" if r.variant else r.law


def _reach(charts: Iterable[list[Line]], least: float) -> float:
    peaks = [float(np.abs(line.y).max()) for lines in charts for line in lines if len(line.y)]
    return 1.1 * max([least, *peaks])


def errors(scenario: Scenario, results: Results) -> list[Chart]:
    """Attitude error by the IMU over time; of each variant and law the worst repeat, all on one scale."""
    moved = [a for a in ("pitch", "roll") if getattr(scenario.base, a) or getattr(scenario.base.sea, a)] or ["pitch", "roll"]
    sets: list[tuple[str, list[Line]]] = []
    for variant in _variants(results):
        for axis in moved:
            lines: list[Line] = []
            for law in dict.fromkeys(r.law for r in results):
                r = _worst(results, variant, law, f"error_arcmin.{axis}.imu_max")
                if r is not None:
                    lines += _line(r, f"error.{axis}.imu", f"{law}, seed {r.seed}", LAW_STYLE[law])
            sets.append((f"{variant + ': ' if variant else ''}{axis} error by the IMU", lines))
    reach = _reach((lines for _, lines in sets), 0.3)
    if 1.0 < reach < 3.3:
        reach = 3.3  # so that the paper's bound is in the picture
    levels = _both(3.0, "3′") + _both(5.0, "5′")
    return [Chart(title, "arcmin", TIME, lines, levels, reach) for title, lines in sets]


def base(scenario: Scenario, results: Results) -> list[Chart]:
    """Motion of the swing table in the first repeat of each variant."""
    charts = []
    for variant in _variants(results):
        r = next(r for r in results if r.variant == variant)
        lines = _line(r, "base.pitch", "pitch", "pitch") + _line(r, "base.roll", "roll", "roll")
        charts.append(Chart(f"{variant + ': ' if variant else ''}swing table", "degrees", TIME, lines, height_px=130))
    return charts[:1] if len({tuple(line.y.tobytes() for line in c.lines) for c in charts}) == 1 else charts


def stations(scenario: Scenario, results: Results) -> list[Chart]:
    """Angle and rod error over the commanded angle, both passes."""
    charts = []
    for r in results:
        if r.repeat or "stations.angle.rising" not in r.curves:
            continue
        for kind, unit, level in (("angle", "arcsec", _both(70.0, "70″")), ("rod", "µm", _both(30.0, "30 µm"))):
            style: Style = "pitch" if kind == "angle" else "roll"
            lines = _line(r, f"stations.{kind}.rising", "rising", style, dots=True)
            lines += _line(r, f"stations.{kind}.falling", "falling", style, soft=True, dots=True)
            title = f"{r.variant + ': ' if r.variant else ''}{'platform angle error' if kind == 'angle' else 'rod error'}, IMU less resolver"
            charts.append(Chart(title, unit, "commanded angle, deg", lines, level, height_px=170))
    return charts


def open_loop(scenario: Scenario, results: Results) -> list[Chart]:
    """Angle and rod error over time, with the angle itself."""
    charts = []
    for r in results:
        if r.repeat or "open_loop.place" not in r.curves:
            continue
        head = f"{r.variant + ': ' if r.variant else ''}"
        for kind, unit, level in (("angle", "arcsec", _both(50.0, "50″")), ("rod", "µm", _both(30.0, "30 µm"))):
            lines = _line(r, f"open_loop.{kind}.imu", "IMU less resolver", "pitch" if kind == "angle" else "roll")
            lines += _line(r, f"open_loop.{kind}.true", "true less resolver", "base")
            charts.append(Chart(f"{head}{'platform angle' if kind == 'angle' else 'rod'} error", unit, TIME, lines, level))
        charts.append(Chart(f"{head}platform angle", "degrees", TIME, _line(r, "open_loop.place", "by resolver", "base"), height_px=100))
    return charts


def push_rod(scenario: Scenario, results: Results) -> list[Chart]:
    """Grating less resolver over the displacement, one colour per load."""
    lines: list[Line] = []
    for r, style in zip((r for r in results if r.repeat == 0), STYLES, strict=False):
        lines += _line(r, "push_rod.extending", f"{r.variant}, extending", style, dots=True)
        lines += _line(r, "push_rod.retracting", "retracting", style, soft=True, dots=True)
    levels = _both(50.0, "50 µm") + _both(70.0, "70 µm")
    return [Chart("Rod error, grating less resolver", "µm", "displacement by the resolver, mm", lines, levels, height_px=320)]


def heading(scenario: Scenario, results: Results) -> list[Chart]:
    """Heading error over time, demand against heading, and joint less step count."""
    charts = []
    for variant in _variants(results):
        head = f"{variant + ': ' if variant else ''}"
        lines: list[Line] = []
        for law in dict.fromkeys(r.law for r in results):
            r = _worst(results, variant, law, "pointing.hold_deg_max")
            if r is not None:
                lines += _line(r, "heading.error", law, LAW_STYLE[law])
        charts.append(Chart(f"{head}heading error by the IMU", "degrees", TIME, lines, _both(0.2, "0.2°"), height_px=150))
        last = [r for r in results if r.variant == variant][-1]
        slews = any(t.at_s > 0.0 for t in scenario.reference.heading) or (look_up(last.figures, "pointing.slews") or 0.0) > 0
        if slews:
            turn = _line(last, "heading.demand", "demand", "base") + _line(last, "heading.imu", "heading by the IMU", "third")
            turn += _line(last, "heading.joint", "azimuth joint by the step count", "roll", soft=True)
            charts.append(Chart(f"{head}heading and azimuth joint, {last.law}", "degrees", TIME, turn))
            gap = _line(last, "heading.gap", "azimuth by IMU and table encoders, less the step count", "third")
            charts.append(Chart(f"{head}lost-step check, {last.law}", "degrees", TIME, gap, _both(0.2, "0.2°"), height_px=110))
    return charts


def thermal(scenario: Scenario, results: Results) -> list[Chart]:
    """Drift of the platform from its cold attitude over time, all variants of one kind together."""
    charts = []
    first = [r for r in results if r.repeat == 0 and "thermal.true.pitch" in r.curves]
    groups: dict[str, list[CaseResult]] = {}
    for r in first:
        groups.setdefault(r.variant.split(",")[0], []).append(r)
    for name, members in groups.items():
        lines: list[Line] = []
        for r, style in zip(members, STYLES, strict=False):
            lines += _line(r, "thermal.true.pitch", r.variant.partition(", ")[2] or r.variant, style)
        charts.append(Chart(f"{name}: true drift in pitch", "arcmin", TIME, lines, height_px=170))
    if first:
        rise = _line(first[0], "thermal.screw", "screw sensor", "roll")
        charts.append(Chart("Temperature rise", "K", TIME, rise, height_px=100))
    return charts


FIGURES: dict[str, Callable[[Scenario, Results], list[Chart]]] = {
    "errors": errors,
    "base": base,
    "stations": stations,
    "open_loop": open_loop,
    "push_rod": push_rod,
    "heading": heading,
    "thermal": thermal,
}


def render(scenario: Scenario, results: Results) -> str:
    """Every figure that the scenario names, in its order."""
    if not any(name in FIGURES for name in scenario.figures):
        return ""
    good = [r for r in results if r.curves]
    if not good:
        return '<p class="note">No run completed: nothing to draw.</p>'
    return "".join(render_chart(chart) for name in scenario.figures if name in FIGURES for chart in FIGURES[name](scenario, good))
