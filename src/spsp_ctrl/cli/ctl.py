"""``spsp-ctrl ctl``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from spsp_ctrl.cli.common import EXIT_USER, JSON, finite, guarded

VERBS = ("arm", "disarm", "stop", "reset", "home", "present", "heading", "turn", "target", "jog")


@click.command(
    epilog="Example: spsp-ctrl ctl --run runs/today heading 12.5", context_settings={"ignore_unknown_options": True}
)
@click.argument("verb", type=click.Choice(VERBS))
@click.argument("arguments", nargs=-1, metavar="[AXIS] [DEG]")
@click.option("--run", "folder", type=click.Path(path_type=Path), metavar="DIR", help="Run folder; default: the newest run under runs/ that listens.")
@click.option("--rate", type=float, default=0.0, callback=finite, metavar="DEG_S", help="Rate of a `target`.")
@JSON
@guarded
def ctl(verb: str, arguments: tuple[str, ...], folder: Path | None, rate: float, as_json: bool) -> None:
    """Ask a running session (`run --ctl`) for something: arm, disarm, stop, reset, home, heading DEG, turn DEG, target DEG, jog AXIS [DEG].

    The request is judged by the run, stamped, logged on /operator and replayed with it. AXIS is pitch, roll or azimuth; a jog without an
    angle is 0.5 deg.
    Exit code 2: no run listens, or it refused the request.
    """
    from spsp_ctrl.runtime.operator import SOCKET_NAME, ask

    request = _request(verb, arguments, rate)
    path = folder / SOCKET_NAME if folder is not None else _newest(SOCKET_NAME)
    try:
        (answer,) = ask(path, [request])
    except (OSError, ValueError) as error:
        click.echo(f"{path}: no run answers ({getattr(error, 'strerror', None) or error}); start one with `spsp-ctrl run --ctl`", err=True)
        raise SystemExit(EXIT_USER) from None
    if as_json:
        click.echo(json.dumps(answer))
    elif answer["ok"]:
        click.echo(f"{verb} taken at {answer['stamp_ns'] * 1e-9:.3f} s")
    if not answer["ok"]:
        click.echo(str(answer["error"]), err=True)
        raise SystemExit(EXIT_USER)


def _request(verb: str, arguments: tuple[str, ...], rate: float) -> dict[str, Any]:
    request: dict[str, Any] = {"verb": verb}
    rest = list(arguments)
    if verb == "jog":
        if not rest:
            raise click.UsageError("jog needs an axis: pitch, roll or azimuth")
        request["axis"] = rest.pop(0)
    if verb in ("heading", "turn", "target") and not rest:
        raise click.UsageError(f"{verb} needs an angle in degrees")
    if rest and verb in ("heading", "turn", "target", "jog"):
        try:
            request["value"] = float(rest.pop(0))
        except ValueError:
            raise click.UsageError(f"{arguments[-1]!r} is not an angle in degrees") from None
    elif verb == "jog":
        request["value"] = 0.5
    if rest:
        raise click.UsageError(f"{verb} takes no {rest[0]!r}")
    if verb == "target":
        request["rate"] = rate
    return request


def _newest(name: str) -> Path:
    found = sorted(Path("runs").glob(f"*/{name}"), key=lambda p: p.stat().st_mtime)
    if not found:
        raise click.UsageError("no run listens under runs/; name its folder with --run, or start one with `spsp-ctrl run --ctl`")
    return found[-1]
