"""Runs the cases of experiments, on several processes, each into a folder of its own, and collects figures and curves."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spsp_ctrl.config.loader import ConfigError, ConfigProblem, Loaded, load_rig, load_scenario, resolve_reference
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.cases import Case, expand, first_seed, settle
from spsp_ctrl.experiments.summary import look_up
from spsp_ctrl.experiments.verdict import CaseResult, Verdict, judge

if TYPE_CHECKING:
    from spsp_ctrl.experiments.margins import MarginRow

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
    seed: int = 0
    """Of the first repeat."""
    seed_from: str = ""
    """Where it comes from, in words."""
    partial: bool = False
    """Not all of its variants: rows of the others are left out."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """A finished experiment."""

    experiment: Experiment
    results: tuple[CaseResult, ...]
    verdicts: tuple[Verdict, ...]
    margins: tuple[MarginRow, ...] = ()
    """Of the loops of each variant, where the scenario's ``figures`` name the ladder."""

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
            "seed": self.experiment.seed,
            "seed_from": self.experiment.seed_from,
            "pass": self.passed,
            "acceptance": [v.to_dict() for v in self.verdicts],
            **({"margins": [asdict(m) for m in self.margins]} if self.margins else {}),
            "runs": [{k: v for k, v in asdict(r).items() if k != "curves"} for r in self.results],
        }


def load(
    path: Path, rig: Loaded[RigConfig], seed: int | None = None, repeats: int | None = None, only: Sequence[str] = ()
) -> Experiment:
    """Read and check an experiment and all its runs, before anything moves. Raises ``ConfigError``."""
    from spsp_ctrl.plant.model import load_model

    scenario = load_scenario(path)
    model = load_model(resolve_reference(rig, ("rig", "model")))
    first, source = first_seed(scenario.model, rig.model, seed)
    cases = tuple(expand(scenario, rig, model, seed, repeats, only))
    return Experiment(scenario.model.name, path, scenario.model, cases, first, source, bool(only))


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
    return CaseResult(case.key, case.variant, case.law, case.repeat, case.seed, ended, figures, curves, case.motion, case.drawn)


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
    taken: dict[tuple[int, int], dict[str, float]] = {}
    first = [item for item in work if not item[2].identified]
    for wave in (first, None):
        if wave is None:
            later = [item for item in work if item[2].identified]
            if not later:
                break
            wave = []
            for i, k, case, folder in later:
                taken[i, k] = _identify(case, [found[i, j] for j in range(len(experiments[i].cases)) if (i, j) in found])
                wave.append((i, k, settle(case, taken[i, k]), folder))
        for (i, k, case, _), result in _results(wave, jobs, keep_logs):
            found[i, k] = replace(result, identified=taken.get((i, k), {}))
            done += case.work_s
            progress(done, total)
    outcomes = []
    for i, experiment in enumerate(experiments):
        results = tuple(found[i, k] for k in range(len(experiment.cases)))
        verdicts = judge(experiment.scenario.acceptance, results)
        if experiment.partial:
            verdicts = [v for v in verdicts if v.by_law]
        margins: tuple[MarginRow, ...] = ()
        if "ladder" in experiment.scenario.figures:
            from spsp_ctrl.experiments.margins import margin_rows

            margins = tuple(margin_rows(experiment.cases))
        outcome = Outcome(experiment, results, tuple(verdicts), margins)
        text = json.dumps(outcome.to_dict(), indent=2, allow_nan=False) + "\n"
        (folders[i] / SUMMARY_NAME).write_text(text, encoding="utf-8")
        (folders[i] / "experiment.yaml").write_bytes(experiment.path.read_bytes())
        outcomes.append(outcome)
    return outcomes


def _identify(case: Case, results: Sequence[CaseResult]) -> dict[str, float]:
    """The figures that a case takes from finished runs: means over the repeats under the same law. Raises ``ConfigError`` where one is missing."""
    taken = {}
    for key, wanted in case.identified.items():
        runs = [r for r in results if r.variant == wanted.variant and r.law == case.law and r.motion == case.motion]
        values = [look_up(r.figures, wanted.value) for r in runs]
        good = [v for v in values if v is not None]
        if not good or len(good) < len(values):
            text = f"variant {case.variant!r} takes {wanted.value!r} of {wanted.variant!r}, which has no such figure"
            raise ConfigError([ConfigProblem(None, 0, 0, text)])
        taken[key] = sum(good) / len(good)
    return taken


Work = tuple[int, int, Case, Path]


def _results(work: list[Work], jobs: int, keep_logs: bool) -> Iterable[tuple[Work, CaseResult]]:
    if jobs <= 1 or len(work) <= 1:
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
