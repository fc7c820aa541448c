"""One run three ways: the plant called directly, every byte over a bus inside this process, and the plant in another process in real time.

``python -m tools.three_ways`` plays the 2-DoF swing with the HIL rig file at its rate. The first two must agree to the last bit; the third is
compared by rms and 99th percentile of |error| of the platform by its own IMU (which the law holds at zero) and in truth (which has the bias and
drift of the IMU too, another draw in each run), median of several runs, cycles near skipped ones left out.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from spsp_ctrl.config.loader import apply_overrides, load_rig, load_scenario
from spsp_ctrl.experiments import session
from spsp_ctrl.experiments.session import Plan
from spsp_ctrl.recording.reader import LogData, digest_topics, read_log

HIL = Path(__file__).parents[1] / "hil"
DIRECT = ("rig={driver: simulated, model: model.yaml, wire: {rated_current_a: 2.5}}",)
INSIDE = ("rig.world=in_process", "rig.truth=null", "rig.can.can0.interface=spsp-lockstep")
INSIDE += tuple(f"rig.serial.{name}.port=spsp-lockstep" for name in ("imu", "stepper"))
SHADOW_S = 0.5
"""Left out after a skipped cycle."""


def errors_arcmin(log: LogData, settle_s: float, end_s: float) -> dict[str, float]:
    """Rms and 99th percentile of |error|, without and with the neighbourhood of skipped cycles."""
    true, timing, measured = log.topics["/truth"], log.topics["/timing"], log.topics["/measurement"]
    t = true["stamp_ns"] * 1e-9
    keep = (t >= settle_s) & (t <= end_s)
    clean = keep.copy()
    for at in t[timing["skipped"] > 0]:
        clean &= (t < at) | (t > at + SHADOW_S)
    found: dict[str, float] = {"skipped": int(timing["skipped"].sum()), "clean_share": float(clean.sum() / max(keep.sum(), 1))}
    fresh = np.diff(measured["imu.seq"], prepend=-1) > 0
    for axis in ("pitch", "roll"):
        for kind, angle, those in (("imu", measured[f"imu.{axis}_rad"], fresh), ("true", true[f"platform_{axis}_rad"], keep)):
            error = np.degrees(angle) * 60.0
            for name, mask in (("", clean & those), ("_all", keep & those)):
                part = np.abs(error[mask])
                found[f"{axis}_{kind}_rms{name}"] = float(np.sqrt(np.mean(part**2))) if part.size else float("nan")
                found[f"{axis}_{kind}_p99{name}"] = float(np.percentile(part, 99)) if part.size else float("nan")
    return found


def lockstep(overrides: tuple[str, ...], duration_s: float, seed: int, folder: Path) -> LogData:
    """One run inside this process."""
    config = apply_overrides(load_rig(HIL / "rig-hil.yaml"), overrides).model
    scenario = load_scenario(HIL / "swing-2dof.yaml").model.model_copy(update={"duration_s": duration_s})
    folder.mkdir(parents=True)
    plan = Plan(config, scenario, HIL / "model.yaml", seed, False)
    return session.run_session(plan, session.prepare(plan), folder).log


def real_time(duration_s: float, seed: int, folder: Path, more: tuple[str, ...]) -> tuple[LogData, dict[str, Any]]:
    """One run against the plant in another process."""
    command = [sys.executable, "-c", "from spsp_ctrl.cli import main; main()", "hil", str(HIL / "swing-2dof.yaml"), "--no-screen", "--no-strict"]
    command += ["--duration", f"{duration_s:g}", "--seed", str(seed), "--out", str(folder), "--json"]
    command += [word for text in more for word in ("--set", text)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    log = read_log(folder / "run.mcap")
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    if done.returncode:
        print(f"  exit {done.returncode}: {summary['ended']}", file=sys.stderr)
    return log, summary


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--duration", type=float, default=60.0, help="seconds of a run (default 60)")
    parser.add_argument("--runs", type=int, default=5, help="runs in real time (default 5)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change the rig file of the runs in real time")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        direct = lockstep(DIRECT, args.duration, args.seed, root / "direct")
        lockstep(INSIDE, args.duration, args.seed, root / "bus")
        ours, theirs = digest_topics(root / "direct" / "run.mcap"), digest_topics(root / "bus" / "run.mcap")
        same = all(ours[topic] == theirs[topic] for topic in ("/measurement", "/control", "/truth"))
        settle = load_scenario(HIL / "swing-2dof.yaml").model.settle_s
        base = errors_arcmin(direct, settle, args.duration)
        runs, summaries = [], []
        for k in range(args.runs):
            log, summary = real_time(args.duration, args.seed, root / f"hil{k}", tuple(args.set))
            runs.append(errors_arcmin(log, settle, args.duration))
            summaries.append({"ended": summary["ended"], "buses": summary.get("buses", {}), "timing_us": summary["timing_us"]})
    median = {key: float(np.nanmedian([run[key] for run in runs])) for key in base} if runs else {}
    ratios = {key: median[key] / base[key] for key in base if runs and key.endswith(("rms", "p99"))}
    result = {"bit_for_bit": same, "direct": base, "real_time_median": median, "ratios": ratios, "runs": runs, "summaries": summaries}
    if args.json:
        print(json.dumps(result, indent=2))
    else:
        print(f"direct and in-process bus: {'the same to the last bit' if same else 'DIFFERENT'}")
        print(f"{'':16}{'lock-step':>10}{'real time':>11}{'ratio':>8}")
        for key, ratio in ratios.items():
            print(f"{key:16}{base[key]:10.3f}{median[key]:11.3f}{ratio:8.3f}")
        for run, summary in zip(runs, summaries, strict=True):
            print(f"  {summary['ended']}, {run['skipped']} skipped, {100 * run['clean_share']:.0f} % counted, buses {summary['buses']}")
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
