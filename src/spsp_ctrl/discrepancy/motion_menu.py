"""Safe motions from which a next experiment is chosen: what each pair of confusable names needs, inside what the bench has already shown to bear."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
import yaml

from spsp_ctrl.discrepancy.records import Record
from spsp_ctrl.plant.axis_model import AxisController, AxisModel
from spsp_ctrl.plant.axis_scenario import AXIS_SCENARIO_SCHEMA, AxisScenario
from spsp_ctrl.plant.layout import A, L

HIGHEST_LOAD_N = 115.0
"""Largest weight of the push-rod bench (Fig 14)."""
HIGHEST_MASS_KG = 5.0
WARM_K = 14.0
SECONDS = 16.0
CROSSOVER_HZ = 14.0
MARGIN = 0.95


@dataclass(frozen=True, slots=True)
class Reach:
    """What a motion keeps to, from the logs at hand."""

    low_m: float
    high_m: float
    speed_m_s: float
    current_a: float
    load_n: float
    screw_c: float
    ambient_c: float
    rate_hz: float
    controller: AxisController
    bare: bool


def reach_of(model: AxisModel, records: Sequence[Record]) -> Reach:
    """Travel, speed and current that these logs hold; the loop that made them, or one of ``CROSSOVER_HZ`` on the model."""
    load = np.concatenate([r.rows["load_m"] for r in records])
    speed = max(float(np.max(np.abs(r.rows["reference_m_s"]))) for r in records)
    if speed == 0.0:
        speed = max(float(np.quantile(np.abs(np.gradient(r.rows["load_m"])) * r.rate_hz, 0.999)) for r in records)
    first = records[0]
    return Reach(
        float(load.min()),
        float(load.max()),
        speed,
        max(float(np.max(np.abs(r.rows["command_a"]))) for r in records),
        max(float(np.max(r.rows["load_force_n"])) for r in records),
        float(np.median(first.rows["screw_c"][: round(first.rate_hz)])),
        float(np.median(first.rows["ambient_c"])),
        first.rate_hz,
        controller_of(model, records),
        model.file.bare,
    )


def controller_of(model: AxisModel, records: Sequence[Record]) -> AxisController:
    """The loop of the model, else that of a log, else one from the numbers of the model."""
    if model.file.controller.kind == "cascade":
        return model.file.controller
    for record in records:
        if record.controller == "cascade" and "controller.yaml" in record.attachments:
            try:
                raw = yaml.safe_load(record.attachments["controller.yaml"])
                found = AxisController.model_validate(raw.get("controller", raw))
            except (yaml.YAMLError, ValueError, AttributeError):
                continue
            if found.kind == "cascade" and found.kp_1_s > 0.0 and found.kv > 0.0:
                return found
    p = model.parameters()
    ratio, w = model.travel_per_rad, 2.0 * pi * CROSSOVER_HZ
    inertia = p[A.rotor_inertia_kg_m2] + p[L.moving_mass_kg] * ratio * ratio
    kv = float(w * inertia / p[A.torque_constant_nm_a] / ratio)
    feedback = "load" if model.file.bare or p[A.resolver_counts] == 0.0 else "resolver"
    limit = min(5.0, float(p[A.current_limit_a]))
    return AxisController.model_validate(
        {"kind": "cascade", "feedback": feedback, "kp_1_s": round(w / 4.0, 3), "kv": round(kv, 3), "feedforward": 1.0, "limit": limit, "rate_span": 1}
    )


def menu(reach: Reach) -> Iterator[AxisScenario]:
    """Every candidate that fits into the reach."""
    middle = 0.5e3 * (reach.low_m + reach.high_m)
    half = 0.5e3 * (reach.high_m - reach.low_m) * MARGIN
    top = 1e3 * reach.speed_m_s * MARGIN
    if half <= 0.0 or top <= 0.0:
        return
    loads = [] if reach.bare else [0.0, min(HIGHEST_LOAD_N, max(60.0, 1.2 * reach.load_n))]
    still = [[0.0, 0.0 if not loads else min(reach.load_n, loads[-1])]]
    cold, warm = reach.screw_c, reach.screw_c + WARM_K

    def made(name: str, title: str, segments: list[dict[str, object]], **inputs: object) -> AxisScenario | None:
        raw = {
            "schema": AXIS_SCENARIO_SCHEMA, "name": name, "title": title, "rate_hz": reach.rate_hz, "seconds": SECONDS,
            "start_mm": round(middle, 6), "controller": reach.controller.model_dump(mode="json"),
            "segments": segments, "load_n": still, "screw_c": [[0.0, cold]], "ambient_c": reach.ambient_c,
            "limits": {
                "travel_mm": [round(1e3 * reach.low_m - 0.05, 3), round(1e3 * reach.high_m + 0.05, 3)],
                "speed_mm_s": round(1.05e3 * reach.speed_m_s, 3), "current_a": round(max(1.5 * reach.current_a, 0.2), 3),
            },
            **inputs,
        }  # fmt: skip
        try:
            return AxisScenario.model_validate(raw)
        except ValueError:
            return None

    def go(to: float, speed: float, name: str = "") -> dict[str, object]:
        move = {"to_mm": round(to, 6), "speed_mm_s": round(speed, 6), "acceleration_mm_s2": round(max(500.0, 8.0 * speed), 3)}
        return ({"name": name} if name else {}) | {"move": move}

    def laps(count: int, speeds: Sequence[float], part: float = 1.0) -> list[dict[str, object]]:
        out: list[dict[str, object]] = [{"name": "still", "rest_s": 0.3}]
        for k in range(count):
            v = speeds[k % len(speeds)]
            out += [go(middle + part * half, v, "lap"), {"rest_s": 0.2}, go(middle - part * half, v), {"rest_s": 0.2}]
        return [*out, go(middle, speeds[0])]

    quick = [top, 0.4 * top]
    every = SECONDS / 8.0
    steps = [[round(k * every, 3), loads[k % 2]] for k in range(8)] if loads else still
    masses = [[round(k * 2.0 * every, 3), (0.0, HIGHEST_MASS_KG)[k % 2]] for k in range(4)]
    ramp = [[0.0, cold], [0.15 * SECONDS, cold], [0.6 * SECONDS, warm], [SECONDS, warm]]
    sizes = [0.02, 0.06, 0.2, 0.8, 3.0]
    small: list[dict[str, object]] = [{"name": "still", "rest_s": 0.3}]
    for size in [s for s in sizes if s < half] * 2:
        small += [go(middle + size, 0.2 * top, "reversals"), {"rest_s": 0.15}, go(middle, 0.2 * top), {"rest_s": 0.15}]
        small += [go(middle - size, 0.2 * top), {"rest_s": 0.15}, go(middle, 0.2 * top), {"rest_s": 0.15}]
    rungs: list[dict[str, object]] = [{"name": "still", "rest_s": 0.3}]
    for share in (0.02, 0.05, 0.12, 0.3, 0.6, 1.0):
        way = min(half, 1.2 * share * top)
        rungs += [go(middle + way, share * top, "ladder"), go(middle - way, share * top)]
    rungs.append(go(middle, 0.4 * top))
    fast = min(0.5 * half, 0.6 * top / (2.0 * pi * 0.6))
    chirp: list[dict[str, object]] = [
        {"name": "still", "rest_s": 0.3},
        {"name": "chirp", "wave": {"amplitude_mm": round(fast, 6), "from_hz": 0.6, "to_hz": 12.0, "seconds": 7.0}},
        {"rest_s": 0.3},
        {"name": "chirp", "wave": {"amplitude_mm": round(0.4 * fast, 6), "from_hz": 0.6, "to_hz": 20.0, "seconds": 7.0}},
    ]
    candidates = [
        made("laps-at-two-loads", "Laps with and without a weight", laps(4, quick), load_n=steps) if loads else None,
        made("laps-cold-and-warm", "The same laps cold and warm", laps(4, quick), screw_c=ramp),
        made("laps-with-two-masses", "Laps with and without an added mass", laps(4, quick), mass_kg=masses),
        made("small-reversals", "Reversals of growing size with rests", small),
        made("small-reversals-at-two-loads", "Reversals of growing size with rests, with and without a weight", small, load_n=steps)
        if loads
        else None,
        made("ladder", "Six speeds both ways", rungs),
        made("ladder-at-two-loads", "Six speeds both ways, with and without a weight", rungs, load_n=steps) if loads else None,
        made("chirp", "A sine of growing frequency", chirp),
        made("laps-long-and-short", "Laps over the whole stroke and over a tenth of it", [*laps(2, quick), *laps(3, [0.2 * top], 0.1)]),
    ]
    yield from (c for c in candidates if c is not None)
