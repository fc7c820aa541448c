"""``python -m spsp_ctrl.cli``: the same as ``spsp-ctrl``."""

from spsp_ctrl.cli import main

main()
