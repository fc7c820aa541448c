"""Draws of an experiment: motions nobody tuned on, plants within a tolerance. Each from one seed and the variant's name, whatever else is run."""

from __future__ import annotations

import subprocess
import zlib
from math import pi
from typing import Any

import numpy as np

from spsp_ctrl import __version__
from spsp_ctrl.config.drawn import Drawn, DrawnMotion, DrawnPlant, DrawnSea, DrawnSine
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import BaseMotion, ModelChange, Scenario, Sea, Sine, Spectrum
from spsp_ctrl.experiments.motion import motion_demand
from spsp_ctrl.mechanism.workspace import Travel
from spsp_ctrl.plant.model import PlantModel
from spsp_ctrl.runtime.identity import ROOT, law_digest

ATTEMPTS = 300
"""Draws of a motion before it is said that none fits the rig."""
SEA_PEAK = 3.3
SEA_OCTAVES = 1.5
LIKELY = 2.0
USED = 0.9
"""A drawn motion uses at most this much of each limit of the rig."""

NEVER_DRAWN: dict[str, str] = {
    "actuator.resolver_counts": "a whole number",
    "actuator.screw_lead": "a nominal dimension that the controller is given; its errors are the effect lead_error, which is drawn",
    "actuator.gear_ratio": "a ratio of whole teeth",
    "actuator.rod_min": "place of a hard stop",
    "actuator.rod_max": "place of a hard stop",
    "rig.column_height": "a nominal dimension that the controller is given; its error is the effect geometric_error, which is drawn",
    "rig.hinge_radius": "as column_height",
    "rig.az_teeth": "a whole number",
    "rig.az_microsteps": "a whole number",
    "rig.az_gear_ratio": "a ratio of whole teeth",
    "rig.az_stop": "place of a hard stop",
    "rig.az_switch": "place of a switch",
    "rig.az_home_half": "place of a switch",
    "rig.temperature_reference": "a definition, not a property",
    "rig.imu_rate": "a setting of the unit, whole cycles per frame",
    "effects.cogging.cogging_order": "a whole number",
}
"""Parameters that no draw touches, with the reason. Values of zero stay zero by themselves."""


class DrawError(ValueError):
    """Nothing that can be drawn fits the rig; the text says why."""


def commit_seed() -> tuple[int, str]:
    """A seed that nobody chose, and where it comes from: the commit of the program, or the digest of its law outside a repository."""
    try:
        done = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False, timeout=10)
        commit = done.stdout.strip() if done.returncode == 0 else ""
    except (OSError, subprocess.SubprocessError):
        commit = ""
    if commit:
        return int(commit[:12], 16) % 2**31, f"commit {commit[:12]}"
    digest = law_digest()
    return int(digest[:12], 16) % 2**31, f"version {__version__}, law {digest}"


def generator(seed: int, name: str) -> np.random.Generator:
    """Random numbers of one run of one variant."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, zlib.crc32(name.encode())])))


def draw(
    drawn: Drawn, name: str, seed: int, scenario: Scenario, config: RigConfig, model: PlantModel
) -> tuple[Scenario, dict[str, ModelChange], dict[str, Any]]:
    """The scenario with its drawn motion, the changes of the plant, and what was drawn for the summary. Raises ``DrawError``."""
    rng = generator(seed, name)
    about: dict[str, Any] = {}
    changes: dict[str, ModelChange] = {}
    if drawn.motion is not None:
        base = draw_motion(drawn.motion, scenario.base, scenario, config, seed, rng)
        scenario = scenario.model_copy(update={"base": base})
        about["motion"] = base.model_dump(include={"axis_order", "pitch", "roll"})
        if base.sea.pitch or base.sea.roll:
            about["motion"]["sea"] = {
                axis: {"rms_deg": s.rms_deg, "strongest_s": 1.0 / max(s.lines, key=lambda line: line[1])[0]}
                for axis, s in (("pitch", base.sea.pitch), ("roll", base.sea.roll))
                if s is not None
            }
    if drawn.plant is not None:
        changes = draw_plant(drawn.plant, model, rng)
        about["factors"] = {key: change.factor for key, change in changes.items() if change.factor is not None}
        about["phases_rad"] = {key: change.value for key, change in changes.items() if change.value is not None}
    return scenario, changes, about


def draw_motion(
    plan: DrawnMotion, base: BaseMotion, scenario: Scenario, config: RigConfig, seed: int, rng: np.random.Generator
) -> BaseMotion:
    """A motion within the ranges of ``plan`` that needs at most :data:`USED` of the rig's travel, speed and acceleration."""
    table_seed = int(np.random.SeedSequence(seed).spawn(1)[0].generate_state(1)[0])  # as plant.virtual seeds its swing table
    why = ""
    for _ in range(ATTEMPTS):
        found = base.model_copy(
            update={
                "axis_order": plan.axis_order[int(rng.integers(len(plan.axis_order)))],
                "pitch": tuple(_sine(s, rng) for s in plan.pitch),
                "roll": tuple(_sine(s, rng) for s in plan.roll),
                "sea": Sea(
                    pitch=_sea(plan.sea_pitch, rng) if plan.sea_pitch else None, roll=_sea(plan.sea_roll, rng) if plan.sea_roll else None
                ),
            }
        )
        try:
            why = beyond(found, scenario, config, table_seed)
        except ValueError as error:
            why = str(error)  # no attitude of the platform compensates it, or no phases of the sea keep its peak
        if not why:
            return found
    raise DrawError(f"none of {ATTEMPTS} drawn motions fits the rig; the last: {why}")


def beyond(base: BaseMotion, scenario: Scenario, config: RigConfig, seed: int) -> str:
    """Which limit a motion of the table would need more than :data:`USED` of; empty when none."""
    travel, limits = Travel.of(config.mechanism), config.limits
    demand = motion_demand(travel, base, scenario.reference, scenario.duration_s, seed)
    rods = (demand.pitch_rod, demand.roll_rod)
    checks = (
        ("pitch", max(-demand.pitch.low, demand.pitch.high), travel.pitch_limit_rad),
        ("roll", max(-demand.roll.low, demand.roll.high), travel.roll_limit_rad),
        ("stroke", max(r.high for r in rods), travel.stroke_max_m),
        ("stroke", max(-r.low for r in rods), -travel.stroke_min_m),
        ("rod speed", max(r.speed for r in rods), 1e-3 * limits.rod_speed_mm_s),
        ("rod acceleration", max(r.accel for r in rods), 1e-3 * limits.rod_accel_mm_s2),
        ("azimuth rate", demand.azimuth.speed, limits.azimuth_rate_deg_s * pi / 180.0),
        ("azimuth acceleration", demand.azimuth.accel, limits.azimuth_accel_deg_s2 * pi / 180.0),
    )
    return next((f"{name} of {need:.3g} against {USED:g} of {limit:.3g} (SI)" for name, need, limit in checks if need > USED * limit), "")


def _between(span: tuple[float, float], rng: np.random.Generator) -> float:
    return round(float(rng.uniform(*span)), 4)


def _sine(plan: DrawnSine, rng: np.random.Generator) -> Sine:
    return Sine(
        amplitude_deg=_between(plan.amplitude_deg, rng), period_s=_between(plan.period_s, rng), phase_deg=_between((-180.0, 180.0), rng)
    )


def _sea(plan: DrawnSea, rng: np.random.Generator) -> Spectrum:
    """A hump of lines about a period: weights fall by half an octave from the middle; spacing jitters, so that nothing repeats."""
    rms, middle_hz = _between(plan.rms_deg, rng), 1.0 / _between(plan.period_s, rng)
    half = 0.5 * SEA_OCTAVES
    spread = np.linspace(-half, half, plan.lines) + rng.uniform(-0.4, 0.4, plan.lines) * (2.0 * half / plan.lines)
    lines = tuple((round(float(middle_hz * 2.0**octave), 5), round(float(np.exp(-0.5 * (octave / (0.5 * half)) ** 2)), 4)) for octave in spread)
    return Spectrum(rms_deg=rms, peak_deg=min(19.0, SEA_PEAK * rms), lines=lines)


def drawable(model: PlantModel) -> tuple[list[str], list[str]]:
    """Dotted names of the parameters that get a factor, and of the phases that go anywhere."""
    factors, phases = [], []
    file = model.file
    for section in ("actuator", "pitch_actuator", "roll_actuator", "rig"):
        for key, quantity in getattr(file, section).items():
            general = f"{'actuator' if section.endswith('actuator') else section}.{key}"
            if general not in NEVER_DRAWN and quantity.value != 0.0:
                factors.append(f"{section}.{key}")
    for entry in file.effects:
        middle = f"{entry.effect}.{entry.axis}" if sum(e.effect == entry.effect for e in file.effects) > 1 else entry.effect
        for key, quantity in entry.parameters.items():
            if f"effects.{entry.effect}.{key}" in NEVER_DRAWN:
                continue
            if quantity.unit in ("rad", "deg") and key.endswith("phase"):
                phases.append(f"effects.{middle}.{key}")
            elif quantity.value != 0.0:
                factors.append(f"effects.{middle}.{key}")
    return factors, phases


def draw_plant(plan: DrawnPlant, model: PlantModel, rng: np.random.Generator) -> dict[str, ModelChange]:
    """A factor for every drawable parameter, an angle for every phase."""
    factors, phases = drawable(model)
    unknown = [name for name in plan.keep if name not in (*factors, *phases)]
    if unknown:
        raise DrawError(f"keep names {unknown[0]!r}, which is not a parameter that is drawn")
    span = 0.01 * plan.within_percent
    changes = {name: ModelChange(factor=float(1.0 + rng.uniform(-span, span))) for name in factors}
    changes |= {name: ModelChange(value=float(rng.uniform(0.0, 2.0 * pi)), unit="rad") for name in phases}
    return {name: change for name, change in changes.items() if name not in plan.keep}


def standing_out(about: dict[str, Any], many: list[dict[str, Any]], errors: list[float], count: int = 5) -> list[tuple[str, float, float]]:
    """Parameters of one draw that stand out: name, factor, and what a straight line through all draws says they add to the error.

    Only parameters count whose correlation with the error is beyond :data:`LIKELY` standard deviations of chance; among a hundred a few are so by
    chance, too: a hint where to look. With fewer than ten draws no line is trusted: the largest deviations come first, and the third number is 0.
    """
    names = list(about.get("factors", {}))
    if not names:
        return []
    mine = np.array([about["factors"][n] for n in names])
    if len(many) < 10:
        order = np.argsort(-np.abs(np.log(mine)))
        return [(names[i], float(mine[i]), 0.0) for i in order[:count].tolist()]
    x = np.array([[one["factors"][n] for n in names] for one in many])
    y = np.array(errors)
    centred, spread = x - x.mean(axis=0), x.var(axis=0)
    slope = (centred * (y - y.mean())[:, None]).mean(axis=0) / np.where(spread > 0.0, spread, np.inf)
    adds = slope * (mine - x.mean(axis=0))
    likely = np.abs(slope) * np.sqrt(spread) > LIKELY / np.sqrt(len(many)) * y.std()
    adds = np.where(likely, adds, 0.0)
    return [(names[i], float(mine[i]), float(adds[i])) for i in np.argsort(-adds)[:count].tolist() if adds[i] > 0.0]

