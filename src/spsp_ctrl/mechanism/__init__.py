"""The mechanism as pure functions: frames, kinematics, profiles. No state, no I/O."""
