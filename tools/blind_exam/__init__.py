"""The blind exam of `spsp-ctrl diagnose`: hidden effects on a truth plant of its own, answers sealed before the run, scored after it.

Nothing here imports the program's plant: the physics, its integrator and its friction are written apart, so that a workflow that only
inverts its own simulation does not pass.
"""
