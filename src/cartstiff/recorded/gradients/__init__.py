"""Exact derivatives of stiffness by the numbers of a mechanism."""
