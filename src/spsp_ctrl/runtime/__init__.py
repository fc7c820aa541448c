"""The loop: one readable cycle, its clocks, its real-time settings, and the session around it."""
