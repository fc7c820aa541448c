"""Device families as the rig uses them: each turns commands into frames or bytes, and these into samples. Plug-ins by entry point."""
