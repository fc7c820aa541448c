"""Strict, typed configuration files."""
