"""Add, for a platform: the names go into a new model file, each at its leg. The file that was read stays as it is."""

from __future__ import annotations

from typing import Any

import numpy as np

from spsp_ctrl.plant.arrays import Array
from spsp_ctrl.plant.effects import EFFECTS, Parameter
from spsp_ctrl.plant.layout import AXES, AXIS_BASE, GLOBAL_BASE, N_AXIS_PARAMETERS, A, G
from spsp_ctrl.plant.model import PlantModel, effect_keys, key


def writable(p: Array) -> Array:
    """Parameters as a file may hold them: cogging of negative sign is a ripple of the same order half a period on."""
    q = p.copy()
    for axis in range(2):
        b = axis * N_AXIS_PARAMETERS
        if q[b + A.cogging_nm] < 0.0:
            if q[b + A.ripple_nm] == 0.0:
                q[b + A.ripple_nm], q[b + A.ripple_order] = -q[b + A.cogging_nm], q[b + A.cogging_order]
                q[b + A.ripple_phase_rad] = np.pi
            q[b + A.cogging_nm] = 0.0
    return q


def platform_document(model: PlantModel, p: Array, spread: dict[int, float], source: str) -> dict[str, Any]:
    """The new model file as plain data: what changed at its value now, what did not as it stood."""
    raw: dict[str, Any] = model.file.model_dump(by_alias=True, exclude_none=True, mode="json")
    old = model.parameters()

    def quantity(parameter: Parameter, i: int) -> dict[str, Any]:
        entry: dict[str, Any] = {"value": float(p[i]), "unit": parameter.unit, "source": source}
        if i in spread:
            entry["std"] = float(spread[i])
        return entry

    for k, axis in enumerate(AXES):
        for parameter in AXIS_BASE:
            i = int(getattr(A, parameter.name)) + k * N_AXIS_PARAMETERS
            if p[i] != old[i]:
                raw.setdefault(f"{axis}_actuator", {})[key(parameter)] = quantity(parameter, i)
    for parameter in GLOBAL_BASE:
        i = int(getattr(G, parameter.name))
        if p[i] != old[i]:
            raw["rig"][key(parameter)] = quantity(parameter, i)
    for effect in EFFECTS:
        keys = effect_keys(effect)
        if effect.per_axis:
            at = [{n: int(getattr(A, q.name)) + k * N_AXIS_PARAMETERS for n, q in keys.items()} for k in range(2)]
        else:
            at = [{n: int(getattr(G, q.name)) for n, q in keys.items()}] if effect.kind != "axis" else []
        if not any(p[i] != old[i] for place in at for i in place.values()):
            continue
        given = [e for e in raw["effects"] if e["effect"] == effect.name]
        entries = []
        for k, place in enumerate(at):
            known: dict[str, Any] = {}
            for e in given:
                if not effect.per_axis or e.get("axis", "both") in ("both", AXES[k]):
                    known |= e["parameters"]
            parameters = {n: quantity(keys[n], i) if p[i] != old[i] else known.get(n) for n, i in place.items() if n in known or p[i] != old[i]}
            if parameters:
                entry: dict[str, Any] = {"effect": effect.name}
                if effect.per_axis:
                    entry["axis"] = AXES[k]
                entries.append(entry | {"parameters": parameters})
        where = raw["effects"].index(given[0]) if given else len(raw["effects"])
        rest = [e for e in raw["effects"] if e["effect"] != effect.name]
        raw["effects"] = [*rest[:where], *entries, *rest[where:]]
    return raw
