"""The virtual rig: model file, stages, kernel, swing table. Never imports the control law."""
