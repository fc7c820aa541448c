"""Names of the errors of a mechanism, as tolerance files and commands use them. What each does is ``mechanism.error_model``.

A1, A2 are the hinges of the pitch and the roll leg on the moving platform, B1, B2 those on the static platform. x, y, z are the axes of the
part at level (x towards the pitch leg, y towards the roll leg, z up). Hinges are measured with the platform at level.
"""

from __future__ import annotations

from typing import NamedTuple


class ErrorSource(NamedTuple):
    """SI unit and meaning of one error."""

    si_unit: str
    text: str


ELEMENTARY: dict[str, ErrorSource] = {
    "dl1": ErrorSource("m", "length of the pitch rod"),
    "dl2": ErrorSource("m", "length of the roll rod"),
    "a1_x": ErrorSource("m", "A1 outwards: upper radius of the pitch leg"),
    "a1_y": ErrorSource("m", "A1 sideways"),
    "a1_z": ErrorSource("m", "A1 upwards"),
    "b1_x": ErrorSource("m", "B1 outwards: lower radius of the pitch leg"),
    "b1_y": ErrorSource("m", "B1 sideways"),
    "b1_z": ErrorSource("m", "B1 upwards"),
    "a2_x": ErrorSource("m", "A2 sideways"),
    "a2_y": ErrorSource("m", "A2 outwards: upper radius of the roll leg"),
    "a2_z": ErrorSource("m", "A2 upwards"),
    "b2_x": ErrorSource("m", "B2 sideways"),
    "b2_y": ErrorSource("m", "B2 outwards: lower radius of the roll leg"),
    "b2_z": ErrorSource("m", "B2 upwards"),
    "u_x": ErrorSource("m", "U joint along x"),
    "u_y": ErrorSource("m", "U joint along y"),
    "u_z": ErrorSource("m", "U joint upwards: column height"),
    "u_offset": ErrorSource("m", "platform axis of the U joint above its column axis"),
    "u_square": ErrorSource("rad", "the two axes of the U joint out of square"),
    "u_yaw": ErrorSource("rad", "whole U joint turned about z on the column"),
    "u_tilt": ErrorSource("rad", "column axis of the U joint out of horizontal"),
}
COMBINED: dict[str, ErrorSource] = {
    "dr": ErrorSource("m", "all four hinge radii together (the paper's dr)"),
    "dh": ErrorSource("m", "column height (the paper's dh)"),
    "upper_radius": ErrorSource("m", "both hinge radii of the moving platform"),
    "lower_radius": ErrorSource("m", "both hinge radii of the static platform"),
    "screw_temperature": ErrorSource("K", "both screws warmer, Eq (13)"),
    "column_temperature": ErrorSource("K", "column warmer"),
    "frame_temperature": ErrorSource("K", "both platforms warmer"),
    "temperature": ErrorSource("K", "everything warmer by the same"),
}
ERROR_SOURCES = {**ELEMENTARY, **COMBINED}
PAPER = ("dl1", "dl2", "dr", "dh")
"""The four of the paper, in the order of its Eq (11)."""
