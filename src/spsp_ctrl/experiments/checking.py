"""What a rig file and a scenario file must fulfil beyond their form, before anything moves: each problem with its line."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from math import radians

from spsp_ctrl.config.loader import ConfigError, ConfigProblem, Loaded
from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.config.scenario import Scenario
from spsp_ctrl.experiments import summary
from spsp_ctrl.mechanism.kinematics import rod_lengths

REACH_MM = 0.1
"""A stroke that ends this much before the stated tilt limit still counts as reaching it (0.06 deg): both are rounded in practice."""


def check_rig(loaded: Loaded[RigConfig]) -> None:
    """The stroke reaches the tilt limits. Raises ``ConfigError``."""
    section = "mechanism"
    g = loaded.model.mechanism
    lengths = (1e3 * g.height_m, 1e3 * g.moving_radius_m, 1e3 * g.static_radius_m)
    level = rod_lengths(0.0, 0.0, *lengths)[0]
    problems = []
    for key, sign, stroke in (("stroke_min_mm", 1.0, g.stroke_min_mm), ("stroke_max_mm", -1.0, g.stroke_max_mm)):
        limits = (g.pitch_limit_deg, g.roll_limit_deg)
        travel = [
            rod_lengths(radians(sign * g.pitch_limit_deg), 0.0, *lengths)[0] - level,
            rod_lengths(0.0, radians(sign * g.roll_limit_deg), *lengths)[1] - level,
        ]
        for axis, limit, needed in zip(("pitch", "roll"), limits, travel, strict=True):
            if abs(stroke) + REACH_MM < abs(needed):
                line, column = loaded.locate((section, key))
                text = (
                    f"{section}.{key} = {stroke:g} does not reach {axis}_limit_deg = {sign * limit:+g}, which needs {needed:.2f} mm; "
                    f"change the stroke or the limit"
                )
                problems.append(ConfigProblem(loaded.path, line, column, text))
    if problems:
        raise ConfigError(problems)


def check_scenario(loaded: Loaded[Scenario], more_figures: Sequence[str] = ()) -> None:
    """Acceptance rows name figures that a summary can hold (or an experiment adds: ``more_figures``). Raises ``ConfigError``."""
    known = [*summary.names(), *more_figures]
    problems = []
    for i, row in enumerate(loaded.model.acceptance):
        if row.value not in known:
            near = difflib.get_close_matches(row.value, known, n=1, cutoff=0.4)
            line, column = loaded.locate(("acceptance", i, "value"))
            text = f"acceptance.{i}.value = {row.value!r}: a run has no such figure" + (f"; did you mean {near[0]!r}?" if near else "")
            problems.append(ConfigProblem(loaded.path, line, column, text))
    if problems:
        raise ConfigError(problems)
