"""Where the table of units used to be; it is :mod:`spsp_ctrl.config.units` now, since tolerance files need it too."""

from spsp_ctrl.config.units import SUFFIX, UNITS, spellings

__all__ = ["SUFFIX", "UNITS", "spellings"]
