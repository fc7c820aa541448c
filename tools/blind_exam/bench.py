"""The bench of the exam: a motion file (``spsp-ctrl/axis-scenario/1``), read as plain YAML by its description in docs/diagnose.md."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tools.blind_exam.motions import Motion
from tools.blind_exam.physics import RATE_HZ, Array, I, Inputs, Law

MM = 1e-3


class BenchError(Exception):
    """The file asks for what this bench cannot do."""


def read(path: Path, nominal: Array) -> tuple[Motion, Law]:
    """Motion and loop of a file. Raises ``BenchError`` where it leaves what the bench can bear."""
    raw = yaml.safe_load(path.read_text(encoding="utf-8"))
    if raw.get("schema") != "spsp-ctrl/axis-scenario/1" or float(raw["rate_hz"]) != RATE_HZ:
        raise BenchError(f"{path.name}: not a motion at {RATE_HZ} Hz")
    law = _law(raw["controller"], nominal)
    course, rates, events = _course(raw)
    t = np.arange(len(course)) / RATE_HZ
    if np.max(np.abs(course)) > 0.034 or np.max(np.abs(rates)) > 0.1:
        raise BenchError(f"{path.name}: beyond the stroke or the speed of the screw")
    inputs = Inputs(
        course,
        rates,
        _steps(raw.get("load_n", [[0.0, 0.0]]), t),
        _steps(raw.get("mass_kg", [[0.0, 0.0]]), t),
        np.interp(t, *np.transpose(raw.get("screw_c", [[0.0, 20.0]]))),
        np.full(len(course), float(raw.get("ambient_c", 20.0))),
    )
    if np.max(np.abs(inputs.load_force_n)) > 150.0 or np.max(inputs.load_mass_kg) > 10.0 or np.ptp(inputs.screw_c) > 40.0:
        raise BenchError(f"{path.name}: no such weight or heater")
    return Motion(inputs, events), law


def _law(section: dict[str, Any], nominal: Array) -> Law:
    if section.get("kind") != "cascade" or int(section.get("rate_span", 1)) != 1:
        raise BenchError("only a cascade over one cycle runs here")
    return Law(
        float(section["kp_1_s"]),
        float(section["kv"]),
        float(section.get("feedforward", 0.0)),
        min(float(section.get("limit", 5.0)), 6.0),
        float(section.get("feedback") == "resolver"),
        float(nominal[I.lead] / nominal[I.gear]),
        float(nominal[I.counts]),
    )


def _steps(points: list[list[float]], t: Array) -> Array:
    """Each value holds until the next."""
    out = np.full(len(t), float(points[0][1]))
    for at, value in points[1:]:
        out[t >= at - 1e-9] = value
    return out


def _course(raw: dict[str, Any]) -> tuple[Array, Array, tuple[tuple[int, str], ...]]:
    cycles, at = round(float(raw["seconds"]) * RATE_HZ), float(raw.get("start_mm", 0.0)) * MM
    start, parts, events, passed = at, [], [], 0
    for segment in raw["segments"]:
        if segment.get("name"):
            events.append((passed, str(segment["name"])))
        if "move" in segment:
            move = segment["move"]
            way = float(move["to_mm"]) * MM - at
            at = float(move["to_mm"]) * MM
            rates = _trapezoid(way, float(move["speed_mm_s"]) * MM, float(move.get("acceleration_mm_s2", 500.0)) * MM)
        elif "wave" in segment:
            rates = _wave(segment["wave"])
        else:
            rates = np.zeros(round(float(segment["rest_s"]) * RATE_HZ))
        parts.append(rates)
        passed += len(rates)
    rates = np.concatenate([*parts, np.zeros(max(0, cycles - passed))])[:cycles]
    course = start + np.concatenate([[0.0], np.cumsum(rates)[:-1]]) / RATE_HZ
    return course, rates, tuple((k, name) for k, name in events if k < cycles)


def _trapezoid(way: float, speed: float, acceleration: float) -> Array:
    if abs(way) < 1e-12:
        return np.zeros(0)
    speed = min(speed, float(np.sqrt(acceleration * abs(way))))
    ramp = max(2, round(speed / acceleration * RATE_HZ))
    flat = max(0, round(abs(way) / speed * RATE_HZ) - ramp)
    shape = np.concatenate([np.arange(1, ramp + 1) / ramp, np.ones(flat), np.arange(ramp - 1, -1, -1) / ramp])
    return np.asarray(shape * (way * RATE_HZ / float(np.sum(shape))))


def _wave(wave: dict[str, Any]) -> Array:
    seconds, low = float(wave["seconds"]), float(wave["from_hz"])
    high = float(wave.get("to_hz") or low)
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    edge = np.clip(np.minimum(t, t[::-1]) / min(0.5, seconds / 2), 0.0, 1.0)
    size = float(wave["amplitude_mm"]) * MM * low / (low + (high - low) * t / seconds)
    place = size * np.sin(2 * np.pi * (low * t + (high - low) * t**2 / (2 * seconds))) * edge**2 * (3 - 2 * edge)
    return np.asarray(np.diff(np.append(place, 0.0)) * RATE_HZ)
