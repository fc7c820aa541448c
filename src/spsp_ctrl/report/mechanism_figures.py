"""Pictures of the mechanism: workspace with conditioning, mobility, rod demand of a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from spsp_ctrl.experiments.motion import MotionDemand
from spsp_ctrl.mechanism import mobility
from spsp_ctrl.mechanism.chain import JointMotion
from spsp_ctrl.mechanism.frames import joint_rotation
from spsp_ctrl.mechanism.workspace import Map, Travel, Workspace, conditioning_map
from spsp_ctrl.report import plots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARCMIN = 60.0 * 180.0 / np.pi
AROUND = 1.3
"""The map goes this much beyond the joint limits."""


def workspace_figure(found: Workspace, points: int = 81) -> Figure:
    """Conditioning and error per rod error over the attitudes, with what limits the travel."""
    travel = found.travel
    axes = (np.linspace(-AROUND, AROUND, points) * limit for limit in (travel.pitch_limit_rad, travel.roll_limit_rad))
    grid = conditioning_map(travel, *axes)
    fig = plots.figure(10.5, 5.4)
    left, right = fig.subplots(1, 2)
    _map(left, grid, travel, grid.conditioning, "conditioning (1 = every direction alike)", "viridis", "%.2f")
    label = "worst attitude error, arcmin per 10 µm of rod"
    _map(right, grid, travel, 1e-5 / grid.weakest_m * ARCMIN, label, "cividis_r", "%.3f")
    handles, labels = left.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3)
    return fig


def _map(ax: Axes, grid: Map, travel: Travel, value: Any, title: str, colours: str, form: str) -> None:
    pitch, roll = np.degrees(grid.pitch_rad), np.degrees(grid.roll_rad)
    inside = value[grid.within]
    low, high = float(inside.min()), float(inside.max())
    filled = ax.contourf(pitch, roll, value, levels=np.linspace(low, high, 25), cmap=colours, extend="both", antialiased=False)
    lines = ax.contour(pitch, roll, value, levels=np.linspace(low, high, 7), colors="white", linewidths=0.6)
    ax.clabel(lines, fmt=form, fontsize=7, colors="black")
    # what cannot be reached is washed out
    ax.contourf(pitch, roll, grid.within.astype(float), levels=[-0.5, 0.5], colors=["white"], alpha=0.6)
    p, r = np.degrees(travel.pitch_limit_rad), np.degrees(travel.roll_limit_rad)
    ax.plot([-p, p, p, -p, -p], [-r, -r, r, r, -r], color="black", linewidth=1.2, label="joint limits")
    for moved, colour, name in ((grid.travel1_m, plots.PITCH, "pitch"), (grid.travel2_m, plots.ROLL, "roll")):
        for end, style, what in ((travel.stroke_min_m, "-", "retracted"), (travel.stroke_max_m, "--", "extended")):
            if moved.min() < end < moved.max():
                ax.contour(pitch, roll, moved, levels=[end], colors=[colour], linestyles=[style], linewidths=1.6)
                ax.plot([], [], color=colour, linestyle=style, label=f"{name} rod fully {what}, {1e3 * end:+.1f} mm")
    ax.set(title=title, xlabel="pitch, deg", ylabel="roll, deg", xlim=(pitch[0, 0], pitch[-1, 0]), ylim=(roll[0, 0], roll[0, -1]))
    ax.set_aspect("equal")
    ax.grid(False)
    assert ax.figure is not None
    ax.figure.colorbar(filled, ax=ax, shrink=0.85, ticks=np.linspace(low, high, 7), format=form)


def mobility_figure(travel: Travel, pitch_rad: float, roll_rad: float) -> Figure:
    """The linkage with its joint axes and the redundant wrench, and why R must be parallel to y."""
    fig = plots.figure(10.5, 5.8)
    grid = fig.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    _linkage(fig.add_subplot(grid[0], projection="3d"), travel, pitch_rad, roll_rad)
    ax = fig.add_subplot(grid[1])
    sweep = np.linspace(-1.0, 1.0, 161) * travel.pitch_limit_rad
    variants: tuple[tuple[mobility.Axis, str, str], ...] = (
        ("y", plots.PITCH, "R axis parallel y: 2 freedoms at every pose"),
        ("x", plots.ROLL, "R axis parallel x, as in Eq (1): 1 once the leg leans"),
    )
    for r_axis, colour, label in variants:
        rps = mobility.mobility(sweep, roll_rad, *travel.lengths_m, r_axis=r_axis).branches[1]
        ax.semilogy(np.degrees(sweep), np.maximum(rps.residual, 1e-18), color=colour, label=label)
    ax.axhline(mobility.TOLERANCE, color=plots.GREY, linestyle=":", label="counted as rank above this")
    ax.set(
        title=f"distance of the RPS wrench from the U joint's, roll {np.degrees(roll_rad):g}°",
        xlabel="pitch, deg",
        ylim=(1e-18, 10.0),
    )
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1))
    return fig


def _linkage(ax: Any, travel: Travel, pitch_rad: float, roll_rad: float) -> None:
    rotation = np.array(joint_rotation(pitch_rad, roll_rad)).reshape(3, 3)
    h, upper, lower = (1e3 * v for v in travel.lengths_m)
    p = np.zeros(3)
    a, b = [upper * rotation[:, k] for k in (0, 1)], [np.array([lower, 0.0, -h]), np.array([0.0, lower, -h])]
    foot = np.array([0.0, 0.0, -h])

    def line(start: Any, end: Any, **style: Any) -> None:
        ax.plot(*np.stack((start, end), axis=1), **style)

    line(foot, p, color=plots.GREY, linewidth=4.0, solid_capstyle="round")
    corner = [upper * 1.15 * (i * rotation[:, 0] + j * rotation[:, 1]) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    ax.plot(*np.array(corner).T, color=plots.GREY, linewidth=1.0)
    names = (("pitch rod (RPS)", plots.PITCH), ("roll rod (UPS)", plots.ROLL))
    for k, (name, colour) in enumerate(names):
        line(b[k], a[k], color=colour, linewidth=2.5, label=name)
        line(foot, b[k], color=plots.GREY, linewidth=1.0)
        ax.scatter(*a[k], color=colour, s=36)
        ax.text(*(a[k] + [0, 0, 0.05 * h]), f"A{k + 1} (S)", fontsize=8)
    ax.text(*(b[0] + [0, 0, -0.12 * h]), "B1 (R)", fontsize=8)
    ax.text(*(b[1] + [0, 0, -0.12 * h]), "B2 (U)", fontsize=8)
    ax.text(0.0, 0.0, 0.1 * h, "P (U)", fontsize=8)
    reach = 0.45 * upper
    y = np.array([0.0, reach, 0.0])
    for centre, axis in ((b[0], y), (b[1], y), (p, y), (p, 0.45 * upper * rotation[:, 0]), (b[1], np.array([reach, 0.0, 0.0]))):
        line(centre - axis, centre + axis, color="black", linewidth=1.0, linestyle="--")
    ax.quiver(*a[0], 0.0, 0.9 * upper, 0.0, color="#b91c1c", linewidth=2.0, label="redundant: force along y through A1")
    ax.quiver(*p, 0.0, -0.9 * upper, 0.0, color="#b91c1c", linewidth=1.0, linestyle=":")
    ax.set(xlabel="x, mm", ylabel="y, mm", zlabel="z, mm")
    ax.set_title(f"pitch {np.degrees(pitch_rad):g}°, roll {np.degrees(roll_rad):g}°; dashed: joint axes")
    ax.set_aspect("equal")
    ax.view_init(elev=18.0, azim=-52.0)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02))


def motion_figure(travel: Travel, demand: MotionDemand) -> Figure:
    """Joint angles and the travel, speed and acceleration of both rods over time."""
    fig = plots.figure(9.0, 8.0)
    rows = fig.subplots(4, 1, sharex=True)
    thin = max(1, len(demand.t_s) // 4000)  # the extremes are in the table; a curve needs no more points
    t, joints = demand.t_s[::thin], JointMotion(*(np.asarray(y)[::thin] for y in demand.joints))  # type: ignore[arg-type]
    s1, s2, v1, v2, a1, a2 = (y[::thin] for y in demand.rods)
    top: Axes = rows[0]
    top.plot(t, np.degrees(joints.pitch_rad), color=plots.PITCH, label="pitch")
    top.plot(t, np.degrees(joints.roll_rad), color=plots.ROLL, label="roll")
    top.plot(t, np.degrees(joints.azimuth_rad), color=plots.THIRD, label="azimuth")
    top.set(title="joint angles, deg")
    for ax, pair, title in (
        (rows[1], (s1, s2), "rod travel from level, mm"),
        (rows[2], (v1, v2), "rod speed, mm/s"),
        (rows[3], (a1, a2), "rod acceleration, mm/s²"),
    ):
        for y, colour, name in zip(pair, (plots.PITCH, plots.ROLL), ("pitch rod", "roll rod"), strict=True):
            ax.plot(t, 1e3 * y, color=colour, label=name)
        ax.set(title=title)
    for end in (travel.stroke_min_m, travel.stroke_max_m):
        rows[1].axhline(1e3 * end, color=plots.GREY, linestyle="--", linewidth=1.0)
    rows[1].plot([], [], color=plots.GREY, linestyle="--", label="stroke")
    for ax in rows[:2]:
        ax.legend(loc="upper right", ncols=3)
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.25 * (high - low))
    rows[3].set(xlabel="time, s", xlim=(t[0], t[-1]))
    return fig
