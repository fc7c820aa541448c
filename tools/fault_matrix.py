"""Measure the fault matrix in lock-step: every signal x every kind x {ALIGNING, ACTIVE}, cause to safe command, and write it into ``docs/faults.md``.

``python -m tools.fault_matrix`` runs all and prints what misses; ``--only imu`` a part, ``--write`` keeps the table for the page. Each case starts
from the same moment of the same run (a fork of the process), so that it costs seconds of simulated time and not a start-up.
"""

from __future__ import annotations

import json
import os
import pickle
import sys
import time
from dataclasses import asdict, dataclass
from math import degrees, hypot
from pathlib import Path
from typing import Any

import click

from spsp_ctrl.config.injection import Injection
from spsp_ctrl.config.loader import load_rig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments.session import Plan, prepare
from spsp_ctrl.messages import Command, Measurement, Mode, Truth
from spsp_ctrl.rig.base import Rig
from spsp_ctrl.rig.injection import Fault as Injected
from spsp_ctrl.runtime import cycle
from spsp_ctrl.runtime.cycle import Controller, CycleState
from spsp_ctrl.safety.faults import BY_ID, BY_NUMBER, Reaction
from tools.fault_cases import MODES, Case, Observability, cases, rightly_named

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "fault-matrix.json"
PERIOD_NS = 1_000_000
START_S = {"ALIGNING": 0.6, "ACTIVE": 4.0}
HORIZON_S = 4.0
HARMLESS_ARCMIN = 60.0
"""Bound of the attitude error that a fault may cause while nobody can see it (and until it is safe)."""
HARMLESS_HEADING_DEG = 3.0

@dataclass
class Row:
    """Outcome of a case."""

    signal: str
    kind: str
    mode: str
    outcome: str
    """``detected``, ``noted`` (the run goes on with the last good value), ``harmless``, or ``missed`` (with the reason)."""
    fault: str
    reaction: str
    observable_ms: float | None
    """After the injection; None: never in this motion."""
    safe_ms: float | None
    """From observable to the first safe command (negative: before), or to the note."""
    limit_ms: float | None
    error_arcmin: float
    """Largest true attitude error beyond that of the fault-free run, until safe."""
    heading_deg: float
    condition: str
    why: str = ""


def scenario(mode: str) -> Scenario:
    """A motion in which every axis works."""
    values: dict[str, Any] = {
        "schema": "spsp-ctrl/scenario/1",
        "name": "fault-matrix",
        "duration_s": 60.0,
        "base": {
            "start_s": 0.1 if mode == "ALIGNING" else 0.5,
            "ramp_s": 2.0,
            "pitch": [{"amplitude_deg": 6.0, "period_s": 4.0}],
            "roll": [{"amplitude_deg": 12.0, "period_s": 8.0}],
            "yaw": [{"amplitude_deg": 6.0, "period_s": 6.0, "phase_deg": 40.0}],
        },
    }
    if mode == "ALIGNING":
        values["park"] = {"pitch_deg": 12.0, "roll_deg": -12.0, "azimuth_deg": 20.0}
    return Scenario.model_validate(values)


class Moment:
    """A run that has come to where faults are injected, and how it would go on without one."""

    def __init__(self, mode: str, horizon_s: float = HORIZON_S) -> None:
        config = load_rig(ROOT / "config" / "rig.yaml").model
        plan = scenario(mode)
        self.mode = mode
        self.rig: Rig = prepare(Plan(config, plan, ROOT / "config" / "model.yaml", 1, False))
        self.controller: Controller = cycle.controller(config)
        self.state: CycleState = cycle.start(config, plan.reference)
        self.first = round(START_S[mode] * 1e9 / PERIOD_NS)
        self.cycles = round(horizon_s * 1e9 / PERIOD_NS)
        for k in range(self.first):
            self.state, _, _ = self.advance(self.state, k)
        assert Mode(self.state.supervisor.mode).name == mode, self.state.supervisor
        self.healthy: list[Truth] = _forked(self._go_on)

    def advance(
        self, state: CycleState, k: int, faults: tuple[Injected, ...] = ()
    ) -> tuple[CycleState, Measurement, tuple[Measurement, Command, Command]]:
        """One cycle; also what was seen, sent and arrived."""
        now = k * PERIOD_NS
        good = self.rig.read(now)
        seen = good
        for fault in faults:
            if fault.signal.sample >= 0:
                row: list[Any] = list(seen)
                row[fault.signal.sample] = fault.frame(row[fault.signal.sample], now)
                seen = Measurement(*row)
        control, state = cycle.step(state, self.controller, seen, (), now, PERIOD_NS * 1e-9)
        arrived = control.command
        for fault in faults:
            if fault.signal.sample < 0:
                arrived = fault.command(arrived, now)
        self.rig.write(arrived, now)
        return state, good, (seen, control.command, arrived)

    def _go_on(self) -> list[Truth]:
        state, truth = self.state, []
        for k in range(self.first, self.first + self.cycles):
            state, _, _ = self.advance(state, k)
            found = self.rig.truth()
            assert found is not None
            truth.append(found)
        assert state.supervisor.fault is None, state.supervisor.fault
        return truth

    def play(self, case: Case) -> Row:
        """One case, in a fork."""
        row: Row = _forked(lambda: self._play(case))
        return row

    def _play(self, case: Case) -> Row:
        injection = Injection.model_validate({"signal": case.signal.name, "kind": case.kind, "at_s": self.first * 1e-3})
        fault = Injected(injection, 1)
        watching = Observability(case)
        state = self.state
        observable: int | None = None
        safe: int | None = None
        name = ""
        notes: dict[str, int] = {}
        error = heading = 0.0
        for i in range(self.cycles):
            state, good, (seen, sent, arrived) = self.advance(state, self.first + i, (fault,))
            if observable is None and watching.step(good, seen, sent, arrived, PERIOD_NS * 1e-9):
                observable = i
            said = state.said
            while said:
                number = said.bit_length() - 1
                said &= ~(1 << number)
                if BY_NUMBER[number].reaction == Reaction.HOLD:
                    notes.setdefault(BY_NUMBER[number].id, i)
            sup = state.supervisor
            if sup.mode in (Mode.STOPPING, Mode.FAULT) and sup.fault is not None:
                safe, name = i, sup.fault.id
                break
            truth, healthy = self.rig.truth(), self.healthy[i]
            assert truth is not None
            error = max(error, hypot(truth.platform_pitch_rad - healthy.platform_pitch_rad, truth.platform_roll_rad - healthy.platform_roll_rad))
            heading = max(heading, abs(truth.heading_rad - healthy.heading_rad))
        return judged(case, watching.words, observable, safe, name, notes, degrees(error) * 60.0, degrees(heading))


def judged(
    case: Case, words: str, observable: int | None, safe: int | None, name: str, notes: dict[str, int], error: float, heading: float
) -> Row:
    """The verdict on what happened."""
    row = Row(case.signal.name, case.kind, case.mode, "missed", name, "", observable, None, None, round(error, 2), round(heading, 3), words)
    bound = error <= HARMLESS_ARCMIN and heading <= HARMLESS_HEADING_DEG
    if safe is not None:
        fault = BY_ID[name]
        row.reaction, row.limit_ms = fault.reaction.name, fault.limit_ms
        row.safe_ms = float(safe - observable) if observable is not None else -1.0
        row.outcome = "detected"
        if not rightly_named(case, name):
            row.outcome, row.why = "missed", "named wrongly"
        elif row.safe_ms > fault.limit_ms:
            row.outcome, row.why = "missed", "too late"
        elif not bound:
            row.outcome, row.why = "missed", "error beyond the bound before it was safe"
        return row
    right = {n: i for n, i in notes.items() if rightly_named(case, n)}
    if right:
        row.fault, at = min(right.items(), key=lambda item: item[1])
        row.reaction, row.limit_ms = "HOLD", BY_ID[row.fault].limit_ms
        row.safe_ms = float(at - observable) if observable is not None else -1.0
        row.outcome = "noted"
        if not bound or row.safe_ms > row.limit_ms:
            row.outcome, row.why = "missed", "error beyond the bound" if not bound else "too late"
        return row
    if notes:
        row.fault, row.why = next(iter(notes)), "named wrongly"
    elif not bound:
        row.why = "not seen, and the error is beyond the bound"
    else:
        row.outcome = "harmless"
    return row


def _forked(work: Any) -> Any:
    """The result of ``work`` done in a copy of this process."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(read)
            with os.fdopen(write, "wb") as stream:
                pickle.dump(work(), stream)
            code = 0
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            os._exit(code)
    os.close(write)
    with os.fdopen(read, "rb") as stream:
        data = stream.read()
    _, status = os.waitpid(child, 0)
    if status:
        raise RuntimeError("a case ended in an exception; see above")
    return pickle.loads(data)


def run(wanted: list[Case], horizon_s: float = HORIZON_S, say: Any = lambda done, total: None) -> list[Row]:
    """Play cases, mode by mode."""
    rows = []
    for mode in MODES:
        part = [case for case in wanted if case.mode == mode]
        if part:
            moment = Moment(mode, horizon_s)
            for case in part:
                rows.append(moment.play(case))
                say(len(rows), len(wanted))
    return rows


@click.command(epilog="Example: python -m tools.fault_matrix --only resolver_pitch")
@click.option("--only", default="", help="Only signals that begin with this.")
@click.option("--write", is_flag=True, help="Keep the figures for docs/faults.md (then run python -m tools.make_docs).")
@click.option("--json", "as_json", is_flag=True, help="Print every row as JSON.")
def main(only: str, write: bool, as_json: bool) -> None:
    """Measure cause-to-safe times of every signal, kind and mode; exit 1 when a row misses its limit."""
    wanted = [case for case in cases() if case.signal.name.startswith(only)]
    began = time.monotonic()

    def say(done: int, total: int) -> None:
        if sys.stderr.isatty():
            print(f"\r{done}/{total}", end="", file=sys.stderr)

    rows = run(wanted, say=say)
    missed = [row for row in rows if row.outcome == "missed"]
    if as_json:
        print(json.dumps([asdict(row) for row in rows], indent=1))
    else:
        for outcome in ("detected", "noted", "harmless", "missed"):
            print(f"{outcome:9} {sum(row.outcome == outcome for row in rows):4}")
        for row in missed:
            print(row)
        print(f"{len(rows)} cases in {time.monotonic() - began:.0f} s")
    if write:
        known = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else []
        found = {(r["signal"], r["kind"], r["mode"]): r for r in (*known, *map(asdict, rows))}
        order = [(c.signal.name, c.kind, c.mode) for mode in MODES for c in cases() if c.mode == mode]
        RESULTS.write_text(json.dumps([found[key] for key in order if key in found], indent=0) + "\n", encoding="utf-8")
    raise SystemExit(1 if missed else 0)


if __name__ == "__main__":
    main()
