"""One case from draw to points: logs, seal, diagnosis, score. Safe to run many at a time, each in a folder of its own."""

from __future__ import annotations

import math
import secrets
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from tools.blind_exam import bench, logs, machine, sealing, subject
from tools.blind_exam.case import CHANNELS, DETECTABLE, Case, build, draw, drive, recalibration, simulate, visibility
from tools.blind_exam.look_alike import likeness
from tools.blind_exam.physics import Array
from tools.blind_exam.scoring import resolved, score

Diagnose = Callable[[list[str]], subject.Ran]


class Settings(NamedTuple):
    """What a result depends on besides the commit and the case."""

    model: Path
    out: Path
    keep: bool = False
    seed: int = 1


def answer_of(case: Case, nominal: Array) -> dict[str, Any]:
    """What is hidden, and by the truth alone whether it can be seen."""
    _, hidden = build(case, nominal)
    shown = visibility(case, nominal)
    like = likeness(case, nominal) if case.group == "twins" else None
    return {
        "group": case.group,
        "twin": None if like is None else {"name": like.name, "apart": float(f"{like.apart:.4g}")},
        "hidden": [
            {
                "effect": h.effect,
                "severity": item.severity,
                "stage": h.stage,
                "values": h.values,
                "floors": {name: float(f"{ratio[name]:.4g}") for name in CHANNELS},
                "detectable": max(ratio.values()) >= DETECTABLE,
                "recalibration": recalibration(case, nominal, i),
            }
            for i, (h, item, ratio) in enumerate(zip(hidden, case.items, shown, strict=True))
        ],
    }


def write_logs(case: Case, nominal: Array, folder: Path) -> tuple[Path, Path, Path]:
    """Training log, commissioning log (the same machine, nothing hidden), held-out log with other motion."""
    folder.mkdir(parents=True, exist_ok=True)
    full, _ = build(case, nominal)
    clean, _ = build(case, nominal, clean=True)
    paths = []
    calibrated = "training" if case.training == "poor" else case.training
    for name, p, kind, noise in (("train", full, case.training, 21), ("commissioning", clean, calibrated, 22), ("held-out", full, case.held_out, 31)):
        paths.append(folder / f"{name}.mcap")
        logs.write(paths[-1], simulate(case, p, nominal, kind, noise), case.controller)
    return paths[0], paths[1], paths[2]


def follow(
    case: Case,
    nominal: Array,
    finding: subject.Finding,
    answer: dict[str, Any],
    given: tuple[Path, Path, Path],
    settings: Settings,
    diagnose: Diagnose,
) -> dict[str, Any]:
    """Run the experiment that the diagnosis asks for on the sealed machine, diagnose again with its log, and say whether the twins are parted."""
    train, commissioning, held = given
    if finding.following is None:
        return {"asked": False, "resolved": None}
    folder = train.parent
    row: dict[str, Any] = {"asked": True, "resolved": False}
    try:
        motion, law = bench.read(folder / "result" / finding.following, nominal)
    except (bench.BenchError, KeyError, ValueError, TypeError, OSError) as error:
        return row | {"not_run": f"{type(error).__name__}: {error}"}
    log, again = folder / "next.mcap", folder / "again"
    logs.write(log, drive(case, build(case, nominal)[0], motion, law, 51), case.controller)
    ran = diagnose(subject.command(train, commissioning, held, settings.model, again, settings.seed, (log,)))
    row["seconds_again"] = round(ran.seconds, 2)
    try:
        second = subject.read(again / "diagnosis.json")
    except (OSError, KeyError, ValueError, TypeError) as error:
        return row | {"not_run": f"{type(error).__name__}: {error}"}
    if not settings.keep:
        log.unlink()
    return row | {
        "resolved": resolved(answer, second),
        "named_again": [n.effect for n in second.named],
        "classes_again": [sorted(n.members) for n in second.named],
    }


def run_case(group: str, exam_seed: int, index: int, settings: Settings, diagnose: Diagnose = subject.diagnose) -> dict[str, Any]:
    """One row of the ledger (without commit and settings, which the caller adds)."""
    nominal = machine.nominal(settings.model)
    case = draw(group, exam_seed, index)
    folder = settings.out / "cases" / case.name
    if folder.exists():
        shutil.rmtree(folder)
    train, commissioning, held = write_logs(case, nominal, folder)
    exam = settings.out / "answers" / case.name  # one book per case, so that cases may run side by side
    digest = sealing.seal(exam, case.name, answer_of(case, nominal), secrets.token_hex(16))
    result = folder / "result"
    ran = diagnose(subject.command(train, commissioning, held, settings.model, result, settings.seed))
    row: dict[str, Any] = {
        "case": case.name,
        "group": group,
        "exam_seed": exam_seed,
        "index": index,
        "controller": case.controller,
        "sealed": digest,
        "code": ran.code,
        "seconds": round(ran.seconds, 2),
    }
    diagnosis = result / "diagnosis.json"
    try:
        finding = subject.read(diagnosis) if diagnosis.exists() else None
    except (KeyError, ValueError, TypeError) as error:
        finding, ran = None, ran._replace(message=f"diagnosis.json is not understood: {type(error).__name__} {error}")
    if finding is None:
        # no answer is a wrong answer: the case stays in every share
        finding = subject.Finding("none", (), 0, {}, False)
        row["failed"] = ran.message
        answer = answer_of(case, nominal)
    else:
        answer = sealing.unseal(exam, case.name, diagnosis)
    row |= {"hidden": answer["hidden"], **score(answer, finding)}
    if group == "twins":
        row |= follow(case, nominal, finding, answer, (train, commissioning, held), settings, diagnose)
    if not settings.keep:
        for path in (train, commissioning, held):
            path.unlink()
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}
