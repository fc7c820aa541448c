"""What every command shares: exit codes, errors without tracebacks, common options, progress bars. Imports nothing heavy."""

from __future__ import annotations

import contextlib
import errno
import functools
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import click

EXIT_ROW_FAILED, EXIT_USER, EXIT_RIG, EXIT_DATA, EXIT_INTERNAL, EXIT_INTERRUPTED = 1, 2, 3, 4, 5, 130
EXIT_CODES = """\b
Exit codes: 0 ok, 1 acceptance row failed or replay differs, 2 wrong input,
3 rig fault, 4 data not understood or log not complete, 5 internal error, 130 interrupted."""

F = TypeVar("F", bound=Callable[..., Any])


def guarded(function: F) -> F:
    """A user's mistake ends in clear lines and a documented exit code, never in a traceback."""

    @functools.wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except (click.exceptions.Exit, click.ClickException, click.Abort):
            raise
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            raise SystemExit(EXIT_INTERRUPTED) from None
        except BrokenPipeError:
            # the reader of our output has gone (for instance `| head`): nothing to complain about
            with contextlib.suppress(OSError):
                sys.stdout.close()
            raise SystemExit(0) from None
        except Exception as error:
            code = _user_exit_code(error)
            if code is None:
                raise
            click.echo(_text(error), err=True)
            raise SystemExit(code) from None

    return cast("F", wrapper)


_STORAGE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)


def _user_exit_code(error: Exception) -> int | None:
    from spsp_ctrl.config.loader import ConfigError
    from spsp_ctrl.rig.base import RigError

    if isinstance(error, ConfigError):
        return EXIT_USER
    if isinstance(error, RigError):
        return EXIT_RIG
    if type(error).__name__ in ("NoPictures", "RecorderError"):
        return EXIT_USER
    if type(error).__name__ == "LogError":
        return EXIT_DATA
    if isinstance(error, OSError) and error.errno in _STORAGE:
        return EXIT_USER
    if isinstance(error, FileNotFoundError | FileExistsError | IsADirectoryError | NotADirectoryError | PermissionError):
        return EXIT_USER
    return None


def _text(error: Exception) -> str:
    """The operating system's complaints in the form of all others: which file, what is wrong."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{error.filename}: {error.strerror[0].lower()}{error.strerror[1:]}"
    return str(error)


def finite(ctx: click.Context, param: click.Parameter, value: Any) -> Any:
    """Callback of a float option: click's ranges let NaN pass."""
    for number in value if isinstance(value, tuple) else (value,):
        if number is not None and not math.isfinite(number):
            raise click.BadParameter(f"{number} is not a finite number", ctx, param)
    return value


OVERRIDE = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one value of the rig file, e.g. control.law=cascade. May be repeated.",
)
CONFIG = click.option(
    "--config", "-c", required=True, type=click.Path(path_type=Path), help="Rig file, e.g. config/rig.yaml."
)
MECHANISM = click.option(
    "--config",
    "-c",
    required=True,
    type=click.Path(path_type=Path),
    help="Rig file or mechanism file, e.g. config/rig.yaml or config/mechanisms/large.yaml.",
)
PICTURE = click.option("--out", "-o", type=click.Path(path_type=Path), metavar="DIR", help="Also write the picture (SVG) to this folder.")
JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")


@contextlib.contextmanager
def bar(label: str, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error for what takes longer than a moment."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
