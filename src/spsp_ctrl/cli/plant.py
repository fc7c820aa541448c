"""``spsp-ctrl plant``: the virtual rig in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import click

from spsp_ctrl.cli.common import EXIT_INTERRUPTED, JSON, OVERRIDE, guarded


@click.group()
def plant() -> None:
    """The virtual rig behind real buses and serial lines."""


@plant.command(epilog="Example: spsp-ctrl plant serve --config hil/rig-plant.yaml, then in another terminal: spsp-ctrl run --config hil/rig-hil.yaml")
@click.option("--config", "-c", required=True, type=click.Path(path_type=Path), help="Plant server file, e.g. hil/rig-plant.yaml.")
@OVERRIDE
@click.option("--scenario", type=click.Path(path_type=Path), help="Play this scenario instead of the file's own.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Seed of noise and roughness.")
@click.option("--sessions", type=click.IntRange(0), default=0, show_default=True, help="End after so many controllers have come and gone; 0: never.")
@click.option("--at-once", is_flag=True, help="The swing begins now, not with a controller: for other clients of the devices.")
@click.option("--parent", type=int, hidden=True, help="End when this process has gone.")
@JSON
@guarded
def serve(
    config: Path,
    overrides: tuple[str, ...],
    scenario: Path | None,
    seed: int | None,
    sessions: int,
    at_once: bool,
    parent: int | None,
    as_json: bool,
) -> None:
    """Play drives, encoders, IMU and stepper of a rig file in real time, around the plant.

    Says `ready` on standard output once every bus and port is open. The swing begins with the first heartbeat of a controller. Ctrl-C ends it.
    """
    from spsp_ctrl.config.loader import load_scenario, load_served
    from spsp_ctrl.plant.model import load_model
    from spsp_ctrl.rig.served import ServedWorld
    from spsp_ctrl.runtime.realtime import RealTime, Wishes

    served = load_served(config, overrides)
    driver = served.driver
    played = load_scenario(scenario or served.scenario).model
    world = ServedWorld(served.rig, driver, load_model(served.model), played, driver.seed if seed is None else seed, at_once=at_once)
    asked = served.rig.realtime
    interrupted = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: interrupted.append(1))

    def ended() -> bool:
        gone = parent is not None and os.getppid() != parent
        return bool(interrupted) or gone or (sessions > 0 and world.sessions >= sessions)

    places = [f"{name}: {bus.interface} {bus.channel}" for name, bus in driver.can.items()]
    places += [f"{name}: {line.port}" for name, line in driver.serial.items()]
    click.echo("ready  " + ", ".join(places), err=as_json)
    begin = time.monotonic()
    try:
        # before the controller: devices answer at once, whoever computes
        with RealTime(Wishes(min(asked.priority + 10, 90)) if asked.enabled else None):
            world.run(ended)
    finally:
        world.close()
    figures = {
        "served_s": round(time.monotonic() - begin, 3),
        "sessions": world.sessions,
        "syncs": world.syncs,
        "latest_ms": round(world.latest_ns * 1e-6, 3),
        "cpu_s": round(time.process_time(), 3),
    }
    if as_json:
        click.echo(json.dumps(figures, indent=2))
    else:
        text = f"{figures['syncs']} SYNCs of {figures['sessions']} controller(s) in {figures['served_s']:.1f} s"
        click.echo(f"{text}, the latest handled after {figures['latest_ms']:.1f} ms")
    if interrupted and sessions > 0 and world.sessions < sessions:
        raise SystemExit(EXIT_INTERRUPTED)
