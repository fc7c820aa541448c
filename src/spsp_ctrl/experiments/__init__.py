"""Sessions and experiments: a rig, a scenario, a recorded run, and the figures that come out of it."""
