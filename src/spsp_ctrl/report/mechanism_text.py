"""Results of the ``mechanism`` commands as JSON (units in the names) and as lines of text made from that JSON."""

from __future__ import annotations

from math import cos, isfinite, sin
from typing import Any

import numpy as np

from spsp_ctrl.experiments.motion import Demand, MotionDemand
from spsp_ctrl.mechanism import kinematics, mobility
from spsp_ctrl.mechanism.workspace import Travel, Workspace
from spsp_ctrl.report.text import number

DEG = 180.0 / np.pi
ARCMIN = 60.0 * DEG


def _finite(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _degrees(pair: tuple[float, float]) -> list[float | None]:
    return [_finite(angle * DEG) for angle in pair]


def _geometry(travel: Travel) -> dict[str, float]:
    return {
        "column_height_mm": 1e3 * travel.height_m,
        "moving_radius_mm": 1e3 * travel.moving_radius_m,
        "static_radius_mm": 1e3 * travel.static_radius_m,
        "rod_at_level_mm": 1e3 * travel.level_m,
        "pitch_limit_deg": travel.pitch_limit_rad * DEG,
        "roll_limit_deg": travel.roll_limit_rad * DEG,
        "stroke_min_mm": 1e3 * travel.stroke_min_m,
        "stroke_max_mm": 1e3 * travel.stroke_max_m,
    }


def pose_dict(travel: Travel, pitch_rad: float, roll_rad: float) -> dict[str, Any]:
    """Rods, Jacobian and conditioning at one pose."""
    l1, l2 = kinematics.rod_lengths(pitch_rad, roll_rad, *travel.lengths_m)
    j11, j21, j22 = kinematics.jacobian(pitch_rad, roll_rad, l1, l2, *travel.lengths_m)
    largest, weakest = kinematics.jacobian_gains(j11, j21, j22)
    return {
        "pitch_deg": pitch_rad * DEG,
        "roll_deg": roll_rad * DEG,
        "rod_length_mm": [1e3 * l1, 1e3 * l2],
        "rod_travel_mm": [1e3 * (l1 - travel.level_m), 1e3 * (l2 - travel.level_m)],
        "jacobian_mm_deg": {"l1_pitch": 1e3 * j11 / DEG, "l2_pitch": 1e3 * j21 / DEG, "l2_roll": 1e3 * j22 / DEG},
        "conditioning": weakest / largest,
        "arcmin_per_um": 1e-6 / weakest * ARCMIN,
    }


def workspace_dict(found: Workspace, pose: tuple[float, float] | None) -> dict[str, Any]:
    """Result of ``mechanism workspace``."""
    travel = found.travel
    rods = {}
    for name, rod, by_stroke in (
        ("pitch_rod", found.rods[0], found.pitch_by_stroke_rad),
        ("roll_rod", found.rods[1], found.roll_by_stroke_rad),
    ):
        rods[name] = {
            "needed_min_mm": 1e3 * rod.shortest_m,
            "needed_max_mm": 1e3 * rod.longest_m,
            "needed_min_at_deg": _degrees(rod.shortest_at_rad),
            "needed_max_at_deg": _degrees(rod.longest_at_rad),
            "stroke_ends_at_deg": _degrees(by_stroke),
        }
    return {
        "mechanism": _geometry(travel),
        **rods,
        "reachable_part": found.reachable,
        "tilt_any_direction_deg": found.any_direction_rad * DEG,
        "singular": {
            "pitch_deg": found.pitch_singular_rad * DEG,
            "roll_at_zero_pitch_deg": float(np.arctan2(travel.height_m, travel.static_radius_m)) * DEG,
            "roll_at_pitch_limit_deg": found.roll_singular_rad * DEG,
        },
        "conditioning_min": found.conditioning_min,
        "conditioning_min_at_deg": _degrees(found.conditioning_min_at_rad),
        "arcmin_per_um_max": 1e-6 / found.weakest_m * ARCMIN,
        "ball_swing_deg": _degrees(found.ball_swing_rad),
        "lower_hinge_swing_deg": _degrees(found.lower_swing_rad),
        **({"pose": pose_dict(travel, *pose)} if pose is not None else {}),
    }


def _pair(values: list[float | None], decimals: int, unit: str) -> str:
    return " / ".join("none" if v is None else number(v, decimals) for v in values) + f" {unit}"


def workspace_lines(result: dict[str, Any]) -> list[str]:
    """Text of ``mechanism workspace``."""
    m = result["mechanism"]
    lines = [
        f"column {m['column_height_mm']:g} mm, hinge radius {m['moving_radius_mm']:g} mm above, {m['static_radius_mm']:g} mm below, "
        f"rods {m['rod_at_level_mm']:.3f} mm at level",
        "",
    ]
    for name, limit in (("pitch", m["pitch_limit_deg"]), ("roll", m["roll_limit_deg"])):
        rod = result[f"{name}_rod"]
        low, high = rod["needed_min_mm"], rod["needed_max_mm"]
        short = [
            f"{field} = {number(end)} stops {name} at {number(angle, 3)}°"
            for field, end, angle, needed in (
                ("stroke_min_mm", m["stroke_min_mm"], rod["stroke_ends_at_deg"][1], low < m["stroke_min_mm"]),
                ("stroke_max_mm", m["stroke_max_mm"], rod["stroke_ends_at_deg"][0], high > m["stroke_max_mm"]),
            )
            if needed and angle is not None
        ]
        lines += [
            f"{name:<5} ±{limit:g}°  needs rod travel {number(low, 3)} / {number(high, 3)} mm "
            f"(stroke {number(m['stroke_min_mm'])} / {number(m['stroke_max_mm'])} mm)",
            *(f"             {text}" for text in short),
        ]
    s = result["singular"]
    c = result["conditioning_min_at_deg"]
    lines += [
        "",
        f"reachable of the joint limits   {100.0 * result['reachable_part']:.2f} %",
        f"tilt towards every direction    {number(result['tilt_any_direction_deg'], 3)}°",
        f"singular pitch                  {number(s['pitch_deg'], 2)}°",
        f"singular roll                   {number(s['roll_at_zero_pitch_deg'], 2)}° level, "
        f"{number(s['roll_at_pitch_limit_deg'], 2)}° at the pitch limit",
        f"worst conditioning              {number(result['conditioning_min'], 4)} at pitch {number(c[0], 1)}°, roll {number(c[1], 1)}°",
        f"worst error per µm of rod       {number(result['arcmin_per_um_max'], 4)}′",
        f"ball joints swing               {_pair(result['ball_swing_deg'], 2, '°')} (pitch / roll rod, from level)",
        f"lower hinges swing              {_pair(result['lower_hinge_swing_deg'], 2, '°')}",
    ]
    if "pose" in result:
        p = result["pose"]
        j = p["jacobian_mm_deg"]
        lines += [
            "",
            f"at pitch {number(p['pitch_deg'])}°, roll {number(p['roll_deg'])}°:",
            f"  rod travel    {_pair(p['rod_travel_mm'], 4, 'mm')}",
            f"  Jacobian      dl1/dpitch {number(j['l1_pitch'], 5)}, dl2/dpitch {number(j['l2_pitch'], 5)}, "
            f"dl2/droll {number(j['l2_roll'], 5)} mm/deg",
            f"  conditioning  {number(p['conditioning'], 4)}; worst error per µm of rod {number(p['arcmin_per_um'], 4)}′",
        ]
    return lines


def _variant(travel: Travel, r_axis: mobility.Axis, pose: tuple[float, float], pitch: Any, roll: Any) -> dict[str, Any]:
    here = mobility.mobility(*pose, *travel.lengths_m, r_axis=r_axis)
    many = mobility.mobility(pitch, roll, *travel.lengths_m, r_axis=r_axis)
    values, counts = np.unique(many.mobility, return_counts=True)
    return {
        "r_axis": r_axis,
        "pose": {
            "mobility": int(here.mobility),
            "wrench_rank": int(here.wrench_rank),
            "redundant_constraints": int(here.redundant_constraints),
            "locked_rank": int(here.locked_rank),
            "locked_condition": _finite(float(here.locked_condition)),
            "branches": [
                {
                    "name": b.name,
                    "joints": list(b.joints),
                    "twist_rank": int(b.twist_rank),
                    "wrenches": int(b.wrench_dimension),
                    "shared_wrenches": int(b.redundant),
                    "distance_from_others": _finite(float(b.residual)),
                }
                for b in here.branches
            ],
        },
        "random_poses": {
            "count": len(pitch),
            "mobility": {str(int(v)): int(n) for v, n in zip(values, counts, strict=True)},
            "redundant_constraints_min": int(many.redundant_constraints.min()),
            "redundant_constraints_max": int(many.redundant_constraints.max()),
            "rps_distance_max": float(many.branches[1].residual.max()),
            "locked_rank_min": int(many.locked_rank.min()),
            "locked_condition_max": _finite(float(many.locked_condition.max())),
        },
    }


def mobility_dict(travel: Travel, pose: tuple[float, float], poses: int, seed: int) -> dict[str, Any]:
    """Result of ``mechanism mobility``: both R axes at one pose and over seeded random poses."""
    rng = np.random.default_rng(seed)
    pitch = rng.uniform(-travel.pitch_limit_rad, travel.pitch_limit_rad, poses)
    roll = rng.uniform(-travel.roll_limit_rad, travel.roll_limit_rad, poses)
    wrench, distance = mobility.redundant_wrench(*pose, *travel.lengths_m)
    return {
        "mechanism": _geometry(travel),
        "pose_deg": _degrees(pose),
        "kutzbach": mobility.Kutzbach().mobility,
        "variants": [_variant(travel, axis, pose, pitch, roll) for axis in ("y", "x")],
        "redundant_wrench": {
            "branch": "RPS",
            "force": [float(v) for v in wrench[3:]],
            "couple_mm": [float(v) * 1e3 * travel.moving_radius_m for v in wrench[:3]],
            "expected_couple_mm": [1e3 * travel.moving_radius_m * v for v in (sin(pose[0]), 0.0, cos(pose[0]))],
            "distance_from_u_joint": distance,
        },
    }


def mobility_lines(result: dict[str, Any]) -> list[str]:
    """Text of ``mechanism mobility``."""
    where = f"pitch {number(result['pose_deg'][0])}°, roll {number(result['pose_deg'][1])}°"
    lines = [f"count of parts (Kutzbach): mobility {result['kutzbach']}: 6 bodies, 7 joints, 13 joint freedoms", ""]
    for v in result["variants"]:
        p, r = v["pose"], v["random_poses"]
        title = "R axis parallel y (the mechanism)" if v["r_axis"] == "y" else "R axis parallel x (as Eq (1) prints it)"
        lines += [f"{title}, at {where}:"]
        lines += [f"  {'branch':<8}{'twist rank':>11}{'wrenches':>10}{'shared':>8}   joints"]
        lines += [
            f"  {b['name']:<8}{b['twist_rank']:>11}{b['wrenches']:>10}{b['shared_wrenches']:>8}   {', '.join(dict.fromkeys(b['joints']))}"
            for b in p["branches"]
        ]
        spread = ", ".join(f"{m} at {n}" for m, n in r["mobility"].items())
        condition = p["locked_condition"]
        lines += [
            f"  wrench rank {p['wrench_rank']}, mobility {p['mobility']}, redundant constraints {p['redundant_constraints']}; "
            f"rods locked: rank {p['locked_rank']}" + (f", condition {number(condition, 2)}" if condition is not None else ""),
            f"  over {r['count']} random poses: mobility {spread}; redundant constraints "
            f"{r['redundant_constraints_min']} to {r['redundant_constraints_max']}; "
            f"RPS wrench at most {r['rps_distance_max']:.1e} from the U joint's",
            "",
        ]
    w = result["redundant_wrench"]
    force, couple = (", ".join(number(x, d) for x in w[key]) for key, d in (("force", 3), ("couple_mm", 2)))
    lines += [
        f"redundant: the RPS leg's force ({force}) through A1; about P it comes with a couple ({couple}) mm times the force.",
        f"The U joint takes the same already ({w['distance_from_u_joint']:.0e} from its span): the leg can be strained sideways against the",
        "column's torsion without any motion. The leg's R axis and A1 must therefore be aligned, or a little play left there.",
    ]
    return lines


def _demand(d: Demand, scale: float, unit: str) -> dict[str, float]:
    return {
        f"min_{unit}": d.low * scale,
        f"max_{unit}": d.high * scale,
        f"speed_{unit}_s": d.speed * scale,
        f"accel_{unit}_s2": d.accel * scale,
    }


def motion_dict(travel: Travel, demand: MotionDemand) -> dict[str, Any]:
    """Result of ``mechanism motion``."""
    beyond = []
    for name, d, low, high, fields in (
        ("pitch", demand.pitch, -travel.pitch_limit_rad, travel.pitch_limit_rad, ("pitch_limit_deg", "pitch_limit_deg")),
        ("roll", demand.roll, -travel.roll_limit_rad, travel.roll_limit_rad, ("roll_limit_deg", "roll_limit_deg")),
        ("pitch rod", demand.pitch_rod, travel.stroke_min_m, travel.stroke_max_m, ("stroke_min_mm", "stroke_max_mm")),
        ("roll rod", demand.roll_rod, travel.stroke_min_m, travel.stroke_max_m, ("stroke_min_mm", "stroke_max_mm")),
    ):
        scale, unit = (DEG, "deg") if "deg" in fields[0] else (1e3, "mm")
        for value, end, over, field in ((d.low, low, d.low < low, fields[0]), (d.high, high, d.high > high, fields[1])):
            if over and abs(value - end) > 1e-9:
                beyond.append({"what": name, "field": field, "unit": unit, "value": value * scale, "limit": end * scale})
    return {
        "duration_s": float(demand.t_s[-1]),
        "pitch_rod": _demand(demand.pitch_rod, 1e3, "mm"),
        "roll_rod": _demand(demand.roll_rod, 1e3, "mm"),
        "pitch": _demand(demand.pitch, DEG, "deg"),
        "roll": _demand(demand.roll, DEG, "deg"),
        "azimuth": _demand(demand.azimuth, DEG, "deg"),
        "beyond": beyond,
    }


def motion_lines(result: dict[str, Any]) -> list[str]:
    """Text of ``mechanism motion``."""
    lines = [f"over {result['duration_s']:g} s:", f"{'':<10}{'from':>10}{'to':>10}{'speed':>12}{'acceleration':>16}"]
    for name, key, unit in (
        ("pitch rod", "pitch_rod", "mm"),
        ("roll rod", "roll_rod", "mm"),
        ("pitch", "pitch", "deg"),
        ("roll", "roll", "deg"),
        ("azimuth", "azimuth", "deg"),
    ):
        d = result[key]
        low, high, speed, accel = (number(value, 3) for value in d.values())
        lines.append(f"{name:<10}{low:>10}{high:>10}{speed:>12}{accel:>16}  {unit}, {unit}/s, {unit}/s²")
    for b in result["beyond"]:
        lines.append(f"{b['what']}: {number(b['value'], 3)} {b['unit']} is beyond {b['field']} = {number(b['limit'])}")
    return lines
