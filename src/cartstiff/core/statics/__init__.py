"""Equilibrium under load, its stability, load-deflection curves,
compensation along a path.
"""
