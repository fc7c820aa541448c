"""A session of a virtual single axis: a motion file on a model file, with the log that a bench of that kind would write."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from spsp_ctrl.config.loader import ConfigError, ConfigProblem
from spsp_ctrl.plant.axis import IN
from spsp_ctrl.plant.axis_bench import closed_loop_samples
from spsp_ctrl.plant.axis_model import AxisModel, load_axis_model
from spsp_ctrl.plant.axis_scenario import AXIS_SCENARIO_SCHEMA, AxisScenario, Course, course, document, load_axis_scenario
from spsp_ctrl.recording.axis_writer import AxisLog

LOG_NAME, SUMMARY_NAME = "axis.mcap", "summary.json"


def is_axis_motion(path: Path) -> bool:
    """Whether a file says that it is the motion of a single axis; errors are left to the loader."""
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return False
    return isinstance(raw, dict) and raw.get("schema") == AXIS_SCENARIO_SCHEMA


def driven(model: AxisModel, scenario: AxisScenario) -> AxisModel:
    """The model with the loop of the motion file around it."""
    return replace(model, file=model.file.model_copy(update={"controller": scenario.controller}))


def run(scenario_path: Path, model_path: Path, folder: Path, seed: int) -> dict[str, Any]:
    """Run the motion on the model into ``folder``; returns the summary. Raises ``ConfigError``."""
    scenario, model = load_axis_scenario(scenario_path), load_axis_model(model_path)
    if abs(scenario.rate_hz / model.file.rate_hz - 1.0) > 1e-9:
        text = f"rate_hz is {scenario.rate_hz:g}, that of {model_path} is {model.file.rate_hz:g}"
        raise ConfigError([ConfigProblem(scenario_path, 0, 0, text)])
    what = course(scenario)
    samples = closed_loop_samples(driven(model, scenario), what.inputs, seed)
    command = np.array([s.command_a for s in samples])
    load = np.array([s.load_m for s in samples])
    kept = bool(np.max(np.abs(command)) <= scenario.limits.current_a * (1.0 + 1e-9))
    attachments = {
        "controller.yaml": controller_yaml(scenario),
        "scenario.yaml": yaml.safe_dump(document(scenario), sort_keys=False),
        "model.yaml": model_path.read_text(encoding="utf-8"),
    }
    path = folder / LOG_NAME
    about = {"scenario": scenario.name, "seed": str(seed), "virtual": "true"}
    with AxisLog(path, rate_hz=scenario.rate_hz, controller="cascade", attachments=attachments, run=about) as log:
        _write(log, samples, what)
    summary: dict[str, Any] = {
        "scenario": scenario.name,
        "model": model.file.name,
        "seed": seed,
        "seconds": scenario.seconds,
        "motions": [name for _, name in what.motions],
        "command_max_a": float(np.max(np.abs(command))),
        "within_limits": kept,
        "following_error_rms_m": float(np.sqrt(np.mean((load - what.inputs[:, IN.reference_m]) ** 2))),
        "log": LOG_NAME,
    }
    (folder / SUMMARY_NAME).write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


def controller_yaml(scenario: AxisScenario) -> str:
    """The section ``controller:`` for the log."""
    return yaml.safe_dump(scenario.controller.model_dump(mode="json"), sort_keys=False)


def _write(log: AxisLog, samples: list[Any], what: Course) -> None:
    names = dict(what.motions)
    for k, sample in enumerate(samples):
        if k in names:
            log.motion(sample.stamp_ns, names[k])
        log.sample(sample)
