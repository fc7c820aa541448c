"""Every run of every shipped experiment without its log: does a fault-free rig ever set off an alarm?

``python -m tools.false_alarms --seconds 12`` plays the first seconds of each run in lock-step and prints every fault, and every note of a fault
that does not stop a run, with the run it came from. Exit 1 when there is one. Experiments that lose IMU frames on purpose (``dropouts``) are part of
it: they must be coasted over.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import click

from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.experiments import catalogue, runner
from spsp_ctrl.experiments.cases import Case
from spsp_ctrl.experiments.session import Plan, prepare
from spsp_ctrl.messages import Mode
from spsp_ctrl.runtime import cycle
from spsp_ctrl.safety.faults import BY_NUMBER

ROOT = Path(__file__).resolve().parents[1]
EXPECTED = ("steps-lost",)
"""Said by experiments whose stepper really loses steps."""


def alarms(case: Case, seconds: float) -> list[str]:
    """What the controller finds wrong in the first ``seconds`` of a run, once it was ready."""
    scenario = case.scenario
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "model.yaml"
        model.write_text(case.model_text, encoding="utf-8")
        rig = prepare(Plan(case.config, scenario, model, case.seed, False))
    controller, state = cycle.controller(case.config), cycle.start(case.config, scenario.reference)
    period_ns = round(1e9 / case.config.rate_hz)
    found: dict[str, float] = {}
    ready = False
    for k in range(round(min(seconds, scenario.duration_s) * case.config.rate_hz)):
        now = k * period_ns
        control, state = cycle.step(state, controller, rig.read(now), (), now, period_ns * 1e-9)
        rig.write(control.command, now)
        ready = ready or control.mode == Mode.ALIGNING
        if ready and state.said:
            for number, fault in BY_NUMBER.items():
                if state.said >> number & 1:
                    found.setdefault(fault.id, now * 1e-9)
        if control.fault:
            found.setdefault(BY_NUMBER[control.fault].id, now * 1e-9)
            break
    if not ready:
        found["never armed"] = seconds
    return [f"{name} at {t:.3f} s" for name, t in found.items() if name not in EXPECTED]


@click.command(epilog="Example: python -m tools.false_alarms --only ladder --seconds 8")
@click.option("--only", default="", help="Only experiments whose name begins with this.")
@click.option("--seconds", default=12.0, type=click.FloatRange(1.0, 3600.0), help="Of each run.")
@click.option("--repeats", default=1, type=click.IntRange(1, 100), help="Of each variant, law and motion.")
@click.option("--share", default=1, type=click.IntRange(1, 1000), help="Only every n-th run.")
def main(only: str, seconds: float, repeats: int, share: int) -> None:
    """Look for false alarms in the shipped experiments."""
    rig = load_rig(ROOT / "config" / "rig.yaml")
    runs = bad = 0
    began = time.monotonic()
    for name, path in catalogue.shipped(ROOT / "config" / "rig.yaml").items():
        if not name.startswith(only):
            continue
        experiment = runner.load(path, rig, None, repeats)
        for case in experiment.cases[::share]:
            if case.scenario.bench is not None:
                continue
            runs += 1
            found = alarms(case, seconds)
            if found:
                bad += 1
                print(f"{name} / {case.variant} / {case.motion} / {case.law}: {', '.join(found)}", flush=True)
        print(f"{name}: {runs} runs so far, {bad} with an alarm, {time.monotonic() - began:.0f} s", flush=True)
    raise SystemExit(1 if bad else 0)


if __name__ == "__main__":
    main()
