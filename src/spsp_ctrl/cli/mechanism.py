"""``spsp-ctrl mechanism``: design questions about the mechanism of a rig file, or of a file with nothing else."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from spsp_ctrl.cli.common import JSON, MECHANISM, OVERRIDE, PICTURE, finite, guarded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from spsp_ctrl.config.loader import Loaded
    from spsp_ctrl.config.scenario import BaseMotion, ReferencePlan, Sine
    from spsp_ctrl.mechanism.workspace import Travel


@click.group()
def mechanism() -> None:
    """How far the mechanism moves, how it is constrained, what a motion asks of it."""


def load(path: Path, overrides: tuple[str, ...]) -> tuple[Loaded[Any], Travel]:
    """The file and its mechanism in SI units."""
    from spsp_ctrl.config.loader import apply_overrides, load_mechanism
    from spsp_ctrl.mechanism.workspace import Travel

    loaded: Loaded[Any] = load_mechanism(path)
    if overrides:
        loaded = apply_overrides(loaded, overrides)
    return loaded, Travel.of(loaded.model.mechanism)


def _pose(loaded: Loaded[Any], travel: Travel, at: tuple[float, float]) -> tuple[float, float]:
    """A pose given in degrees, in rad; one that cannot be reached is an error at the key that forbids it."""
    from math import radians

    from spsp_ctrl.config.loader import ConfigError, ConfigProblem
    from spsp_ctrl.mechanism.workspace import UnreachablePose, check_pose

    pitch, roll = (radians(angle) for angle in at)
    try:
        check_pose(travel, pitch, roll)
    except UnreachablePose as error:
        line, column = loaded.locate(("mechanism", error.field))
        raise ConfigError([ConfigProblem(loaded.path, line, column, str(error))]) from None
    return pitch, roll


def _show(result: dict[str, Any], lines: list[str], as_json: bool, out: Path | None, name: str, figure: Figure | None) -> None:
    """Print the result; write the picture first, so that nothing is printed for a folder that cannot be written."""
    if out is not None and figure is not None:
        from spsp_ctrl.report import plots

        result["picture"] = str(plots.save(figure, out, name))
        lines = [*lines, "", f"picture: {result['picture']}"]
    click.echo(json.dumps(result, indent=2, allow_nan=False) if as_json else "\n".join(lines))


def _require_pictures(out: Path | None) -> None:
    if out is not None:
        from spsp_ctrl.report import plots

        plots.require()


AT = click.option(
    "--at",
    nargs=2,
    type=click.FloatRange(-90.0, 90.0),
    callback=finite,
    default=None,
    metavar="PITCH ROLL",
    help="One pose, degrees, e.g. --at 12 -8.",
)


@mechanism.command(epilog="Example: spsp-ctrl mechanism workspace --config config/rig.yaml --out pictures")
@MECHANISM
@OVERRIDE
@AT
@PICTURE
@JSON
@guarded
def workspace(config: Path, overrides: tuple[str, ...], at: tuple[float, float] | None, out: Path | None, as_json: bool) -> None:
    """Travel of joints and rods, what limits it, singularities, conditioning, hinge angles.

    With --at also the rod travel, Jacobian and conditioning of that pose.
    """
    _require_pictures(out)
    loaded, travel = load(config, overrides)
    pose = _pose(loaded, travel, at) if at is not None else None
    from spsp_ctrl.mechanism.workspace import workspace as compute
    from spsp_ctrl.report import mechanism_text

    found = compute(travel)
    result = mechanism_text.workspace_dict(found, pose)
    figure = None
    if out is not None:
        from spsp_ctrl.report.mechanism_figures import workspace_figure

        figure = workspace_figure(found)
    _show(result, mechanism_text.workspace_lines(result), as_json, out, "workspace", figure)


@mechanism.command(epilog="Example: spsp-ctrl mechanism mobility --config config/rig.yaml --at 12 -8")
@MECHANISM
@OVERRIDE
@AT
@click.option("--poses", default=10_000, type=click.IntRange(1, 1_000_000), show_default=True, help="Random poses within the joint limits.")
@click.option("--seed", default=1, type=click.IntRange(0, 2**31 - 1), show_default=True, help="Seed of the random poses.")
@PICTURE
@JSON
@guarded
def mobility(
    config: Path, overrides: tuple[str, ...], at: tuple[float, float] | None, poses: int, seed: int, out: Path | None, as_json: bool
) -> None:
    """Degrees of freedom by screw theory, and which constraint is redundant.

    Two mechanisms side by side: the R axis parallel to y, as it must be, and parallel to x, as Eq (1) of the paper prints it. At level (or
    at the pose of --at) and over random poses.
    """
    _require_pictures(out)
    loaded, travel = load(config, overrides)
    pose = _pose(loaded, travel, at) if at is not None else (0.0, 0.0)
    from spsp_ctrl.report import mechanism_text

    result = mechanism_text.mobility_dict(travel, pose, poses, seed)
    figure = None
    if out is not None:
        from spsp_ctrl.report.mechanism_figures import mobility_figure

        figure = mobility_figure(travel, *pose)
    _show(result, mechanism_text.mobility_lines(result), as_json, out, "mobility", figure)


class SineType(click.ParamType):  # type: ignore[type-arg]  # generic in the newest click only
    """``AMPLITUDE/PERIOD`` or ``AMPLITUDE/PERIOD/PHASE`` in deg, s, deg."""

    name = "sine"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Sine:
        """Parse and judge one sine."""
        from pydantic import ValidationError

        from spsp_ctrl.config.scenario import Sine

        if isinstance(value, Sine):
            return value
        try:
            numbers = [float(part) for part in str(value).split("/")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            self.fail(f"{value!r}: give amplitude and period as DEG/S, e.g. 15/4, or with a phase as DEG/S/DEG, e.g. 15/4/90", param, ctx)
        try:
            return Sine(amplitude_deg=numbers[0], period_s=numbers[1], phase_deg=numbers[2] if len(numbers) == 3 else 0.0)
        except ValidationError as error:
            first = error.errors()[0]
            self.fail(f"{value!r}: {first['loc'][0]}: {first['msg'][0].lower()}{first['msg'][1:]}", param, ctx)


SINE = SineType()


@mechanism.command(epilog="Example: spsp-ctrl mechanism motion --config config/rig.yaml --carrier --pitch 6/4 --roll 15/8")
@MECHANISM
@OVERRIDE
@click.option("--pitch", "pitch", multiple=True, type=SINE, metavar="DEG/S[/DEG]", help="Sine of pitch: amplitude/period[/phase]; may be repeated.")
@click.option("--roll", "roll", multiple=True, type=SINE, metavar="DEG/S[/DEG]", help="The same of roll.")
@click.option("--carrier", is_flag=True, help="The carrier makes this motion and the platform is held level; default: the joints make it.")
@click.option(
    "--axis-order",
    type=click.Choice(["roll_pitch", "pitch_roll"]),
    default="roll_pitch",
    show_default=True,
    help="Axes of the carrier's motion, outer first.",
)
@click.option("--scenario", type=click.Path(path_type=Path), help="Take carrier motion and reference from a scenario file instead.")
@click.option("--lock-azimuth", is_flag=True, help="Azimuth stands still and the heading is free; default: azimuth holds the heading.")
@click.option("--duration", type=click.FloatRange(0.1, 600.0), callback=finite, metavar="S", help="Length of the motion; default one common period.")
@PICTURE
@JSON
@guarded
def motion(
    config: Path,
    overrides: tuple[str, ...],
    pitch: tuple[Sine, ...],
    roll: tuple[Sine, ...],
    carrier: bool,
    axis_order: str,
    scenario: Path | None,
    lock_azimuth: bool,
    duration: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Travel, speed and acceleration of joints and rods for a motion of the platform or of the carrier.

    Where the motion leaves the joint limits or the stroke, the result says so and the exit code is 1.
    """
    _require_pictures(out)
    if scenario is not None and (pitch or roll or carrier):
        raise click.UsageError("--scenario brings its own motion: leave --pitch, --roll and --carrier away")
    if scenario is None and not (pitch or roll):
        raise click.UsageError("no motion given: use --pitch and --roll, e.g. --pitch 6/4 --roll 15/8, or --scenario FILE")
    base, reference = _plans(pitch, roll, carrier, axis_order, scenario)
    if lock_azimuth and (reference.pitch or reference.roll or reference.pitch_deg or reference.roll_deg):
        raise click.UsageError("--lock-azimuth needs a motion of the carrier with a level platform: add --carrier")
    _, travel = load(config, overrides)
    from spsp_ctrl.experiments.motion import motion_demand
    from spsp_ctrl.report import mechanism_text

    demand = motion_demand(travel, base, reference, duration, azimuth_locked=lock_azimuth)
    result = mechanism_text.motion_dict(travel, demand)
    figure = None
    if out is not None:
        from spsp_ctrl.report.mechanism_figures import motion_figure

        figure = motion_figure(travel, demand)
    _show(result, mechanism_text.motion_lines(result), as_json, out, "motion", figure)
    if result["beyond"]:
        raise SystemExit(1)


def _plans(
    pitch: tuple[Sine, ...], roll: tuple[Sine, ...], carrier: bool, axis_order: Any, scenario: Path | None
) -> tuple[BaseMotion, ReferencePlan]:
    from spsp_ctrl.config.scenario import BaseMotion, ReferencePlan

    if scenario is not None:
        from spsp_ctrl.config.loader import load_scenario

        plan = load_scenario(scenario).model
        return plan.base, plan.reference
    # both begin at the same time and are looked at one period later, so only their phases count
    if carrier:
        return BaseMotion(axis_order=axis_order, pitch=pitch, roll=roll), ReferencePlan()
    return BaseMotion(), ReferencePlan(kind="joint", pitch=pitch, roll=roll)
