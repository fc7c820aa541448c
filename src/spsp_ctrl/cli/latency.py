"""``spsp-ctrl latency``: is this machine punctual enough for a control loop?"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from spsp_ctrl.cli.common import EXIT_ROW_FAILED, JSON, OVERRIDE, PICTURE, bar, finite, guarded

if TYPE_CHECKING:
    import subprocess

    from spsp_ctrl.runtime.latency import Setup


@click.command(epilog="Example: spsp-ctrl latency --config config/rig.yaml --duration 60 --out latency")
@click.option("--config", "-c", type=click.Path(path_type=Path), help="Rig file: its rate and its real-time settings are tested.")
@OVERRIDE
@click.option("--duration", type=click.FloatRange(1.0, 3600.0), callback=finite, default=10.0, show_default=True, metavar="S", help="Seconds.")
@click.option("--rate", type=click.IntRange(100, 5000), metavar="HZ", help="Cycles per second; default that of the rig file, else 1000.")
@click.option("--cpu", type=click.IntRange(0, 1023), help="Core; default that of the rig file, else the last one.")
@click.option("--spin", type=click.FloatRange(0.0, 200.0), callback=finite, metavar="US", help="Watch the clock for the last so many us.")
@click.option("--alone", is_flag=True, help="Do not run cyclictest beside the loop, even where it is installed.")
@click.option("--limit-p99", type=click.FloatRange(0.1, 1e6), callback=finite, metavar="US", help="p99 above which the verdict is failed.")
@click.option("--limit-misses", type=click.FloatRange(0.0, 100.0), callback=finite, metavar="PERCENT", help="The same for late cycles.")
@PICTURE
@JSON
@guarded
def latency(
    config: Path | None,
    overrides: tuple[str, ...],
    duration: float,
    rate: int | None,
    cpu: int | None,
    spin: float | None,
    alone: bool,
    limit_p99: float | None,
    limit_misses: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Test how punctual this machine is, before trusting it with a rig.

    The clock of the control loop runs with the real-time settings of the rig file and, where it is installed, cyclictest runs beside it on the same
    core at the same time. The verdict is good (p99 of the lateness within 10 % of the period, at most 0.01 % of the cycles late by a period),
    usable (25 %, 0.5 %) or failed, which ends with exit code 1. Nothing moves: no rig is opened.
    """
    from spsp_ctrl.runtime import latency as test
    from spsp_ctrl.runtime import machine as machines
    from spsp_ctrl.runtime.realtime import degraded

    setup = _setup(config, overrides, duration, rate, cpu, spin)
    period_us = 1e6 / setup.rate_hz
    limits = test.Limits()
    if limit_p99 is not None:
        limits = limits._replace(usable_p99_share=limit_p99 / period_us, p99_share=min(limits.p99_share, limit_p99 / period_us))
    if limit_misses is not None:
        limits = limits._replace(usable_misses=limit_misses / 100.0, misses=min(limits.misses, limit_misses / 100.0))
    if not as_json and not sys.stderr.isatty():
        click.echo(f"measuring {duration:g} s on core {setup.cpu} ...", err=True)
    machine = machines.look(setup.cpu)
    before = machines.cpu_times(setup.cpu)
    with bar("measuring", as_json) as advance:
        values, granted, other = test.run(setup, not alone, lambda process: _watch(process, duration, advance))
    after = machines.cpu_times(setup.cpu)
    stolen = (after[0] - before[0]) / max(1, after[1] - before[1])
    result = test.summarise(setup, limits, values, granted, other)
    result["machine"] = machine._asdict() | {"stolen_share": stolen}
    result["advice"] = machines.advice(machine, setup.cpu, dict(degraded(granted)), stolen)
    if out is not None:
        from spsp_ctrl.report.latency_picture import picture

        out.mkdir(parents=True, exist_ok=True)
        title = f"{setup.rate_hz} Hz for {duration:g} s on core {setup.cpu}: {result['verdict']}"
        own: dict[float, int] = {}
        for value in values:
            own[value] = own.get(value, 0) + 1
        theirs = None if isinstance(other, str) else {float(us): n for us, n in other[0].items()}
        text = picture(title, own, theirs, period_us, limits.p99_share * period_us, limits.usable_p99_share * period_us)
        (out / "latency.svg").write_text(text, encoding="utf-8")
    if as_json:
        click.echo(json.dumps(result, indent=2))
    else:
        _print(result, degraded(granted))
        if out is not None:
            click.echo(str(out / "latency.svg"))
    if result["verdict"] == test.FAILED:
        raise SystemExit(EXIT_ROW_FAILED)


def _setup(config: Path | None, overrides: tuple[str, ...], duration: float, rate: int | None, cpu: int | None, spin: float | None) -> Setup:
    """What the rig file says, with what the options say instead."""
    from spsp_ctrl.runtime.latency import Setup, default_cpu

    if config is None:
        if overrides:
            raise click.UsageError("--set changes a rig file: give --config as well")
        wanted = default_cpu() if cpu is None else cpu
        return Setup(duration, rate or 1000, wanted, spin_us=0.0 if spin is None else spin)
    from spsp_ctrl.config.loader import apply_overrides, load_rig

    loaded = load_rig(config)
    if overrides:
        loaded = apply_overrides(loaded, overrides)
    rig = loaded.model
    asked = rig.realtime
    if cpu is None:
        cpu = default_cpu() if asked.cpu is None else asked.cpu
    return Setup(duration, rate or rig.rate_hz, cpu, asked.priority, asked.spin_us if spin is None else spin, asked.enabled)


def _watch(process: subprocess.Popen[bytes], duration: float, advance: Any) -> None:
    """Progress by the clock: the measuring process is not to be disturbed. Its output waits in the pipe only after it has ended its time."""
    import time

    begin = time.monotonic()
    while process.poll() is None and time.monotonic() - begin < duration:
        time.sleep(0.25)
        advance(round(1e3 * min(time.monotonic() - begin, duration)), round(1e3 * duration))


def _print(result: dict[str, Any], refused: list[tuple[str, str]]) -> None:
    limits, setup = result["limits"], result["setup"]
    colour = {"good": "green", "usable": "yellow", "failed": "red"}[result["verdict"]]
    rows = [("loop of spsp-ctrl", result["own"])]
    if "absent" not in result["cyclictest"]:
        rows.append(("cyclictest", result["cyclictest"]))
    spin = f", watching the clock for the last {setup['spin_us']:g} us" if setup["spin_us"] else ""
    click.echo(f"{setup['rate_hz']} Hz for {setup['seconds']:g} s on core {setup['cpu']}{spin}")
    click.echo(f"{'lateness of the wake-up, us':28}{'p50':>9}{'p99':>9}{'p99.9':>9}{'max':>10}{'late by a period':>20}")
    for name, r in rows:
        late = f"{r['late']} ({100.0 * r['miss_rate']:.3g} %)"
        click.echo(f"{name:28}{r['p50']:9.1f}{r['p99']:9.1f}{r['p99_9']:9.1f}{r['max']:10.0f}{late:>20}")
    if "ratio" in result:
        cells = ((result["ratio"].get(k), width) for k, width in (("p50", 9), ("p99", 9), ("p99_9", 9), ("max", 10)))
        click.echo(f"{'ratio':28}" + "".join(f"{'-':>{width}}" if r is None else f"{r:{width}.2f}" for r, width in cells))
    else:
        click.echo(f"cyclictest: {result['cyclictest']['absent']}")
    for name, why in refused:
        click.secho(f"degraded: {name.replace('_', ' ')} {why}", fg="red")
    click.secho(f"verdict: {result['verdict']}", fg=colour, bold=True)
    click.echo(
        f"  good: p99 <= {limits['p99_us']:.4g} us, late <= {100.0 * limits['misses']:.3g} %;"
        f" usable: p99 <= {limits['usable_p99_us']:.4g} us, late <= {100.0 * limits['usable_misses']:.3g} %"
    )
    for row in result["advice"]:
        click.echo(f"  {row['about']}: {row['seen']}\n    {row['do']}")
