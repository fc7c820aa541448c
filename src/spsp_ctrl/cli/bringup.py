"""``spsp-ctrl check`` and ``spsp-ctrl scan``, and the stages of a first run: what happens before power may be switched on."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from spsp_ctrl.cli.common import CONFIG, EXIT_RIG, EXIT_USER, JSON, OVERRIDE, guarded

if TYPE_CHECKING:
    from spsp_ctrl.config.rig import RigConfig
    from spsp_ctrl.experiments.session import Plan
    from spsp_ctrl.rig.base import Rig
    from spsp_ctrl.rig.finding import Found


def load(path: Path, overrides: tuple[str, ...]) -> RigConfig:
    """A rig file, checked. Raises ``ConfigError``."""
    from spsp_ctrl.config.loader import apply_overrides, load_rig

    loaded = load_rig(path)
    return (apply_overrides(loaded, overrides) if overrides else loaded).model


def table(rows: list[tuple[str, ...]]) -> list[str]:
    """Columns, each as wide as its widest entry but the last."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]) - 1)] if rows else []
    return ["  ".join([cell.ljust(w) for cell, w in zip(row, widths, strict=False)] + [row[-1]]).rstrip() for row in rows]


@click.command(epilog="Example: spsp-ctrl check --config config/rig.yaml")
@CONFIG
@OVERRIDE
@click.option("--runs", type=click.Path(path_type=Path), default=Path("runs"), help="Where runs will be written.")
@JSON
@guarded
def check(config: Path, overrides: tuple[str, ...], runs: Path, as_json: bool) -> None:
    """Is this computer ready for a rig file? Ports, permissions, kernel, bus load, real-time limits, disk. Opens no port.

    Exit code 3 when something would keep the rig from running.
    """
    from spsp_ctrl.rig.preflight import FAIL, preflight

    rows = preflight(load(config, overrides), runs)
    failed = [row for row in rows if row.state == FAIL]
    if as_json:
        click.echo(json.dumps({"ready": not failed, "rows": [row._asdict() for row in rows]}, indent=2))
    else:
        lines = table([(row.state, row.what, row.found) for row in rows])
        for row, line in zip(rows, lines, strict=True):
            click.echo(line + (f"\n         {row.advice}" if row.advice else ""))
        click.echo("not ready" if failed else "ready")
    if failed:
        raise SystemExit(EXIT_RIG)


@click.command(epilog="Example: spsp-ctrl scan --interface udp_multicast --channel 239.74.163.2")
@click.option("--config", "-c", type=click.Path(path_type=Path), help="Rig file: scan its buses and lines and compare.")
@OVERRIDE
@click.option("--interface", help="Without a rig file: a python-can interface, e.g. socketcan.")
@click.option("--channel", default="can0", show_default=True, help="Its channel.")
@click.option("--bitrate", default=1_000_000, show_default=True, type=click.IntRange(10_000, 1_000_000), help="Bit/s of that bus.")
@click.option("--serial", "port", help="Without a rig file: a serial port (PORT or PORT@BAUD), asked as MIP and as TMCL.")
@JSON
@guarded
def scan(
    config: Path | None, overrides: tuple[str, ...], interface: str | None, channel: str, bitrate: int, port: str | None, as_json: bool
) -> None:
    """Who is on the bus: number, kind, vendor, product, serial number, firmware. Reads only; nothing is configured or switched on.

    With a rig file every device is compared with it; a missing, doubled or wrong one is refused (exit code 3).
    """
    if config is None and interface is None and port is None:
        raise click.UsageError("give --config, or --interface, or --serial")
    found = _scan_bare(interface, channel, bitrate, port) if config is None else _scan_config(load(config, overrides))
    refused = [f for f in found if f.problem]
    if as_json:
        click.echo(json.dumps({"refused": len(refused), "found": [f.to_dict() for f in found]}, indent=2))
    else:
        click.echo("\n".join(describe(found)) if found else "nobody answers")
    if refused:
        raise SystemExit(EXIT_RIG)


def describe(found: list[Found]) -> list[str]:
    """A table for a person."""
    rows: list[tuple[str, ...]] = [("place", "number", "kind", "vendor", "product", "serial", "firmware", "in the rig file")]
    for f in found:
        w = f.who
        verdict = f.expected_as or "-"
        if f.problem:
            verdict = f"{verdict}  REFUSED: {f.problem}"
        number = str(w.address) if w and w.address else "-"
        words = (w.kind, w.vendor or "-", w.product or "-", w.serial or "-", w.firmware or "-") if w else ("-",) * 5
        rows.append((f.place, number, *words, verdict))
    return table(rows)


def _scan_config(config: RigConfig) -> list[Found]:
    from spsp_ctrl.config.devices import BusDriver
    from spsp_ctrl.rig.base import RigError
    from spsp_ctrl.rig.finding import scan as scan_lines
    from spsp_ctrl.rig.wires import open_lines

    driver = config.rig
    if not isinstance(driver, BusDriver) or driver.world == "in_process":
        raise RigError("this rig is simulated inside the process: there is no bus to scan")
    can, serial = open_lines(config, driver)
    try:
        return scan_lines(driver, can, serial)
    finally:
        for bus in can.values():
            bus.close()
        for line in serial.values():
            line.close()


def _scan_bare(interface: str | None, channel: str, bitrate: int, port: str | None) -> list[Found]:
    from spsp_ctrl.devices.transport.base import TransportError
    from spsp_ctrl.devices.transport.opening import open_can, open_serial
    from spsp_ctrl.rig.base import RigError
    from spsp_ctrl.rig.finding import Found, ask_mip, ask_tmcl, sweep_canopen

    out: list[Found] = []
    try:
        if interface is not None:
            bus = open_can(interface, channel, bitrate)
            found, silent = sweep_canopen(bus)
            bus.close()
            out += [Found(channel, who, "", f"{who.answers} devices have this number" if who.answers > 1 else "") for who in found]
            out += [Found(channel, None, "", f"node {number} talks but answers no question") for number in sorted(silent)]
        if port is not None:
            path, _, baud = port.partition("@")
            if baud and not baud.isdigit():
                raise click.UsageError(f"--serial {port}: {baud!r} is no baud rate")
            line = open_serial(path, int(baud or 115_200))
            who = ask_mip(line).found or ask_tmcl(line, None, 1, 2)
            line.close()
            out += [Found(path, w, "", "") for w in who]
    except TransportError as error:
        raise RigError(str(error)) from None
    return out


# ---- stages of a run ---------------------------------------------------------------------------------------------------


def share(ctx: click.Context, param: click.Parameter, value: str | None) -> float | None:
    """Callback of ``--limit``: ``10%`` or ``0.1``."""
    if value is None:
        return None
    try:
        number = float(value.removesuffix("%")) / (100.0 if value.endswith("%") else 1.0)
    except ValueError:
        raise click.BadParameter(f"{value!r} is no share; write 10% or 0.1", ctx, param) from None
    if not 0.01 <= number <= 1.0:
        raise click.BadParameter(f"{value} is not between 1% and 100%", ctx, param)
    return number


def is_hardware(config: RigConfig) -> bool:
    """Whether a run of this rig file can move something real."""
    from spsp_ctrl.config.devices import BusDriver

    return isinstance(config.rig, BusDriver) and config.rig.world == "hardware"


def confirm(question: str, yes: bool) -> None:
    """Ask before the next stage. Without a terminal only ``--yes`` goes on."""
    if yes:
        return
    if not sys.stdin.isatty():
        click.echo(f"{question} This is real hardware and nobody is there to answer; give --yes to go on", err=True)
        raise SystemExit(EXIT_USER)
    if not click.confirm(question, err=True):
        click.echo("stopped; nothing was switched on", err=True)
        raise SystemExit(EXIT_USER)


def stages(plan: Plan, no_enable: bool, limit: float | None, yes: bool) -> Plan:
    """The plan as the stage wants it; on real hardware after checks and a question for each stage."""
    from dataclasses import replace

    from spsp_ctrl.rig.staging import limited, unpowered

    config = plan.config
    if limit is not None:
        config = limited(config, limit)
    if no_enable:
        config = unpowered(config)
    if is_hardware(config):
        from spsp_ctrl.rig.base import RigError
        from spsp_ctrl.rig.preflight import FAIL, preflight

        failed = [row for row in preflight(config, Path("runs")) if row.state == FAIL]
        if failed:
            raise RigError("\n".join(f"{row.what}: {row.found}. {row.advice}".rstrip() for row in failed))
        confirm("Stage 1 of 2: open the buses and lines, identify and configure every device, no motor current. Go on?", yes)
    return replace(plan, config=config)


def before_power(config: RigConfig, rig: Rig, no_enable: bool, limit: float | None, yes: bool) -> None:
    """The last question, after everybody has been identified. A "no" lets go of everything."""
    if not is_hardware(config) or no_enable:
        return
    much = f"limits at {100 * limit:g} %" if limit is not None else "FULL limits"
    a = config.limits
    text = f"{a.current_a:g} A, rods {a.rod_speed_mm_s:g} mm/s, azimuth {a.azimuth_rate_deg_s:g} deg/s"
    try:
        confirm(f"Stage 2 of 2: power may be switched on, {much} ({text}). Is everybody clear, the emergency stop at hand? Go on?", yes)
    except BaseException:
        rig.stop()
        rig.close()
        raise


def never_enabled(rig: Rig, no_enable: bool) -> Rig:
    """The rig, or with ``--no-enable`` one whose every command is "off"."""
    from spsp_ctrl.rig.staging import NeverEnabled

    return NeverEnabled(rig) if no_enable else rig


def dry_run(plan: Plan, as_json: bool) -> dict[str, Any]:
    """Identify, check, print the exact frames of start-up and of one cycle. Power is kept off by a guard on the bus itself."""
    from spsp_ctrl.config.devices import BusDriver
    from spsp_ctrl.rig.base import RigError
    from spsp_ctrl.rig.dry import rehearse

    if not isinstance(plan.config.rig, BusDriver) or plan.config.rig.world == "in_process":
        raise RigError("--dry-run is for a rig on buses: this one is simulated inside the process and sends no frames to anybody")
    found = rehearse(plan.config)
    if as_json:
        click.echo(json.dumps(found.to_dict(), indent=2))
    else:
        click.echo("\n".join(found.lines()))
    return found.to_dict()
