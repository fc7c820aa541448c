"""``python -m tools.blind_exam.platform``: the blind exam of the whole rig in closed loop. Draw, seal, diagnose, score, print.

The truth is ``platform_physics`` (nothing of ``plant/``); the real law runs on it through the driver seam and the session writes the logs.
"""

from __future__ import annotations

import json
import secrets
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

import spsp_ctrl
from spsp_ctrl.cli.common import EXIT_ROW_FAILED, JSON, bar, guarded
from spsp_ctrl.config.loader import load_rig, load_scenario
from spsp_ctrl.experiments import session
from spsp_ctrl.recording.reader import read_log
from tools.blind_exam import platform_machine as machine
from tools.blind_exam import sealing
from tools.blind_exam.ledger import Ledger, commit_of, settings_of
from tools.blind_exam.platform_machine import LEGS, LIBRARY, OUTSIDE, SEVERITIES, TWINS
from tools.blind_exam.platform_physics import Array
from tools.blind_exam.platform_rig import ExamRig
from tools.blind_exam.scoring import Share

SETS = ("single", "multiple", "nothing", "outside")
DETECTABLE = 1.5
TRAIN_S, HELD_S = 60.0, 40.0
TIMEOUT_S = 1800.0
FLAGS = ("unexplained", "partly-explained", "not-understood", "invalid")
SEEN = (
    "drive_pitch.current_a", "drive_roll.current_a", "resolver_pitch.counts", "resolver_roll.counts", "imu.pitch_rad", "imu.roll_rad", "imu.yaw_rad",
    "imu.received_ns",
)  # fmt: skip
"""Fields of the log by which an effect may be seen."""


class Item(NamedTuple):
    """One hidden thing."""

    name: str
    leg: int
    severity: float
    seed: int

    @property
    def where(self) -> str:
        """Its place."""
        places = (LIBRARY.get(self.name) or OUTSIDE[self.name]).places
        return places[self.leg] if places == LEGS else places[0]


def draw(group: str, seed: int, index: int) -> tuple[int, tuple[Item, ...]]:
    """Seed of the machine and what is hidden in it; the same seed gives the same case."""
    rng = np.random.default_rng([seed, 50, SETS.index(group), index])
    build = int(rng.integers(1 << 31))
    if group == "nothing":
        return build, ()
    kinds = list(OUTSIDE if group == "outside" else LIBRARY)
    order = np.random.default_rng([seed, 51, SETS.index(group), index // len(kinds)]).permutation(len(kinds))
    if group == "multiple":
        names = [str(n) for n in rng.choice(kinds, size=2 + index % 3, replace=False)]
        sizes = [float(rng.choice(SEVERITIES[2:])) for _ in names]
    else:
        names = [kinds[order[index % len(kinds)]]]
        sizes = [float(rng.choice(SEVERITIES[1:] if group == "single" else SEVERITIES[2:]))]
    return build, tuple(Item(n, int(rng.integers(2)), s, int(rng.integers(1 << 31))) for n, s in zip(names, sizes, strict=True))


def made(build: int, items: tuple[Item, ...]) -> tuple[Array, float, list[dict[str, float]]]:
    """The machine with the hidden things in it, extra delay of its IMU, and what the library would have to say."""
    p, late, values = machine.built(machine.nominal(), np.random.default_rng([build, 1])), 0.0, []
    for item in items:
        kind = LIBRARY.get(item.name) or OUTSIDE[item.name]
        said = kind.apply(p, item.leg, item.severity, np.random.default_rng([item.seed, 2]))
        late += said.get("imu_added_delay", 0.0)
        values.append(said)
    return p, late, values


def record(folder: Path, p: Array, late: float, held: bool, noise: int, short: float = 1.0) -> Path:
    """One session of the real law on the machine; returns its log."""
    config = load_rig(machine.ROOT / "config" / "rig.yaml").model
    played = load_scenario(machine.ROOT / "config" / "motions" / ("platform-check.yaml" if held else "platform-identify.yaml")).model
    played = played.model_copy(update={"duration_s": short * (HELD_S if held else TRAIN_S)})
    folder.mkdir(parents=True)
    plan = session.Plan(config, played, machine.MODEL, 1, False)
    session.run_session(plan, ExamRig(config, p, played, noise, late), folder)
    return folder / session.LOG_NAME


def shift(one: Path, other: Path, again: Path) -> float:
    """By how many floors the most touched field moves between two logs; ``again`` is the second machine with other noise."""
    rows = [read_log(p, topics=("/measurement",)).topics["/measurement"] for p in (one, other, again)]
    n = min(map(len, rows))
    best = 0.0
    for name in SEEN:
        a, b, c = (np.asarray(r[name][1000:n], np.float64) for r in rows)
        if name == "imu.received_ns":
            a, b, c = (x - np.asarray(r["imu.stamp_ns"][1000:n], np.float64) for x, r in zip((a, b, c), rows, strict=True))
        floor = float(np.sqrt(np.mean((b - c) ** 2) / 2.0))
        best = max(best, float(np.sqrt(np.mean((a - b) ** 2))) / max(floor, 1e-12) if floor > 0.0 or (a != b).any() else 0.0)
    return best


def twins(one: str, other: str) -> bool:
    """Whether two names count as one."""
    return one == other or any(one in t and other in t for t in TWINS)


def run_case(group: str, seed: int, index: int, out: Path, jobs: int, keep: bool) -> dict[str, Any]:
    """One row of the ledger."""
    build, items = draw(group, seed, index)
    name = f"platform-{group}-{seed}-{index:04d}"
    folder = out / "cases" / name
    shutil.rmtree(folder, ignore_errors=True)
    p, late, values = made(build, items)
    clean, clean_late, _ = made(build, ())
    train = record(folder / "train", p, late, False, 21)
    commissioning = record(folder / "commissioning", clean, clean_late, False, 22)
    held = record(folder / "held", p, late, True, 31)
    again = record(folder / "again", clean, clean_late, True, 33)
    hidden = []
    for k, (item, said) in enumerate(zip(items, values, strict=True)):
        q, q_late, _ = made(build, tuple(i for j, i in enumerate(items) if j != k))
        without = record(folder / f"without-{k}", q, q_late, True, 32)
        size = shift(held, without, again if len(items) == 1 else record(folder / f"without-{k}-again", q, q_late, True, 34))
        told = {"effect": item.name, "where": item.where, "severity": item.severity, "values": said}
        hidden.append(told | {"floors": size, "detectable": size >= DETECTABLE})
    answers = out / "answers" / name
    digest = sealing.seal(answers, name, {"group": group, "hidden": hidden}, secrets.token_hex(16))
    result = folder / "result"
    words = [sys.executable, "-m", "spsp_ctrl.cli", "diagnose", str(train), "--commissioning", str(commissioning), "--held-out", str(held)]
    words += ["--model", str(machine.MODEL), "--out", str(result), "--jobs", str(jobs)]
    begin = time.monotonic()
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        code, message = done.returncode, (done.stderr.strip().splitlines() or [""])[-1]
    except subprocess.TimeoutExpired:
        code, message = -1, "no end in time"
    row: dict[str, Any] = {"case": name, "group": group, "exam_seed": seed, "index": index, "sealed": digest, "code": code}
    row["seconds"] = round(time.monotonic() - begin, 1)
    diagnosis = result / "diagnosis.json"
    if diagnosis.exists():
        answer = sealing.unseal(answers, name, diagnosis)
        row |= score(answer["hidden"], json.loads(diagnosis.read_text(encoding="utf-8")))
    else:
        row |= score(hidden, {"verdict": "none", "effects": [], "unexplained": [], "gap": {}}) | {"failed": message}
    if not keep:
        shutil.rmtree(folder, ignore_errors=True)
    return row


def score(hidden: list[dict[str, Any]], said: dict[str, Any]) -> dict[str, Any]:
    """Points of one case."""
    named = [(e["name"], e["where"], {m["name"].split("@")[0] for m in e["class"]} | {e["name"]}) for e in said["effects"]]
    seen = [h for h in hidden if h["detectable"]]

    def is_right(h: dict[str, Any], e: tuple[str, str, set[str]]) -> bool:
        return any(twins(h["effect"], n) for n in e[2])

    first = bool(named) and bool(hidden) and any(is_right(h, named[0]) for h in hidden)
    place = first and any(is_right(h, named[0]) and h["where"] == named[0][1] for h in hidden)
    recall = sum(any(is_right(h, e) and h["where"] == e[1] for e in named) for h in seen)
    precise = sum(any(is_right(h, e) and h["where"] == e[1] for h in hidden) for e in named)
    errors = []
    if first and len(hidden) == 1 and named[0][0] == hidden[0]["effect"]:
        for key, true in hidden[0]["values"].items():
            got = said["effects"][0]["parameters"].get(key)
            if got is not None and true:
                errors.append(abs(got["value"] - true) / abs(true))
    flagged = bool(said["unexplained"]) or said["verdict"] in FLAGS
    return {
        "verdict": said["verdict"], "hidden": hidden, "named": [f"{n}@{w}" for n, w, _ in named], "first_right": first, "where_right": place,
        "recall": [recall, len(seen)], "precision": [precise, len(named)], "exact": len(named) == len(seen) == recall, "errors": errors,
        "flagged": flagged, "misnamed": bool(named) and not flagged and not any(is_right(h, e) for h in hidden for e in named),
        "closed": [g["closed"] for g in said["gap"].values() if g["closed"] is not None],
    }  # fmt: skip


def figures(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Shares with Wilson intervals."""

    def share(values: list[bool]) -> str:
        return str(Share(sum(values), len(values)))

    out: dict[str, str] = {}
    by = {g: [r for r in rows if r["group"] == g] for g in SETS}
    if single := by["single"]:
        seen = [r for r in single if r["hidden"][0]["detectable"]]
        out["single: detectable"] = share([r["hidden"][0]["detectable"] for r in single])
        out["single: first name right, of detectable"] = share([r["first_right"] for r in seen])
        out["single: where right, of those named right"] = share([r["where_right"] for r in seen if r["first_right"]])
        errors = [e for r in seen for e in r["errors"]]
        if errors:
            out["single: parameter error"] = f"median {np.median(errors):.1%}, 90 % {np.quantile(errors, 0.9):.1%} (n {len(errors)})"
        closed = [min(r["closed"]) for r in seen if r["first_right"] and r["closed"]]
        if closed:
            out["single: gap closed, worst channel"] = f"median {np.median(closed):.2f}, worst tenth {np.quantile(closed, 0.1):.2f} (n {len(closed)})"
    if multiple := by["multiple"]:
        out["multiple: recall"] = str(Share(sum(r["recall"][0] for r in multiple), sum(r["recall"][1] for r in multiple)))
        out["multiple: precision"] = str(Share(sum(r["precision"][0] for r in multiple), sum(r["precision"][1] for r in multiple)))
        out["multiple: exact set"] = share([r["exact"] for r in multiple])
    if nothing := by["nothing"]:
        out["nothing: any name"] = share([bool(r["named"]) for r in nothing])
        out["nothing: flagged"] = share([r["flagged"] for r in nothing])
    if outside := by["outside"]:
        seen = [r for r in outside if r["hidden"][0]["detectable"]]
        out["outside: flagged, of detectable"] = share([r["flagged"] for r in seen])
        out["outside: confidently misnamed"] = share([r["misnamed"] for r in seen])
    out["no diagnosis at all"] = share(["failed" in r for r in rows])
    out["seconds"] = f"median {np.median([r['seconds'] for r in rows]):.0f}" if rows else "none"
    return out


@click.command(epilog="Example: python -m tools.blind_exam.platform --n 4 --seed 1 --jobs 2 --set single --out runs/platform-exam")
@click.option("--n", "count", default=4, show_default=True, type=click.IntRange(1), help="Cases of each set.")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="Seed of the draw.")
@click.option("--jobs", default=2, show_default=True, type=click.IntRange(1), help="Cores of one diagnosis; cases run one after the other.")
@click.option("--set", "groups", multiple=True, type=click.Choice(SETS), help="Only this set (repeatable); default: all.")
@click.option("--index", "indices", multiple=True, type=click.IntRange(0), help="Only this case of the set (repeatable), to run one again.")
@click.option("--out", default=Path("runs/platform-exam"), show_default=True, type=click.Path(path_type=Path), help="Folder of cases and answers.")
@click.option("--keep", is_flag=True, help="Keep the logs of every case.")
@click.option("--table-only", is_flag=True, help="Run nothing, print what the ledger has of this commit.")
@JSON
@guarded
def main(
    count: int, seed: int, jobs: int, groups: tuple[str, ...], indices: tuple[int, ...], out: Path, keep: bool, table_only: bool, as_json: bool
) -> None:
    """Examine `spsp-ctrl diagnose` on a platform that it has never seen, in closed loop."""
    commit = commit_of(Path(spsp_ctrl.__file__).parent)
    keyed = settings_of({"kind": "platform", "model": machine.MODEL.read_text(encoding="utf-8"), "exam": commit_of(Path(__file__).parent)})
    ledger = Ledger(out / "ledger.jsonl")
    wanted = [(group, index) for index in (indices or range(count)) for group in (groups or SETS)]
    todo = [] if table_only else [(g, i) for g, i in wanted if not ledger.has(commit, f"platform-{g}-{seed}-{i:04d}", keyed)]
    with bar("examining", as_json) as progress:
        for done, (group, index) in enumerate(todo):
            ledger.append({"commit": commit, "settings": keyed, **run_case(group, seed, index, out, jobs, keep)})
            progress(done + 1, len(todo))
    rows = ledger.of(commit, keyed, None if table_only else {f"platform-{g}-{seed}-{i:04d}" for g, i in wanted})
    if as_json:
        click.echo(json.dumps({"commit": commit, "settings": keyed, "cases": len(rows), "figures": figures(rows)}, indent=2))
    else:
        for what, value in figures(rows).items():
            click.echo(f"{what:<45} {value}")
        for r in rows:
            hidden = ", ".join(f"{h['effect']}@{h['where']} x{h['severity']:g} ({h['floors']:.1f} floors)" for h in r["hidden"]) or "nothing"
            named = ", ".join(r["named"]) or "no name"
            click.echo(f"  {r['group']} {r['index']}: {hidden} -> {named} [{r['verdict']}] {r['seconds']} s {r.get('failed', '')}")
    if any("failed" in r for r in rows):
        raise SystemExit(EXIT_ROW_FAILED)


if __name__ == "__main__":
    sys.exit(main())
