"""Short sessions for the tests of log, replay and end of session, through the functions and commands that a user's run goes through."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from click.testing import CliRunner, Result

from spsp_ctrl.cli import cli
from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments import session
from spsp_ctrl.experiments.session import Plan, SessionResult

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "config"
RIG = CONFIG / "rig.yaml"
SWING = load_scenario(CONFIG / "experiments" / "swing-2dof.yaml").model


def scenario(**values: Any) -> Scenario:
    """The swing with some values changed."""
    return Scenario.model_validate(SWING.model_dump(by_alias=True) | values)


def run_short(
    folder: Path, duration_s: float = 1.2, *, seed: int = 1, real_time: bool = False, config: RigConfig | None = None, **values: Any
) -> SessionResult:
    """A session into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    plan = Plan(config or load_rig(RIG).model, scenario(duration_s=duration_s, **values), CONFIG / "model.yaml", seed, real_time)
    return session.run_session(plan, session.prepare(plan), folder)


def command(*arguments: object) -> Result:
    """``spsp-ctrl ARGUMENTS`` in this process; anything that is not an exit code is raised here."""
    result = CliRunner().invoke(cli, [str(a) for a in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def one_clear_line(result: Result, code: int, *words: str) -> None:
    """The command ended with ``code`` and said why in a single line that holds ``words``."""
    lines = result.stderr.strip().splitlines()
    assert result.exit_code == code, result.output
    assert len(lines) == 1, lines
    assert "Traceback" not in result.output
    for word in words:
        assert word in lines[0], lines[0]
