"""Add: the names go into a new model file, with value, deviation, evidence and where they hold. The file that was read stays as it is."""

from __future__ import annotations

from typing import Any

import yaml

from spsp_ctrl.discrepancy.fitting import Fitted
from spsp_ctrl.discrepancy.naming import Named
from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.axis_model import ACTUATOR_KEYS, AXIS_EFFECTS, AXIS_KEYS, BARE_ACTUATOR_KEYS, AxisModel
from spsp_ctrl.plant.effects import BY_NAME
from spsp_ctrl.plant.layout import A
from spsp_ctrl.plant.model import effect_keys


def deviations(fitted: Fitted) -> dict[int, float]:
    """Standard deviation of each parameter that was fitted; of an amplitude and phase from their cosine and sine."""
    from math import hypot

    out: dict[int, float] = {}
    for k, v in enumerate(fitted.variables):
        if not v.part:
            out[v.index] = fitted.sigma(k)
        elif v.part == "cos":
            both = hypot(fitted.sigma(k), fitted.sigma(k + 1)) / 2.0**0.5
            out[v.index] = both
            amplitude = float(fitted.p[v.index])
            out[v.phase] = min(3.2, both / amplitude) if amplitude > 0.0 else 3.2
    return out


def document(model: AxisModel, p: Array, fitted: Fitted, named: list[Named], source: str) -> dict[str, Any]:
    """The new model file as plain data: recalibrated numbers, the effects of the old file at their values now, and the new ones."""
    file = model.file
    raw = file.model_dump(by_alias=True, exclude_none=True, mode="json")
    spread, old = deviations(fitted), model.parameters()
    keys = BARE_ACTUATOR_KEYS if file.bare else ACTUATOR_KEYS
    for section, known in (("actuator", keys), ("axis", AXIS_KEYS)):
        for name, entry in raw[section].items():
            if name == "force_per_command":
                if p[A.torque_constant_nm_a] != old[A.torque_constant_nm_a]:
                    entry["value"] *= float(p[A.torque_constant_nm_a] / old[A.torque_constant_nm_a])
                continue
            _renew(entry, model.index(known[name].name), p, old, spread, known[name].unit, source)
    present = {e["effect"]: e for e in raw.get("effects", [])}
    for entry in raw.get("effects", []):
        for name, q in entry["parameters"].items():
            parameter = effect_keys(BY_NAME[entry["effect"]])[name]
            _renew(q, model.index(parameter.name), p, old, spread, parameter.unit, source)
    for effect in AXIS_EFFECTS:
        for name, parameter in effect_keys(effect).items():
            i = model.index(parameter.name)
            given = present.get(effect.name, {}).get("parameters", {})
            if p[i] != 0.0 and name not in given and p[i] != old[i]:
                entry = present.get(effect.name)
                if entry is None:
                    entry = present[effect.name] = {"effect": effect.name, "parameters": {}}
                    raw.setdefault("effects", []).append(entry)
                quantity: dict[str, Any] = {"value": float(p[i]), "unit": parameter.unit, "source": source}
                if i in spread:
                    quantity["std"] = float(spread[i])
                entry["parameters"][name] = quantity
    return raw


def _renew(entry: dict[str, Any], index: int, p: Array, old: Array, spread: dict[int, float], unit: str, source: str) -> None:
    if p[index] == old[index]:
        return
    entry["value"], entry["unit"], entry["source"] = float(p[index]), unit, source
    entry.pop("std", None)
    if index in spread:
        entry["std"] = float(spread[index])


def text(raw: dict[str, Any], notes: list[str]) -> str:
    """The file with what is known about each name as comments on top."""
    head = "".join(f"# {line}\n" for line in notes)
    return head + yaml.safe_dump(raw, sort_keys=False, allow_unicode=True, width=150)
