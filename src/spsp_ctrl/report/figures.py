"""The figures of a run report, from signals to HTML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import yaml

from spsp_ctrl.report.data import ARCMIN_PER_RAD, DEG_PER_RAD, RunData, Series, Signals
from spsp_ctrl.report.svg import Band, Level, Panel, Style, TimeAxis, Trace, render_panel
from spsp_ctrl.report.text import PRIME, number

RIG_SCHEMA = "spsp-ctrl/rig/1"
AXES: tuple[Style, Style] = ("pitch", "roll")
PAPER_BOUND_ARCMIN = 3.0
OUTER_BOUND_ARCMIN = 5.0


@dataclass(frozen=True)
class Limits:
    """Limits that the figures draw; ``None`` when the log carries no rig file."""

    stroke_mm: tuple[float, float] | None = None
    rod_speed_mm_s: float | None = None
    current_a: float | None = None


def limits_of(data: RunData) -> Limits:
    """Read the limits from the resolved rig file attached to the log (found by its schema, whatever its name)."""
    for text in data.attachments.values():
        try:
            rig = yaml.safe_load(text)
        except yaml.YAMLError:
            continue
        if not isinstance(rig, Mapping) or rig.get("schema") != RIG_SCHEMA:
            continue
        mechanism, limits = rig.get("mechanism", {}), rig.get("limits", {})
        low, high = mechanism.get("stroke_min_mm"), mechanism.get("stroke_max_mm")
        return Limits(
            stroke_mm=(float(low), float(high)) if low is not None and high is not None else None,
            rod_speed_mm_s=_float(limits.get("rod_speed_mm_s")),
            current_a=_float(limits.get("current_a")),
        )
    return Limits()


def _float(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def _trace(name: str, series: Series | None, factor: float, style: Style, **look: bool) -> list[Trace]:
    return [] if series is None else [Trace(name, series.t_s, series.y * factor, style, **look)]


def _symmetric(limit: float | None) -> list[Level]:
    return [] if limit is None else [Level(s * limit, number(s * limit)) for s in (-1.0, 1.0)]


def _shared_range(panels: list[Panel]) -> tuple[float, float] | None:
    values = [t.y[np.isfinite(t.y)] for p in panels for t in p.traces]
    values = [v for v in values if len(v)]
    if not values:
        return None
    reach = max(float(np.abs(v).max()) for v in values) * 1.08
    return (-reach, reach) if reach > 0.0 else None


def attitude(signals: Signals, axis: TimeAxis) -> str:
    """Table and platform attitude, one panel per axis, on one common scale."""
    source = "" if signals.has_truth else ", estimated"
    panels = []
    for name in AXES:
        base, platform = signals.base(name), signals.platform(name)
        traces = _trace(f"swing table{_swing(base, axis)}", base, DEG_PER_RAD, "base", area=True)
        traces += _trace(f"platform{source}{_swing(platform, axis)}", platform, DEG_PER_RAD, name, bold=True)
        panels.append(Panel(name.capitalize(), "degrees", traces, min_span=0.2))
    common = _shared_range(panels)
    out = [render_panel(replace(panel, y_range=common), axis, last=k == 1) for k, panel in enumerate(panels)]
    return "".join(out)


def _swing(series: Series | None, axis: TimeAxis) -> str:
    """Largest deflection after the start-up, for the legend."""
    values = series.after(axis.settle_s) if series is not None else np.empty(0)
    if not len(values):
        return ""
    peak = float(np.abs(values).max()) * DEG_PER_RAD
    return f", ±{number(peak, 1 if peak >= 1.0 else 3)}°"


def attitude_error(signals: Signals, axis: TimeAxis) -> str:
    """Attitude error in arcmin against the bands at 3 and 5 arcmin, and once more enlarged."""
    traces = {
        name: (
            _trace("IMU-measured", signals.error(name, true=False), ARCMIN_PER_RAD, name, soft=signals.has_truth)
            + _trace("true", signals.error(name, true=True), ARCMIN_PER_RAD, name)
        )
        for name in AXES
    }
    judged = [t.y[(t.t_s >= axis.settle_s) & np.isfinite(t.y)] for both in traces.values() for t in both]
    peak = max((float(np.abs(y).max()) for y in judged if len(y)), default=0.0)
    bounds = [
        Level(s * v, f"{number(s * v)}{PRIME}") for v in (PAPER_BOUND_ARCMIN, OUTER_BOUND_ARCMIN) for s in (-1.0, 1.0)
    ]
    bands = (
        Band(-PAPER_BOUND_ARCMIN, PAPER_BOUND_ARCMIN, "good"),
        Band(PAPER_BOUND_ARCMIN, OUTER_BOUND_ARCMIN, "warn"),
        Band(-OUTER_BOUND_ARCMIN, -PAPER_BOUND_ARCMIN, "warn"),
    )
    inside = peak < OUTER_BOUND_ARCMIN
    reach = 1.2 * OUTER_BOUND_ARCMIN if inside else 1.1 * peak
    out = [
        render_panel(
            Panel(
                name.capitalize(),
                "arcmin",
                traces[name],
                bounds,
                bands,
                (-reach, reach),
                (-4.0, -2.0, 0.0, 2.0, 4.0) if inside else None,
            ),
            axis,
            last=False,
        )
        for name in AXES
    ]
    own = max(1.15 * peak, 0.05)
    for name in AXES:
        detail = Panel(f"{name.capitalize()}, enlarged", "arcmin", traces[name], y_range=(-own, own), height_px=150)
        out.append(render_panel(detail, axis, last=name == AXES[-1]))
    return "".join(out)


def azimuth(signals: Signals, axis: TimeAxis) -> str:
    """Heading error and the azimuth joint, in degrees."""
    error = _trace("measured", signals.error("heading", true=False), DEG_PER_RAD, "third", soft=signals.has_truth)
    error += _trace("true", signals.error("heading", true=True), DEG_PER_RAD, "third")
    judged = [t.y[(t.t_s >= axis.settle_s) & np.isfinite(t.y)] for t in error]
    peak = max((float(np.abs(y).max()) for y in judged if len(y)), default=0.0)
    reach = max(1.15 * peak, 0.01)
    joint = _trace("azimuth joint", signals.get("/control", "estimate.azimuth_rad"), DEG_PER_RAD, "third")
    yaw = signals.base("yaw")
    if yaw is not None and np.nanmax(np.abs(yaw.y), initial=0.0) > 0.0:
        joint = _trace("swing table yaw", yaw, DEG_PER_RAD, "base") + joint
    return render_panel(
        Panel("Heading error", "degrees", error, y_range=(-reach, reach)), axis, last=False
    ) + render_panel(Panel("Azimuth joint", "degrees", joint, min_span=0.1), axis)


def rods(signals: Signals, axis: TimeAxis, limits: Limits) -> str:
    """Rod travel with the ends of the stroke, and rod speed with its limit."""
    travel: list[Trace] = []
    speed: list[Trace] = []
    for name in AXES:
        travel += _trace(f"{name} leg", signals.get("/control", f"estimate.rod_{name}_m"), 1e3, name)
        speed += _trace(f"{name} leg", signals.rod_speed(name), 1e3, name)
    ends = [Level(v, number(v)) for v in limits.stroke_mm] if limits.stroke_mm else []
    bound = _symmetric(limits.rod_speed_mm_s)
    note = ""
    fastest = max((float(np.abs(t.y[np.isfinite(t.y)]).max(initial=0.0)) for t in speed), default=0.0)
    if limits.rod_speed_mm_s is not None and limits.rod_speed_mm_s > 2.0 * fastest:
        note = f"The speed limit of ±{number(limits.rod_speed_mm_s)} mm/s lies outside this frame."
    return render_panel(Panel("Rod travel from level", "mm", travel, ends, min_span=0.2), axis, False) + render_panel(
        Panel("Rod speed", "mm/s", speed, bound, min_span=0.2, note=note), axis
    )


def drives(signals: Signals, axis: TimeAxis, limits: Limits) -> str:
    """Motor currents with their limit, and what the compensations believe."""
    current: list[list[Trace]] = []
    backlash: list[Trace] = []
    thermal: list[Trace] = []
    for name in AXES:
        measured = signals.get("/measurement", f"drive_{name}.current_a")
        current.append(_trace(f"{name} motor", measured, 1.0, name))
        backlash += _trace(f"{name} leg", signals.get("/control", f"{name}.backlash_m"), 1e6, name)
        thermal += _trace(f"{name} leg", signals.get("/control", f"estimate.thermal_{name}_m"), 1e6, name)
    finite = [t.y[np.isfinite(t.y)] for traces in current for t in traces]
    peak = max((float(np.abs(y).max(initial=0.0)) for y in finite), default=0.0)
    note = ""
    if limits.current_a is not None and limits.current_a > 2.0 * peak:
        share = 100.0 * peak / limits.current_a
        note = f"The limit of ±{number(limits.current_a)} A lies outside these frames; {share:.0f} % of it was used."
    reach = 1.1 * max(peak, 0.05, limits.current_a or 0.0 if not note else 0.0)
    out = [
        render_panel(
            Panel(
                f"{name.capitalize()} motor current",
                "A",
                current[k],
                _symmetric(limits.current_a),
                y_range=(-reach, reach),
                height_px=140,
                note=note if k == 1 else "",
            ),
            axis,
            last=False,
        )
        for k, name in enumerate(AXES)
    ]
    out.append(render_panel(Panel("Backlash compensation", "µm", backlash, height_px=130, min_span=1.0), axis, False))
    out.append(render_panel(Panel("Thermal compensation", "µm", thermal, height_px=130, min_span=1.0), axis))
    return "".join(out)
