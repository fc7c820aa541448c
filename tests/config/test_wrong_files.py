# ruff: noqa: E501  (a table: one case a line)
"""Deliberately wrong files through the real command: clear lines with file:line:column, exit code 2, no traceback, no run folder.

Each case is a stated edit of a file in config/ (``change``), or a whole file in its place (``content``). Expected is one line per problem: the text
in the edited file that the line number must point at (None: the file as a whole), and what the message must say.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from click.testing import CliRunner

from spsp_ctrl.cli import cli

CONFIG = Path(__file__).parents[2] / "config"
REALTIME = (CONFIG / "rig.yaml").read_text(encoding="utf-8").rpartition("\nrealtime:")[2]
"""All of the last section."""
RIG, MODEL, SCENARIO = "rig.yaml", "model.yaml", "experiments/swing-2dof.yaml"
SECTION = "mechanism"
HEAD = {RIG: "schema: spsp-ctrl/rig/1\n", MODEL: "schema: spsp-ctrl/model/1\n", SCENARIO: "schema: spsp-ctrl/scenario/1\nname: x\n"}
Problem = tuple[str | None, str]


@dataclass(frozen=True)
class Wrong:
    """One wrong file and what must be said about it."""

    name: str
    problems: tuple[Problem, ...]
    file: str = RIG
    change: tuple[tuple[str, str], ...] = ()
    content: bytes | None = field(default=None, repr=False)
    subprocess: bool = False


def edit(name: str, old: str, new: str, *problems: Problem, file: str = RIG, subprocess: bool = False) -> Wrong:
    return Wrong(name, problems, file, ((old, new),), subprocess=subprocess)


def whole(name: str, content: bytes, *problems: Problem, file: str = RIG, subprocess: bool = False) -> Wrong:
    return Wrong(name, problems, file, content=content, subprocess=subprocess)


def bomb() -> bytes:
    lines = [HEAD[RIG], "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 9)]
    return "".join(lines).encode()


CASES = (
    # ---- rig file: keys and values
    edit("unknown-key", "rod_speed_mm_s:", "rod_sped_mm_s:", ("rod_sped_mm_s", "unknown key 'limits.rod_sped_mm_s'; did you mean 'rod_speed_mm_s'?"),
         subprocess=True),
    edit("unknown-key-nothing-near", "realtime:", "weather: fine\nrealtime:", ("weather", "unknown key 'weather'; delete it")),
    edit("unknown-section", "supervisor:", "superviser:", ("superviser:", "unknown key 'superviser'; did you mean 'supervisor'?")),
    edit("wrong-unit-in-key", "travel_margin_mm: 0.2", "travel_margin_m: 0.0002",
         ("travel_margin_m:", "given as 'travel_margin_mm' (mind the unit)")),
    edit("wrong-unit-in-required-key", "column_height_mm: 265.5", "column_height_cm: 26.55",
         ("column_height_cm", f"'{SECTION}.column_height_cm': this quantity is given as 'column_height_mm'")),
    edit("out-of-range", "rate_hz: 1000 ", "rate_hz: 20 ", ("rate_hz: 20 ", "rate_hz = 20 is out of range: it must be >= 100"), subprocess=True),
    edit("negative-limit", "current_a: 6.0", "current_a: -6.0", ("current_a: -6.0", "limits.current_a = -6.0 is out of range: it must be > 0")),
    edit("nan", "current_a: 6.0", "current_a: .nan", ("current_a: .nan", "a finite number is needed")),
    edit("infinity", "rod_speed_mm_s: 80.0", "rod_speed_mm_s: .inf", ("rod_speed_mm_s: .inf", "a finite number is needed")),
    edit("overflow", "rod_speed_mm_s: 80.0", "rod_speed_mm_s: 1e999", ("rod_speed_mm_s: 1e999", "a finite number is needed")),
    edit("number-with-unit", "current_a: 6.0", "current_a: 6 A", ("current_a: 6 A", "'6 A' is text, a number is needed (without quotes or unit)")),
    edit("quoted-number", "current_a: 6.0", 'current_a: "6.0"', ('current_a: "6.0"', "'6.0' is text, a number is needed")),
    edit("switch-for-number", "current_a: 6.0", "current_a: true", ("current_a: true", "limits.current_a = True: input should be a valid number")),
    edit("number-for-switch", "auto_arm: true", "auto_arm: 1", ("auto_arm: 1", "supervisor.auto_arm = 1: input should be a valid boolean")),
    edit("word-for-choice", "law: stabiliser", "law: pid", ("law: pid", "control.law = 'pid': input should be 'stabiliser' or 'cascade'")),
    edit("missing-key", "  rod_speed_mm_s: 80.0 ", "  #", ("limits:", "key 'limits.rod_speed_mm_s' is missing")),
    edit("section-line-lost", "\nimu:", "\n#", ("  rate_hz: 200.0", "key 'rate_hz' is given twice; delete one")),
    edit("missing-section", "\nroll_actuator: *actuator", "\n#", ("# yaml", "key 'roll_actuator' is missing; add it to this mapping")),
    edit("empty-section", REALTIME, "  #\n", ("realtime:", "realtime: expected `key: value` lines, found nothing")),
    edit("list-for-mapping", f"{SECTION}:", f"{SECTION}: [1, 2]\nold:", (f"{SECTION}: [1, 2]", f"{SECTION}: expected `key: value` lines, found a list"),
         ("old:", "unknown key 'old'")),
    edit("two-problems", "rod_speed_mm_s: 80.0", "rod_speed_mm_s: 0\n  rod_speed: 3",
         ("rod_speed_mm_s: 0", "it must be > 0"), ("rod_speed: 3", "given as 'rod_speed_mm_s'"), subprocess=True),
    edit("duplicate-key", "  microsteps: 16 ", "  microsteps: 16\n  microsteps: 32 ", ("microsteps: 32", "key 'microsteps' is given twice; delete one")),
    edit("impossible-geometry", "moving_radius_mm: 100.0", "moving_radius_mm: 300.0",
         (f"{SECTION}:", "impossible geometry: moving_radius_mm (300) must be smaller than column_height_mm (265.5)"), subprocess=True),
    edit("stroke-too-short", "stroke_min_mm: -34.1", "stroke_min_mm: -20.0",
         ("stroke_min_mm", "does not reach pitch_limit_deg = +20, which needs -34.12 mm"), ("stroke_min_mm", "does not reach roll_limit_deg")),
    edit("unknown-driver", "driver: simulated", "driver: teleport", ("driver: teleport", "rig.driver = 'teleport': it must be one of 'simulated', 'bus'")),
    edit("seed-too-large", "seed: 1 ", "seed: 99999999999 ", ("seed: 99999999999", "rig.seed = 99999999999 is out of range: it must be <= 2.14748e+09")),
    edit("missing-scenario", "swing-2dof.yaml", "swing-3dof.yaml", ("scenario: ", "scenario: no such file: "), subprocess=True),
    edit("missing-model", "model: model.yaml", "model: nothing.yaml", ("model: nothing.yaml", "rig.model: no such file: ")),
    edit("scenario-is-a-folder", "experiments/swing-2dof.yaml", "experiments", ("scenario: ", "scenario: no such file: ")),
    # ---- rig file: not a rig file at all
    edit("wrong-schema", "spsp-ctrl/rig/1", "spsp-ctrl/scenario/1", ("schema: ", "this is a scenario file, not a rig file")),
    edit("schema-of-the-future", "spsp-ctrl/rig/1", "spsp-ctrl/rig/7", ("schema: ", "unknown schema 'spsp-ctrl/rig/7'; expected 'spsp-ctrl/rig/1'")),
    edit("no-schema", "schema: spsp-ctrl/rig/1\n", "", ("# yaml", "no `schema:` line; a file of this kind starts with `schema: spsp-ctrl/rig/1`")),
    edit("tabs", "  priority: 50", "\tpriority: 50", ("\tpriority", "indent with spaces, not tabs"), subprocess=True),
    whole("not-yaml", b"PK: {[}\n", ("PK", "not valid YAML")),
    whole("unclosed-quote", HEAD[RIG].encode() + b'name: "rig\nrate_hz: 1000\n', (None, "not valid YAML")),
    whole("prose", b"Dear colleague, the rig works.\n", ("Dear", "expected `key: value` lines at the top level")),
    whole("list-on-top", b"- schema: spsp-ctrl/rig/1\n", ("- schema", "expected `key: value` lines at the top level")),
    whole("empty", b"", ("", "is empty; copy one of the files in config/"), subprocess=True),
    whole("comments-only", b"# nothing\n\n", ("# nothing", "is empty")),
    whole("not-utf8", HEAD[RIG].encode() + "name: Prüfstand\n".encode("latin-1"), ("name", "is not UTF-8 text")),
    whole("binary", bytes(range(256)) * 10, (None, "is a binary file, expected YAML text")),
    whole("control-character", HEAD[RIG].encode() + b"name: a\x07b\n", ("schema", "not valid YAML")),
    whole("huge", b"# x\n" * 300_000, (None, "is larger than 1 MiB: not a configuration file")),
    whole("alias-bomb", bomb(), (None, "too many values (aliases repeated?)"), subprocess=True),
    whole("alias-of-itself", HEAD[RIG].encode() + b"a: &a [*a]\n", ("a: &a", "nested deeper than 50 levels")),
    whole("deep", HEAD[RIG].encode() + b"a: " + b"[" * 5000 + b"]" * 5000, (None, "nest")),
    whole("unknown-alias", HEAD[RIG].encode() + b"a: *b\n", ("a: *b", "not valid YAML: found undefined alias")),
    whole("mapping-as-key", HEAD[RIG].encode() + b"? [a, b]\n: 1\n", ("? [a", "a list or mapping cannot be a key")),
    whole("python-tag", HEAD[RIG].encode() + b"name: !!python/object/apply:os.getcwd []\n", ("name: !!python", "tag 'tag:yaml.org,2002:python/object/apply:os.getcwd' is not allowed; delete it")),
    whole("binary-tag", HEAD[RIG].encode() + b"name: !!binary aGk=\n", ("name: !!binary", "is not allowed; delete it")),
    whole("two-documents", HEAD[RIG].encode() + b"---\nname: x\n", ("---", "not valid YAML: but found another document")),
    # ---- model file
    edit("wrong-unit-in-model", "{value: 4.0, unit: mm,", "{value: 4.0, unit: N,", ("screw_lead:", "screw_lead: unit 'N' does not fit, give one of m, mm, um"),
         file=MODEL),
    edit("model-out-of-range", "{value: 24.0, unit: V,", "{value: -24.0, unit: V,", ("bus_voltage:", "bus_voltage: -24 V is outside 1 to 1000 V"), file=MODEL),
    edit("model-parameter-missing", '  resistance: {value: 0.5, unit: ohm, source: "D: same motor, line to line"}\n', "",
         ("actuator:", "parameter 'resistance' is missing: winding resistance [ohm]"), file=MODEL),
    edit("model-parameter-unknown", "  bus_voltage:", "  buss_voltage:", ("actuator:", "parameter 'bus_voltage' is missing"),
         ("buss_voltage", "unknown parameter 'buss_voltage'; did you mean 'bus_voltage'?"), file=MODEL),
    edit("effect-unknown", "- effect: cogging", "- effect: coging", ("- effect: coging", "unknown effect 'coging'; did you mean 'cogging'?"), file=MODEL,
         subprocess=True),
    edit("effect-parameter-unknown", "      gap: {", "      gapp: {", ("gapp", "unknown parameter 'gapp'; did you mean 'gap'?"), file=MODEL),
    edit("effect-twice", "  - effect: backlash\n", "  - effect: backlash\n    parameters: {gap: {value: 1.0, unit: um}}\n  - effect: backlash\n",
         ("      gap: {value: 12.0", "gap: given twice for the same actuator (also in entry 2 of effects)"), file=MODEL),
    edit("effect-on-an-unknown-axis", "axis: roll", "axis: yaw", ("axis: yaw", "input should be 'both', 'pitch' or 'roll'"), file=MODEL),
    edit("quantity-without-unit", "{value: 24.0, unit: V,", "{value: 24.0,", ("bus_voltage:", "key 'actuator.bus_voltage.unit' is missing"), file=MODEL),
    edit("bare-number-in-model", "bus_voltage: {value: 24.0, unit: V, ", "bus_voltage: 24.0 #", ("bus_voltage:", "expected `key: value` lines, found 24.0"),
         file=MODEL),
    edit("model-impossible-geometry", "hinge_radius: {value: 100.0, unit: mm", "hinge_radius: {value: 1.0, unit: m",
         ("hinge_radius:", "impossible geometry: hinge_radius (1 m) must be smaller than column_height (0.2655 m)"), file=MODEL),
    # ---- scenario file
    edit("negative-duration", "duration_s: 40.0", "duration_s: -40.0", ("duration_s: -40.0", "duration_s = -40.0 is out of range: it must be >= 0.1"),
         file=SCENARIO),
    edit("amplitude-out-of-range", "amplitude_deg: 6.0", "amplitude_deg: 60.0",
         ("  pitch: [", "base.pitch.0.amplitude_deg = 60.0 is out of range: it must be <= 45"), file=SCENARIO),
    edit("sine-not-in-a-list", "pitch: [{amplitude_deg: 6.0, period_s: 4.0}]", "pitch: {amplitude_deg: 6.0, period_s: 4.0}",
         ("  pitch: {", "base.pitch: expected a list, found `key: value` lines"), file=SCENARIO),
    edit("acceptance-path", "error_arcmin.pitch.imu_max", "error_arcmin.pitch.imu_maximum",
         ("imu_maximum", "a run has no such figure; did you mean 'error_arcmin.pitch.imu_max'?"), file=SCENARIO, subprocess=True),
    edit("roughness-band", "low_hz: 2.0, high_hz: 10.0", "low_hz: 10.0, high_hz: 2.0",
         ("  roughness:", "high_hz (2) must not be below low_hz (10) (base.roughness)"), file=SCENARIO),
    edit("scenario-unknown-kind", "kind: inertial", "kind: inertia", ("kind: inertia", "reference.kind = 'inertia': input should be 'inertial' or 'joint'"),
         file=SCENARIO),
)  # fmt: skip


def line_number(text: str, needle: str) -> int:
    return text[: text.index(needle)].count("\n") + 1


def place(folder: Path, case: Wrong) -> Path:
    shutil.copytree(CONFIG, folder / "config")
    path = folder / "config" / case.file
    if case.content is not None:
        path.write_bytes(case.content)
    text = path.read_text(encoding="utf-8") if case.change else ""
    for old, new in case.change:
        assert text.count(old) >= 1, f"{case.file} no longer holds {old!r}"
        text = text.replace(old, new, 1)
        path.write_text(text, encoding="utf-8")
    return path


def invoke(folder: Path, arguments: list[str], in_subprocess: bool) -> tuple[int, str, str]:
    if in_subprocess:
        command = [sys.executable, "-c", "from spsp_ctrl.cli import main; main()", *arguments]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
        return done.returncode, done.stdout, done.stderr
    before = Path.cwd()
    os.chdir(folder)
    try:
        result = CliRunner().invoke(cli, arguments)
    finally:
        os.chdir(before)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, result.stderr


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_wrong_file_is_refused_with_its_line(case: Wrong, tmp_path: Path) -> None:
    path = place(tmp_path, case)
    code, out, err = invoke(tmp_path, ["run", "--config", "config/rig.yaml", "--fast"], case.subprocess)
    assert code == 2
    assert out == ""
    assert "Traceback" not in err
    lines = err.splitlines()
    assert len(lines) == len(case.problems), err
    name = f"config/{case.file}"
    text = path.read_bytes().decode("utf-8", "replace")
    for line, (where, what) in zip(lines, case.problems, strict=True):
        assert what in line
        assert len(line) < 400
        if where is None:
            assert line.startswith(f"{name}:")
        else:
            found = re.match(rf"{re.escape(name)}:(\d+):(\d+): ", line)
            assert found, line
            assert int(found[1]) == line_number(text, where), line
            assert int(found[2]) >= 1
    assert not (tmp_path / "runs").exists()


def test_there_are_as_many_cases_as_the_issue_asks_for_and_some_go_through_a_process() -> None:
    assert len(CASES) >= 25
    assert sum(case.subprocess for case in CASES) >= 5
    assert len({case.name for case in CASES}) == len(CASES)


@pytest.mark.parametrize(
    ("setting", "what"),
    [
        ("control.law", "expected KEY=VALUE"),
        ("=3", "expected KEY=VALUE"),
        ("control..law=x", "expected KEY=VALUE"),
        ("control.law=pid", "control.law = 'pid': input should be 'stabiliser' or 'cascade'"),
        ("control.lew=cascade", "unknown key 'control.lew'; did you mean 'law'?"),
        ("limits.current_a=-1", "limits.current_a = -1 is out of range"),
        ("limits.current_a=six", "'six' is text, a number is needed"),
        ("limits.current_a=.nan", "a finite number is needed"),
        ("limits.current_a=[", "the value is not valid YAML"),
        ("limits.current_a=!!binary aGk=", "the value is not valid YAML"),
        ("limits.current_a=&a [*a]", "the value is not valid YAML"),
        ("limits.current_a=", "limits.current_a = None"),
        ("name.first=x", "name.first is not a key of this file"),
        ("limits=3", "limits: expected `key: value` lines, found 3"),
        ("schema=spsp-ctrl/rig/2", "schema = 'spsp-ctrl/rig/2'"),
        ("rig.model=nothing.yaml", "rig.model: no such file"),
    ],
)
def test_wrong_override_is_one_clear_line(setting: str, what: str, tmp_path: Path) -> None:
    shutil.copytree(CONFIG, tmp_path / "config")
    code, out, err = invoke(tmp_path, ["run", "--config", "config/rig.yaml", "--fast", "--set", setting], False)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert what in err
    assert f"--set {setting}" in err or "config/rig.yaml: " in err
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["--config", "nothing.yaml"], "nothing.yaml: no such file"),
        (["--config", "config"], "config: is a folder, expected a YAML file"),
        (["--config", "config/rig.yaml", "--scenario", "none.yaml"], "none.yaml: no such file"),
        (["--config", "config/model.yaml"], "config/model.yaml:6:1: this is a plant model file, not a rig file"),
        (["--config", "config/rig.yaml", "--scenario", "config/rig.yaml"], "this is a rig file, not a scenario file"),
        (["--config", "config/rig.yaml", "--duration", "-1"], "-1.0 is not in the range"),
        (["--config", "config/rig.yaml", "--duration", "nan"], "nan is not a finite number"),
        (["--config", "config/rig.yaml", "--seed", "-1"], "-1 is not in the range"),
        (["--config", "config/rig.yaml", "--fast", "--out", "config/rig.yaml"], "config/rig.yaml: is a file, not a folder"),
        (["--config", "config/rig.yaml", "--speed", "3"], "No such option"),
        ([], "Missing option '--config'"),
    ],
)
def test_wrong_option_is_refused_before_anything_is_written(arguments: list[str], what: str, tmp_path: Path) -> None:
    shutil.copytree(CONFIG, tmp_path / "config")
    code, out, err = invoke(tmp_path, ["run", *arguments], False)
    assert (code, out) == (2, "")
    assert what in err
    assert "Traceback" not in err
    assert not (tmp_path / "runs").exists()


def test_unreadable_file(tmp_path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may read everything")
    shutil.copytree(CONFIG, tmp_path / "config")
    (tmp_path / "config" / RIG).chmod(0)
    code, _, err = invoke(tmp_path, ["run", "--config", "config/rig.yaml"], False)
    assert code == 2
    assert "config/rig.yaml: cannot be read: Permission denied" in err


def test_a_device_is_not_read_for_ever(tmp_path: Path) -> None:
    code, _, err = invoke(tmp_path, ["run", "--config", "/dev/zero"], True)
    assert (code, err) == (2, "/dev/zero: is larger than 1 MiB: not a configuration file\n")
