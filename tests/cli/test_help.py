"""Help of every command, and what it costs; exit codes of the whole."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from spsp_ctrl import __version__
from spsp_ctrl.cli import cli, common


def commands(group: click.Group = cli, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


ALL = list(commands())


@pytest.mark.parametrize(("path", "command"), ALL, ids=[" ".join(path) for path, _ in ALL])
def test_help_says_what_it_does_and_has_an_example(path: tuple[str, ...], command: click.Command) -> None:
    result = CliRunner().invoke(cli, [*path, "--help"])
    assert result.exit_code == 0
    assert command.help
    assert f"Example: spsp-ctrl {' '.join(path)}" in " ".join(result.output.split())
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, f"{parameter.name} has no help"


def test_there_are_the_commands_of_the_first_issue() -> None:
    assert {("run",), ("replay",), ("log", "info"), ("log", "cat"), ("log", "export"), ("log", "repair")} <= {path for path, _ in ALL}


def in_process(*arguments: str) -> subprocess.CompletedProcess[str]:
    code = f"import sys\nsys.argv = ['spsp-ctrl', *{list(arguments)!r}]\nfrom spsp_ctrl.cli import main\ntry:\n    main()\nfinally:\n"
    code += "    print('\\n'.join(['MODULES', *sys.modules]), file=sys.stderr)"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["log", "info", "--help"], ["--version"]], ids=" ".join)
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    done = in_process(*arguments)
    assert done.returncode == 0
    modules = set(done.stderr.partition("MODULES\n")[2].split())
    assert "click" in modules
    assert not {"numpy", "scipy", "numba", "pydantic", "yaml", "mcap", "rich"} & modules


def test_help_lists_the_exit_codes_and_version_is_the_packages() -> None:
    result = CliRunner().invoke(cli, ["--help"])
    for code in (1, 2, 3, 4, 5, 130):
        assert f"{code} " in result.output
    assert __version__ in CliRunner().invoke(cli, ["--version"]).output


@pytest.mark.parametrize("arguments", [["runn"], ["log", "show"], ["run", "--quick"], ["replay"], ["log", "info"]], ids=" ".join)
def test_wrong_command_lines_are_exit_code_2(arguments: list[str]) -> None:
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 2
    assert "Usage:" in result.stderr


def raising(error: BaseException) -> click.Command:
    @click.command()
    @common.guarded
    def command() -> None:
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (FileNotFoundError(2, "No such file or directory", "x"), 2, "x: no such file or directory\n"),
        (OSError(28, "No space left on device", "run.csv"), 2, "run.csv: no space left on device\n"),
        (PermissionError(13, "Permission denied", "x"), 2, "x: permission denied\n"),
        (KeyboardInterrupt(), 130, "interrupted\n"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else None,
)
def test_errors_of_the_operating_system_are_one_line(error: BaseException, code: int, text: str) -> None:
    result = CliRunner().invoke(raising(error), [])
    assert (result.exit_code, result.stderr) == (code, text)


def test_a_defect_shows_its_traceback_and_is_exit_code_5() -> None:
    code = (
        "from spsp_ctrl import cli\nimport click\nfrom spsp_ctrl.cli.common import guarded\n"
        "@click.command('broken')\n@guarded\ndef broken():\n    raise RuntimeError('a defect')\n"
        "cli.cli.add_command(broken)\nimport sys\nsys.argv = ['spsp-ctrl', 'broken']\ncli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 5
    assert "Traceback" in done.stderr
    assert "This is a defect of spsp-ctrl; please report it" in done.stderr


def test_output_into_a_closed_pipe_is_no_error(tmp_path_factory: pytest.TempPathFactory) -> None:
    code = "from spsp_ctrl.cli import main; main()"
    first = subprocess.Popen([sys.executable, "-c", code, "log", "cat", "tests/fixtures/swing.mcap"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert first.stdout is not None
    first.stdout.readline()
    first.stdout.close()
    assert first.stderr is not None
    error = first.stderr.read()
    assert first.wait(60) == 0
    assert error == b""
