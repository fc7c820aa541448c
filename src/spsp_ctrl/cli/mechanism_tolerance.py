"""``spsp-ctrl mechanism tolerance`` and ``mechanism budget``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from spsp_ctrl.cli.common import EXIT_ROW_FAILED, EXIT_USER, JSON, MECHANISM, OVERRIDE, PICTURE, bar, finite, guarded
from spsp_ctrl.cli.mechanism import _require_pictures, _show, load

if TYPE_CHECKING:
    from spsp_ctrl.config.tolerances import ToleranceFile
    from spsp_ctrl.mechanism.tolerance import Tolerance
    from spsp_ctrl.mechanism.workspace import Travel


@click.group()
def tolerance() -> None:
    """Do tolerances keep a requirement on the attitude, and which are the loosest that do."""


TOLERANCES = click.option(
    "--file", "-f", "file", required=True, type=click.Path(path_type=Path), help="Tolerance file, e.g. config/tolerances/table4.yaml."
)
REQUIREMENT = click.option(
    "--requirement-arcmin",
    type=click.FloatRange(0.001, 600.0),
    callback=finite,
    metavar="ARCMIN",
    help="Largest pitch or roll error allowed; default that of the file.",
)
UNITS = click.option("--units", default=1_000_000, type=click.IntRange(1000, 20_000_000), show_default=True, help="Units of the Monte Carlo.")
SEED = click.option("--seed", default=1, type=click.IntRange(0, 2**31 - 1), show_default=True, help="Seed of the Monte Carlo.")
ZEROED = click.option("--zeroed", is_flag=True, help="After the rods were set so that the platform is level at level.")


def _set(
    config: Path, overrides: tuple[str, ...], file: Path, requirement_arcmin: float | None
) -> tuple[Travel, ToleranceFile, tuple[Tolerance, ...], float]:
    """Mechanism, file, tolerances and requirement (rad)."""
    from math import radians

    from spsp_ctrl.config.loader import ConfigError, ConfigProblem, load_tolerances
    from spsp_ctrl.mechanism.tolerance import tolerances_of

    _, travel = load(config, overrides)
    loaded = load_tolerances(file)
    given = loaded.model.requirement
    if requirement_arcmin is None and (given is None or given.value <= 0.0):
        text = "no requirement; add `requirement: {value: 3, unit: arcmin}` or give --requirement-arcmin"
        raise ConfigError([ConfigProblem(loaded.path, *loaded.locate(("requirement",)), text)])
    need = radians(requirement_arcmin / 60.0) if requirement_arcmin is not None else given.si  # type: ignore[union-attr]
    return travel, loaded.model, tolerances_of(loaded.model, travel.lengths_m), need


@tolerance.command(epilog="Example: spsp-ctrl mechanism tolerance check --config config/rig.yaml --file config/tolerances/table4.yaml --out pictures")
@MECHANISM
@OVERRIDE
@TOLERANCES
@REQUIREMENT
@UNITS
@SEED
@ZEROED
@click.option("--require", type=click.Choice(["worst", "rss", "yield"]), help="Exit with 1 unless the requirement is kept this way.")
@PICTURE
@JSON
@guarded
def check(
    config: Path,
    overrides: tuple[str, ...],
    file: Path,
    requirement_arcmin: float | None,
    units: int,
    seed: int,
    zeroed: bool,
    require: str | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """A set of tolerances by worst case, root sum square and Monte Carlo; shares, what to relax first, zeroing at level."""
    _require_pictures(out)
    travel, _, tolerances, need = _set(config, overrides, file, requirement_arcmin)
    from spsp_ctrl.report import tolerance_text

    with bar("Monte Carlo", as_json) as advance:
        found = _user_error(lambda: tolerance_text.check_set(travel, tolerances, need, units, seed, zeroed, advance))
    figure = None
    if out is not None:
        from spsp_ctrl.report.error_figures import check_figure

        figure = check_figure(found, tolerances, travel)
    _show(found.result, tolerance_text.check_lines(found.result), as_json, out, "tolerance-check", figure)
    if require == "yield":
        kept = all(mc["passes"] for mc in found.result["monte_carlo"].values())
    else:
        kept = require is None or found.result["worst_case" if require == "worst" else "rss"]["passes"]
    if not kept:
        raise SystemExit(EXIT_ROW_FAILED)


def _user_error(compute: Any) -> Any:
    """Tolerances that no set or no attitude can satisfy are the user's."""
    try:
        return compute()
    except ValueError as error:
        click.echo(str(error), err=True)
        raise SystemExit(EXIT_USER) from None


def _with_costs(tolerances: tuple[Tolerance, ...], costs: tuple[str, ...]) -> tuple[Tolerance, ...]:
    names = [t.source.name for t in tolerances]
    weights: dict[str, float] = {}
    for text in costs:
        name, equals, raw = text.partition("=")
        if not equals or name not in names:
            raise click.BadParameter(f"--cost {text}: expected NAME=WEIGHT with a source of the file: {', '.join(names)}")
        try:
            weights[name] = float(raw)
        except ValueError:
            weights[name] = float("nan")
        if not 0.0 < weights[name] <= 1e6:
            raise click.BadParameter(f"--cost {text}: a weight is a number above 0, at most 1e6")
    return tuple(replace(t, cost=weights.get(t.source.name, t.cost)) for t in tolerances)


@tolerance.command(epilog="Example: spsp-ctrl mechanism tolerance allocate --config config/rig.yaml --file config/tolerances/table4.yaml --cost dr=2")
@MECHANISM
@OVERRIDE
@TOLERANCES
@REQUIREMENT
@click.option("--by", type=click.Choice(["worst", "rss", "yield"]), default="worst", show_default=True, help="How the requirement is to be kept.")
@click.option("--yield", "wanted", type=click.FloatRange(50.0, 99.999), default=99.73, show_default=True, help="Percent of the units.")
@click.option("--cost", "costs", multiple=True, metavar="NAME=WEIGHT", help="Relative cost of holding 10 um (0.1 mrad, 1 K); may be repeated.")
@UNITS
@SEED
@ZEROED
@click.option("--write", type=click.Path(path_type=Path), metavar="FILE", help="Write the set found as a tolerance file.")
@click.option("--force", is_flag=True, help="With --write: replace an existing file.")
@JSON
@guarded
def allocate(
    config: Path,
    overrides: tuple[str, ...],
    file: Path,
    requirement_arcmin: float | None,
    by: Any,
    wanted: float,
    costs: tuple[str, ...],
    units: int,
    seed: int,
    zeroed: bool,
    write: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """The loosest (cheapest) limits for the sources of a file that keep the requirement.

    Cost falls as 1 / limit. The file may bound a limit (min, max), keep it (fixed) or tie several (group).
    """
    travel, given, tolerances, need = _set(config, overrides, file, requirement_arcmin)
    tolerances = _with_costs(tolerances, costs)
    if write is not None and write.exists() and not force:
        raise click.UsageError(f"{write} exists already; choose another name or give --force")
    _require_scipy()
    from spsp_ctrl.mechanism import allocation
    from spsp_ctrl.mechanism.tolerance import WORST_GRID, Poses, attitude_matrix, limits_of
    from spsp_ctrl.report import tolerance_text

    limits = (travel.pitch_limit_rad, travel.roll_limit_rad)
    with bar("allocating", as_json) as advance:
        found = _user_error(
            lambda: allocation.allocate(tolerances, *limits, travel.lengths_m, need, by, wanted / 100.0, units, seed, zeroed, advance)
        )
    matrix = attitude_matrix(tolerances, Poses.grid(*limits, WORST_GRID), travel.lengths_m, zeroed)
    order = [{"sources": list(r.names)} for r in allocation.relaxation(tolerances, limits_of(tolerances), matrix)]
    result = tolerance_text.allocation_dict(tolerances, found, need, allocation.current_cost(tolerances), zeroed)
    result["relax_first"], result["tighten_first"] = order[0]["sources"], order[-1]["sources"]
    lines = tolerance_text.allocation_lines(result, order)
    if write is not None:
        write.write_text(tolerance_text.allocated_file(given, tolerances, found, need), encoding="utf-8")
        result["written"] = str(write)
        lines.append(f"written: {write}")
    _show(result, lines, as_json, None, "", None)


def _require_scipy() -> None:
    import importlib.util

    if importlib.util.find_spec("scipy") is None:
        click.echo("the allocation needs scipy: pip install 'spsp-ctrl[design]'", err=True)
        raise SystemExit(EXIT_USER)


@click.command(epilog="Example: spsp-ctrl mechanism budget --config config/rig.yaml --file config/tolerances/transmission.yaml")
@MECHANISM
@OVERRIDE
@click.option(
    "--file", "-f", "file", required=True, type=click.Path(path_type=Path), help="Transmission file, e.g. config/tolerances/transmission.yaml."
)
@PICTURE
@JSON
@guarded
def budget(config: Path, overrides: tuple[str, ...], file: Path, out: Path | None, as_json: bool) -> None:
    """Gears, screw and temperature as rod-length error, and the attitude error that it gives (section 3.5, Fig 11)."""
    _require_pictures(out)
    _, travel = load(config, overrides)
    from spsp_ctrl.config.loader import load_transmission
    from spsp_ctrl.mechanism.budget import transmission_budget
    from spsp_ctrl.report import tolerance_text

    found = transmission_budget(load_transmission(file).model, travel.pitch_limit_rad, travel.roll_limit_rad, travel.lengths_m)
    result = tolerance_text.budget_dict(found)
    figure = None
    if out is not None:
        from spsp_ctrl.report.error_figures import budget_figure

        figure = budget_figure(found)
    _show(result, tolerance_text.budget_lines(result), as_json, out, "budget", figure)
