"""The stages of a first run: without power, and with a part of what the rig may do."""

from __future__ import annotations

from typing import Any

from spsp_ctrl.config.rig import RigConfig
from spsp_ctrl.messages import Command, Measurement, Truth
from spsp_ctrl.rig.base import Rig, RigIdentity

_new = tuple.__new__


def limited(config: RigConfig, share: float) -> RigConfig:
    """The rig file with speeds, accelerations, currents and align rate times ``share`` (0 to 1)."""
    limits = config.limits
    names = ("rod_speed_mm_s", "rod_accel_mm_s2", "current_a", "azimuth_rate_deg_s", "azimuth_accel_deg_s2", "align_rate_deg_s")
    return config.model_copy(update={"limits": limits.model_copy(update={name: share * getattr(limits, name) for name in names})})


def unpowered(config: RigConfig) -> RigConfig:
    """The rig file that does not arm by itself."""
    return config.model_copy(update={"supervisor": config.supervisor.model_copy(update={"auto_arm": False})})


class NeverEnabled:
    """A rig whose commands are all "off": ``--no-enable``. Everything is read, judged, computed and recorded as usual."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def __getattr__(self, name: str) -> Any:
        """Whatever else the rig has (raw frames, notes of its lines)."""
        return getattr(self._rig, name)

    def open(self) -> RigIdentity:
        """See ``Rig``."""
        return self._rig.open()

    def read(self, now_ns: int) -> Measurement:
        """See ``Rig``."""
        return self._rig.read(now_ns)

    def write(self, command: Command, now_ns: int) -> Command:
        """See ``Rig``. What is returned, and so recorded, is what was sent."""
        off: Command = _new(Command, (command.stamp_ns, command.seq, False, 0.0, 0.0, 0.0, 0.0, 0.0))
        return self._rig.write(off, now_ns)

    def stop(self) -> None:
        """See ``Rig``."""
        self._rig.stop()

    def close(self) -> None:
        """See ``Rig``."""
        self._rig.close()

    def truth(self) -> Truth | None:
        """See ``Rig``."""
        return self._rig.truth()
