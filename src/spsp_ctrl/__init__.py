"""Real-time stabilisation controller for a 3-DoF series-parallel stabilised platform."""

__version__ = "0.1.0"
