"""Mutated frames and byte streams into every decoder and every simulated device: ``python -m tools.fuzz --shots 1000000``."""
