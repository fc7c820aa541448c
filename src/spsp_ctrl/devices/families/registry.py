"""Families by name: the built-in ones, then plug-ins by entry point (``spsp_ctrl.drive``, ``.imu``, ``.angle``, ``.stepper``)."""

from __future__ import annotations

from importlib import import_module
from typing import Any

BUILT_IN = {
    "drive": {"cia402": "spsp_ctrl.devices.families.cia402:Cia402Drive", "odrive": "spsp_ctrl.devices.families.odrive:OdriveDrive"},
    "imu": {"mip": "spsp_ctrl.devices.families.mip:MipUnit"},
    "angle": {"cia406": "spsp_ctrl.devices.families.cia406:Cia406Angle"},
    "stepper": {"tmcl": "spsp_ctrl.devices.families.tmcl:TmclStepper"},
}
"""The same names stand as entry points in ``pyproject.toml``; here so that a rig of ours needs no look into the installed packages (40 ms)."""


class UnknownFamily(Exception):
    """No such family; the text says which there are."""


def family(kind: str, name: str) -> Any:
    """The class of a family. Raises ``UnknownFamily``."""
    path = BUILT_IN[kind].get(name)
    if path is not None:
        module, _, attribute = path.partition(":")
        return getattr(import_module(module), attribute)
    from importlib.metadata import entry_points

    found = {point.name: point for point in entry_points(group=f"spsp_ctrl.{kind}")}
    if name not in found:
        raise UnknownFamily(f"no {kind} family {name!r}; installed: {', '.join(sorted({*BUILT_IN[kind], *found}))}")
    return found[name].load()
