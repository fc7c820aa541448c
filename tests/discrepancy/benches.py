"""Logs of a small virtual bench: the motion is short, what is wrong with the machine is up to the test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from spsp_ctrl.experiments.axis_session import controller_yaml, driven
from spsp_ctrl.messages import AxisSample
from spsp_ctrl.plant.axis_bench import closed_loop_samples
from spsp_ctrl.plant.axis_model import AxisModel, load_axis_model
from spsp_ctrl.plant.axis_scenario import course, load_axis_scenario
from spsp_ctrl.recording.axis_writer import AxisLog

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "config" / "axis.yaml"
MOTIONS = ROOT / "config" / "motions"
Change = Callable[[AxisSample], AxisSample | None]


def samples_of(
    motion: str, seed: int, changes: dict[str, float] | None = None, seconds: float = 10.0, model: AxisModel | None = None
) -> list[AxisSample]:
    """Samples of a shipped motion on the axis as designed, with parameters changed (by their names in SI)."""
    scenario = load_axis_scenario(MOTIONS / f"{motion}.yaml")
    machine = driven(model or load_axis_model(MODEL), scenario)
    p = machine.parameters()
    for name, value in (changes or {}).items():
        p[machine.index(name)] = value
    return closed_loop_samples(machine, course(scenario).inputs[: round(seconds * scenario.rate_hz)], seed, p=p)


def write(path: Path, motion: str, samples: list[AxisSample], change: Change = lambda s: s, **how: Any) -> Path:
    """A log of them, each sample through ``change`` (None drops it)."""
    scenario = load_axis_scenario(MOTIONS / f"{motion}.yaml")
    marks = dict(course(scenario).motions)
    attachments = how.pop("attachments", {"controller.yaml": controller_yaml(scenario)})
    with AxisLog(path, rate_hz=scenario.rate_hz, controller=how.pop("controller", "cascade"), attachments=attachments) as log:
        for k, sample in enumerate(samples):
            if k in marks:
                log.motion(sample.stamp_ns, marks[k])
            changed = change(sample)
            if changed is not None:
                log.sample(changed)
    return path
