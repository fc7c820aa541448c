"""``spsp-ctrl hil``: controller and plant in two processes, started together."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from spsp_ctrl.cli import run
from spsp_ctrl.cli.common import JSON, OVERRIDE, guarded

READY_S = 120.0
"""The first start compiles the plant."""


@click.command(epilog="Example: spsp-ctrl hil hil/swing-2dof.yaml --duration 20")
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--rig", "-r", type=click.Path(path_type=Path), help="Rig file with `world: served`; default: rig-hil.yaml beside the scenario.")
@OVERRIDE
@click.option("--duration", type=click.FloatRange(0.1, 86400.0), metavar="S", help="Seconds to run.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Seed of the virtual rig.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Run folder; default runs/<UTC time>.")
@click.option("--no-strict", is_flag=True, help="Exit with 0 even when an acceptance row fails.")
@click.option("--no-screen", is_flag=True, help="No live screen.")
@JSON
@click.pass_context
@guarded
def hil(
    context: click.Context,
    scenario: Path,
    rig: Path | None,
    overrides: tuple[str, ...],
    duration: float | None,
    seed: int | None,
    out: Path | None,
    no_strict: bool,
    no_screen: bool,
    as_json: bool,
) -> None:
    """Run a scenario in real time over CAN frames and serial bytes, against the plant in a process of its own.

    Starts `plant serve` and `run` on a multicast group and pseudo-terminals of their own, and ends with the verdict table and the report.
    """
    from spsp_ctrl.config.loader import load_scenario

    load_scenario(scenario)
    rig = rig or scenario.parent / "rig-hil.yaml"
    with _private(rig, scenario, overrides) as (served, private), _plant(served, private, seed, as_json):
        context.invoke(
            run.run,
            config=rig,
            overrides=private,
            scenario=scenario,
            duration=duration,
            seed=seed,
            out=out,
            strict=not no_strict,
            no_screen=no_screen,
            as_json=as_json,
        )


@contextmanager
def _private(rig: Path, scenario: Path, overrides: tuple[str, ...]) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """A plant server file and settings that give this session buses and ports of its own."""
    from spsp_ctrl.config.devices import HARMLESS
    from spsp_ctrl.config.loader import ConfigError, ConfigProblem, load_served

    folder = Path(tempfile.mkdtemp(prefix="spsp-ctrl-hil-"))
    memory = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else folder
    try:
        served = folder / "served.yaml"
        names = {"schema": "spsp-ctrl/served/1", "rig": str(rig.absolute()), "scenario": str(scenario.absolute())}
        served.write_text("".join(f"{key}: {json.dumps(value)}\n" for key, value in names.items()), encoding="utf-8")
        driver = load_served(served, overrides).driver
        own = [f"rig.serial.{name}.port={folder / name}" for name in driver.serial]
        for name, bus in driver.can.items():
            if bus.interface == "udp_multicast":
                own.append(f"rig.can.{name}.channel=239.74.{secrets.randbelow(200) + 20}.{secrets.randbelow(250) + 2}")
            elif bus.interface == "slcan":
                own.append(f"rig.can.{name}.channel={folder / name}")
            elif bus.interface not in (*HARMLESS, "socketcan"):
                raise ConfigError([ConfigProblem(rig, 0, 0, f"rig.can.{name}: {bus.interface} cannot be served")])
        own.append(f"rig.truth={memory / folder.name / 'truth'}")
        yield served, (*overrides, *own)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.rmtree(memory / folder.name, ignore_errors=True)


@contextmanager
def _plant(served: Path, overrides: tuple[str, ...], seed: int | None, quiet: bool) -> Iterator[None]:
    """The plant server while the block runs; what it says at its end."""
    from spsp_ctrl.rig.base import RigError

    command = [sys.executable, "-c", "from spsp_ctrl.cli import main; main()", "plant", "serve", "--config", str(served), "--json"]
    command += ["--parent", str(os.getpid())]
    command += [word for text in overrides for word in ("--set", text)]
    command += [] if seed is None else ["--seed", str(seed)]
    if not quiet:
        click.echo("starting the plant (the first start compiles it, about 10 s) ...", err=True)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stderr is not None
    try:
        said: list[str] = []
        begin = time.monotonic()
        while not any(line.startswith("ready") for line in said):
            line = process.stderr.readline()
            if not line or time.monotonic() - begin > READY_S:
                raise RigError("the plant server does not start: " + (" ".join(text.strip() for text in said) or "it says nothing"))
            said.append(line)
        yield
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            told, _ = process.communicate(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            told, _ = process.communicate()
        if told.strip() and not quiet:
            figures = json.loads(told)
            text = f"plant: {figures['syncs']} SYNCs, the latest handled after {figures['latest_ms']:.1f} ms"
            click.echo(f"{text}, {100.0 * figures['cpu_s'] / max(figures['served_s'], 1e-3):.0f} % of a processor")
