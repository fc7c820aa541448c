"""``spsp-ctrl mechanism errors`` and ``mechanism paper``; with ``cli.mechanism_tolerance`` the commands of the error model."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from spsp_ctrl.cli.common import JSON, MECHANISM, OVERRIDE, PICTURE, bar, finite, guarded
from spsp_ctrl.cli.mechanism import SINE, _pose, _require_pictures, _show, load
from spsp_ctrl.cli.mechanism_tolerance import budget, tolerance

if TYPE_CHECKING:
    from spsp_ctrl.config.scenario import Sine
    from spsp_ctrl.mechanism.error_analysis import Valued, Wave
    from spsp_ctrl.mechanism.error_model import Source
    from spsp_ctrl.mechanism.workspace import Travel


@click.group()
def errors() -> None:
    """What manufacturing and thermal errors do to the attitude: each source, along a motion, at poses."""


SOURCES = click.option(
    "--source",
    "given",
    multiple=True,
    metavar="NAME[=VALUE UNIT]",
    help="Error source, e.g. dl1=20um or frame_temperature=10K; may be repeated. `errors sources` lists all.",
)
FILE = click.option("--file", "-f", "file", type=click.Path(path_type=Path), help="Take sources and sizes from a tolerance file.")
_NUMBER = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")


def _known(name: str, known: dict[str, Source]) -> Source:
    import difflib

    if name not in known:
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
        raise click.BadParameter(f"unknown error source {name!r}" + (f"; did you mean {near[0]!r}?" if near else "; see `errors sources`"))
    return known[name]


def _value(text: str, known: dict[str, Source]) -> tuple[Source, float | None]:
    """``NAME`` or ``NAME=VALUE UNIT``."""
    from spsp_ctrl.config.tolerances import check_unit
    from spsp_ctrl.config.units import UNITS

    name, equals, rest = text.partition("=")
    source = _known(name.strip(), known)
    if not equals:
        return source, None
    match = _NUMBER.match(rest)
    if match is None:
        raise click.BadParameter(f"--source {text}: {rest!r} is not a number with its unit, e.g. {source.name}=20um")
    number, unit = match.groups()
    if not unit:
        raise click.BadParameter(f"--source {text}: the value has no unit, e.g. {source.name}={number}um")
    try:
        check_unit(unit, source.si_unit)
    except ValueError as error:
        raise click.BadParameter(f"--source {text}: {error}") from None
    value = float(number) * UNITS[unit][1]
    if value == 0.0 or abs(value) > 1e3:
        raise click.BadParameter(f"--source {text}: the size of an error must not be 0 (or more than 1000 in SI units)")
    return source, value


def _sources(travel: Travel, given: tuple[str, ...], file: Path | None) -> list[tuple[Source, float | None]]:
    """What the options name; the paper's four with the sizes of its Table 2 when they name nothing."""
    from spsp_ctrl.config.error_sources import PAPER
    from spsp_ctrl.mechanism.error_model import error_sources
    from spsp_ctrl.mechanism.paper_claims import TABLE_2_M

    known = error_sources(travel.lengths_m)
    if file is not None and given:
        raise click.UsageError("--file brings its own sources: leave --source away")
    if file is not None:
        from spsp_ctrl.config.loader import load_tolerances
        from spsp_ctrl.mechanism.tolerance import tolerances_of

        return [(t.source, t.limit) for t in tolerances_of(load_tolerances(file).model, travel.lengths_m)]
    if given:
        found = [_value(text, known) for text in given]
        names = [source.name for source, _ in found]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise click.UsageError(f"--source {twice} is given twice")
        return found
    return [(known[name], size) for name, size in zip(PAPER, TABLE_2_M, strict=True)]


@errors.command("sources", epilog="Example: spsp-ctrl mechanism errors sources --config config/rig.yaml")
@MECHANISM
@OVERRIDE
@click.option("--file", "-f", "file", type=click.Path(path_type=Path), help="Take the materials (thermal expansion) from a tolerance file.")
@JSON
@guarded
def errors_sources(config: Path, overrides: tuple[str, ...], file: Path | None, as_json: bool) -> None:
    """Every known error source: what it means, and the attitude error that a small step of it gives."""
    _, travel = load(config, overrides)
    from spsp_ctrl.mechanism.error_model import error_sources
    from spsp_ctrl.report import error_text

    materials = None
    if file is not None:
        from spsp_ctrl.config.loader import load_tolerances
        from spsp_ctrl.mechanism.tolerance import materials_of

        materials = materials_of(load_tolerances(file).model, travel.lengths_m)
    result = error_text.sources_dict(travel, list(error_sources(travel.lengths_m, materials).values()))
    click.echo(json.dumps(result, indent=2, allow_nan=False) if as_json else "\n".join(error_text.sources_lines(result)))


def _waves(sines: tuple[Sine, ...]) -> list[Wave]:
    from math import radians

    return [(radians(s.amplitude_deg), s.period_s, radians(s.phase_deg)) for s in sines]


@errors.command("dynamic", epilog="Example: spsp-ctrl mechanism errors dynamic --config config/rig.yaml --source dl1=20um --source dh=10um")
@MECHANISM
@OVERRIDE
@SOURCES
@FILE
@click.option("--pitch", multiple=True, type=SINE, metavar="DEG/S[/DEG]", help="Sine of pitch: amplitude/period[/phase]. Default 15/4 and 20/8.")
@click.option("--roll", multiple=True, type=SINE, metavar="DEG/S[/DEG]", help="The same of roll.")
@PICTURE
@JSON
@guarded
def errors_dynamic(
    config: Path,
    overrides: tuple[str, ...],
    given: tuple[str, ...],
    file: Path | None,
    pitch: tuple[Sine, ...],
    roll: tuple[Sine, ...],
    out: Path | None,
    as_json: bool,
) -> None:
    """Attitude error along a motion: each source alone, then all together (section 3.2, Figs 5 to 7 and 10).

    Together means with the signs as given; the last line is the worst case of any signs. Without --source and --file: Table 2.
    """
    _require_pictures(out)
    _, travel = load(config, overrides)
    chosen = _sources(travel, given, file)
    values = _with_sizes(chosen)
    from spsp_ctrl.mechanism.error_analysis import paper_motion, respond, separate_and_together, sine_motion
    from spsp_ctrl.report import error_text

    motion = sine_motion(_waves(pitch), _waves(roll)) if pitch or roll else paper_motion()
    _check_motion(travel, motion)
    responses = _responses(
        lambda: [respond(c, motion.pitch_rad, motion.roll_rad, travel.lengths_m) for c in separate_and_together(values)]
    )
    together = error_text.envelope(motion, travel, responses[-1]) if len(values) > 1 else None
    result = error_text.dynamic_dict(motion, responses, together)
    figure = None
    if out is not None:
        from spsp_ctrl.report.error_figures import dynamic_figure

        figure = dynamic_figure(motion, responses, worst=together)
    _show(result, error_text.dynamic_lines(result, responses), as_json, out, "errors-dynamic", figure)


def _with_sizes(chosen: list[tuple[Source, float | None]]) -> Valued:
    missing = next((source.name for source, size in chosen if size is None), None)
    if missing:
        raise click.UsageError(f"--source {missing} needs a size here, e.g. {missing}=20um")
    return tuple((source, size) for source, size in chosen if size is not None)


def _check_motion(travel: Travel, motion: Any) -> None:
    """Joint limits; the stroke is left to ``mechanism motion``."""
    import numpy as np

    for name, angle, limit in (("pitch", motion.pitch_rad, travel.pitch_limit_rad), ("roll", motion.roll_rad, travel.roll_limit_rad)):
        peak = float(np.abs(angle).max())
        if peak > limit * (1.0 + 1e-9):
            raise click.UsageError(f"--{name}: {np.degrees(peak):.3f} deg is beyond {name}_limit_deg = {np.degrees(limit):g} of the mechanism")


def _responses(compute: Any) -> Any:
    """Errors too large for any attitude are the user's."""
    try:
        return compute()
    except ValueError as error:
        raise click.UsageError(str(error)) from None


@errors.command("static", epilog="Example: spsp-ctrl mechanism errors static --config config/rig.yaml --at 12 -8 --source upper_radius=50um")
@MECHANISM
@OVERRIDE
@SOURCES
@FILE
@click.option(
    "--at", multiple=True, nargs=2, type=click.FloatRange(-90.0, 90.0), callback=lambda c, p, v: [finite(c, p, pair) for pair in v],
    metavar="PITCH ROLL", help="A pose, degrees; may be repeated. Default: the corners A to D of the joint limits.",
)
@PICTURE
@JSON
@guarded
def errors_static(
    config: Path,
    overrides: tuple[str, ...],
    given: tuple[str, ...],
    file: Path | None,
    at: list[tuple[float, float]],
    out: Path | None,
    as_json: bool,
) -> None:
    """Attitude error at poses while each source grows (section 3.3, Figs 8 and 9).

    A source with a size grows up to it in eight steps; without, over Table 3 (10 um to 0.5 mm), 1 mrad or 50 K.
    """
    _require_pictures(out)
    loaded, travel = load(config, overrides)
    chosen: list[tuple[Source, float | None]] = _sources(travel, given, file)
    if not given and file is None:
        chosen = [(source, None) for source, _ in chosen]
    poses = [_pose(loaded, travel, pair) for pair in at]
    from spsp_ctrl.mechanism.error_analysis import TABLE_3_M, corners, static_tables
    from spsp_ctrl.report import error_text

    points = [(f"{k + 1}", *pose) for k, pose in enumerate(poses)] or list(corners(travel.pitch_limit_rad, travel.roll_limit_rad))
    largest = {"rad": 1e-3, "K": 50.0}

    def sizes(source: Source, size: float | None) -> list[float]:
        if size is None and source.si_unit == "m":
            return list(TABLE_3_M)
        reach = largest.get(source.si_unit, 0.0) if size is None else size
        return [reach * k / 8.0 for k in range(1, 9)]

    tables = _responses(
        lambda: [
            static_tables([p for _, p, _ in points], [r for _, _, r in points], travel.lengths_m, [source], sizes(source, size))[0]
            for source, size in chosen
        ]
    )
    result = error_text.static_dict(points, tables)
    figure = None
    if out is not None:
        from spsp_ctrl.report.error_figures import static_figure

        figure = static_figure(points, tables)
    _show(result, error_text.static_lines(points, tables), as_json, out, "errors-static", figure)


@click.command(epilog="Example: spsp-ctrl mechanism paper --out pictures --markdown docs/paper-claims.md")
@click.option("--markdown", type=click.Path(path_type=Path), metavar="FILE", help="Write the table as a page.")
@click.option("--out", "-o", type=click.Path(path_type=Path), metavar="DIR", help="Write Figs 5 to 10 (SVG) to this folder.")
@JSON
@guarded
def paper(markdown: Path | None, out: Path | None, as_json: bool) -> None:
    """Every numeric claim of the paper's sections 2 and 3: what its own model gives, and whether the two agree.

    Computed with the paper's geometry and inputs, whatever the rig file says; the Monte Carlo takes 1,000,000 units.
    """
    _require_pictures(out)
    from spsp_ctrl.mechanism.paper_claims import paper_claims
    from spsp_ctrl.report import paper_page

    with bar("Monte Carlo", as_json) as advance:
        claims = paper_claims(advance=advance)
    written = []
    if out is not None:
        from spsp_ctrl.report.error_figures import paper_figures

        written += paper_figures(out)
    if markdown is not None:
        markdown.write_text(paper_page.claims_page(claims), encoding="utf-8")
        written.append(markdown)
    if as_json:
        result = paper_page.claims_dict(claims)
        result["written"] = [str(path) for path in written]
        click.echo(json.dumps(result, indent=2, allow_nan=False))
    else:
        click.echo("\n".join([*paper_page.claims_lines(claims), *(f"written: {path}" for path in written)]))


COMMANDS: tuple[click.Command, ...] = (errors, tolerance, budget, paper)
"""To be added to the group ``mechanism``."""
