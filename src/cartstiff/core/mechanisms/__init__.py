"""Mechanisms: coordinates to pose, Jacobian and closures; loading them from files."""
