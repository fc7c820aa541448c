"""A run on the push-rod bench (Figs 13, 14): the screw is turned from place to place, resolver and grating ruler are read at each.

No law takes part (the paper turns the rod by hand), so the log carries the bench's signals in the topics of the rig where they fit: resolver, drive
and temperature in ``/measurement``, the displacement by the resolver as ``estimate.rod_*`` and the commanded speed in ``/control``, rod, nut and
force in ``/truth``, the readings of each place as events ``station``. It has no rig file attached and cannot be replayed, which ``replay`` says.
"""

from __future__ import annotations

import json
from math import pi
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.loader import dump_resolved
from spsp_ctrl.experiments.cases import Case
from spsp_ctrl.experiments.signals import UM_PER_M, Array, Curves, Figures
from spsp_ctrl.mechanism.profile import staircase
from spsp_ctrl.messages import NO_MEASUREMENT, AxisTerms, AzimuthTerms, Command, Control, Estimate, Mode, Reference, ReferenceKind, Timing, Truth
from spsp_ctrl.plant.bench import PushRodBench
from spsp_ctrl.plant.model import load_model
from spsp_ctrl.recording.writer import Recorder
from spsp_ctrl.runtime.identity import versions

T = TypeVar("T")


def _zero(cls: type[T]) -> T:
    """A message of flat fields, all zero."""
    make: Any = cls
    return cast("T", make._make(kind() for kind in get_type_hints(cls).values()))


_ESTIMATE, _AXIS, _AZIMUTH = _zero(Estimate), _zero(AxisTerms), _zero(AzimuthTerms)
_REFERENCE = _zero(Reference)._replace(kind=int(ReferenceKind.JOINT))
_TRUTH = _zero(Truth)


class Reading(NamedTuple):
    """One place on one pass."""

    extending: bool
    displacement_mm: float
    """By the resolver through the transmission ratio."""
    error_um: float
    """Grating less resolver."""


def places_mm(from_mm: float, to_mm: float, step_mm: float) -> tuple[float, ...]:
    """There and back."""
    count = round(abs(to_mm - from_mm) / step_mm)
    there = tuple(float(v) for v in np.linspace(from_mm, to_mm, count + 1))
    return there + there[-2::-1]


def run(case: Case, model_path: Path, folder: Path) -> tuple[Figures, Curves, str]:
    """One bench run into ``folder``: figures, curves and how it ended."""
    scenario, config = case.scenario, case.config
    b = scenario.bench
    assert b is not None
    bench = PushRodBench(load_model(model_path), b, config.rate_hz, case.seed, scenario.temperature.ambient_c)
    actuator = config.pitch_actuator if b.actuator == "pitch" else config.roll_actuator
    travel_per_rad = actuator.screw_lead_mm * 1e-3 / (2.0 * pi * actuator.gear_ratio)
    rad_per_count = 2.0 * pi / 2**actuator.resolver_bits
    places = places_mm(b.from_mm, b.to_mm, b.step_mm)
    dwell = b.move_s + b.dwell_s
    files = {"scenario.yaml": dump_resolved(scenario), "model.yaml": model_path.read_text(encoding="utf-8")}
    about = {"bench": "push-rod", "seed": str(case.seed), "rate_hz": str(config.rate_hz), "scenario": scenario.name, "virtual": "true"}
    recorder = Recorder(folder / "run.mcap", real_time=False, attachments=files, metadata={"run": about, "versions": versions()})
    readings: list[Reading] = []
    period_ns = round(1e9 / config.rate_hz)
    cycles_per_place = round(dwell * config.rate_hz)
    try:
        for k in range(len(places) * cycles_per_place):
            now_ns = k * period_ns
            _, rate_mm_s = staircase(k / config.rate_hz, places, dwell, b.move_s)
            speed = rate_mm_s * 1e-3 / travel_per_rad
            bench.advance(speed)
            counts = bench.resolver()
            travel = counts * rad_per_count * travel_per_rad
            _record(recorder, bench, b.actuator, now_ns, k, counts, travel, speed)
            if (k + 1) % cycles_per_place == 0:
                place = k // cycles_per_place
                grating = bench.grating_m()
                reading = Reading(place <= len(places) // 2, travel * 1e3, (grating - travel) * UM_PER_M)
                readings.append(reading)
                row = reading._asdict() | {"grating_mm": grating * 1e3, "force_n": bench.force_n, "weight_n": b.weight_n}
                recorder.event(now_ns, "info", "station", json.dumps(row))
    finally:
        stats = recorder.close()
    figures: Figures = {"push_rod": _figures(readings), "log": {"records": stats.records, "lost": stats.lost, "problem": stats.problem}}
    (folder / "summary.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return figures, _curves(readings), "completed"


def _record(recorder: Recorder, bench: PushRodBench, axis: str, now_ns: int, k: int, counts: int, travel: float, speed: float) -> None:
    _, motor_rate, current = bench.motor
    none = NO_MEASUREMENT
    drive = none.drive_pitch._replace(stamp_ns=now_ns, seq=k, enabled=True, current_a=current, bus_voltage_v=bench.bus_voltage_v)
    screw: dict[str, Any] = {f"screw_{axis}_c": bench.screw_c}
    signals: dict[str, Any] = {
        f"resolver_{axis}": none.resolver_pitch._replace(stamp_ns=now_ns, seq=k, counts=counts),
        f"drive_{axis}": drive,
    }
    temperature = none.temperature._replace(stamp_ns=now_ns, seq=k)._replace(**screw)
    m = none._replace(stamp_ns=now_ns, cycle=k, temperature=temperature)._replace(**signals)
    believed: dict[str, Any] = {f"rod_{axis}_m": travel}
    wanted: dict[str, Any] = {f"{axis}_speed_rad_s": speed}
    command = Command(now_ns, k, True, 0.0, 0.0, 0.0, 0.0, 0.0)._replace(**wanted)
    control = Control(
        now_ns, k, int(Mode.DISARMED), 0, 0, 0, _ESTIMATE._replace(**believed), _REFERENCE, _AXIS, _AXIS, _AZIMUTH, command
    )
    true: dict[str, Any] = {
        f"rod_{axis}_m": bench.rod_m,
        f"screw_{axis}_m": bench.screw_m,
        f"rod_force_{axis}_n": bench.force_n,
        f"motor_{axis}_rate_rad_s": motor_rate,
        f"current_{axis}_a": current,
        f"screw_{axis}_c": bench.screw_c,
    }
    truth = _TRUTH._replace(stamp_ns=now_ns, cycle=k)._replace(**true)
    recorder.record_cycle(m, control, Timing(now_ns, k, 0, 0, 0, 0, 0, 0, 0), truth)


def _columns(readings: list[Reading]) -> tuple[NDArray[np.bool_], Array, Array]:
    table = np.array(readings, dtype=np.float64).reshape(-1, 3)
    return table[:, 0] > 0.5, table[:, 1], table[:, 2]


def _figures(readings: list[Reading]) -> Figures:
    """Largest and mean error in um, its fall over the stroke by a straight line, the distance of the passes."""
    extending, x, y = _columns(readings)
    slope = float(np.polyfit(x, y, 1)[0])
    up, down = y[extending][np.argsort(x[extending])], y[~extending][np.argsort(x[~extending])]
    shared = min(len(up), len(down))
    return {
        "places": len(y),
        "error_um_max": float(np.abs(y).max()),
        "error_um_mean": float(y.mean()),
        "fall_um": -slope * float(np.ptp(x)),
        "passes_um_mean": float(np.abs(up[:shared] - down[:shared]).mean()),
    }


def _curves(readings: list[Reading]) -> Curves:
    extending, x, y = _columns(readings)
    return {"push_rod.extending": (x[extending], y[extending]), "push_rod.retracting": (x[~extending], y[~extending])}
