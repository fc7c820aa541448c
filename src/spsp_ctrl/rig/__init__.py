"""The seam: what every rig is to the control loop."""
