"""Gains from the plant model, with the margins of every loop: ``python tools/design_gains.py``. The method is in docs/tuning.md."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from spsp_ctrl.cli.common import EXIT_ROW_FAILED, EXIT_USER, JSON, bar, guarded

if TYPE_CHECKING:
    from spsp_ctrl.config.rig import RigConfig
    from spsp_ctrl.plant.model import PlantModel
    from spsp_ctrl.tuning.design import Design, DesignSpec, LoopRow
    from spsp_ctrl.tuning.loops import Margins

COLUMNS = ("law", "closed on", "axis", "broken at", "Kt x", "J x", "crossover Hz", "PM deg", "GM dB", "delay ms", "disk", "at Hz")


@click.command(epilog="Example: python tools/design_gains.py --config config/rig.yaml --write gains.yaml")
@click.option("--config", "-c", default="config/rig.yaml", show_default=True, type=click.Path(path_type=Path), help="Rig file.")
@click.option("--model", type=click.Path(path_type=Path), help="Plant model; default: that of the rig file.")
@click.option("--spec", "specs", multiple=True, metavar="KEY=VALUE", help="Change a number of the specification (repeatable); `--spec list`.")
@click.option("--measure", is_flag=True, help="Also measure the loops on the running code with the gains of the rig file (1 min).")
@click.option("--check", is_flag=True, help="Exit with 1 unless the rig file has the designed gains.")
@click.option("--strict", is_flag=True, help="Exit with 1 where a margin falls short, and write nothing.")
@click.option("--write", type=click.Path(path_type=Path), metavar="FRAGMENT", help="Write the gains as YAML to a new file.")
@JSON
@guarded
def main(
    config: Path, model: Path | None, specs: tuple[str, ...], measure: bool, check: bool, strict: bool, write: Path | None, as_json: bool
) -> None:
    """Design the gains of ``control:`` on the plant model and print them with the margins of every loop.

    Loops whose margins fall short are named one by one; an unstable loop, or any of them with --strict, ends with 1 and nothing is written.
    """
    from spsp_ctrl.tuning.design import DesignSpec, design, differences, shortfalls

    if specs == ("list",):
        for f in fields(DesignSpec):
            click.echo(f"{f.name}={f.default}")
        return
    spec = _spec(DesignSpec(), specs)
    if write is not None and write.exists():
        raise FileExistsError(f"{write}: exists already; give a new file")
    rig, plant = _load(config, model)
    try:
        with bar("designing", as_json) as progress:
            result = design(rig, plant, spec, progress)
    except ValueError as error:
        click.echo(str(error), err=True)
        raise SystemExit(EXIT_USER) from None
    measured = _measured(rig, plant, spec, as_json) if measure else []
    short, other = shortfalls(result.rows), differences(rig.control, result.control)

    if as_json:
        out = result.as_dict() | {"shortfalls": short, "differences": other}
        if measured:
            keys = ("law", "kind", "axis", "at", "torque_constant", "motor_inertia", "margins")
            out["measured"] = [{k: getattr(row, k) for k in keys[:-1]} | {"margins": row.margins and row.margins.as_dict()} for row in measured]
        click.echo(json.dumps(out, indent=2, allow_nan=False))
    else:
        _print(result, measured)
    for line in short:
        click.echo(f"margin falls short: {line}", err=True)
    if check:
        for line in other:
            click.echo(line, err=True)
    if short and (strict or any(row.margins is None for row in result.rows if row.nominal)):
        raise SystemExit(EXIT_ROW_FAILED)
    if write is not None:
        head = f"# Designed by tools/design_gains.py on the model {plant.file.name!r}; to be merged into a rig file.\n"
        write.write_text(head + _yaml(result.control), encoding="utf-8")
    if check and other:
        raise SystemExit(EXIT_ROW_FAILED)


def _spec(spec: DesignSpec, texts: tuple[str, ...]) -> DesignSpec:
    names = [f.name for f in fields(spec)]
    for text in texts:
        name, _, value = text.partition("=")
        if name not in names:
            raise click.BadParameter(f"{name!r}: known are {', '.join(names)}", param_hint="--spec")
        try:
            number = float(value)
        except ValueError:
            raise click.BadParameter(f"{text}: {value!r} is not a number", param_hint="--spec") from None
        if not 0.0 < number < 1e6:
            raise click.BadParameter(f"{text}: a positive number is needed", param_hint="--spec")
        spec = replace(spec, **{name: number})
    return spec


def _load(config: Path, model: Path | None) -> tuple[RigConfig, PlantModel]:
    from spsp_ctrl.config.loader import load_rig, resolve_reference
    from spsp_ctrl.plant.model import load_model

    loaded = load_rig(config)
    return loaded.model, load_model(model or resolve_reference(loaded, ("rig", "model")))


def _measured(rig: RigConfig, plant: PlantModel, spec: DesignSpec, quiet: bool) -> list[LoopRow]:
    from spsp_ctrl.tuning.design import LAWS, LoopRow, corners, with_law
    from spsp_ctrl.tuning.measure import MeasurementError, measure, measured_margins
    from spsp_ctrl.tuning.plant_model import axis_plant, corner

    # pitch has the softer structural mode
    scales = [(1.0, 1.0), *((k, j) for k, j, _ in corners(axis_plant(plant, "pitch"), spec.corner))]
    cases = [(law, k, j, at) for law in LAWS for k, j in scales for at in ("current", "imu", "resolver")]
    rows = []
    with bar("measuring", quiet) as progress:
        for n, (law, k, j, at) in enumerate(cases):
            progress(n, len(cases))
            found = None
            # a loop that does not stay closed and within its limits has no response
            with suppress(MeasurementError):
                found = measured_margins(measure(with_law(rig, law), corner(plant, k, j), at, "pitch"))
            rows.append(LoopRow(law, "inertial", "pitch", at, k, j, found))
        progress(len(cases), len(cases))
    return rows


def _yaml(control: dict[str, Any]) -> str:
    import yaml

    return yaml.safe_dump({"control": control}, sort_keys=False)


def _cells(m: Margins | None, none: str) -> list[str]:
    if m is None:
        return [none] + [""] * 5
    gain = f"{m.gain_down_db:+.1f} {m.gain_db:+.1f}" if m.gain_down_db > -100.0 else f"{m.gain_db:+.1f}"
    return [f"{m.crossover_hz:.1f}", f"{m.phase_deg:.0f}", gain, f"{m.delay_ms:.1f}", f"{m.disk:.2f}", f"{m.disk_hz:.0f}"]


def _row(row: LoopRow, none: str = "unstable") -> list[str]:
    closed = "IMU" if row.kind == "inertial" else "resolvers"
    return [row.law, closed, row.axis, row.at, f"{row.torque_constant:g}", f"{row.motor_inertia:g}", *_cells(row.margins, none)]


def _worse_axis(rows: list[LoopRow]) -> list[LoopRow]:
    """Of each pair of loops that differ in the axis alone, the one with the smaller disk margin."""
    worse: dict[tuple[str, str, str, float, float], LoopRow] = {}
    for row in rows:
        key = (row.law, row.kind, row.at, row.torque_constant, row.motor_inertia)
        if key not in worse or _disk(row) < _disk(worse[key]):
            worse[key] = row
    return list(worse.values())


def _disk(row: LoopRow) -> float:
    return row.margins.disk if row.margins else 0.0


def _print(result: Design, measured: list[LoopRow]) -> None:
    from rich.box import MARKDOWN
    from rich.console import Console
    from rich.table import Table

    from spsp_ctrl.tuning.loops import ISOLATION_HZ

    console = Console(width=140, highlight=False)
    console.print(_yaml(result.control))
    for title, rows in (
        ("Margins, nominal plant", [r for r in result.rows if r.nominal]),
        ("Margins in the corners of torque constant and motor inertia, the worse axis", _worse_axis([r for r in result.rows if not r.nominal])),
    ):
        table = Table(*COLUMNS, title=title, box=MARKDOWN, title_justify="left")
        for row in rows:
            table.add_row(*_row(row))
        console.print(table)
    if measured:
        table = Table(*COLUMNS, title="Measured on the running code, gains of the rig file", box=MARKDOWN, title_justify="left")
        for row in measured:
            table.add_row(*_row(row, "limit acted"))
        console.print(table)
    title = "Isolation: platform angle over base angle, dB"
    table = Table("law", *(f"{f:g} Hz" for f in ISOLATION_HZ), title=title, box=MARKDOWN, title_justify="left")
    for law, db in result.isolation_db.items():
        table.add_row(law, *(f"{v:.1f}" for v in db))
    console.print(table)


if __name__ == "__main__":
    main()
