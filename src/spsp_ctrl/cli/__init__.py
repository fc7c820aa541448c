"""The command line. Each command imports what it needs when it runs, so that ``--help`` answers at once."""

from __future__ import annotations

import click

from spsp_ctrl import __version__
from spsp_ctrl.cli import bringup, diagnose, experiment, hil, latency, log, mechanism, mechanism_errors, plant, run
from spsp_ctrl.cli.common import EXIT_CODES, EXIT_INTERNAL


@click.group(
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog=EXIT_CODES,
)
@click.version_option(__version__, prog_name="spsp-ctrl")
def cli() -> None:
    """Real-time stabilisation controller for a three-axis series-parallel platform.

    \b
    First run, no hardware:   spsp-ctrl run --config config/rig.yaml
    Explain it afterwards:    open runs/<time>/report.html
    Check the law on its log: spsp-ctrl replay runs/<time>/run.mcap
    """


COMMANDS = (
    run.run, run.replay, bringup.check, bringup.scan, plant.plant, diagnose.diagnose, experiment.experiment, hil.hil, latency.latency, log.log,
    mechanism.mechanism,
)  # fmt: skip
for command in COMMANDS:
    cli.add_command(command)
for command in mechanism_errors.COMMANDS:
    mechanism.mechanism.add_command(command)


def main() -> None:
    """Entry point."""
    try:
        cli(prog_name="spsp-ctrl")
    except SystemExit:
        raise
    except Exception as error:
        import traceback

        traceback.print_exc()
        click.echo(f"internal error: {error!r}. This is a defect of spsp-ctrl; please report it with the lines above.", err=True)
        raise SystemExit(EXIT_INTERNAL) from None
