"""What the axis is asked to do: references of 24 s at 500 Hz with load and temperature, and the names of the motions in them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tools.blind_exam.physics import RATE_HZ, Array, Inputs

CYCLES = 24 * RATE_HZ
DT = 1.0 / RATE_HZ
ACCEL_M_S2 = 0.6
LADDER_M_S = (0.0015, 0.004, 0.009, 0.018, 0.035, 0.055)


class Motion(NamedTuple):
    """Inputs of one log and where each motion in it starts."""

    inputs: Inputs
    events: tuple[tuple[int, str], ...]


class Pen:
    """Draws a reference segment by segment."""

    def __init__(self, start_m: float = 0.0) -> None:
        self.rates: list[Array] = []
        self.events: list[tuple[int, str]] = []
        self.cycles = 0
        self.at_m = start_m
        self.start_m = start_m

    def name(self, motion: str) -> None:
        self.events.append((self.cycles, motion))

    def rate(self, rates: Array) -> None:
        self.rates.append(rates)
        self.cycles += len(rates)
        self.at_m += float(np.sum(rates)) * DT

    def dwell(self, seconds: float) -> None:
        self.rate(np.zeros(round(seconds * RATE_HZ)))

    def go(self, to_m: float, speed_m_s: float, accel: float = ACCEL_M_S2) -> None:
        """Trapezoid in speed, exact in distance."""
        way = to_m - self.at_m
        if abs(way) < 1e-9:
            return
        speed = min(speed_m_s, float(np.sqrt(accel * abs(way))))
        ramp = max(2, round(speed / accel * RATE_HZ))
        flat = max(0, round((abs(way) / speed) * RATE_HZ) - ramp)
        shape = np.concatenate([np.arange(1, ramp + 1) / ramp, np.ones(flat), np.arange(ramp - 1, -1, -1) / ramp])
        self.rate(shape * (way / (float(np.sum(shape)) * DT)))

    def wave(self, position: Array) -> None:
        """A given course, relative to where the pen is and beginning at zero."""
        self.rate(np.diff(np.append(position, position[-1])) / DT)

    def motion(self, load_n: Array, load_kg: Array, screw_c: Array, ambient_c: Array | None = None) -> Motion:
        rates = np.concatenate(self.rates)
        rates = np.concatenate([rates, np.zeros(max(0, CYCLES - len(rates)))])[:CYCLES]
        course = self.start_m + np.concatenate([[0.0], np.cumsum(rates)[:-1]]) * DT
        inputs = Inputs(course, rates, load_n, load_kg, screw_c, np.full(CYCLES, 20.0) if ambient_c is None else ambient_c)
        return Motion(inputs, tuple((at, name) for at, name in self.events if at < CYCLES))


def _ramp(points: list[tuple[float, float]]) -> Array:
    t = np.arange(CYCLES) * DT
    return np.asarray(np.interp(t, [p[0] for p in points], [p[1] for p in points]), np.float64)


def _multisine(seconds: float, rms_m: float, rng: np.random.Generator, low: float = 0.25, high: float = 9.0) -> Array:
    """Odd lines with random phase, amplitude falling with frequency so that the current stays flat; windowed at its ends."""
    n = round(seconds * RATE_HZ)
    t = np.arange(n) * DT
    lines = np.arange(1, 200, 2) * 0.25
    lines = lines[(lines >= low) & (lines <= high)]
    wave = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / (1.0 + (f / 0.8) ** 2) for f in lines)
    edge = np.minimum(1.0, np.minimum(t, t[::-1]) / 0.25)
    wave = np.asarray(wave) * edge**2 * (3 - 2 * edge)
    return np.asarray(wave * (rms_m / np.sqrt(np.mean(wave**2))))


def training(seed: int) -> Motion:
    """Ladder both ways, reversals of several sizes, multisine, two equal laps with dwell; load steps and a warm-up."""
    rng = np.random.default_rng([seed, 1])
    pen = Pen()
    pen.name("still")
    pen.dwell(0.2)
    pen.name("ladder")
    for speed in LADDER_M_S:
        way = min(0.02, 0.3 * speed + 0.0005)
        pen.go(way, speed)
        pen.go(-way * 0.6, speed)
    pen.go(0.0, 0.03)
    pen.name("reversals")
    for size in (2e-5, 6e-5, 2e-4, 8e-4, 3e-3):
        for _ in range(2):
            pen.go(pen.at_m + size, 0.006, 0.3)
            pen.go(pen.at_m - size, 0.006, 0.3)
    pen.name("multisine")
    pen.wave(_multisine(3.6, 0.0035, rng))
    lap_s = (CYCLES - pen.cycles) * DT / 2
    for _ in range(2):
        pen.name("repeat")
        end = pen.cycles + int(lap_s * RATE_HZ)
        pen.go(0.026, 0.05)
        pen.dwell(0.25)
        pen.go(-0.026, 0.025)
        pen.dwell(0.25)
        pen.go(0.0, 0.05)
        pen.dwell(max(0.0, (end - pen.cycles) * DT))
    lap_a, lap_b = CYCLES - 2 * int(lap_s * RATE_HZ), CYCLES - int(lap_s * RATE_HZ)
    load = np.zeros(CYCLES)
    mass = np.zeros(CYCLES)
    at = {name: cycle for cycle, name in reversed(pen.events)}
    load[: at["reversals"]] = 20.0
    load[at["multisine"] : lap_a] = 80.0  # none in the reversals: the nut goes from flank to flank there
    mass[lap_a:] = 5.0
    load[lap_a:] = 40.0
    half = np.arange(CYCLES - lap_b)
    load[lap_a + half[half > len(half) // 2]] = 100.0
    load[lap_b + half[half > len(half) // 2]] = 100.0
    return pen.motion(load, mass, _ramp([(0, 20), (3, 20), (lap_a * DT, 34), (24, 34)]), _ramp([(0, 20), (16, 24), (24, 24)]))


def held_out(seed: int) -> Motion:
    """Another kind: chirp, random point-to-point moves, steps held, a fast swing; other loads, cooling."""
    rng = np.random.default_rng([seed, 2])
    pen = Pen()
    pen.name("still")
    pen.dwell(0.2)
    pen.name("points")
    while pen.cycles < 9 * RATE_HZ:
        pen.go(float(rng.uniform(-0.029, 0.029)), float(np.exp(rng.uniform(np.log(0.003), np.log(0.06)))), 0.8)
        pen.dwell(float(rng.uniform(0.05, 0.3)))
    pen.go(0.0, 0.04)
    pen.name("chirp")
    t = np.arange(6 * RATE_HZ) * DT
    pen.wave(0.012 * np.sin(2 * np.pi * (0.2 * t + (2.8 / 12) * t**2)) / (1.0 + 0.9 * t) * np.minimum(1, t[::-1] / 0.4))
    pen.go(0.0, 0.03)
    pen.name("staircase")
    for step in (3e-5, 1e-4, 4e-4, 2e-3, -5e-3, -1e-3, -2e-4, -5e-5):
        pen.go(pen.at_m + step, 0.02, 0.5)
        pen.dwell(0.12)
    pen.go(0.0, 0.03)
    pen.name("swing")
    t = np.arange(max(RATE_HZ, CYCLES - pen.cycles)) * DT
    pen.wave(0.024 * np.sin(2 * np.pi * 0.37 * t) * np.minimum(1.0, t / 0.5))
    load = _ramp([(0, 60), (5, 60), (5.002, 10), (12, 110), (18, 30), (24, 90)])
    mass = np.where(np.arange(CYCLES) > 15 * RATE_HZ, 3.0, 0.0)
    return pen.motion(load, mass, _ramp([(0, 36), (8, 36), (20, 22), (24, 22)]), _ramp([(0, 25), (24, 21)]))


def poor(seed: int) -> Motion:
    """One slow sine: most of the library is not excited."""
    rng = np.random.default_rng([seed, 3])
    pen = Pen()
    pen.name("sine")
    t = np.arange(CYCLES) * DT
    pen.wave(rng.uniform(0.010, 0.016) * np.sin(2 * np.pi * t / 8.0))
    constant = np.full(CYCLES, 40.0)
    return pen.motion(constant, np.zeros(CYCLES), np.full(CYCLES, 24.0))


def plain(seed: int) -> Motion:
    """Laps at three speeds that never rest, one load, one temperature: what many a bench records, and on which several names look alike."""
    pen = Pen()
    pen.name("laps")
    speeds = (0.045, 0.025, 0.014)
    lap = 0
    while pen.cycles < CYCLES:
        speed = speeds[lap % 3]
        pen.go(0.02, speed)
        pen.go(-0.02, speed)
        lap += 1
    return pen.motion(np.full(CYCLES, 40.0), np.zeros(CYCLES), np.full(CYCLES, 30.0))


def plain_held_out(seed: int) -> Motion:
    """Other laps of the same kind: random places, no rest, the same load and temperature."""
    rng = np.random.default_rng([seed, 4])
    pen = Pen()
    pen.name("places")
    side = 1.0
    while pen.cycles < CYCLES:
        pen.go(side * float(rng.uniform(0.008, 0.026)), float(rng.uniform(0.012, 0.05)), 0.8)
        side = -side
    return pen.motion(np.full(CYCLES, 40.0), np.zeros(CYCLES), np.full(CYCLES, 30.0))


KINDS = {"training": training, "held_out": held_out, "poor": poor, "plain": plain, "plain_held_out": plain_held_out}
