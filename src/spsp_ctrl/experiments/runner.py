"""Runs the cases of experiments, on several processes, each into a folder of its own, and collects figures and curves."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from spsp_ctrl.config.loader import Loaded, load_rig, load_scenario, resolve_reference
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.cases import Case, expand
from spsp_ctrl.experiments.verdict import CaseResult, Verdict, judge

SUMMARY_NAME = "summary.json"
MODEL_NAME = "model.yaml"
Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class Experiment:
    """A checked experiment with its runs."""

    name: str
    path: Path
    scenario: Scenario
    cases: tuple[Case, ...]


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished experiment."""

    experiment: Experiment
    results: tuple[CaseResult, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def passed(self) -> bool:
        """Every row."""
        return all(v.passed for v in self.verdicts)

    @property
    def faults(self) -> list[str]:
        """Runs that did not complete."""
        return [f"{r.key}: {r.ended}" for r in self.results if r.ended != "completed"]

    def to_dict(self) -> dict[str, Any]:
        """``summary.json`` of an experiment."""
        return {
            "experiment": self.experiment.name,
            "title": self.experiment.scenario.title,
            "pass": self.passed,
            "acceptance": [v.to_dict() for v in self.verdicts],
            "runs": [{k: v for k, v in asdict(r).items() if k != "curves"} for r in self.results],
        }


def load(
    path: Path, rig: Loaded[RigConfig], seed: int | None = None, repeats: int | None = None
) -> Experiment:
    """Read and check an experiment and all its runs, before anything moves. Raises ``ConfigError``."""
    from spsp_ctrl.plant.model import load_model

    scenario = load_scenario(path)
    model = load_model(resolve_reference(rig, ("rig", "model")))
    return Experiment(scenario.model.name, path, scenario.model, tuple(expand(scenario, rig, model, seed, repeats)))


def run_case(case: Case, folder: Path, keep_log: bool = True) -> CaseResult:
    """One run into ``folder``."""
    from spsp_ctrl.experiments import bench_session, session, summary

    folder.mkdir(parents=True, exist_ok=True)
    model_path = folder / MODEL_NAME
    model_path.write_text(case.model_text, encoding="utf-8")
    if case.scenario.bench is not None:
        figures, curves, ended = bench_session.run(case, model_path, folder)
    else:
        plan = session.Plan(case.config, case.scenario, model_path, case.seed, real_time=False)
        result = session.run_session(plan, session.prepare(plan), folder)
        figures, ended = result.summary, result.loop.ended
        curves = {}
        if ended == "completed":
            curves = summary.curves(result.log.topics, case.config, case.scenario, session.imu_bias(model_path))
    if not keep_log:
        (folder / session.LOG_NAME).unlink(missing_ok=True)
    return CaseResult(case.key, case.variant, case.law, case.repeat, case.seed, ended, figures, curves)


def run(
    experiments: Sequence[Experiment], folders: Sequence[Path], jobs: int, keep_logs: bool = True, progress: Progress = lambda done, total: None
) -> list[Outcome]:
    """Run every case of every experiment, the longest first, and write each experiment's ``summary.json``.

    Each experiment has its folder, each run a folder in it. ``progress`` gets simulated seconds done and in all.
    """
    work = [(i, k, case, folders[i] / case.key) for i, e in enumerate(experiments) for k, case in enumerate(e.cases)]
    total = sum(case.work_s for _, _, case, _ in work)
    done = 0.0
    found: dict[tuple[int, int], CaseResult] = {}
    progress(0.0, total)
    for (i, k, case, _), result in _results(work, jobs, keep_logs):
        found[i, k] = result
        done += case.work_s
        progress(done, total)
    outcomes = []
    for i, experiment in enumerate(experiments):
        results = tuple(found[i, k] for k in range(len(experiment.cases)))
        outcome = Outcome(experiment, results, tuple(judge(experiment.scenario.acceptance, results)))
        text = json.dumps(outcome.to_dict(), indent=2, allow_nan=False) + "\n"
        (folders[i] / SUMMARY_NAME).write_text(text, encoding="utf-8")
        (folders[i] / "experiment.yaml").write_bytes(experiment.path.read_bytes())
        outcomes.append(outcome)
    return outcomes


Work = tuple[int, int, Case, Path]


def _results(work: list[Work], jobs: int, keep_logs: bool) -> Iterable[tuple[Work, CaseResult]]:
    if jobs <= 1 or len(work) == 1:
        for item in work:
            yield item, run_case(item[2], item[3], keep_logs)
        return
    # fresh processes: a fork would copy the threads of a progress bar half alive
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(work)), context) as pool:
        futures = {
            pool.submit(run_case, item[2], item[3], keep_logs): item for item in sorted(work, key=lambda w: -w[2].work_s)
        }
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def open_folder(out: Path | None) -> Path:
    """``out``, or ``runs/<UTC>``. Raises ``OSError`` (``FileExistsError`` for a folder that already holds results)."""
    from spsp_ctrl.experiments.session import new_folder

    if out is not None and (out / SUMMARY_NAME).exists():
        raise FileExistsError(f"{out} already holds results ({SUMMARY_NAME}); choose another folder")
    return new_folder(out)


def load_rig_with(path: Path, overrides: Sequence[str]) -> Loaded[RigConfig]:
    """Rig file with ``--set`` texts laid over it."""
    from spsp_ctrl.config.loader import apply_overrides

    loaded = load_rig(path)
    return apply_overrides(loaded, overrides) if overrides else loaded
