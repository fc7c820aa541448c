"""Pictures of the error commands: errors along a motion (Figs 5 to 7, 10), at poses (Figs 8, 9), tolerances, transmission budget (Fig 11)."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from spsp_ctrl.config.error_sources import PAPER
from spsp_ctrl.mechanism.budget import Budget
from spsp_ctrl.mechanism.error_analysis import (
    Case,
    Motion,
    PoseTable,
    Response,
    corners,
    paper_motion,
    respond,
    static_tables,
)
from spsp_ctrl.mechanism.error_model import error_sources
from spsp_ctrl.mechanism.paper_claims import LENGTHS_M, LIMIT_RAD, TABLE_2_M, TABLE_4_M
from spsp_ctrl.mechanism.tolerance import AXES, Tolerance, worst_case
from spsp_ctrl.mechanism.vectorised import Array
from spsp_ctrl.mechanism.workspace import Travel
from spsp_ctrl.report import plots
from spsp_ctrl.report.error_text import ARCMIN, DEG, SHOWN, Points, case_title, envelope
from spsp_ctrl.report.text import PRIME, number
from spsp_ctrl.report.tolerance_text import Check

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (plots.PITCH, plots.ROLL)
ERROR = "attitude error, arcmin"


def dynamic_figure(
    motion: Motion,
    responses: Sequence[Response],
    titles: Sequence[str] | None = None,
    worst: Array | None = None,
    requirement_arcmin: float | None = None,
) -> Figure:
    """One panel per case over the motion; ``worst`` (2, time) is drawn in the last one."""
    columns = min(2, len(responses))
    rows = ceil(len(responses) / columns)
    fig = plots.figure((5.6 if columns > 1 else 7.0) * columns + 0.4, 3.0 * rows + 1.8)
    grid = fig.add_gridspec(rows + 1, columns, height_ratios=(*[2.0] * rows, 1.0))
    thin = max(1, len(motion.t_s) // 2000)  # the extremes are in the table; a curve needs no more points
    t = motion.t_s[::thin]
    for k, response in enumerate(responses):
        alone = k == len(responses) - 1 and k % columns == 0
        ax = fig.add_subplot(grid[k // columns, :] if alone else grid[k // columns, k % columns])
        if worst is not None and k == len(responses) - 1:
            for axis in (0, 1):
                band = worst[axis][::thin] * ARCMIN
                ax.plot(t, band, t, -band, color=COLOURS[axis], linestyle=(0, (4, 2)), linewidth=1.0)
                ax.plot([], [], color=COLOURS[axis], linestyle=(0, (4, 2)), linewidth=1.0, label=f"{AXES[axis]}, worst signs")
            if requirement_arcmin is not None:
                for side in (-1.0, 1.0):
                    ax.axhline(side * requirement_arcmin, color="black", linewidth=0.8)
                ax.plot([], [], color="black", linewidth=0.8, label=f"±{requirement_arcmin:g}{PRIME}")
        for axis in (0, 1):
            curve = response.linear[axis][::thin] * ARCMIN
            ax.plot(t, curve, color=COLOURS[axis], label=AXES[axis])
        ax.set(title=titles[k] if titles else case_title(response), ylabel=ERROR, xlim=(t[0], t[-1]))
        _room_for_legend(ax)
    for column in range(columns):
        ax = fig.add_subplot(grid[rows, column])
        ax.plot(t, motion.pitch_rad[::thin] * DEG, color=plots.PITCH)
        ax.plot(t, motion.roll_rad[::thin] * DEG, color=plots.ROLL)
        ax.set(title="motion, deg", xlabel="time, s", xlim=(t[0], t[-1]))
    return fig


def _room_for_legend(ax: Axes) -> None:
    low, high = ax.get_ylim()
    if high - low < 1e-9:
        low, high = low - 0.1, high + 0.1
    ax.set_ylim(low, high + 0.22 * (high - low))
    ax.legend(loc="upper right", ncols=5, fontsize=7.5, columnspacing=1.2, handlelength=1.8)


def static_figure(points: Points, tables: Sequence[PoseTable], letters: bool = False) -> Figure:
    """One panel per source over its size: lines are the linear model, marks the exact one. ``letters`` numbers the panels (a), (b), …"""
    columns = 2 if len(tables) > 1 else 1
    rows = ceil(len(tables) / columns)
    fig = plots.figure(5.4 * columns + 0.3, 3.3 * rows + 0.5)
    styles = ("-", "--", "-.", ":")
    marks = ("o", "s", "^", "v")
    handles: list[tuple[Artist, str]] = []
    for k, table in enumerate(tables):
        ax = fig.add_subplot(rows, columns, k + 1)
        unit, factor = SHOWN[table.source.si_unit]
        sizes = table.sizes * factor
        reach = np.array([0.0, sizes.max()])
        for point, (name, pitch, roll) in enumerate(points):
            where = f"{name} ({number(round(pitch * DEG, 3))}°, {number(round(roll * DEG, 3))}°)"
            for axis in (0, 1):
                look: Any = {"color": COLOURS[axis], "linestyle": styles[point % 4]}
                slope = table.per_unit[axis, point] / factor * ARCMIN
                ax.plot(reach, slope * reach, linewidth=1.2, **look)
                ax.plot(sizes, table.exact[axis, point] * ARCMIN, marks[point % 4], markersize=3.5, color=COLOURS[axis])
                if k == 0:
                    (handle,) = ax.plot([], [], marker=marks[point % 4], markersize=3.5, **look)
                    handles.append((handle, f"{AXES[axis]} at {where}"))
        title = f"({'abcdefgh'[k % 8]}) {table.source.name}" if letters else f"{table.source.name}: {table.source.text}"
        ax.set(title=title, xlabel=f"{table.source.name}, {unit.replace('um', 'µm')}", ylabel=ERROR)
        ax.axhline(0.0, color=plots.GREY, linewidth=0.6)
    fig.legend([h for h, _ in handles], [text for _, text in handles], loc="outside lower center", ncols=2, fontsize=8)
    return fig


def check_figure(check: Check, tolerances: Sequence[Tolerance], travel: Travel) -> Figure:
    """Shares of the worst case, its map over the workspace, and the Monte Carlo."""
    fig = plots.figure(13.5, 4.6)
    bars, plane, histogram = fig.subplots(1, 3, width_ratios=(1.2, 1.0, 1.2))
    need = check.requirement_rad * ARCMIN
    order = np.argsort(check.worst.shares_rad)
    shares = check.worst.shares_rad[order] * ARCMIN
    left = np.concatenate(([0.0], np.cumsum(shares[::-1])[:-1]))[::-1]
    names = [tolerances[int(k)].source.name for k in order]
    bars.barh(names, shares, left=left, color=COLOURS[check.worst.axis])
    for k, (start, share) in enumerate(zip(left, shares, strict=True)):
        bars.text(start + share, k, f" {share:.2f}{PRIME}", va="center", fontsize=8)
    bars.axvline(need, color=plots.GREY, linestyle="--")
    bars.set(
        title=f"shares of the worst {AXES[check.worst.axis]} error; dashed: {need:g}{PRIME}",
        xlabel="arcmin, added from below",
        xlim=(0.0, 1.15 * max(check.worst.error_rad * ARCMIN, need)),
    )
    bars.grid(axis="y", visible=False)
    limits = np.array([t.limit for t in tolerances])
    side = round(len(check.poses.pitch_rad) ** 0.5)
    worst = worst_case(check.matrix, limits).max(axis=0).reshape(side, side) * ARCMIN
    pitch, roll = (a.reshape(side, side) * DEG for a in (check.poses.pitch_rad, check.poses.roll_rad))
    flat = float(np.ptp(worst)) < 1e-9
    filled = plane.contourf(pitch, roll, worst, levels=1 if flat else 20, cmap="cividis_r", antialiased=False)
    if worst.min() < need < worst.max():
        lines = plane.contour(pitch, roll, worst, levels=[need], colors="black", linewidths=1.2)
        plane.clabel(lines, fmt=f"{need:g}{PRIME}", fontsize=8)
    fig.colorbar(filled, ax=plane, shrink=0.85, format="%.2f")
    plane.set(title="worst case, pitch or roll, arcmin", xlabel="pitch, deg", ylabel="roll, deg")
    plane.set_aspect("equal")
    plane.grid(False)
    top = max(mc.quantile(0.9999) for mc in check.made.values()) * ARCMIN
    edges = np.linspace(0.0, 1.05 * max(top, need), 120)
    for (name, mc), colour in zip(check.made.items(), (plots.PITCH, plots.ROLL, plots.THIRD), strict=False):
        density, _ = np.histogram(mc.worst_rad * ARCMIN, bins=edges, density=True)
        label = f"{name}: {100.0 * mc.beyond(check.requirement_rad):.2f} % beyond"
        histogram.stairs(density, edges, color=colour, fill=True, alpha=0.35, label=label)
    histogram.axvline(need, color=plots.GREY, linestyle="--", label=f"{need:g}{PRIME}")
    units = next(iter(check.made.values())).units
    histogram.set(title=f"worst attitude error of {units} units, arcmin", xlim=(0.0, edges[-1]), yticks=[])
    histogram.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, fontsize=8)
    return fig


def budget_figure(budget: Budget) -> Figure:
    """Fig 11 with figures: what makes up the rod-length error."""
    fig = plots.figure(9.0, 1.7 + 0.42 * (len(budget.rows) + 2))
    ax = fig.subplots()
    kinds = {"play": plots.ROLL, "gear": plots.GREY, "screw": plots.PITCH, "thermal": "#b91c1c", "sensor": plots.THIRD}
    names = [row.name for row in budget.rows] + ["all, root sum square", "all, worst case"]
    values = [row.rod_m * 1e6 for row in budget.rows] + [budget.rss_m * 1e6, budget.worst_m * 1e6]
    colours = [kinds[row.kind] for row in budget.rows] + [plots.GREY] * 2
    ax.barh(names, values, color=colours)
    greatest = budget.effect.greatest * ARCMIN * 1e-6
    for k, value in enumerate(values):
        ax.text(value, k, f" {value:.1f} µm, {value * greatest:.2f}{PRIME}", va="center", fontsize=8)
    if budget.rod_limit_m is not None:
        ax.axvline(budget.rod_limit_m * 1e6, color="black", linestyle="--", label=f"limit {budget.rod_limit_m * 1e6:g} µm")
    for kind in dict.fromkeys(row.kind for row in budget.rows):
        ax.barh([names[0]], [0.0], color=kinds[kind], label=kind)
    ax.invert_yaxis()
    reach = max(1.25 * max(values), 1.05e6 * (budget.rod_limit_m or 0.0), 1.0)
    ax.set(title="rod-length error and the largest attitude error it gives", xlabel="µm", xlim=(0.0, reach))
    ax.grid(axis="y", visible=False)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=6, fontsize=8)
    return fig


def paper_figures(folder: Path) -> list[Path]:
    """Figs 5 to 10 of the paper by the corrected model, as SVG files in a folder."""
    motion = paper_motion()
    known = error_sources(LENGTHS_M)
    two, four = (tuple((known[n], v) for n, v in zip(PAPER, values, strict=True)) for values in (TABLE_2_M, TABLE_4_M))
    alone = [respond(Case(s.name, ((s, v),)), motion.pitch_rad, motion.roll_rad, LENGTHS_M) for s, v in two]
    seven = respond(Case("all errors of Table 2", two), motion.pitch_rad, motion.roll_rad, LENGTHS_M)
    ten = respond(Case("Table 4, all positive, and the worst signs", four), motion.pitch_rad, motion.roll_rad, LENGTHS_M)
    travel = Travel(*LENGTHS_M, LIMIT_RAD, LIMIT_RAD, -0.1, 0.1)
    points = corners(LIMIT_RAD, LIMIT_RAD)
    sources = [known[n] for n in PAPER]

    def at(some: Points) -> Figure:
        tables = static_tables([p for _, p, _ in some], [r for _, _, r in some], LENGTHS_M, sources)
        return static_figure(some, tables, letters=True)

    def lettered(responses: Sequence[Response]) -> list[str]:
        return [f"({letter}) {case_title(r)}" for letter, r in zip("ab", responses, strict=True)]

    figures = {
        "fig05": dynamic_figure(motion, alone[:2], lettered(alone[:2])),
        "fig06": dynamic_figure(motion, alone[2:], lettered(alone[2:])),
        "fig07": dynamic_figure(motion, [seven]),
        "fig08": at(points[:2]),
        "fig09": at(points[2:]),
        "fig10": dynamic_figure(motion, [ten], worst=envelope(motion, travel, ten), requirement_arcmin=3.0),
    }
    return [plots.save(fig, folder, name) for name, fig in figures.items()]
