"""The control law as pure steps: ``(state, inputs, dt) -> (outputs, state)``. No clock, no I/O, no array maths; never imports a rig or a plant."""
