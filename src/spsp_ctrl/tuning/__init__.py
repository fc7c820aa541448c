"""Gains and margins from the model, offline: a linear model of one axis, its loops, their measurement on the running code, and the design."""
