"""What a foreign recording is judged by before it becomes a log: sample time, holes, NaN, whole numbers, signs, scaling, saturation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spsp_ctrl.config.import_map import Time

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
OK, NOTE, REFUSED, ACCEPTED = "ok", "note", "refused", "accepted"
COUPLED = 0.8
"""Two channels are compared only where their correlation says that one follows the other."""


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table of checks."""

    name: str
    channel: str
    value: float
    """What was found."""
    limit: str
    """What is allowed, in words."""
    verdict: str
    """``ok``, ``note``, ``refused``, or ``accepted`` where the map says so."""
    text: str = ""
    """What to do."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One imported column in SI units."""

    name: str
    source: str
    unit: str
    low: float
    high: float
    rms: float
    step: float
    """Smallest change: its resolution."""
    hold_s: float
    """Longest time without a change."""
    missing: int
    """Samples that are NaN."""


@dataclass(frozen=True, slots=True)
class Grid:
    """The samples in time."""

    stamps_ns: Ints
    """From 0."""
    cycles: Ints
    rate_hz: float
    start_s: float
    """Time of the file at the first sample."""


def constant_rate(samples: int, time: Time) -> Grid:
    """Samples that follow each other without a time column."""
    assert time.rate_hz is not None
    cycles = np.arange(samples, dtype=np.int64)
    return Grid(np.rint(cycles * (1e9 / time.rate_hz)).astype(np.int64), cycles, time.rate_hz, 0.0)


def judge_time(t: Array, time: Time) -> tuple[Grid | None, list[Check]]:
    """Grid and checks of a time column in seconds. No grid when a check is so wrong that there is none."""
    bad = int(np.count_nonzero(~np.isfinite(t)))
    checks = [Check("time-finite", "time", bad, "0 samples", OK if not bad else REFUSED, "" if not bad else "the time column has holes")]
    if bad or len(t) < 3:
        if not bad:
            checks.append(Check("samples", "time", len(t), ">= 3", REFUSED, "nothing to import"))
        return None, checks
    steps = np.diff(t)
    back = np.flatnonzero(steps <= 0.0)
    text = f"sample {back[0] + 2} does not come after the one before it" if len(back) else ""
    checks.append(Check("monotonic", "time", len(back), "0 steps back", REFUSED if len(back) else OK, text))
    if len(back):
        return None, checks
    typical = float(np.median(steps))
    counts = np.maximum(np.rint(steps / typical), 1.0).astype(np.int64)
    cycles = np.concatenate(([0], np.cumsum(counts)))
    if cycles[-1] > 10 * len(t):  # before the fit: mostly holes
        checks.append(Check("gaps", "time", float(steps.max()), f"<= {time.max_gap_s:g} s", REFUSED, "more holes than samples"))
        return None, checks
    period = float(np.polyfit(cycles - cycles[-1] / 2.0, t - t[0], 1)[0])
    rate = 1.0 / period
    if time.rate_hz is not None:
        error = rate / time.rate_hz - 1.0
        wrong = abs(error) > time.max_rate_error
        text = f"the time column says {rate:.6g} Hz" + (": unit of the time column?" if abs(error) > 0.5 else "") if wrong else ""
        checks.append(Check("rate", "time", error, f"within {time.max_rate_error:g} of {time.rate_hz:g} Hz", REFUSED if wrong else OK, text))
        rate = time.rate_hz
    elif abs(rate - round(rate)) < 1e-5 * rate and rate > 0.5:
        rate = float(round(rate))
    jitter = float(np.max(np.abs(steps / period - counts)))
    wrong = jitter > time.max_jitter
    text = f"at sample {int(np.argmax(np.abs(steps / period - counts))) + 2}: resample, or raise time.max_jitter" if wrong else ""
    checks.append(Check("jitter", "time", jitter, f"<= {time.max_jitter:g} of {period * 1e3:.6g} ms", REFUSED if wrong else OK, text))
    holes = np.flatnonzero(counts > 1)
    longest = float(steps[holes].max() - period) if len(holes) else 0.0
    wrong = longest > time.max_gap_s + 1e-9
    text = f"{len(holes)} holes, the first after sample {holes[0] + 1}" if len(holes) else ""
    verdict = REFUSED if wrong else NOTE if len(holes) else OK
    checks.append(Check("gaps", "time", longest, f"<= {time.max_gap_s:g} s", verdict, text))
    return Grid(np.rint((t - t[0]) * 1e9).astype(np.int64), cycles, rate, float(t[0])), checks


def describe(name: str, source: str, unit: str, values: Array, rate_hz: float) -> Channel:
    """Facts of a column for the table of channels."""
    good = values[np.isfinite(values)]
    missing = len(values) - len(good)
    if not len(good):
        return Channel(name, source, unit, float("nan"), float("nan"), float("nan"), 0.0, 0.0, missing)
    moves = np.abs(np.diff(good))
    edges = np.concatenate(([0], np.flatnonzero(moves) + 1, [len(good)]))
    step = float(moves[moves > 0.0].min()) if np.any(moves > 0.0) else 0.0
    rms = float(np.sqrt(np.mean(good * good)))
    return Channel(name, source, unit, float(good.min()), float(good.max()), rms, step, float(np.diff(edges).max()) / rate_hz, missing)


def judge_values(name: str, kind: type, values: Array) -> Iterator[Check]:
    """Checks of one column by itself."""
    endless = int(np.count_nonzero(np.isinf(values)))
    missing = int(np.count_nonzero(np.isnan(values)))
    if endless:
        yield Check("finite", name, endless, "0 samples", REFUSED, "infinite values")
    if missing:
        first = int(np.flatnonzero(np.isnan(values))[0]) + 1
        yield Check("nan", name, missing, "0 samples", REFUSED, f"the first at sample {first}: cut them out with from_s, to_s")
    if kind is float or missing or endless:
        return
    off = float(np.max(np.abs(values - np.rint(values)), initial=0.0))
    if kind is bool:
        wrong = not bool(np.all((values == 0.0) | (values == 1.0)))
        yield Check("flag", name, float(np.max(values)), "0 or 1", REFUSED if wrong else OK, "a flag holds 0 or 1" if wrong else "")
    else:
        yield Check("whole", name, off, "whole numbers", OK if off < 1e-6 else NOTE, "rounded to whole counts" if off >= 1e-6 else "")


def saturated(name: str, values: Array) -> Check | None:
    """A channel that sits on its own largest or smallest value: clipped by an amplifier, a converter or a controller."""
    if len(np.unique(values[:10_000])) < 16 or not np.all(np.isfinite(values)):
        return None
    share = max(float(np.mean(values == values.max())), float(np.mean(values == values.min())))
    if share < 0.01:
        return None
    return Check("saturation", name, share, "< 0.01 of the samples", NOTE, "sits at its own extreme: clipped?")


def _rate(values: Array, rate_hz: float, lag: int) -> Array:
    """Central difference over 2 ``lag`` samples, at the inner samples."""
    return (values[2 * lag :] - values[: -2 * lag]) * (rate_hz / (2 * lag))


def _follow(name: str, label: str, x: Array, y: Array, low: float, high: float, hint: str) -> Iterator[Check]:
    """Does y follow x with a factor between ``low`` and ``high``? Nothing is said where they have little to do with each other."""
    x, y = x - x.mean(), y - y.mean()
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if xx <= 0.0 or yy <= 0.0:
        return
    r, slope = xy / (xx * yy) ** 0.5, xy / xx
    if abs(r) < COUPLED:
        yield Check(f"{name}-sign", label, r, f"correlation beyond {COUPLED:g}", NOTE, "not judged: one hardly follows the other")
        return
    yield Check(f"{name}-sign", label, r, "> 0", OK if r > 0.0 else REFUSED, "" if r > 0.0 else f"they move against each other: {hint}")
    if high > 0.0:
        wrong = not low <= abs(slope) <= high
        text = "unit, scale or offset of one of the two is wrong" if wrong else ""
        yield Check(f"{name}-scale", label, abs(slope), f"{low:g} .. {high:g}", REFUSED if wrong else OK, text)


def judge_axis(values: Mapping[str, Array], rate_hz: float) -> Iterator[Check]:
    """Signs and scaling of an axis, from the columns that were recorded."""
    have = values.keys()
    lag = max(1, round(0.005 * rate_hz))
    inner = slice(lag, -lag)
    if {"reference_m", "load_m"} <= have:
        yield from _follow("reference", "load_m on reference_m", values["reference_m"], values["load_m"], 0.5, 2.0, "sign of load_m or reference_m")
    if {"reference_m", "reference_m_s"} <= have:
        slope = _rate(values["reference_m"], rate_hz, lag)
        yield from _follow("reference-rate", "reference_m_s on d reference_m/dt", slope, values["reference_m_s"][inner], 0.8, 1.25, "sign of either")
    if {"resolver_counts", "load_m"} <= have:
        yield from _follow("resolver", "load_m on resolver_counts", values["resolver_counts"], values["load_m"], 0.0, 0.0, "sign of either")
    if {"command_a", "current_a"} <= have:
        yield from _follow("current", "current_a on command_a", values["command_a"], values["current_a"], 0.2, 5.0, "sign of either")
    if {"command_a", "load_m"} <= have and len(values["load_m"]) > 100 * lag:
        yield from _inertia(values["command_a"], values["load_m"], rate_hz, lag)


def _inertia(command: Array, load: Array, rate_hz: float, lag: int) -> Iterator[Check]:
    """A positive command must accelerate the load forwards: command = inertia * acceleration + friction + offset, inertia > 0."""
    speed = _rate(load, rate_hz, lag)
    acceleration = _rate(speed, rate_hz, lag)
    speed, drive = speed[lag:-lag], command[2 * lag : -2 * lag]
    scale = float(np.std(acceleration)) or 1.0
    top = float(np.abs(speed).max()) or 1.0
    columns = np.stack([acceleration / scale, speed / top, np.tanh(speed / (0.02 * top)), np.ones_like(speed)], axis=1)
    friction, *_ = np.linalg.lstsq(columns[:, 1:], drive, rcond=None)
    full, *_ = np.linalg.lstsq(columns, drive, rcond=None)
    without = float(np.sum((drive - columns[:, 1:] @ friction) ** 2))
    rest = float(np.sum((drive - columns @ full) ** 2))
    gain = 1.0 - rest / without if without > 0.0 else 0.0
    label = "acceleration of load_m on command_a"
    if gain < 0.2:
        yield Check("command-sign", label, gain, "explains >= 0.2", NOTE, "not judged: the command hardly shows in the acceleration")
        return
    right = float(full[0]) > 0.0
    text = "" if right else "a positive command brakes: sign of command_a or load_m"
    yield Check("command-sign", label, float(full[0]) / scale, "> 0", OK if right else REFUSED, text)


def judge_platform(values: Mapping[str, Array], rate_hz: float) -> Iterator[Check]:
    """Signs and scaling of an IMU: its gyro against its own attitude (small angles, so only roughly)."""
    lag = max(1, round(0.02 * rate_hz))
    for angle, gyro in (("imu.pitch_rad", "imu.gyro_y_rad_s"), ("imu.roll_rad", "imu.gyro_x_rad_s")):
        if {angle, gyro} <= values.keys() and len(values[angle]) > 4 * lag:
            slope = _rate(values[angle], rate_hz, lag)
            name = f"imu-{angle[4:].split('_')[0]}"
            yield from _follow(name, f"{gyro} on d {angle}/dt", slope, values[gyro][lag:-lag], 0.5, 2.0, "sign of either")
